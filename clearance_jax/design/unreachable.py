"""A bound that no clearance can hold: said before anything is searched for, with what is left and what would help."""

import numpy as np

from clearance_jax.design.budget import CLOSED, RIGID
from clearance_jax.design.evaluate import Simulations, simulations_of
from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.design.specification import Limit, Specification
from clearance_jax.parameters import parameters
from clearance_jax.solve.settings import QUASI_STATIC
from clearance_jax.units import format_quantity

CLEARANCE = "_clearance"
# The numbers of a contact that its stiffness is proportional to.
STIFFNESS = (".stiffness", "_modulus")


def unreachable(specification: Specification, program: Program) -> str:
    """Why no design can hold a limit, in words; empty where one may.

    Poses are asked first, at the smallest clearances. Where they violate a limit that grows with the clearances, the
    dynamics are asked once.
    """
    assert program.cheap is not None
    if not all(name.endswith(CLEARANCE) for name in specification.variables):
        return ""
    posed = program.cheap.at(program.lower, True)
    if not 0 < posed.worst < np.inf:
        return ""
    solved = program.at(program.lower, True)
    k = int(np.argmax(solved.limits))
    leader = int(program.leaders[k])
    assert posed.jacobian is not None
    if not 0 < solved.worst < np.inf or posed.jacobian[leader] @ posed.x < 0:
        return ""
    return "stopped before the search: " + unreachable_words(specification, program, posed, solved, k)


def unreachable_words(
    specification: Specification, program: Program, posed: Evaluation, solved: Evaluation, k: int
) -> str:
    """What is left of a limit, with its place `k`, at the smallest clearances, by poses and by the model that judges;
    which joint contributes most; and what would help.
    """
    label, leader = program.limit_names[k], int(program.leaders[k])
    text = f"no clearances within their bounds hold {label}. At the smallest ones it is "
    if specification.manufacture.title:
        return text + f"{1 + solved.limits[k]:.4g} times its bound (by poses {1 + posed.limits[leader]:.4g} times)."
    limit = next(one for one in specification.limits if one.title == program.groups[k])
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
    """Which joint contributes most, and what would help."""
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
    """A scenario in which the contacts of a joint hardly give way."""
    known = parameters(specification.mechanism)
    names = [n for n in known if n.startswith(f"{joint}.") and n.endswith(STIFFNESS)]
    return scenario._replace(values={**scenario.values, **{n: RIGID * specification.worth(n) for n in names}})
