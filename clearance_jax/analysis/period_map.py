"""The period map of a mechanism: the state a period later, its scales, and Newton's step to a fixed point."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.field import slope
from clearance_jax.mechanism.actuators import ConstantEffort, Servo
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.flow import Inputs, flow
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.tolerances import LOCAL, largest_length, tolerances

TURN = 2 * np.pi
# The least size of a cycle with a period of its own, in the scene's scales: what is smaller is at rest.
SMALLEST = 1e-12
# What moves less than this part of what moves most counts as this part.
LITTLE = 1e-4
# Where its period is looked for, in parts of the guess, and at how many instants of an orbit.
EARLIEST, LATEST, INSTANTS = 0.75, 1.25, 101
# How often rows and columns of a system are scaled: each time their sizes come half as near to one.
BALANCED = 20
# The largest gap between a drive's end and its start, in radians or largest lengths; that of its speed is in these per
# radian of the period.
SEAM = 1e-6


class CycleSearch(NamedTuple):
    """The numeric arguments of a search."""

    mechanism: Mechanism
    t0: Array
    period: Array
    rtol: Array
    guess: Array | None
    turns: Array | None


class CycleOptions(NamedTuple):
    """The static arguments of a search: other ones compile another program."""

    options: Settings
    settle: int
    iterations: int
    is_free: bool = False


def seams(mechanism: Mechanism, t0: Array, period: Array) -> dict[str, Array]:
    """How far each drive, servo target and load course is from its start after the period, by name: in radians
    (without whole turns) or largest lengths; a load in its own unit.
    """
    length, out = largest_length(mechanism), {}
    for wrench in mechanism.wrenches:
        if wrench.course is not None:
            (begin, end), _ = _ends(wrench.course, t0, period)
            out[wrench.name] = jnp.abs(end - begin)
    for coordinate in mechanism.coordinates():
        servos = [actuator.target for actuator in coordinate.motion.actuators if isinstance(actuator, Servo)]
        drive = coordinate.motion.drive
        for course in servos if drive is None else [drive]:
            (begin, end), rates = _ends(course, t0, period)
            missed = end - begin
            if coordinate.slides is None:
                missed -= TURN * jnp.round(missed / TURN)
            unit = 1.0 if coordinate.slides is None else length
            gap = jnp.maximum(jnp.abs(missed), jnp.abs(rates[1] - rates[0]) * period / TURN) / unit
            out[coordinate.name] = jnp.maximum(out.get(coordinate.name, 0.0), gap)
    return out


def _ends(drive: AbstractDrive, t0: Array, period: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """A drive's positions and velocities at both ends of the period."""
    (q0, v0, _), (q1, v1, _) = drive(t0), drive(t0 + period)
    return (jnp.asarray(q0, float), jnp.asarray(q1, float)), (jnp.asarray(v0, float), jnp.asarray(v1, float))


def constant_memory(jacobian: Array, free: int) -> Array:
    """Which components (n,) are memory that no touch rewrote in the period: their rows are exactly unit rows."""
    size = jacobian.shape[0]
    return (jnp.arange(size) >= 2 * free) & jnp.all(jacobian == jnp.eye(size), axis=1)


def advance(search: CycleSearch, y: Array, effort: CycleOptions) -> tuple[Array, Any]:
    """The state a period later (NaN if the solve fails) and the result code. The start is projected on the ideal
    closures, so that a direction that opens a loop has multiplier 0, and I - dP/dy is regular.
    """
    t0, mechanism = search.t0, search.mechanism
    if mechanism.closures():
        y = project(t0, y, mechanism.prepare(), 2)
    solution = flow(Inputs(mechanism, t0, t0 + search.period, None, search.rtol, None, y), options=effort.options)
    # NaN as a factor: if `where` selected it, its slopes would be zero.
    return jnp.where(solution.succeeded, 1.0, jnp.nan) * solution.final, solution.code


def scale(search: CycleSearch, y: Array) -> Array:
    """Scale of each component of the state (n,), as in error control; 1 for memory without error control."""
    problem = Problem(search.mechanism.prepare())
    allowed = tolerances(problem, y, search.t0, search.t0 + search.period, search.rtol)
    unit = allowed.unit + allowed.relative / (LOCAL * search.rtol) * jnp.abs(y)
    return jnp.where(jnp.isfinite(unit), unit, 1.0)


