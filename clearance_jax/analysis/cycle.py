"""The search for a limit cycle: Newton's method on the period map, multipliers, derivative.

The motion is a fixed point y = P(y) of the period map P, which takes the state [q, v, memory] at t0 to the one a period
later. Newton's method uses the error-controlled Jacobian of a solve, so that it also finds cycles that are unstable or
settle slowly. The implicit function theorem gives the derivative of the cycle from that of one period,
dy = (I - dP/dy)^-1 (dP/dp) dp.

A cycle that nothing drives (of a servo with backlash, of a stick-slip) has a period of its own. It is one unknown more,
and one condition more keeps the state from sliding along the cycle: the change of the state has no part along its rate.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.field import slope
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.actuators import ConstantEffort, Servo
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.codes import Result, words
from clearance_jax.solve.first_state import initial_state
from clearance_jax.solve.flow import Inputs, flow
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.tolerances import LOCAL, largest_length, tolerances

TURN = 2 * np.pi
# The search stops at a residual of rtol. If no step lowers it further, it must be within this many rtol, which is the
# error that a solve may have.
CLOSED = 100.0
# A damped step must lower the residual by this part of its damping. A rejected step is shortened by SHRINK; below
# SHORTEST it is given up, and the motion settles for longer.
DECREASE, SHRINK, SHORTEST = 0.25, 0.25, 1 / 64
# The largest gap between a drive's end and its start, in radians or largest lengths; that of its speed is in these per
# radian of the period.
SEAM = 1e-6


class PeriodicMotion(Module):
    """A periodic motion and how its search ended. Only `y` and `period` have derivatives; other fields are constants.

    - `y`: the state [q, v, memory] at t0 in SI units, shape (n,); if not converged, the last one of the search.
    - `period` [s]: as given, or as found.
    - `monodromy`: the derivative dP/dy of the state after one period P(y) by the state before, shape (n, n). Its error
      is controlled.
    - `residual`: largest |P(y) - y|, in units of the lengths and speeds of the scene. The error of `y` is about
      `residual` / `margin`.
    - `iterations`: how many Newton steps and phases of settling were tried.
    - `turns`: whole turns of each free coordinate in a period, shape (free,); 0 for a slide.
    - `converged`: whether the search succeeded; `code`: how its last solve ended (`codes.Result`).
    """

    y: Float[Array, " n"]
    period: Scalar
    monodromy: Float[Array, "n n"]
    residual: Scalar
    iterations: Int[Array, ""]
    turns: Float[Array, " free"]
    converged: Bool[Array, ""]
    code: Int[Array, ""]
    held: Bool[Array, " n"]
    """Which components are memory that no touch rewrites in the period. Their rows of `monodromy` are unit rows, so
    their multipliers are 1; stability and margin leave them out."""
    is_free: bool = eqx.field(static=True, default=False)
    """Whether nothing drives it. One multiplier is then 1, for a shift along it; stability and margin leave it out."""

    @property
    def multipliers(self) -> Complex[Array, "*batch n"]:
        """Floquet multipliers (eigenvalues of `monodromy`), the largest first."""
        return _eigenvalues(self.monodromy)

    @property
    def _moving(self) -> Complex[Array, "*batch n"]:
        values = _eigenvalues(jnp.where(self.held[..., None], 0.0, self.monodromy))
        if not self.is_free:
            return values
        along = jnp.argmin(jnp.abs(values - 1), axis=-1)[..., None]
        return jnp.where(jnp.arange(values.shape[-1]) == along, 0.0, values)

    @property
    def stable(self) -> Array:
        """Whether a small disturbance dies out: all |multiplier| < 1, without those of constant memory (`held`)."""
        return self.converged & jnp.all(jnp.abs(self._moving) < 1, axis=-1)

    @property
    def margin(self) -> Array:
        """Smallest |1 - multiplier|; at 0 (a fold of the cycle) the derivative does not exist."""
        return jnp.min(jnp.abs(1 - self._moving), axis=-1)

    @property
    def message(self) -> str:
        """Why a single search did not converge, or that its cycle is unstable; empty for a stable cycle."""
        count = f"{int(self.iterations)} iterations"
        if bool(self.stable):
            return ""
        if bool(self.converged):
            size = float(jnp.max(jnp.abs(self._moving)))
            return f"The periodic motion is not stable: its largest |multiplier| is {size:.3g}."
        if int(self.code) != Result.REACHED_END:
            return f"No periodic motion was found: after {count} a solve stopped, {words(self.code)}."
        return (
            f"No periodic motion was found: after {count} the state still misses itself by {float(self.residual):.2g} "
            "of the scene's scales. The motion may be chaotic, or repeat after several periods only (try 2 or 3 times "
            "the period), or settle slowly (try a larger `settle`, or a `guess`)."
        )


def _eigenvalues(matrix: Array) -> Array:
    values = jnp.linalg.eigvals(matrix)
    return jnp.take_along_axis(values, jnp.argsort(-jnp.abs(values), axis=-1), axis=-1)


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


@eqx.filter_custom_jvp
def cycle(search: CycleSearch, *, effort: CycleOptions) -> PeriodicMotion:
    """Search; `y` is differentiable by every number of the mechanism and by the period."""
    return search_cycle(search, effort)


@cycle.def_jvp
def _cycle_jvp(primals, tangents, *, effort: CycleOptions):
    (search,), (rates,) = primals, tangents
    if rates.t0 is not None:
        raise ClearanceError("A periodic motion cannot be differentiated by `t0`: shift the drives' times.")
    motion = cycle(search, effort=effort)
    tangent = jax.tree.map(lambda _: None, motion)
    if jax.tree.leaves((rates.mechanism, rates.period)):
        period = None if effort.is_free else rates.period
        closed = search._replace(period=motion.period)

        def end(mechanism, period):
            return advance(closed._replace(mechanism=mechanism, period=period), motion.y, effort)[0]

        at, along = (search.mechanism, motion.period), (rates.mechanism, period)
        reached, moved = eqx.filter_jvp(end, at, along)
        moved, later = _step(closed, effort, motion.y, motion.y, motion.monodromy, moved)
        # NaN as a factor: if `where` selected it, the derivative of that would be zero.
        known = jnp.where(motion.converged & jnp.all(jnp.isfinite(reached)), 1.0, jnp.nan)
        later = later if effort.is_free or period is None else period
        tangent = eqx.tree_at(
            lambda m: (m.y, m.period), tangent, (moved * known, later * known), is_leaf=lambda x: x is None
        )
    return motion, tangent


# One compiled function: other numbers do not compile it again.
find = solo_jit(lambda search, effort: cycle(search, effort=effort))


class _State(NamedTuple):
    """The state of a search: a start `y`, the `end` after a period without whole `turns`, and the `jacobian` dP/dy."""

    y: Array
    period: Array
    end: Array
    jacobian: Array
    residual: Array
    turns: Array
    unit: Array
    damping: Array
    """Part of Newton's step to be tried next; 0: settle."""
    stalled: Array
    iterations: Array
    code: Array


