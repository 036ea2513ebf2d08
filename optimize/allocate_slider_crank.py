"""The cheapest clearances of a loaded slider-crank's two pins that keep the piston within 0.2 mm of where it should be:
`python -m optimize.allocate_slider_crank`. Solvers with and without gradients, and a certificate.
"""

import numpy as np

import clearance_jax as cj
from clearance_jax.design import ToleranceProblem
from experiments.common import SCENES
from experiments.publish import command
from optimize.cma_method import CMA_ES
from optimize.common import Allocation, allocate, cheapest
from optimize.optax_methods import AUGMENTED_LAGRANGIAN

COSTS = {"crankpin.radial_clearance": 2e-4, "wrist.radial_clearance": 1e-4}
"""Cost times clearance [m]: the crankpin is dearer to make."""
BOUND = 2e-4
REVOLUTION = 2 * np.pi / 60.0
METHODS = ("slsqp", AUGMENTED_LAGRANGIAN, "cobyqa", CMA_ES)


def problem(quick: bool = False) -> ToleranceProblem:
    end = 0.1 * REVOLUTION if quick else REVOLUTION
    return cheapest(cj.load(SCENES / "slider_crank_loaded.toml"), end, COSTS, "piston", BOUND)


def main(quick: bool = False) -> Allocation:
    return allocate("allocate_slider_crank", problem(quick), METHODS[:1] if quick else METHODS, quick)


if __name__ == "__main__":
    command(main, __doc__, "a tenth of a revolution, one solver")
