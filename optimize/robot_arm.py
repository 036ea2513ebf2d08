"""The cheapest radial and axial clearances of all six joints of an arm from a URDF file that keep its tool within 1 mm,
along two trajectories and with two payloads: `python -m optimize.robot_arm`.

12 variables, 4 conditions. The search goes by quasi-static poses. The dynamics judge what it finds, with a settled
start, and once more at a tenth of the tolerance. Where they exceed the bound, the poses search again with a bound that
is smaller by as much, until the dynamics hold it.

`clearance run optimize/studies/robot_arm.toml` searches once, by poses. `--quick`: one trajectory and one payload, over
a tenth of the motion, without the dynamics.
"""

import threading
import time
from pathlib import Path

import numpy as np

from clearance_jax.design import Design, Evaluation, ToleranceProblem
from clearance_jax.design.asked.specification import Limit, scenarios_of
from clearance_jax.design.search.evaluate import simulations_of
from clearance_jax.io.study.study import Study, load_study
from clearance_jax.solve.settings import DYNAMICS, QUASI_STATIC
from experiments.common import output, table
from experiments.publish import command, say

STUDY = Path(__file__).parent / "studies" / "robot_arm.toml"
ROUNDS = 4
"""Searches at most."""
MARGIN, LARGEST = 0.97, 2.0
"""Part of its bound at which the next search should end: a change of the last digit moves the largest error by 2 %. The
bound is divided by this factor at most (a motion that fails has no error).
"""


def changed(problem: ToleranceProblem, bound: float, quick: bool = False) -> ToleranceProblem:
    """The problem with another bound; `quick`: the first of its conditions alone, over a tenth of the motion."""
    asked = problem.specification
    costs = dict(zip(asked.variables, asked.costs, strict=True))
    (limit,) = asked.limits
    conditions = dict(list(asked.conditions.items())[: 1 if quick else None])
    t1, limits = (0.1 if quick else 1.0) * asked.t1, [Limit(limit.metric, bound, limit.name)]
    how = {**asked.options, "fidelity": QUASI_STATIC}
    return ToleranceProblem(asked.mechanism, t1, asked.variables, limits, costs, conditions, **how)


def dynamic_errors(problem: ToleranceProblem, design: Design, rtol: float | None = None):
    """The largest errors of the tool by the dynamics, over the bound, in each condition."""
    judge = problem.specification.judged_by(DYNAMICS)
    return 1 + simulations_of(judge, rtol).worst(design.evaluation.x, scenarios_of(judge))


def compile_judge(problem: ToleranceProblem) -> None:
    """Judge some clearances in one condition."""
    judge = problem.specification.judged_by(DYNAMICS)
    lower, upper = np.array(list(judge.variables.values())).T
    simulations_of(judge).worst(np.sqrt(lower * upper), scenarios_of(judge)[:1])


def clearances(design: Design) -> None:
    """What every joint may have, as a table."""
    joints = sorted({name.split(".")[0] for name in design.clearances})
    kinds = "radial_clearance", "axial_clearance"
    rows = [(joint, *(f"{1e6 * design.clearances[f'{joint}.{kind}']:.2f}" for kind in kinds)) for joint in joints]
    table(("joint", "radial clearance [um]", "axial clearance [um]"), rows, output("robot_arm.md"))


def main(quick: bool = False) -> Design:
    study: Study = load_study(STUDY)
    assert study.design is not None
    asked = study.design.problem
    (limit,), names = asked.specification.limits, list(asked.specification.conditions)
    begin, bound, rows, rounds = time.perf_counter(), float(limit.bound), [], 0
    options, judge = study.design.solve, threading.Thread(target=compile_judge, args=(asked,), daemon=True)

    def note(by: str, found: np.ndarray) -> None:
        took = time.perf_counter() - begin
        numbers = (f"{one:.4f}" for one in found)
        rows.append((f"{1e3 * bound:.4f}", f"{design.objective:.4f}", by, *numbers, f"{took:.0f}"))

    def seen(evaluation: Evaluation) -> None:
        print(f"{time.perf_counter() - begin:.0f} s: cost {evaluation.objective:.4g}", flush=True)
        # The program of the judge is compiled beside the first search, once that has its own.
        if not quick and judge.ident is None:
            judge.start()

    tolerance = asked.specification.rtol
    while True:
        design = changed(asked, bound, quick).solve(progress=seen, **options)
        if quick:
            break
        found = dynamic_errors(asked, design)
        note(f"{asked.specification.solver}, rtol {tolerance:.0e}", found)
        if max(found) <= 1:
            found = dynamic_errors(asked, design, 0.1 * tolerance)
            note(f"{asked.specification.solver}, rtol {0.1 * tolerance:.0e}", found)
        rounds += 1
        if max(found) <= 1 or rounds == ROUNDS:
            break
        bound *= MARGIN / min(max(found), LARGEST)
        options = options | {"start": dict(design.clearances), "starts": 1}
    say(design)
    clearances(design)
    if rows:
        say("By the dynamics: the largest error of the tool over its bound of 1 mm, in each condition.")
        head = ("bound of the poses [mm]", "cost [EUR]", "dynamics by", *names, "after [s], with compiling")
        table(head, rows, output("robot_arm_dynamics.md"))
    return design


if __name__ == "__main__":
    command(main, __doc__, "poses alone, one condition, a tenth of the motion")
