"""The search for a design: choice of method, starts, classes, continuation of smoothed laws, explanation of failure."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.trust import gradient_report
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import NONE_CHOSEN, Candidates, classes_of, priced
from clearance_jax.design.asked.formulation import formulate, objective_of, unposed
from clearance_jax.design.asked.manufacture import Neighbours
from clearance_jax.design.asked.specification import AUTO as BOTH
from clearance_jax.design.asked.specification import Specification
from clearance_jax.design.search.class_search import choose_classes, without_classes
from clearance_jax.design.search.infeasible import unreachable, why_infeasible
from clearance_jax.design.search.methods import AUTO, METHODS, Method, method_of
from clearance_jax.design.search.model_management import MATCHED, MATCHED_VALUES
from clearance_jax.design.search.program import BudgetSpent, Evaluation, Program
from clearance_jax.design.search.run import INTERRUPTED, SPENT, USELESS, run, stopping, trade
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.variants import change_each_play
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import DYNAMICS

# Methods whose tolerance depends on that of the solves.
TOLERANT = {"slsqp", MATCHED.name, MATCHED_VALUES.name}


class SearchOptions(NamedTuple):
    """The arguments of `ToleranceProblem.solve` that each search has; `place`: where simulations are solved."""

    method: str | Method
    start: Mapping[str, float] | None
    starts: int
    seed: int
    record: str | Path | None
    most: int
    progress: Callable[[Evaluation], None] | None
    place: Any
    classes: Candidates | None
    diameters: Mapping[str, float] | None

    def formulate(self, specification: Specification, **changes: Any) -> Program:
        """The program of a problem, with the options that it needs."""
        options = {"record": self.record, "most": self.most, "progress": self.progress}
        return formulate(specification, place=self.place, **(options | changes))


def search(specification: Specification, how: SearchOptions) -> Design:
    """Search for the best design."""
    listed = None if how.classes is None else classes_of(specification, how.classes, how.diameters)
    specification = specification if listed is None else priced(specification, listed)
    design = _continuous(specification, how)
    if listed is None or not design.feasible:
        return design
    if design.stop_reason in (INTERRUPTED, SPENT):
        return without_classes(design, NONE_CHOSEN, design.stop_reason)
    return choose_classes(design, listed, how.place, **_options(specification, design.method))


def _options(specification: Specification, method: Method) -> dict[str, Any]:
    """The options of a method: a tolerance that is not finer than the solves."""
    return {"tolerance": 10 * specification.rtol} if method.name in TOLERANT else {}


def _continuous(specification: Specification, how: SearchOptions) -> Design:
    """Search for the best design with continuous variables."""
    method = how.method if how.method == AUTO else method_of(how.method)
    note = ""
    if specification.fidelity == BOTH:
        if method not in (AUTO, METHODS["slsqp"]):
            raise ClearanceError('`fidelity = "auto"` has a method of its own: leave `method` out.')
        if why := unposed(specification):
            specification, note = specification.judged_by(DYNAMICS), f"by the dynamics alone: {why}"
    program = how.formulate(specification)
    x = np.sqrt(program.lower * program.upper)
    if how.start is not None:
        start = np.array([float(how.start[name]) for name in specification.variables])
        x = start if len(specification.names) == len(start) else start.min(keepdims=True)
    if program.cheap is not None:
        return _managed(specification, program, x, how)
    if program.best is not None:
        x = program.best.x
    if method == AUTO:
        note = _distrust(specification, x)
        method = "cobyqa" if note else "slsqp"
    method = method_of(method)
    if method.gradients:
        _check_derivatives(specification, x)
    if reason := _first(program, specification, x, method.gradients):
        return _design(specification, program, method, reason, note)
    options = _options(specification, method)
    stop_reason = _runs(program, method, x, how, **options)
    if not specification.manufacture.is_sampled:
        cost = functools.partial(objective_of, specification)
        stop_reason = trade(program, method, cost, stop_reason, **options)  # go on from a cheaper one beside the best
    return _explained(_design(specification, program, method, stop_reason, note))


def _explained(design: Design) -> Design:
    """The design, with a note on why no design holds every limit if the search has ended so."""
    if design.feasible or design.stop_reason in (INTERRUPTED, SPENT):
        return design
    try:
        why = why_infeasible(design.specification, design.program)
    except (KeyboardInterrupt, BudgetSpent):
        return design
    # The explanation may have evaluated the smallest clearances for the first time.
    point = design.program.best or design.program.nearest or design.evaluation
    return design.with_note("" if point.feasible else why, evaluation=point)


def _runs(program: Program, method: Method, x: np.ndarray, how: SearchOptions, **options: Any) -> str:
    """Run from a point and from random ones; returns why the last run stopped early."""
    stop_reason, rng = run(program, method, x, **options), np.random.default_rng(how.seed)
    for _ in range(how.starts - 1):
        # Other starts are tried after a failed run, but not after an interruption.
        if stop_reason not in (INTERRUPTED, SPENT):
            other = np.exp(rng.uniform(np.log(program.lower), np.log(program.upper)))
            stop_reason = run(program, method, other, **options)
    return stop_reason


def _design(specification: Specification, program: Program, method: Method, stop_reason: str, note: str) -> Design:
    point = program.best or program.nearest
    if point is None:
        raise ClearanceError("`most` must be at least 1: no design was evaluated.")
    return Design(specification, program, method, point, stop_reason, note)


def _managed(specification: Specification, program: Program, x: np.ndarray, how: SearchOptions) -> Design:
    """Search by model management of poses and dynamics; by values alone if slopes of the dynamics are useless."""
    tolerance = _options(specification, MATCHED)
    if reason := _first(program, specification, x):
        return _design(specification, program, MATCHED, reason, "")
    stop_reason = _runs(program, MATCHED, x, how, **tolerance)
    if not stop_reason.startswith(USELESS) or stop_reason == SPENT:
        return _explained(_design(specification, program, MATCHED, stop_reason, ""))
    why = stop_reason.removeprefix(USELESS)
    note = f"{why[0].upper()}{why[1:]}. So the search compared values alone, and a better design may exist"
    if not specification.manufacture.is_design:
        stop_reason = _runs(program, MATCHED_VALUES, x, how, **tolerance)
        return _design(specification, program, MATCHED_VALUES, stop_reason, note)
    among, asked = Neighbours(), specification.manufacture
    specification = dataclasses.replace(specification, manufacture=among)
    note += f". Of every limit it takes the largest value of {among.samples} designs within {among.scatter:.0%}"
    note += f" (one more exceeds it with a probability of {1 / (among.samples + 1):.0%})"
    # Evaluations by the first search count towards `most`; the poses that it computed are known.
    wider = how.formulate(specification, most=how.most - program.solves, known=program.points)
    stop_reason = _runs(wider, MATCHED_VALUES, x, how, **tolerance)
    if not wider.history:  # stopped before any design had neighbours: return the best one of the first search
        return _design(dataclasses.replace(specification, manufacture=asked), program, MATCHED, stop_reason, note)
    return _design(specification, wider, MATCHED_VALUES, stop_reason, note)


@stopping
def _first(program: Program, specification: Specification, x: np.ndarray, gradient: bool = True) -> str:
    """Why no design can hold a limit, or what stopped this test, in words; empty: go on."""
    return unreachable(specification, program, x, gradient)


def _check_derivatives(specification: Specification, x: np.ndarray) -> None:
    """Raise `ClearanceError` for a metric without derivatives, before any solve."""
    values = specification.clearances(x)
    for limit in specification.limits:

        def of(c, metric=limit.simulation_metric.base_metric):
            moved = replace(specification.mechanism, {name: c * v for name, v in values.items()})
            return metric(moved, jnp.asarray(specification.t1), **specification.solving)

        try:
            jax.eval_shape(jax.jacfwd(of), jnp.ones(()))
        except ClearanceError as error:
            raise ClearanceError(f"Limit `{limit.title}`: {error} Or choose method='cobyqa'.") from None


def _distrust(specification: Specification, x: np.ndarray) -> str:
    """Why gradients are useless at a point, in words; empty if they are not."""
    names = tuple(specification.variables)
    # Fewer than by default, as there is a report for every limit in every condition.
    few: Any = {"probes": 16, "samples": max(16, len(names) + 3), "on_untrusted": "ignore"}
    options = few | specification.options
    for name, values in specification.conditions.items():
        moved = replace(specification.move(specification.mechanism, values), specification.clearances(x))
        for limit in specification.limits:
            try:
                report = gradient_report(moved, limit.metric.base_metric, names, specification.t1, **options)
            except (ClearanceError, RuntimeError) as error:
                return f"There are no gradients to trust ({name}, {limit.title}): {error}"
            if not report.trusted:
                return f"Gradients are not to be trusted ({name}, {limit.title}): {report.reasons[0]}"
    return ""


def smoothed(mechanism: Mechanism, width: float) -> Mechanism:
    """The mechanism with a smooth onset of every normal law over a width [m]."""
    return change_each_play(mechanism, lambda play: dataclasses.replace(play, normal=play.normal.smoothed(width)))


def continued(specification: Specification, widths: Sequence[float], how: SearchOptions) -> Design:
    """The best design of the laws themselves, by searches with laws smoothed over smaller and smaller `widths` [m], the
    last of which is 0. Each starts from the design of the one before, and only the first one has further starts. Every
    width has its own record beside that of the laws themselves. **Raises** `ClearanceError` for widths that do not fall
    to 0, and for classes.
    """
    falls = all(high > low for high, low in itertools.pairwise(widths))
    if not (falls and widths and all(0 <= width < math.inf for width in widths) and widths[-1] == 0):
        raise ClearanceError(
            "`smoothing` must be widths [m] that become smaller, and the last one must be 0, which is the law itself: "
            f"such as (1e-6, 1e-7, 0). But it is {tuple(widths)}."
        ).about("smoothing", tuple(widths))
    if how.classes is not None:
        raise ClearanceError(
            "`smoothing` is for variables that take any values: leave `classes` out, and then choose the classes with "
            "`start` at the answer."
        ).about("classes")
    record = None if how.record is None else Path(how.record)
    before: list[tuple[float, Design]] = []
    for width in widths[:-1]:
        asked = dataclasses.replace(specification, mechanism=smoothed(specification.mechanism, width))
        beside = record and record.with_name(f"{record.stem}.smoothed-{width:g}{record.suffix}")
        design = search(asked, how._replace(record=beside))
        if design.stop_reason == INTERRUPTED:
            note = f"this is a design of laws that are smoothed over {width:g} m, not of the laws themselves"
            return design.with_note(note, before=tuple(before))
        before.append((width, design))
        how = how._replace(start=design.clearances, starts=1)
    return dataclasses.replace(search(specification, how), before=tuple(before))
