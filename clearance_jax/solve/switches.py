"""Where a step crosses a switch of the contact laws: the signals along the step, and the first change of regime."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.dynamics.equations import signals
from clearance_jax.mechanism.mechanism import Mechanism, layout
from clearance_jax.solve.interpolate import between, hermite, quintic


class Samples(NamedTuple):
    """The watched signals of one joint along a step."""

    overlap: Array
    overlap_rate: Array
    slip_velocity: Array


def first_switch(times, curves, memory, mechanism: Mechanism, pad, points: int):
    """Whether any law changes regime inside a step, and when to end the step so that it ends just past the change.

    **Arguments:** `times` (t0, t1); `curves`: from `watched`; `memory`: by joint; `pad`: how far past [s]; `points`:
    samples.
    """
    t0, t1 = times
    h = t1 - t0
    joints = [j.clearance for j in mechanism.clearance_joints() if j.clearance is not None]
    memories = [memory[j.name] for j in mechanism.clearance_joints()]

    def regimes(s):
        return [
            joint.regime(*along(curve, h, s), kept) for joint, curve, kept in zip(joints, curves, memories, strict=True)
        ]

    # The regime at the start is read just after it: the start itself is the last switch.
    begin = jnp.minimum(pad / h, 0.5)
    grid = np.arange(1, points + 1) / points
    s = jnp.concatenate([begin[None], jnp.asarray(grid), *(extremum(curve, h, grid)[None] for curve in curves)])
    sampled = regimes(s)
    started = [regime[0] for regime in sampled]

    def changed(now):
        return jnp.any(jnp.stack([regime != start for regime, start in zip(now, started, strict=True)]), axis=0)

    # The first sample past a change; no sort (XLA then compiles the whole solve as one function, see `configure`).
    high = jnp.min(jnp.where(changed(sampled) & (s > begin), s, jnp.inf))
    found = high <= 1
    high = jnp.where(found, high, 1.0)
    low = jnp.maximum(begin, (jnp.ceil(high * points) - 1) / points)

    def wide(bracket):
        low, high = bracket
        return found & (high - low > 0.25 * begin)

    def halve(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        beyond = changed(regimes(middle))
        return jnp.where(beyond, low, middle), jnp.where(beyond, middle, high)

    _, high = jax.lax.while_loop(wide, halve, (low, high))
    at = t0 + high * h + pad
    return found & (at < t1 - pad), at


def watched(times, ends, mechanism: Mechanism):
    """Signals and their rates at both ends of a step, per joint; `ends` (y0, y1, slope0, slope1)."""
    (t0, t1), (y0, y1, slope0, slope1) = times, ends
    here, here_rate = signals_and_rates(t0, y0, slope0, mechanism)
    there, there_rate = signals_and_rates(t1, y1, slope1, mechanism)
    return list(zip(here, here_rate, there, there_rate, strict=True))


# Where along a step its curves are checked: not symmetric about the middle, where the error of an odd motion is zero.
CHECKED = (0.3, 0.6)


def misfit(times, ends, curves, mechanism: Mechanism) -> Array:
    """How far the overlaps are from their curves inside a step, over the clearance: the largest.

    The error estimate sees only the state. What a drive prescribes, or a body that turns freely, moves the surfaces
    without any error in the state: a step could swing past a contact and not know.
    """
    t0, h = times[0], times[1] - times[0]
    worst, free = jnp.zeros(()), layout(mechanism).free
    joints = [j.clearance for j in mechanism.clearance_joints() if j.clearance is not None]
    for s in CHECKED:
        seen = signals(t0 + s * h, between(ends, h, s, free), mechanism)
        for joint, curve, now in zip(joints, curves, seen, strict=True):
            off = jnp.abs(along(curve, h, s).overlap - now.overlap) / joint.radial_clearance
            worst = jnp.maximum(worst, off)
    return worst


@jax.jit
def signals_and_rates(t, y, slope, mechanism):
    """The watched signals of every clearance joint, and their time derivatives along the motion."""
    return jax.jvp(lambda t, y: signals(t, y, mechanism), (t, y), (jnp.ones_like(t), slope))


def along(curve, h, s) -> Samples:
    """The signals at fractions `s` of the step: quintic Hermite for the overlap, cubic for the slip."""
    a, a_rate, b, b_rate = curve
    start, end = (
        (at.overlap, at.overlap_rate * h, rate.overlap_rate * h * h) for at, rate in ((a, a_rate), (b, b_rate))
    )
    overlap, rate = quintic(start, end, s)
    slip = hermite(a.slip_velocity, a_rate.slip_velocity * h, b.slip_velocity, b_rate.slip_velocity * h, s)
    return Samples(overlap, rate / h, slip)


def extremum(curve, h, grid) -> Array:
    """The fraction of the step at which the gap comes closest to a change of sign (a graze begins and ends there)."""
    samples = along(curve, h, jnp.asarray(grid))
    apart = curve[0].overlap <= 0
    closeness = jnp.where(apart, samples.overlap, -samples.overlap)
    k = jnp.argmax(closeness)
    n = len(grid)
    # Secant on the rate over the neighbouring samples; where it has no root there the sample itself serves.
    low, high = jnp.maximum(k - 1, 0), jnp.minimum(k + 1, n - 1)
    ra, rb = samples.overlap_rate[low], samples.overlap_rate[high]
    sa, sb = jnp.asarray(grid)[low], jnp.asarray(grid)[high]
    crosses = ra * rb < 0
    s = jnp.where(crosses, sa - ra * (sb - sa) / jnp.where(crosses, rb - ra, 1.0), jnp.asarray(grid)[k])
    for _ in range(2):
        here = along(curve, h, s)
        step = 1e-4
        slope = (along(curve, h, s + step).overlap_rate - here.overlap_rate) / step
        moved = s - here.overlap_rate / jnp.where(slope != 0, slope, 1.0)
        s = jnp.where(crosses & (moved > sa) & (moved < sb), moved, s)
    return s
