"""Detection of bounds that no clearances can hold, before a search, with explanations of what would help."""

import dataclasses
from typing import Any

import numpy as np

from clearance_jax.design.budget import CLOSED, RIGID
from clearance_jax.design.evaluate import Simulations, simulations_of
from clearance_jax.design.formulation import formulate, unposed
from clearance_jax.design.program import Evaluation, Program
from clearance_jax.design.specification import Limit, Scenario, Specification, scenarios_of
from clearance_jax.dynamics.mobility import mobility
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import NO_GRAVITY, Mechanism
from clearance_jax.metrics.signals import Acceleration, ContactForce, JointMoment, JointReaction
from clearance_jax.parameters import parameters
from clearance_jax.solve.settings import QUASI_STATIC
from clearance_jax.units import format_quantity

CLEARANCE = "_clearance"
# Suffixes of the numbers that the stiffness of a contact is proportional to.
STIFFNESS = (".stiffness", "_modulus")

# Signals that are about as large in the ideal mechanism as with play, or smaller.
CARRIED = (ContactForce, JointReaction, JointMoment, Acceleration)
# The factor by which the ideal mechanism must exceed a bound, as friction takes a part of the normal forces.
SURE = 1.2


def unreachable(specification: Specification, program: Program, start: np.ndarray, gradient: bool) -> str:
    """Why no design can hold a limit, in words; empty if one may.

    The smallest clearances are evaluated: by quasi-static poses first, if the program has them, else by the dynamics if
    the `start` violates a limit. A limit that they violate, and that grows with the clearances, is then compared with
    the ideal mechanism (`floor_words`).
    """
    if not all(name.endswith(CLEARANCE) for name in specification.variables):
        return ""
    if program.cheap is not None:
        reason = _by_poses(specification, program)
    else:
        reason = _by_dynamics(specification, program, start, gradient)
    return f"stopped before the search: {reason}" if reason else ""


def _by_poses(specification: Specification, program: Program) -> str:
    assert program.cheap is not None
    posed = program.cheap.at(program.lower, True)
    if not 0 < posed.worst < np.inf:
        return ""
    solved = program.at(program.lower, True)
    k = int(np.argmax(solved.limits))
    leader = int(program.leaders[k])
    assert posed.jacobian is not None
    if not 0 < solved.worst < np.inf or posed.jacobian[leader] @ posed.x < 0:
        return ""
    return unreachable_words(specification, program, posed, solved, k)


def _by_dynamics(specification: Specification, program: Program, start: np.ndarray, gradient: bool) -> str:
    if specification.manufacture.title or any(limit.ages for limit in specification.limits):
        return ""
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
    """Why limit `k` is violated at any clearances, in words: the loads of the ideal mechanism are too large, or the
    contacts are too soft; empty if neither is known.
    """
    limit = limit_of(specification, program, k)
    signal = getattr(limit.metric.base_metric, "signal", None)
    if isinstance(signal, CARRIED):
        return carried_words(specification, program, solved, k)
    if not getattr(signal, "needs_ideal", False) or unposed(specification.nominal()):
        return ""
    cheap = program.cheap or formulate(specification.judged_by(QUASI_STATIC))
    posed, leader = cheap.at(program.lower, True), int(program.leaders[k])
    assert posed.jacobian is not None
    if not 0 < posed.limits[leader] < np.inf or posed.jacobian[leader] @ posed.x < 0:
        return ""
    return unreachable_words(specification, program, posed, solved, k)


def limit_of(specification: Specification, program: Program, k: int) -> Limit:
    """The designer's limit of limit `k` of the program."""
    return next(limit for limit in specification.limits if limit.title == program.groups[k])


