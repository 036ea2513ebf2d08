"""The cheapest clearances of a planar robot arm that keep its tool within 0.2 mm of where it should be, with a payload,
along one trajectory: `python -m optimize.allocate_planar_arm`. Three joints, all with clearance, on an ideal base; and
five joints, to count how many solves it takes with gradients and without.
"""

import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.design import ToleranceProblem
from experiments.common import output, table
from experiments.publish import command
from optimize.cma_method import CMA_ES
from optimize.common import Allocation, allocate, cheapest
from optimize.optax_methods import AUGMENTED_LAGRANGIAN

BOUND = 2e-4
END = 1.0
FROM, TO = (0.6, -0.9, 0.7, -0.5, 0.4), (1.2, -0.4, -0.2, 0.3, -0.2)
"""Joint angles before and after the move [rad]."""
METHODS = ("slsqp", AUGMENTED_LAGRANGIAN, "cobyqa")


def arm(joints: int) -> cj.Mechanism:
    """Links that get shorter and lighter, 2 kg at the end, gravity; every joint is driven and has play."""
    lengths, masses = 0.4 * 0.75 ** np.arange(joints), 6.0 * 0.6 ** np.arange(joints)
    bodies, chain, parent, at = [], [], "ground", 0.0
    for i, (length, mass) in enumerate(zip(lengths.tolist(), masses.tolist(), strict=True)):
        play = cj.RevoluteClearance(5e-5, 0.01, laws.HuntCrossley(4e9, 20.0), laws.TanhCoulomb(0.1, 0.01))
        drive = cj.drives.Step5Sum([0.1], [0.9], [TO[i] - FROM[i]], FROM[i])
        bodies.append(cj.Body(f"link{i + 1}", mass, mass * length**2 / 12, cj.Position(length / 2)))
        joint = cj.Revolute(
            f"joint{i + 1}", parent, f"link{i + 1}", at_parent=cj.Position(at), motion=cj.Motion(drive), clearance=play
        )
        chain.append(joint)
        parent, at = f"link{i + 1}", length
    return cj.Mechanism(
        bodies=(*bodies, cj.Body("payload", 2.0, 2e-3)),
        joints=(*chain, cj.Fixed("gripper", parent, "payload", at_parent=cj.Position(at))),
        points=(cj.Point("tool", "payload"),),
        gravity=cj.Gravity(y=-9.81),
        name=f"planar {joints}R arm",
    )


def problem(joints: int = 3, quick: bool = False) -> ToleranceProblem:
    names = [f"joint{i + 1}.radial_clearance" for i in range(joints)]
    # Larger joints cost more.
    costs = {name: 1e-4 * 1.5 ** (joints - 1 - i) for i, name in enumerate(names)}
    return cheapest(arm(joints), 0.2 * END if quick else END, costs, "tool", BOUND, least=5e-6)


def count_solves(joints: int) -> dict[str, int]:
    """Solves that it takes each way to come within a thousandth of the best cost, limits held."""
    designs = {"slsqp": problem(joints).solve(), "cma-es": problem(joints).solve(CMA_ES)}
    best = min(found.objective for found in designs.values())
    needed = {}
    for method, found in designs.items():
        near = (i for i, p in enumerate(found.program.history) if p.feasible and p.objective <= 1.001 * best)
        needed[method] = 1 + next(near, len(found.program.history))
    table(
        ("method", "cost", "solves until within a thousandth", "solves"),
        [(m, f"{d.objective:.6f}", needed[m], len(d.program.history)) for m, d in designs.items()],
        output(f"allocate_planar_arm_{joints}.md"),
    )
    return needed


def main(quick: bool = False) -> Allocation:
    found = allocate("allocate_planar_arm", problem(quick=quick), METHODS[:1] if quick else METHODS, quick)
    if not quick:
        count_solves(5)
    return found


if __name__ == "__main__":
    command(main, __doc__, "three joints, a fifth of the motion, one solver")
