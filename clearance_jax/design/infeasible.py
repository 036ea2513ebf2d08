"""Explanations of why a search has found no feasible design, and what would help."""

import numpy as np

from clearance_jax.design.formulation import formulate, unposed
from clearance_jax.design.program import SLACK, Evaluation, Program
from clearance_jax.design.specification import Specification, scenarios_of
from clearance_jax.design.unreachable import CARRIED, CLEARANCE, carried_words, unreachable_words
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.signals import PositionError
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import DYNAMICS, QUASI_STATIC
from clearance_jax.solve.simulate import simulate


def why_infeasible(specification: Specification, program: Program) -> str:
    """Why no design of a finished search holds every limit, in words.

    It evaluates the smallest clearances, also by quasi-static poses.
    """
    finite = [point for point in program.history if np.isfinite(point.worst)]
    if not finite:
        return _no_motion(specification, program)
    least = _least(program, finite)
    never = [title for title, worst in least.items() if worst > SLACK]
    if not never:
        return (
            "each limit holds at some design that was evaluated, but no design holds all of them: they contradict each "
            f"other. Loosen one of {', '.join(f'`{title}`' for title in least)}, or let the variables go further"
        )
    title = max(never, key=lambda title: least[title])
    reason = _carried(specification, program, title) or _posed(specification, program, title)
    return reason or _seen(program, finite, title, least[title])


def _least(program: Program, points: list[Evaluation]) -> dict[str, float]:
    """The least violation of each of the designer's limits over all points."""
    groups = np.array(program.groups)
    return {title: min(float(p.limits[groups == title].max()) for p in points) for title in dict.fromkeys(groups)}


def _no_motion(specification: Specification, program: Program) -> str:
    """Why no motion reached its end: the message of the solve of the last design."""
    failure = f"none of {program.solves} designs that were tried has a motion to its end"
    if not program.history:
        return failure
    values, nominal = specification.clearances(program.history[-1].x), specification.nominal()
    for scenario in scenarios_of(nominal):
        why = _ending(nominal, replace(nominal.move(nominal.mechanism, scenario.values), values))
        if why:
            return f"{failure}. At the last one{scenario.title} {why}"
    return failure


def _ending(specification: Specification, mechanism: Mechanism) -> str:
    """Why a motion does not reach its end, in words; empty if it does."""
    try:
        solution = simulate(mechanism, specification.t1, throw=False, **specification.solving)
    except ClearanceError as error:
        return f"a solve says: {error}"
    return "" if bool(solution.succeeded) else solution.message


def _carried(specification: Specification, program: Program, title: str) -> str:
    """Whether the ideal mechanism already exceeds a limit on a force or an acceleration, in words; else empty."""
    limit = next((limit for limit in specification.limits if limit.title == title), None)
    signal = None if limit is None else getattr(limit.metric.base_metric, "signal", None)
    plain = all(name.endswith(CLEARANCE) for name in specification.variables) and not specification.manufacture.title
    if not isinstance(signal, CARRIED) or not plain:
        return ""
    rows, solved = np.flatnonzero(np.array(program.groups) == title), program.at(program.lower)
    return carried_words(specification, program, solved, int(rows[np.argmax(solved.limits[rows])]))


def _posed(specification: Specification, program: Program, title: str) -> str:
    """What quasi-static poses say of an error of a point at the smallest clearances, in words; else empty."""
    limit = next((limit for limit in specification.limits if limit.title == title), None)
    signal = None if limit is None else getattr(limit.metric.base_metric, "signal", None)
    if not isinstance(signal, PositionError) or specification.solving.get("fidelity") != DYNAMICS:
        return ""
    manufacture, names = specification.manufacture, specification.variables
    if manufacture.title or manufacture.among or not all(name.endswith(CLEARANCE) for name in names):
        return ""
    if unposed(specification.nominal()):
        return ""
    cheap = program.cheap or formulate(specification.judged_by(QUASI_STATIC))
    posed, solved = cheap.at(program.lower, True), program.at(program.lower, True)
    rows = np.flatnonzero(np.array(program.groups) == title)
    k = int(rows[np.argmax(solved.limits[rows])])
    if not np.isfinite(solved.worst) or solved.limits[k] <= SLACK:
        return ""
    if not np.isfinite(posed.worst):
        return _singular(specification, program, solved, k)
    if posed.limits[int(program.leaders[k])] > SLACK:
        return unreachable_words(specification, program, posed, solved, k)
    return (
        f"at the smallest clearances {program.limit_names[k]} is {1 + solved.limits[k]:.3g} times its bound, but "
        f"{1 + posed.limits[int(program.leaders[k])]:.3g} times by quasi-static poses: what is left is motion, impacts "
        "or ringing of pins. A settled start, damping or a preload of the joints, or a gentler motion helps, or a "
        "looser bound"
    )


def _singular(specification: Specification, program: Program, solved: Evaluation, k: int) -> str:
    """Why there are no quasi-static poses at the smallest clearances, although the dynamics reach the end."""
    excess = f"at the smallest clearances {program.limit_names[k]} is {1 + solved.limits[k]:.4g} times its bound"
    posed = specification.nominal().judged_by(QUASI_STATIC)
    values = specification.clearances(solved.x)
    for scenario in scenarios_of(posed):
        why = _ending(posed, replace(posed.move(posed.mechanism, scenario.values), values))
        if why:
            return (
                f"{excess}, and its quasi-static motion{scenario.title} has no end: {why}. Near a singular posture (a "
                "dead centre, a stretched arm) any play makes large errors: keep the motion away from it, or loosen "
                "the bound"
            )
    return excess


def _seen(program: Program, points: list[Evaluation], title: str, least: float) -> str:
    """What the evaluated designs say of a limit that none of them holds, in words."""
    rows = np.flatnonzero(np.array(program.groups) == title)
    excess = f"of {len(points)} designs that were evaluated none has {title} below {1 + least:.4g} times its bound"
    near = min(points, key=lambda p: float(p.limits[rows].max()))
    parts = _by_values(points, rows)
    if parts is None and near.jacobian is not None:
        parts = near.jacobian[int(rows[np.argmax(near.limits[rows])])] * near.x
    if parts is None:
        return f"{excess}. Loosen it, or widen the bounds of the variables"
    if np.abs(parts) @ np.log(program.upper / program.lower) < np.log(1 + least):
        return f"{excess}, and by what they change no variables will: loads, drives or other numbers decide it"
    i = int(np.argmax(np.abs(parts)))
    way = "smaller" if parts[i] > 0 else "larger"
    return f"{excess}. A {way} `{program.names[i]}` helps most; let it go further, or loosen the bound"


def _by_values(points: list[Evaluation], rows: np.ndarray) -> np.ndarray | None:
    """The exponents of a limit as a product of powers of the variables, fitted to values, as slopes may be those of a
    chaotic motion; `None` if there are too few points.
    """
    logs = np.log([p.x for p in points])
    values = np.log([max(1 + float(p.limits[rows].max()), 1e-300) for p in points])
    exponents, _, rank, _ = np.linalg.lstsq(logs - logs.mean(0), values - values.mean(), rcond=1e-6)
    return exponents if rank == logs.shape[1] and len(points) > rank + 1 else None
