"""The cheapest clearances of a loaded four-bar's three joints that keep its rocker's tip within 0.5 mm of its place:
`python -m optimize.allocate_four_bar`. Solvers with and without gradients, and a certificate.
"""

import numpy as np

import clearance_jax as cj
from clearance_jax.design import ToleranceProblem
from experiments.common import SCENES
from experiments.publish import command
from optimize.common import Allocation, allocate, cheapest
from optimize.optax_methods import AUGMENTED_LAGRANGIAN

COSTS = {"crankpin.radial_clearance": 2e-4, "pivot.radial_clearance": 1e-4, "knuckle.radial_clearance": 1e-4}
"""Cost times clearance [m]."""
BOUND = 5e-4
REVOLUTION = 2 * np.pi / 20.0
METHODS = ("slsqp", AUGMENTED_LAGRANGIAN, "cobyqa")


def problem(quick: bool = False) -> ToleranceProblem:
    end = 0.01 * REVOLUTION if quick else REVOLUTION
    return cheapest(cj.load(SCENES / "four_bar_loaded.toml"), end, COSTS, "tip", BOUND)


def main(quick: bool = False) -> Allocation:
    return allocate("allocate_four_bar", problem(quick), METHODS[:1] if quick else METHODS, quick)


if __name__ == "__main__":
    command(main, __doc__, "a hundredth of a revolution, one solver")
