"""Search for the posture of a chain at its aim: a damped Newton method, and the rates of the posture along a path.

Levenberg (1944) and Marquardt (1963), with a damping proportional to the square of the residual. It keeps the
convergence quadratic where conditions repeat each other or joints are redundant (Fan and Yuan 2005,
doi:10.1007/s00607-004-0083-1). Each step is the smallest one that solves its problem. A coordinate stays at a limit
that its step would leave.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.postures.chain import AbstractChain, Aim, PreparedChain, look_at
from clearance_jax.mechanism.motion.paths import PreparedPath, matrix_of
from clearance_jax.mechanism.state import layout, move, parts, position_rates
from clearance_jax.spatial import as_array

Positions = Float[Array, " positions"]
Sought = Float[Array, " sought"]
# Iterations at most; about ten are usual, more if the aim is out of reach.
MOST = 100
# The first factor of the damping, and its change after a step that fails and after one that helps.
DAMPING, WORSE, BETTER = 1.0, 4.0, 0.125
# Singular values below this part of the largest are noise: no step goes along their directions.
NOISE = 1e-9
# Residuals (in chain sizes and radians): round-off; and solved, as far as limits or closures allow.
ROUND_OFF, SOLVED = 1e-14, 1e-10
# In a step, how often coordinates are added to those that stay at a limit.
HOLDS = 3


class PostureSolution(NamedTuple):
    """End of a search: positions, `gap` and Jacobian there, sought coordinates `at_limit`, iterations, `closed`."""

    q: Positions
    gap: Float[Array, " rows"]
    jacobian: Float[Array, "rows sought"]
    at_limit: Bool[Array, " sought"]
    iterations: Array
    closed: Array

    @property
    def left(self) -> Array:
        """The norm of the residual."""
        return jnp.linalg.norm(self.gap)

    @property
    def solved(self) -> Array:
        """Whether the aim is reached."""
        return (self.left < SOLVED) & self.closed


def sought_values(chain: AbstractChain, q: Positions) -> Sought:
    """The values of the sought coordinates; zeros for a ball, which has no limits."""
    values = []
    for part in parts(chain.mechanism):
        values += [jnp.zeros(())] * 3 if part.coordinate.is_ball else [q[part.q.start]]
    return jnp.stack(values)[np.array(chain.sought)]


def bounds(chain: AbstractChain) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper limits of the sought coordinates."""
    limits = chain.limits
    lower = [-np.inf if limit.lower is None else limit.lower for limit in limits]
    return np.array(lower), np.array([np.inf if limit.upper is None else limit.upper for limit in limits])


def change(chain: AbstractChain, q: Positions, change: Sought) -> Positions:
    """Positions after a change of the sought coordinates."""
    whole = jnp.zeros(layout(chain.mechanism).free).at[np.array(chain.sought)].set(change)
    return as_array(move(chain.mechanism, tuple(q), tuple(whole)))


def _damped_step(jacobian: Array, gap: Array, damping: Array) -> Sought:
    """The step d that minimises (J d + gap)^2 + damping d^2."""
    u, s, v = jnp.linalg.svd(jacobian, full_matrices=False)
    factor = s / jnp.maximum(s**2 + damping + (NOISE * s[0]) ** 2, jnp.finfo(s.dtype).tiny)
    return -((factor * (u.T @ gap)) @ v)


