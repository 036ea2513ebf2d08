"""How fast neighbouring motions diverge, up to when a derivative is meaningful, and how hard contacts touch."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.analysis.scatter import SamplingPlan
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.observers import TouchCounter, Touches
from clearance_jax.solve.settings import Settings, evenly
from clearance_jax.solve.simulate import run

# Times at which the spread of the pins is sampled.
SAMPLES = 400


@eqx.filter_jit
def neighbours(
    mechanism: Mechanism, names: tuple[str, ...], points: Array, scatter: Array, t1: Any, options: Settings
) -> tuple[Array, Array, tuple[Touches, ...]]:
    """How far motions at points (lanes, parameters) are from their neighbours, and their touches.

    Returns times (SAMPLES,); the distance of the pins of neighbouring motions over their clearance, of the joint where
    it is largest (lanes, SAMPLES), to first order for independent changes `scatter` of the parameters; and every
    joint's `Touches`, shape (lanes,).
    """
    times = evenly(options.t0, t1, SAMPLES)
    joints = mechanism.clearance_joints()
    observers = tuple(TouchCounter(i) for i in range(len(joints)))

    def at(point):
        def pins(point):
            changed = replace(mechanism, dict(zip(names, point, strict=True)))
            solution = run(changed, t1, options._replace(save_at=times, energy_balance=False), observers=observers)
            ready = changed.prepare()
            return jax.vmap(lambda t, y: observe(t, y, ready)["eccentricity"])(times, solution.y), solution.records

        slopes, record = jax.jacfwd(pins, has_aux=True)(point)
        return jnp.sqrt(jnp.sum((slopes * scatter[None, None, None]) ** 2, axis=(2, 3))), record

    apart, record = jax.vmap(at)(points)
    sizes = jnp.stack([joint.size for joint in joints])
    return times, jnp.max(apart / sizes[None, None], axis=2), record


class Divergence(NamedTuple):
    """The divergence and touches of motions over the scatter, named as in `GradientReport`; the defaults are those of a
    mechanism without clearance.
    """

    lyapunov: float = 0.0
    horizon: float = np.inf
    precision_horizon: float = np.inf
    impacts: tuple[int, int] = (0, 0)
    slowest_impact: float = np.inf
    nearest_miss: float = np.inf


def divergence(plan: SamplingPlan, mechanism, draws: np.ndarray, t1, limit: float, options: Settings) -> Divergence:
    """The divergence of the motion and of those at `draws` (samples, parameters), by one program. Motions have parted
    once their spread is above `limit` (over the clearance).
    """
    if not mechanism.clearance_joints():
        return Divergence()
    names, rtol = plan.names, plan.rtol
    points = jnp.asarray(plan.centre + np.concatenate([np.zeros((1, len(names))), draws]))
    scatter = jnp.asarray(plan.scatter * plan.unit)
    times, apart, touches = neighbours(mechanism, names, points, scatter, t1, options)
    times, spread = np.asarray(times), np.sqrt(np.mean(np.asarray(apart) ** 2, axis=0))
    exponent, horizon = horizon_of(times, spread, limit)
    precision = np.log(1 / rtol) / exponent if exponent * (times[-1] - times[0]) > 1 else np.inf
    count = np.sum([np.asarray(joint.count) for joint in touches], axis=0)
    slowest, miss = (min(float(joint[i][0]) for joint in touches) for i in (1, 2))
    return Divergence(exponent, horizon, precision, (int(count.min()), int(count.max())), slowest, miss)


def horizon_of(times: np.ndarray, spread: np.ndarray, limit: float) -> tuple[float, float]:
    """Growth rate of a spread (samples,) over the second half [1/s], and when it passes `limit` for good [s]:
    extrapolated if that is after the end, infinite if the spread does not grow exponentially.
    """
    half = len(times) // 2
    later = np.log(np.maximum(spread[half:], np.finfo(float).tiny))
    # A straight line averages over the jumps at impacts.
    rate = float(np.polyfit(times[half:], later, 1)[0])
    below = np.flatnonzero(spread <= limit)
    first = below[-1] + 1 if below.size else 0
    if first < len(times):
        return rate, float(times[first])
    # Growth by less than a factor e over the whole motion is drift, not divergence.
    if rate * (times[-1] - times[0]) < 1:
        return rate, float("inf")
    return rate, float(times[-1] + (np.log(limit) - later[-1]) / rate)
