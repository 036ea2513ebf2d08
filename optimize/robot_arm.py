"""The cheapest radial and axial clearances of all six joints of an arm from a URDF file that keep its tool within 1 mm,
along two trajectories and with two payloads: `python -m optimize.robot_arm`.

12 variables, 4 conditions. The search goes by quasi-static poses and is corrected by the dynamics (`fidelity="auto"`);
a certificate by another solver follows, and what each joint adds to the error. The same problem as
`clearance run optimize/studies/robot_arm.toml`. `--quick`: by poses alone, one trajectory and one payload, over a tenth
of the motion.
"""

import time
from pathlib import Path

from clearance_jax.design import Design, Evaluation, ToleranceProblem
from clearance_jax.io.study import Study, load_study
from clearance_jax.solve.settings import QUASI_STATIC
from experiments.common import output, table
from experiments.publish import command, say

STUDY = Path(__file__).parent / "studies" / "robot_arm.toml"


def small(problem: ToleranceProblem) -> ToleranceProblem:
    """The first of its conditions, over a tenth of the motion, judged by poses."""
    asked = problem.specification
    name, values = next(iter(asked.conditions.items()))
    costs = dict(zip(asked.variables, asked.costs, strict=True))
    options = {**asked.options, "fidelity": QUASI_STATIC}
    limits, conditions, t1 = asked.limits, {name: values}, 0.1 * asked.t1
    return ToleranceProblem(asked.mechanism, t1, asked.variables, limits, costs, conditions, **options)


def clearances(design: Design) -> None:
    """What every joint may have, as a table."""
    joints = sorted({name.split(".")[0] for name in design.clearances})
    kinds = "radial_clearance", "axial_clearance"
    rows = [(joint, *(f"{1e6 * design.clearances[f'{joint}.{kind}']:.2f}" for kind in kinds)) for joint in joints]
    table(("joint", "radial clearance [um]", "axial clearance [um]"), rows, output("robot_arm.md"))


def main(quick: bool = False) -> Design:
    study: Study = load_study(STUDY)
    asked = study.design
    assert asked is not None
    problem = small(asked.problem) if quick else asked.problem
    begin = time.perf_counter()

    def seen(evaluation: Evaluation) -> None:
        print(f"{time.perf_counter() - begin:.0f} s: cost {evaluation.objective:.4g}", flush=True)

    design = problem.solve(progress=seen, **asked.solve)
    say(design)
    clearances(design)
    if not quick:
        say(f"Answer after {time.perf_counter() - begin:.0f} s, compiling included.")
        say(design.verify(**asked.verify))
        say(f"Certificate after {time.perf_counter() - begin:.0f} s.")
    return design


if __name__ == "__main__":
    command(main, __doc__, "poses alone, one condition, a tenth of the motion")