def carried_words(specification: Specification, program: Program, solved: Evaluation, k: int) -> str:
    """A sentence on the force (joint reaction) or acceleration of the ideal mechanism, if it clearly exceeds the bound;
    else empty.
    """
    limit, scenario = limit_of(specification, program, k), _scenario(specification, program, k)
    ideal = specification.move(specification.mechanism, scenario.values).ideal()
    carried = _carried(specification, limit, ideal)
    if not carried > SURE * limit.bound:
        return ""
    least, bound, carries = (
        format_quantity(value, limit.metric.unit, 4)
        for value in (float((1 + solved.limits[k]) * limit.bound), limit.bound, carried)
    )
    text = f"no clearances hold {program.limit_names[k]}. At the smallest ones it is {least} of at most {bound}, and "
    text += f"without any clearance {carries}: "
    light = _carried(specification, limit, dataclasses.replace(ideal, gravity=NO_GRAVITY))
    if light < 0.5 * carried:
        return text + "the weight of the parts decides it. Lighter parts help, or a looser bound."
    return text + (
        f"loads and the inertia of the motion decide it ({format_quantity(light, limit.metric.unit, 4)} without "
        "weight). A slower or smoother motion, lighter parts or smaller loads help, or a looser bound."
    )


def _carried(specification: Specification, limit: Limit, ideal: Mechanism) -> float:
    """The metric of a force or an acceleration for the ideal mechanism; NaN if its reactions or its motion are not
    determined.
    """
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


def _scenario(specification: Specification, program: Program, k: int) -> Scenario:
    """The scenario of limit `k`."""
    scenarios = scenarios_of(specification)
    return scenarios[k * len(scenarios) // len(program.groups)]


def unreachable_words(
    specification: Specification, program: Program, posed: Evaluation, solved: Evaluation, k: int
) -> str:
    """Sentences on limit `k` at the smallest clearances, by poses and by the model that judges; on the joint that
    contributes most; and on what would help.
    """
    label, leader = program.limit_names[k], int(program.leaders[k])
    text = f"no clearances within their bounds hold {label}. At the smallest ones it is "
    if specification.manufacture.title:
        return text + f"{1 + solved.limits[k]:.4g} times its bound (by poses {1 + posed.limits[leader]:.4g} times)."
    limit = limit_of(specification, program, k)
    if isinstance(getattr(limit.metric.base_metric, "signal", None), CARRIED):
        return carried_words(specification, program, solved, k)
    simulations = simulations_of(specification.judged_by(QUASI_STATIC))
    scenarios, count = scenarios_of(specification), sum(simulations.sizes())
    scenario, row, x = scenarios[leader // count], leader % count, specification.values(posed.x)
    bare = float(simulations.limits(CLOSED * x, scenario, True)[0][row])
    text += f"{_value(limit, solved.limits[k])} of at most {_value(limit, 0.0)}; by quasi-static poses "
    text += _value(limit, posed.limits[leader])
    if np.isfinite(bare):
        text += f", and {_value(limit, bare)} without any clearance, by the elasticity of the contacts alone"
    return text + ". " + _help(specification, limit, simulations, scenario, row, bare)


def _value(limit: Limit, scaled: float) -> str:
    return format_quantity(float((1 + scaled) * limit.bound), limit.metric.unit, 3)


def _help(
    specification: Specification, limit: Limit, simulations: Simulations, scenario: Scenario, row: int, bare: float
) -> str:
    """A sentence on the joint that contributes most, and on what would help."""
    x = np.array([low for low, _ in specification.variables.values()])
    values, slopes = simulations.limits(x, scenario, True)
    assert slopes is not None
    parts: dict[str, float] = {}
    for name, part in zip(specification.variables, slopes[row] * x, strict=True):
        joint = name.rpartition(".")[0]
        parts[joint] = parts.get(joint, 0.0) + float(part)
    play = dict(parts)
    for joint in parts:
        stiffer = simulations.limits(x, _stiffened(specification, scenario, joint), True)[0]
        parts[joint] += float(np.nan_to_num(values[row] - stiffer[row]))
    most = max(parts, key=lambda joint: parts[joint])
    elastic = parts[most] - play[most]
    text = f"Joint `{most}` contributes most ({_value(limit, elastic - 1)} by elasticity, "
    text += f"{_value(limit, play[most] - 1)} by play): a longer sleeve, a larger pin, a stiffer contact or a preload "
    text += "there helps, or a looser bound"
    return text + ("." if bare > 0 else ", or smaller least clearances.")


def _stiffened(specification: Specification, scenario: Scenario, joint: str) -> Scenario:
    """The scenario with nearly rigid contacts in a joint."""
    known = parameters(specification.mechanism)
    names = [n for n in known if n.startswith(f"{joint}.") and n.endswith(STIFFNESS)]
    return scenario._replace(values={**scenario.values, **{n: RIGID * specification.worth(n) for n in names}})