def find(chain: PreparedChain, aim: Aim | None, time: Scalar, start: Positions) -> PostureSolution:
    """Search from a start; a coordinate outside its limits is first brought to them."""
    lower, upper = bounds(chain)
    limited = bool(np.any(np.isfinite(lower)) or np.any(np.isfinite(upper)))
    units = chain.units

    def leaving(values, step):
        return ((values <= lower) & (step < 0)) | ((values >= upper) & (step > 0))

    def step_of(now: PostureSolution, damping):
        values = sought_values(chain, now.q)
        weight = damping * jnp.sum(now.gap**2)

        def step_without(fixed):
            return _damped_step(jnp.where(fixed[None], 0.0, now.jacobian), now.gap, weight)

        at_limit = leaving(values, -(now.gap @ now.jacobian))
        if limited:
            at_limit = jax.lax.fori_loop(0, HOLDS, lambda _, x: x | leaving(values, step_without(x)), at_limit)
        step = step_without(at_limit) * units
        return jnp.clip(values + step, lower, upper) - values, at_limit

    def once(carry):
        now, damping, _ = carry
        step, at_limit = step_of(now, damping)
        q = change(chain, now.q, step)
        look = look_at(chain, aim, time, q)
        before, after = now.left, jnp.linalg.norm(look.gap)
        better = after < before
        new = PostureSolution(q, look.gap, look.jacobian, at_limit, now.iterations, look.closed)
        # The first iteration only evaluates the start: nothing is known before.
        first = now.iterations == 0
        new = jax.tree.map(lambda a, b: jnp.where(better | first, a, b), new, now)._replace(at_limit=at_limit)
        damping = jnp.where(first, damping, damping * jnp.where(better, BETTER, WORSE))
        stuck = (damping > 1e12) | ((after > 0.5 * before) & (before < SOLVED))
        done = (new.left < ROUND_OFF) | (~first & stuck)
        return new._replace(iterations=now.iterations + 1), damping, done

    rows = jax.eval_shape(lambda q: look_at(chain, aim, time, q).gap, start).shape[0]
    nothing = jnp.zeros((rows, len(chain.sought)))
    none = jnp.zeros(len(chain.sought), bool)
    # With no residual the first step is zero.
    begin = PostureSolution(start, jnp.zeros(rows), nothing, none, jnp.asarray(0), jnp.asarray(True))
    carry = begin, jnp.asarray(DAMPING), jnp.asarray(False)
    solution, _, _ = jax.lax.while_loop(lambda carry: ~carry[2] & (carry[0].iterations < MOST), once, carry)
    return solution


def solve(chain: PreparedChain, aim: Aim | None, time: Scalar, start: Positions) -> PostureSolution:
    """`find` with derivatives by the mechanism's numbers, the aim and the time (not by the start): those of the
    implicit function, by one more Newton step.
    """
    solution = jax.lax.stop_gradient(find(*without_derivatives((chain, aim, time, start))))
    jacobian = jnp.where(solution.at_limit[None], 0.0, solution.jacobian)
    left = look_at(chain, aim, time, solution.q).gap - solution.gap
    step = _damped_step(jacobian, left, jnp.zeros(())) * chain.units
    return solution._replace(q=change(chain, solution.q, step))


# Along a path ---------------------------------------------------------------------------------------------------------


def aim_at(path: PreparedPath, time: Scalar, beside: Scalar) -> Aim:
    """The aim on a path at a time."""
    place, quaternion = path.pose(time, beside)
    return Aim(place, matrix_of(quaternion) if path.oriented else None)


def rates(
    chain: PreparedChain, path: PreparedPath, time: Scalar, beside: Scalar, q: Positions
) -> tuple[Sought, Sought]:
    """First and second rates of the sought coordinates on a path: the smallest that follow it, and their exact
    derivative.
    """
    plan = layout(chain.mechanism)

    def first(time, q):
        place, quaternion, velocity, spin = path.motion(time, beside)
        aim = Aim(place, matrix_of(quaternion) if path.oriented else None)
        look = look_at(chain, aim, time, q)
        flat = chain.mechanism.is_plane
        wanted = [velocity[: 2 if flat else 3] / chain.size]
        wanted += [spin[2 if flat else 0 :]] if path.oriented else []
        asked = jnp.concatenate([*wanted, jnp.zeros(look.drift.shape[0] - sum(w.shape[0] for w in wanted))])
        return (jnp.linalg.pinv(look.jacobian, rtol=NOISE) @ (asked - look.drift)) * chain.units

    speeds = first(time, q)
    whole = jnp.zeros(plan.free).at[np.array(chain.sought)].set(speeds)
    along = as_array(position_rates(chain.mechanism, tuple(q), tuple(whole)))
    return jax.jvp(first, (time, q), (jnp.ones_like(time), along))
