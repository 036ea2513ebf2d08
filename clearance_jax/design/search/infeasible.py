"""Explanations of why no design holds every limit, before and after a search, and what would help."""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from clearance_jax.design.asked.formulation import formulate, unposed
from clearance_jax.design.asked.specification import Limit, Scenario, Specification, scenarios_of
from clearance_jax.design.judge.budget import CLOSED, RIGID
from clearance_jax.design.search.evaluate import FEW, simulations_of
from clearance_jax.design.search.program import SLACK, Evaluation, Program
from clearance_jax.dynamics.closures import mobility
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import NO_GRAVITY, Mechanism
from clearance_jax.metrics.signals import Acceleration, ContactForce, JointMoment, JointReaction, PositionError
from clearance_jax.parameters import parameters, replace
from clearance_jax.solve.settings import DYNAMICS, QUASI_STATIC
from clearance_jax.solve.simulate import simulate
from clearance_jax.units import format_quantity

CLEARANCE, BACKLASH = "_clearance", ".backlash"
# Suffixes of the numbers that the stiffness of a contact is proportional to.
STIFFNESS = (".stiffness", "_modulus")
# A factor on clearances that shows whether a limit falls as they grow.
LARGER = 1.1
# What helps in a bearing.
BEARING = "longer sleeve, a larger pin, a stiffer contact or a preload"

# Signals that are about as large in the ideal mechanism as with play, or smaller.
CARRIED = (ContactForce, JointReaction, JointMoment, Acceleration)
# The factor by which the ideal mechanism must exceed a bound, as friction takes a part of the normal forces.
SURE = 1.2


def unreachable(specification: Specification, program: Program, start: np.ndarray, gradient: bool) -> str:
    """Why no design can hold a limit, in words; empty if one may. The smallest clearances are evaluated: by
    quasi-static poses first, if the program has them, else by the dynamics if the `start` violates a limit. A limit
    that they violate, and that grows with the clearances, is then compared with the ideal mechanism (`floor_words`).
    """
    if not _are_gaps(specification):
        return ""
    asked = specification, program
    reason = _by_poses(*asked) if program.cheap is not None else _by_dynamics(*asked, start, gradient)
    return f"stopped before the search: {reason}" if reason else ""


def _are_gaps(specification: Specification) -> bool:
    """Whether all variables are clearances or backlash."""
    return all(name.endswith((CLEARANCE, BACKLASH)) for name in specification.variables)


def _by_poses(specification: Specification, program: Program) -> str:
    assert program.cheap is not None
    posed = program.cheap.at(program.lower, True)
    if not 0 < posed.worst < np.inf:
        return ""
    solved = program.at(program.lower)  # values alone are compiled sooner
    k = int(np.argmax(solved.limits))
    if not 0 < solved.worst < np.inf or _falls(program, program.cheap, posed, k):
        return ""
    return unreachable_words(specification, program, posed, solved, k)


def _falls(program: Program, cheap: Program, posed: Evaluation, k: int) -> bool:
    """Whether limit `k` falls as all clearances grow by the same factor, by quasi-static poses."""
    leader = int(program.leaders[k])
    if posed.jacobian is not None:
        return bool(posed.jacobian[leader] @ posed.x < 0)
    return bool(cheap.at(LARGER * posed.x).limits[leader] < posed.limits[leader])


def _by_dynamics(specification: Specification, program: Program, start: np.ndarray, gradient: bool) -> str:
    if specification.manufacture.title or any(limit.ages for limit in specification.limits):
        return ""
    if gradient and len(program.names) > FEW:
        # Values alone are compiled sooner, and a search of so many variables needs them as well. But a search by poses
        # has nearly the same program with gradients.
        solved = program.at(program.lower, program.fidelity == QUASI_STATIC)
        if solved.worst <= 0:
            return ""
        why = floor_words(specification, program, solved, int(solved.limits.argmax())) if solved.worst < np.inf else ""
        if why:
            return why
    begin = program.at(start, gradient)
    if not 0 < begin.worst < np.inf:
        return ""
    solved = program.at(program.lower, gradient)
    # A limit that falls with larger clearances is left to the search.
    never = (solved.limits > 0) & (solved.limits <= begin.limits)
    if not np.isfinite(solved.worst) or not np.any(never):
        return ""
    return floor_words(specification, program, solved, int(np.argmax(np.where(never, solved.limits, -np.inf))))


