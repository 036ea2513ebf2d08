"""The search for a limit cycle: Newton's method on the period map, multipliers, derivative.

The motion is a fixed point y = P(y) of the period map P, which takes the state [q, v, memory] at t0 to the one a period
later. Newton's method uses the error-controlled Jacobian of a solve, so that it also finds cycles that are unstable or
settle slowly. The implicit function theorem gives the derivative of the cycle from that of one period,
dy = (I - dP/dy)^-1 (dP/dp) dp.

A cycle that nothing drives (of a servo with backlash, of a stick-slip) has a period of its own. It is one unknown more,
and one condition more keeps the state from sliding along the cycle: the change of the state has no part along its rate.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import solo_jit
from clearance_jax.analysis.period_map import (
    SEAM,
    TURN,
    CycleOptions,
    CycleSearch,
    advance,
    constant_memory,
    free_turns,
    nearest_return,
    newton_step,
    orbit,
    scale,
    seams,
    size_of,
)
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.codes import Result, words
from clearance_jax.solve.first_state import initial_state

# The search stops at a residual of rtol. If no step lowers it further, it must be within this many rtol, which is the
# error that a solve may have.
CLOSED = 100.0
# A damped step must lower the residual by this part of its damping. A rejected step is shortened by SHRINK; below
# SHORTEST it is given up, and the motion settles for longer.
DECREASE, SHRINK, SHORTEST = 0.25, 0.25, 1 / 64


class PeriodicMotion(Module):
    """A periodic motion and how its search ended. Only `y` and `period` have derivatives; other fields are constants.

    - `y`: the state [q, v, memory] at t0 in SI units, shape (n,); if not converged, the last one of the search.
    - `period` [s]: as given, or as found.
    - `monodromy`: the derivative dP/dy of the state after one period P(y) by the state before, shape (n, n). Its error
      is controlled.
    - `residual`: largest |P(y) - y|, in units of the lengths and speeds of the scene; with a period of its own in units
      of how far each component moves, if that is less. The error of `y` is about `residual` / `margin`, in these units.
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
        if self.is_free and not np.isfinite(self.residual):
            return f"No periodic motion was found: after {count} the mechanism is at rest."
        scales = "the cycle's size" if self.is_free else "the scene's scales"
        return (
            f"No periodic motion was found: after {count} the state still misses itself by {float(self.residual):.2g} "
            f"of {scales}. The motion may be chaotic, or repeat after several periods only (try 2 or 3 times "
            "the period), or settle slowly (try a larger `settle`, or a `guess`)."
        )


def _eigenvalues(matrix: Array) -> Array:
    values = jnp.linalg.eigvals(matrix)
    return jnp.take_along_axis(values, jnp.argsort(-jnp.abs(values), axis=-1), axis=-1)


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
        moved, later = newton_step(closed, effort, motion.y, motion.y, motion.monodromy, moved)
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
        step, later = newton_step(search, effort, s.y, s.end, s.jacobian, s.end - s.y)
        return s.y + s.damping * step, jnp.maximum(s.period + s.damping * later, 0.5 * s.period)

    def iterate(s: _State) -> _State:
        settling = s.damping == 0
        y, period = jax.lax.cond(settling, lambda: (settle(s.y, search.period), search.period), lambda: newton(s))
        unit = jnp.where(settling, scale(search, y), s.unit)
        if effort.is_free:
            times, states = orbit(search._replace(period=period), effort, y)
            nearest = nearest_return(search, times, states, count_turns)
            period, unit = jnp.where(settling, nearest, period), scale(search, y) * size_of(search, states)
        jacobian, (end, code) = jax.jacfwd(period_map, has_aux=True)(y, period)
        turns = jnp.where(settling, count_turns(y, end), s.turns)
        end = end.at[:n].add(-TURN * turns)
        # At rest, which has any period, there is no unit.
        residual = jnp.max(jnp.where(unit > 0, jnp.abs(end - y) / unit, jnp.inf))
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