def orbit(search: CycleSearch, effort: CycleOptions, y: Array) -> tuple[Array, Array]:
    """The motion from a state for somewhat longer than the period: times [s] since its start, and states there."""
    times = search.period * jnp.linspace(0, LATEST, INSTANTS)
    inputs = Inputs(search.mechanism, search.t0, search.t0 + times[-1], search.t0 + times, search.rtol, None, y)
    return times, flow(inputs, options=effort.options).y


def nearest_return(search: CycleSearch, times: Array, states: Array, count_turns: Callable) -> Array:
    """The time, not long before the period or after it, at which an orbit is nearest to where it began."""
    y, n = states[0], layout(search.mechanism).free
    turned = states.at[:, :n].add(-TURN * jax.vmap(lambda end: count_turns(y, end))(states))
    away = jnp.max(jnp.abs(turned - y[None]) / scale(search, y)[None], axis=1)
    known = (times > EARLIEST * search.period) & jnp.isfinite(away)
    return times[jnp.argmin(jnp.where(known, away, jnp.inf))]


def size_of(search: CycleSearch, states: Array) -> Array:
    """How far each component of the state moves on an orbit, in the scene's scales (n,), at most 1. A cycle with a
    period of its own may be far smaller than these: the play of a gear, beside a turn. At rest it is zero.
    """
    extent = jnp.minimum(jnp.ptp(states, axis=0) / scale(search, states[0]), 1.0)
    most = jnp.max(extent)
    return jnp.where(most < SMALLEST, 0.0, jnp.maximum(extent, LITTLE * most))


def free_turns(search: CycleSearch) -> Array:
    """Whole turns of each free coordinate in a period, shape (free,); NaN if only the motion can tell. A slide makes
    none, nor does a rotation with a spring; a rotation with a servo follows the servo's target.
    """
    if search.turns is not None:
        return search.turns
    out = []
    for coordinate in search.mechanism.free_coordinates():
        holding = [a for a in coordinate.motion.actuators if not isinstance(a, ConstantEffort)]
        targets = [a.target for a in holding if isinstance(a, Servo)]
        if coordinate.slides is None and not holding:
            out.append(jnp.asarray(jnp.nan))
        elif coordinate.slides is None and len(targets) == len(holding):
            (begin, end), _ = _ends(targets[0], search.t0, search.period)
            out.append(jnp.round((end - begin) / TURN))
        else:
            out.append(jnp.zeros(()))
    return jnp.stack(out)


def newton_step(
    search: CycleSearch, effort: CycleOptions, y: Array, end: Array, jacobian: Array, missed: Array
) -> tuple[Array, Array]:
    """The changes of the state and of the period that take up what the motion `missed`: of (I - dP/dy) dy = missed,
    without constant memory, which keeps its value. With a free period, (I - dP/dy) dy - f(end) dT = missed and f(y) .
    dy = 0, for the rate f of the state.
    """
    unit = scale(search, y)
    jacobian = jnp.where(constant_memory(jacobian, layout(search.mechanism).free)[:, None], 0.0, jacobian)
    matrix = jnp.eye(unit.size) - jacobian * unit[None, :] / unit[:, None]
    if not effort.is_free:
        return unit * solve_balanced(matrix, missed / unit, search.rtol), jnp.zeros(())
    ready = search.mechanism.prepare()
    before, after = (slope(t, x, ready) / unit for t, x in ((search.t0, y), (search.t0 + search.period, end)))
    bordered = jnp.block([[matrix, -after[:, None]], [before[None, :], jnp.zeros((1, 1))]])
    change = solve_balanced(bordered, jnp.append(missed / unit, 0.0), search.rtol)
    return unit * change[:-1], change[-1]


def solve_balanced(matrix: Array, right: Array, rtol: Array) -> Array:
    """The solution of a system whose singular values below `rtol` of the largest are left out. Rows and columns are
    scaled first until the largest entry of each is about one (Ruiz 2001): a component whose scale is far from how much
    it moves would have a small singular value for no other reason.
    """

    def halfway(_, scales):
        row, column = scales
        size = jnp.abs(row[:, None] * matrix * column[None, :])
        largest = jnp.max(size, axis=1), jnp.max(size, axis=0)
        return tuple(by / jnp.sqrt(jnp.where(most > 0, most, 1.0)) for by, most in zip(scales, largest, strict=True))

    ones = jnp.ones(right.size)
    row, column = jax.lax.fori_loop(0, BALANCED, halfway, (ones, ones))
    return column * (jnp.linalg.pinv(row[:, None] * matrix * column[None, :], rtol=rtol) @ (row * right))