def floor_words(specification: Specification, program: Program, solved: Evaluation, k: int) -> str:
    """Why limit `k` is violated at any clearances (loads, or soft contacts), in words; empty if it is not known."""
    limit = limit_of(specification, program, k)
    if isinstance(limit.signal, CARRIED):
        return carried_words(specification, program, solved, k)
    if not getattr(limit.signal, "needs_ideal", False) or unposed(specification.nominal()):
        return ""
    # Where poses do not lead the search, their values alone are compiled sooner.
    cheap = program.cheap or formulate(specification.judged_by(QUASI_STATIC))
    posed = cheap.at(program.lower, program.cheap is not None)
    if not 0 < posed.limits[int(program.leaders[k])] < np.inf or _falls(program, cheap, posed, k):
        return ""
    return unreachable_words(specification, program, posed, solved, k)


def limit_of(specification: Specification, program: Program, k: int) -> Limit:
    """The designer's limit of limit `k` of the program."""
    return next(limit for limit in specification.limits if limit.title == program.groups[k])


def carried_words(specification: Specification, program: Program, solved: Evaluation, k: int) -> str:
    """A sentence on the force or acceleration of the ideal mechanism, if it clearly exceeds the bound; else empty."""
    limit, scenarios = limit_of(specification, program, k), scenarios_of(specification)
    scenario = scenarios[k * len(scenarios) // len(program.groups)]
    ideal = specification.move(specification.mechanism, scenario.values).intended()
    carried = _carried(specification, limit, ideal)
    if not carried > SURE * limit.bound:
        return ""
    light = _carried(specification, limit, dataclasses.replace(ideal, gravity=NO_GRAVITY))
    numbers = float((1 + solved.limits[k]) * limit.bound), limit.bound, carried, light
    least, bound, carries, unweighted = (format_quantity(number, limit.metric.unit, 4) for number in numbers)
    why = (
        f"loads and the inertia of the motion decide it ({unweighted} without weight). A slower or smoother motion, "
        "lighter parts or smaller loads help, or a looser bound."
    )
    if light < 0.5 * carried:
        why = "the weight of the parts decides it. Lighter parts help, or a looser bound."
    smallest = f"At the smallest ones it is {least} of at most {bound}, and without any clearance {carries}"
    return f"no clearances hold {program.limit_names[k]}. {smallest}: {why}"


def _carried(specification: Specification, limit: Limit, ideal: Mechanism) -> float:
    """The metric for the ideal mechanism; NaN if its reactions or its motion are not determined."""
    metric: Any = limit.metric.base_metric
    if isinstance(metric.signal, ContactForce):
        metric = dataclasses.replace(metric, signal=JointReaction(metric.signal.joint))
    options = {name: value for name, value in specification.options.items() if name != "start"}
    try:
        if ideal.may_repeat and mobility(ideal, specification.t0).repeated:
            return np.nan
        return float(np.max(np.asarray(metric(ideal, specification.t1, **options))))
    except (ClearanceError, RuntimeError):
        return np.nan


def unreachable_words(
    specification: Specification, program: Program, posed: Evaluation, solved: Evaluation, k: int
) -> str:
    """Sentences on limit `k` at the smallest clearances, by poses and by the model that judges, and what would help."""
    label, leader = program.limit_names[k], int(program.leaders[k])
    drives = all(name.endswith(BACKLASH) for name in specification.variables)
    gaps, springs = ("backlash", "drives") if drives else ("clearance", "contacts")
    text = f"no {gaps} within its bounds holds {label}. At the least it is " if drives else ""
    text = text or f"no clearances within their bounds hold {label}. At the smallest ones it is "
    if specification.manufacture.title:
        return text + f"{1 + solved.limits[k]:.4g} times its bound (by poses {1 + posed.limits[leader]:.4g} times)."
    limit = limit_of(specification, program, k)
    if isinstance(limit.signal, CARRIED):
        return carried_words(specification, program, solved, k)
    simulations = simulations_of(specification.judged_by(QUASI_STATIC))
    scenarios, count = scenarios_of(specification), sum(simulations.sizes())
    scenario, row, x = scenarios[leader // count], leader % count, specification.values(posed.x)
    gradient = posed.jacobian is not None
    bare = float(simulations.limits(CLOSED * x, scenario, gradient)[0][row])
    text += f"{_value(limit, 1 + solved.limits[k])} of at most {_value(limit, 1.0)}; by quasi-static poses "
    text += _value(limit, 1 + posed.limits[leader])
    if np.isfinite(bare):
        text += f", and {_value(limit, 1 + bare)} without any {gaps}, by the elasticity of the {springs} alone"
    judge = partial(simulations.limits, gradient=gradient)
    return text + ". " + _help(specification, limit, judge, scenario, row, bare)


def _value(limit: Limit, share: float) -> str:
    """A share of the bound as a quantity."""
    return format_quantity(float(share * limit.bound), limit.metric.unit, 3)


def _help(
    specification: Specification, limit: Limit, judge: Callable, scenario: Scenario, row: int, bare: float
) -> str:
    """A sentence on the joint that contributes most, and on what would help; `judge` poses clearances in a scenario."""
    x = np.array([low for low, _ in specification.variables.values()])
    joints = np.array([name.rpartition(".")[0] for name in specification.variables])
    play, elastic, known = {}, {}, parameters(specification.mechanism)
    value = judge(x, scenario)[0][row]
    for joint in dict.fromkeys(joints):
        # What the limit loses without play, and where contacts are nearly rigid.
        closed = judge(np.where(joints == joint, CLOSED * x, x), scenario)[0][row]
        play[joint] = float(np.nan_to_num(value - closed))
        names = [n for n in known if n.startswith(f"{joint}.") and n.endswith(STIFFNESS)]
        rigid = {**scenario.values, **{n: RIGID * specification.worth(n) for n in names}}
        elastic[joint] = float(np.nan_to_num(value - judge(x, scenario._replace(values=rigid))[0][row]))
    most = max(play, key=lambda joint: play[joint] + elastic[joint])
    what, helps, gaps = "Joint", BEARING, "clearances"
    if f"{most}{BACKLASH}" in specification.variables:
        what, helps, gaps = "Drive", "stiffer drive", "backlash"
    return (
        f"{what} `{most}` contributes most ({_value(limit, elastic[most])} by elasticity, {_value(limit, play[most])} "
        f"by play): a {helps} there helps, or a looser bound{'.' if bare > 0 else f', or smaller least {gaps}.'}"
    )


def why_infeasible(specification: Specification, program: Program) -> str:
    """Why no design of a finished search holds every limit. It evaluates the smallest clearances, also by poses."""
    finite = [point for point in program.history if np.isfinite(point.worst)]
    if not finite:
        return _no_motion(specification, program)
    groups = np.array(program.groups)
    # The least violation of each of the designer's limits over all points.
    least = {title: min(float(p.limits[groups == title].max()) for p in finite) for title in dict.fromkeys(groups)}
    never = [title for title, worst in least.items() if worst > SLACK]
    if not never:
        return (
            "each limit holds at some design that was evaluated, but no design holds all of them: they contradict each "
            f"other. Loosen one of {', '.join(f'`{title}`' for title in least)}, or let the variables go further"
        )
    title = max(never, key=lambda title: least[title])
    return _at_smallest(specification, program, title) or _at_evaluated(program, finite, title, least[title])


def _no_motion(specification: Specification, program: Program) -> str:
    """Why no motion reached its end: the message of the solve of the last design."""
    failure = f"none of {program.solves} designs that were tried has a motion to its end"
    if not program.history:
        return failure
    unfinished = _unfinished(specification.nominal(), specification.clearances(program.history[-1].x))
    return failure if unfinished is None else f"{failure}. At the last one{unfinished[0]} {unfinished[1]}"


def _unfinished(specification: Specification, values: Mapping[str, float]) -> tuple[str, str] | None:
    """The title of the first scenario whose motion does not reach its end, and why, in words; `None`: all do."""
    for scenario in scenarios_of(specification):
        why = _ending(specification, replace(specification.move(specification.mechanism, scenario.values), values))
        if why:
            return scenario.title, why
    return None


def _ending(specification: Specification, mechanism: Mechanism) -> str:
    """Why a motion does not reach its end, in words; empty if it does."""
    try:
        solution = simulate(mechanism, specification.t1, throw=False, **specification.solving)
    except ClearanceError as error:
        return f"a solve says: {error}"
    return "" if bool(solution.succeeded) else solution.message


def _at_smallest(specification: Specification, program: Program, title: str) -> str:
    """What the ideal mechanism or quasi-static poses say of a limit at the smallest clearances, in words; or empty."""
    signal = next((limit.signal for limit in specification.limits if limit.title == title), None)
    manufacture = specification.manufacture
    if manufacture.title or not _are_gaps(specification):
        return ""
    rows = np.flatnonzero(np.array(program.groups) == title)
    if isinstance(signal, CARRIED):
        solved = program.at(program.lower)
        return carried_words(specification, program, solved, int(rows[np.argmax(solved.limits[rows])]))
    if not isinstance(signal, PositionError) or specification.solving.get("fidelity") != DYNAMICS:
        return ""
    if manufacture.among or unposed(specification.nominal()):
        return ""
    cheap = program.cheap or formulate(specification.judged_by(QUASI_STATIC))
    posed, solved = cheap.at(program.lower, program.cheap is not None), program.at(program.lower, True)
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
    unfinished = _unfinished(specification.nominal().judged_by(QUASI_STATIC), specification.clearances(solved.x))
    if unfinished is None:
        return excess
    return (
        f"{excess}, and its quasi-static motion{unfinished[0]} has no end: {unfinished[1]}. Near a singular posture (a "
        "dead centre, a stretched arm) any play makes large errors: keep the motion away from it, or loosen the bound"
    )


def _at_evaluated(program: Program, points: list[Evaluation], title: str, least: float) -> str:
    """What the evaluated designs say of a limit that none of them holds, in words."""
    rows = np.flatnonzero(np.array(program.groups) == title)
    excess = f"of {len(points)} designs that were evaluated none has {title} below {1 + least:.4g} times its bound"
    near = min(points, key=lambda p: float(p.limits[rows].max()))
    exponents = _exponents(points, rows)
    if exponents is None and near.jacobian is not None:
        exponents = near.jacobian[int(rows[np.argmax(near.limits[rows])])] * near.x
    if exponents is None:
        return f"{excess}. Loosen it, or widen the bounds of the variables"
    # By how much the limit changes, in logarithms, if every variable goes from one bound to the other.
    if np.abs(exponents) @ np.log(program.upper / program.lower) < np.log(1 + least):
        return f"{excess}, and by what they change no variables will: loads, drives or other numbers decide it"
    i = int(np.argmax(np.abs(exponents)))
    way = "smaller" if exponents[i] > 0 else "larger"
    return f"{excess}. A {way} `{program.names[i]}` helps most; let it go further, or loosen the bound"


def _exponents(points: list[Evaluation], rows: np.ndarray) -> np.ndarray | None:
    """The exponents of a limit as a product of powers of the variables, fitted to values; `None`: too few points."""
    logs = np.log([p.x for p in points])
    values = np.log([max(1 + float(p.limits[rows].max()), 1e-300) for p in points])
    exponents, _, rank, _ = np.linalg.lstsq(logs - logs.mean(0), values - values.mean(), rcond=1e-6)
    return exponents if rank == logs.shape[1] and len(points) > rank + 1 else None
