"""The search for the cheapest tolerance classes that hold every limit, from the continuous design."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from clearance_jax.ask.place import SolvePlace
from clearance_jax.design.answer import Design
from clearance_jax.design.branch_and_bound import BoundedOptimum, BranchAndBound
from clearance_jax.design.classes import ChosenClasses, ToleranceClass, least_ends
from clearance_jax.design.evaluate import FEW, simulations_of
from clearance_jax.design.program import SLACK, Evaluation, Program
from clearance_jax.design.run import run
from clearance_jax.design.specification import scenarios_of


def choose_classes(
    design: Design, classes: Mapping[str, tuple[ToleranceClass, ...]], place: SolvePlace, **options: Any
) -> Design:
    """The cheapest combination of `classes` that holds every limit, by branch and bound from a continuous design.

    A combination holds if the limits of the problem hold with every clearance at the greatest of its class, and those
    of parts as designed hold with every clearance at its least.

    **Arguments:** `classes`: by variable, the tightest first; `options`: of the design's method.
    """
    program, places = design.program, {name: i for i, name in enumerate(design.program.names)}
    lists = {places[name]: np.array([entry.greatest for entry in listed]) for name, listed in classes.items()}
    before = program.solves
    ends = _Least(design, classes, place)

    def relax(box: Program, start: np.ndarray) -> str:
        return run(box, design.method, start, **options)

    costs, laws = None, design.specification.costs
    if len(lists) == len(program.names):
        costs = {i: np.array([float(laws[i](value)) for value in values]) for i, values in lists.items()}
    # Without a tolerance the resolution is that to which the method meets limits.
    how = {"gradients": design.method.gradients, "resolution": options.get("tolerance", design.method.slack)}
    outcome = BranchAndBound(program, lists, relax, ends.hold, costs, **how).search(design.evaluation.x)
    chosen = {} if outcome.best is None else _names(program, classes, outcome.best.x)
    result = ChosenClasses(
        chosen,
        np.nan if outcome.best is None else outcome.best.objective,
        outcome.bound,
        np.nan if outcome.relaxed is None else outcome.relaxed.objective,
        outcome.nodes,
        program.solves - before + ends.solves,
        int(np.prod([len(listed) for listed in classes.values()])),
        outcome.doubts,
    )
    return _design(design, result, outcome, lists)


def _names(program: Program, classes: Mapping[str, tuple[ToleranceClass, ...]], x: np.ndarray):
    worth = dict(zip(program.names, x, strict=True))
    return {n: min(listed, key=lambda entry: abs(entry.greatest - worth[n])) for n, listed in classes.items()}


def _design(design: Design, result: ChosenClasses, outcome: BoundedOptimum, lists: Mapping[int, np.ndarray]) -> Design:
    """The design with the chosen classes; if no combination holds, the tightest one with a note."""
    stopped = {"stop_reason": design.stop_reason or outcome.stop_reason, "classes": result}
    if outcome.best is not None:
        return dataclasses.replace(design, evaluation=outcome.best, **stopped)
    if outcome.stop_reason:
        return without_classes(design, result, outcome.stop_reason)
    x = design.evaluation.x.copy()
    for i, values in lists.items():
        x[i] = values[0]
    tightest = design.program.at(x, design.method.gradients)
    note = f"{design.note}; " * bool(design.note) + _refusal(design, tightest, lists, outcome.doubts)
    return dataclasses.replace(design, evaluation=tightest, **{**stopped, "note": note})


def without_classes(design: Design, result: ChosenClasses, stop_reason: str) -> Design:
    """The continuous design, if the search was stopped before it had found a feasible combination."""
    note = "stopped before any class was chosen: the clearances are those of a continuous design"
    note = "; ".join(text for text in (design.note, note) if text)
    return dataclasses.replace(design, stop_reason=design.stop_reason or stop_reason, classes=result, note=note)


def _refusal(design: Design, tightest: Evaluation, lists: Mapping[int, np.ndarray], doubts: tuple[str, ...]) -> str:
    """A note on why no combination of classes holds, and what would help."""
    program, cost = design.program, f"{design.objective:.6g} {design.specification.cost_unit}"
    none = "no combination of the classes holds every limit"
    if doubts:
        none = "no combination of the classes was found that holds every limit (searches failed, so there may be one)"
    if tightest.feasible:
        return (
            f"{none}. With all clearances at their least the tightest ones do not hold. Choose classes with larger "
            "least clearances, or add some"
        )
    text = f"{none}: with the tightest of each, "
    text += f"{program.worst_violation(tightest)}. Without classes the design costs {cost}. "
    if tightest.jacobian is None or not np.isfinite(tightest.worst):
        return text + "Add tighter classes, or loosen the bound"
    slopes = tightest.jacobian[int(np.argmax(tightest.limits))] * tightest.x
    name = program.names[max(lists, key=lambda i: slopes[i])]
    return text + f"A tighter class of `{name}` helps most, or a looser bound"


class _Least:
    """Checks combinations with every clearance at the least of its class."""

    def __init__(self, design: Design, classes: Mapping[str, tuple[ToleranceClass, ...]], place: SolvePlace):
        specification = design.specification.as_designed()
        self._program, self._classes = design.program, classes
        self._simulations, self._scenarios = simulations_of(specification, place=place), scenarios_of(specification)
        self._exact = design.program.gradients > 0 and len(specification.variables) <= FEW
        self.solves = 0

    def hold(self, x: np.ndarray) -> bool:
        """Whether the combination with the greatest clearances `x` (n,) holds with its least ones."""
        least = least_ends(self._program.names, x, _names(self._program, self._classes, x))
        self.solves += 1
        return float(np.max(self._simulations.worst(least, self._scenarios, self._exact))) <= SLACK