def search_cycle(search: CycleSearch, effort: CycleOptions) -> PeriodicMotion:
    """Settle, then take damped Newton steps with the error-controlled Jacobian; settle again if these get stuck."""
    plan = layout(search.mechanism)
    n, size = plan.free, plan.size
    first = initial_state(search.mechanism.prepare(), search.t0) if search.guess is None else search.guess
    free = free_turns(search)

    def period_map(y, period):
        end, code = advance(search._replace(period=period), y, effort)
        return end, (end, code)

    def count_turns(y, end):
        """Whole turns in the period: of free rotations those that they made, of the others the prescribed ones."""
        return jnp.where(jnp.isnan(free), jnp.round((end - y)[:n] / TURN), free)

    def settle(y, period):
        def once(_, y):
            end, _ = advance(search._replace(period=period), y, effort)
            return end.at[:n].add(-TURN * count_turns(y, end))

        return jax.lax.fori_loop(0, effort.settle, once, y)

    def newton(s):
        step, later = _step(search, effort, s.y, s.end, s.jacobian, s.end - s.y, s.unit)
        return s.y + s.damping * step, jnp.maximum(s.period + s.damping * later, 0.5 * s.period)

    def iterate(s: _State) -> _State:
        settling = s.damping == 0
        y, period = jax.lax.cond(settling, lambda: (settle(s.y, s.period), s.period), lambda: newton(s))
        jacobian, (end, code) = jax.jacfwd(period_map, has_aux=True)(y, period)
        turns = jnp.where(settling, count_turns(y, end), s.turns)
        end = end.at[:n].add(-TURN * turns)
        unit = jnp.where(settling, scale(search, y), s.unit)
        residual = jnp.max(jnp.abs(end - y) / unit)
        better = residual <= (1 - DECREASE * s.damping) * s.residual
        shorter = jnp.where(s.damping * SHRINK < SHORTEST, 0.0, s.damping * SHRINK)
        damping = jnp.where(settling | better, 1.0, shorter)
        # Within the error of a solve P is not smooth: a step that fails there cannot be improved.
        stalled = ~settling & ~better & (s.residual <= CLOSED * search.rtol)
        new = _State(y, period, end, jacobian, residual, turns, unit, damping, stalled, s.iterations + 1, code)
        kept = s._replace(damping=damping, stalled=stalled, iterations=s.iterations + 1)
        return jax.tree.map(lambda a, b: jnp.where(settling | better, a, b), new, kept)

    def goes_on(s: _State):
        going = (s.residual > search.rtol) & ~s.stalled & jnp.all(jnp.isfinite(s.y))
        return going & (s.iterations < effort.iterations)

    nothing = jnp.asarray(jnp.inf), jnp.zeros(n), jnp.ones(size), jnp.zeros(()), jnp.asarray(False)
    count, code = jnp.asarray(0), jnp.asarray(int(Result.REACHED_END))
    start = _State(first, search.period, first, jnp.zeros((size, size)), *nothing, count, code)
    s = jax.lax.while_loop(goes_on, iterate, start)
    gaps = [gap <= SEAM for gap in seams(search.mechanism, search.t0, s.period).values()]
    converged = (s.residual <= CLOSED * search.rtol) & jnp.all(jnp.asarray(gaps))
    latched = constant_memory(s.jacobian, n)
    told = s.residual, s.iterations, s.turns, converged, s.code, latched
    return PeriodicMotion(s.y, s.period, s.jacobian, *told, is_free=effort.is_free)


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


def _step(
    search: CycleSearch, effort: CycleOptions, y: Array, end: Array, jacobian: Array, missed: Array, unit: Any = None
) -> tuple[Array, Array]:
    """The changes of the state and of the period that take up what the motion `missed`, in units of the state's scale:
    of (I - dP/dy) dy = missed, without constant memory, which keeps its value. With a free period, (I - dP/dy) dy -
    f(end) dT = missed and f(y) . dy = 0, for the rate f of the state.
    """
    unit = scale(search, y) if unit is None else unit
    jacobian = jnp.where(constant_memory(jacobian, layout(search.mechanism).free)[:, None], 0.0, jacobian)
    matrix = jnp.eye(unit.size) - jacobian * unit[None, :] / unit[:, None]
    if not effort.is_free:
        return unit * (jnp.linalg.pinv(matrix, rtol=search.rtol) @ (missed / unit)), jnp.zeros(())
    ready = search.mechanism.prepare()
    before, after = (slope(t, x, ready) / unit for t, x in ((search.t0, y), (search.t0 + search.period, end)))
    # In units of the period times the size of the rate, every row and column is about one.
    size = jnp.linalg.norm(before)
    bordered = jnp.block([[matrix, -after[:, None] / size], [before[None, :] / size, jnp.zeros((1, 1))]])
    change = jnp.linalg.pinv(bordered, rtol=search.rtol) @ jnp.append(missed / unit, 0.0)
    return unit * change[:-1], change[-1] / size
