"""Where a step crosses a switch of the contact laws: the joints' relative motion along the step, and the first change
of a sign.

The relative motion is interpolated, not the gap: so each joint's own geometry and laws say what is a switch, along one
curve. A fixed number of samples and secants, and no loop that waits for the slowest lane of a batch.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._types import Flag, Scalar
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.joints import PreparedClearance, Relative
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.interpolate import between, polynomial, quintic_coefficients

# Samples of a step, secants to the extremum of a penetration, and secants to the place of a switch.
SAMPLES = 10
EXTREMUM, SECANTS = 3, 4
# Where along a step its curves are checked: not symmetric about the middle, where the error of an odd motion is zero.
CHECKED = (0.3, 0.6)


class Curve(NamedTuple):
    """The relative motion of one joint along a step of size `h`: coefficients (6, 3) of its pose over the fraction."""

    coefficients: Float[Array, "6 3"]
    h: Scalar

    def at(self, s: Scalar) -> Relative:
        """The relative motion at a fraction of the step."""
        pose, slope = polynomial(tuple(self.coefficients[k] for k in range(6)), s)
        return relative_of(pose, slope / self.h)


def relative_of(pose: Float[Array, "3"], twist: Float[Array, "3"]) -> Relative:
    """A pose (place, angle) and twist as a relative motion."""
    return Relative((pose[0], pose[1]), pose[2], (twist[0], twist[1]), twist[2])


def _stacked(time, y, mechanism) -> Float[Array, "joints 2 3"]:
    return jnp.stack(
        [
            jnp.stack([jnp.stack([*at.place, at.angle]), jnp.stack([*at.velocity, at.spin])])
            for at in relative_motions(time, y, mechanism)
        ]
    )


def curves(times, ends, mechanism: Mechanism) -> tuple[list[Curve], Scalar]:
    """The relative motion of every clearance joint along a step, and how far it is inside the step from where the
    surfaces truly are, over the clearance: the largest. `ends` (y0, y1, slope0, slope1).

    The error estimate sees only the state. What a drive prescribes, or a body that turns freely, moves the surfaces of
    a loop without any error in the state: a step could swing past a contact and not know. (Where play is a coordinate
    of the tree its curve is the state's own.)
    """
    t0, h = times[0], times[1] - times[0]
    plan, joints = layout(mechanism), mechanism.clearance_joints()
    states = tuple(y[: plan.size] for y in ends)
    inner = CHECKED if any(joint.play is None for joint in joints) else ()
    s = np.array([0.0, 1.0, *inner])
    y = jnp.stack([states[0], states[1], *(between(states, h, x, plan) for x in inner)])
    slopes = jnp.stack([states[2], states[3], *(jnp.zeros_like(states[0]) for _ in inner)])
    now = jnp.where(s == 1, times[1], t0 + s * h)
    seen, rates = jax.vmap(
        lambda t, y, f: jax.jvp(lambda t, y: _stacked(t, y, mechanism), (t, y), (jnp.ones_like(t), f))
    )(now, y, slopes)
    place, speed, gain = seen[:, :, 0], h * seen[:, :, 1], h * h * rates[:, :, 1]
    start, end = ((place[k], speed[k], gain[k]) for k in (0, 1))
    coefficients = jnp.stack(quintic_coefficients(start, end), axis=1)
    found = [Curve(coefficients[i], h) for i in range(len(joints))]
    worst = jnp.zeros(())
    for k, x in enumerate(inner, start=2):
        for i, joint in enumerate(joints):
            if joint.play is None:
                off = found[i].at(jnp.asarray(x)).place
                apart = jnp.hypot(off[0] - place[k, i, 0], off[1] - place[k, i, 1])
                worst = jnp.maximum(worst, apart / joint.size)
    return found, worst


def first_switch(curve_of: list[Curve], y: Array, mechanism: Mechanism, begin: Scalar) -> tuple[Flag, Scalar]:
    """Whether any law changes regime inside a step, and the fraction of the step at which the first one just has.

    **Arguments:** `y`: the state that has the laws' memory; `begin`: the fraction just after the start, at which the
    regime is read that the step starts in (the start itself is the last switch), and to which a place is sought.
    """
    memory = layout(mechanism).split(y).memory
    first = jnp.asarray(jnp.inf)
    for joint, curve in zip(mechanism.clearance_joints(), curve_of, strict=True):
        first = jnp.minimum(first, first_of(joint.clearance, curve, memory[joint.name], begin))
    return first <= 1, jnp.where(first <= 1, first, 1.0)


def first_of(clearance: PreparedClearance, curve: Curve, memory, begin: Scalar) -> Scalar:
    """The fraction at which one joint's first change of regime just has been; infinite where there is none."""
    before = curve.at(begin)

    def switches(s):
        return clearance.switches(curve.at(s), memory, before)

    grid = np.arange(1, SAMPLES + 1) / SAMPLES
    samples = jnp.concatenate([begin[None], jnp.asarray(grid)])
    samples = jnp.concatenate([samples, extremum(clearance, curve, samples)])
    values = jax.vmap(switches)(samples)
    started = values[0] > 0
    changed = jnp.any((values > 0) != started[None], axis=1) & (samples > begin)
    high = jnp.min(jnp.where(changed, samples, jnp.inf))
    found = high <= 1
    high = jnp.where(found, high, 1.0)
    low = jnp.max(jnp.where(samples < high, samples, begin))
    ends = values[jnp.argmax(samples == low)], values[jnp.argmax(samples == high)]
    return jnp.where(found, located(switches, started, (low, high), ends, begin), jnp.inf)


def extremum(clearance: PreparedClearance, curve: Curve, samples: Array) -> Float[Array, " points"]:
    """The fraction at which each point's penetration comes closest to a change of sign: a graze begins and
    ends there.
    """

    def depths(s):
        return clearance.depths(curve.at(s))

    depth, rate = jax.vmap(depths)(samples)
    n = samples.shape[0]
    best = jnp.argmax(jnp.where(depth[:1] <= 0, depth, -depth), axis=0)
    before, after = jnp.maximum(best - 1, 0), jnp.minimum(best + 1, n - 1)

    def of(place, low, high, k):
        """The root of the rate between two samples, by secants that keep a bracket; the sample where there is none."""
        crosses = rate[low, k] * rate[high, k] < 0

        def secant(_, bracket):
            a, b, fa, fb = bracket
            s = a - fa * (b - a) / jnp.where(fb != fa, fb - fa, 1.0)
            f = depths(s)[1][k]
            left = fa * f > 0
            # Illinois: the end that stays counts half, or it would stay for ever.
            new_a, new_b = jnp.where(left, s, a), jnp.where(left, b, s)
            return new_a, new_b, jnp.where(left, f, 0.5 * fa), jnp.where(left, 0.5 * fb, f)

        start = samples[low], samples[high], rate[low, k], rate[high, k]
        a, b, fa, fb = jax.lax.fori_loop(0, EXTREMUM, secant, start)
        return jnp.where(crosses, jnp.where(jnp.abs(fa) < jnp.abs(fb), a, b), place)

    count = depth.shape[1]
    return jnp.stack([of(samples[best[k]], before[k], after[k], k) for k in range(count)])


def located(switches, started, bracket, ends, precision: Scalar) -> Scalar:
    """The fraction just past the first change of a sign in a bracket, by secants on all functions that change there."""

    def secant(_, carry):
        low, high, at_low, at_high, last = carry
        crosses = (at_low > 0) != (at_high > 0)
        share = jnp.where(crosses, at_low / jnp.where(crosses, at_low - at_high, 1.0), jnp.inf)
        root = low + jnp.min(jnp.clip(share, 0.0, 1.0)) * (high - low)
        # Past the root by as much as it is still uncertain.
        past = jnp.clip(jnp.abs(root - last), 0.25 * precision, 0.02 * (high - low) + 0.25 * precision)
        s = jnp.minimum(root + past, high)
        now = switches(s)
        beyond = jnp.any((now > 0) != started)
        low, high = jnp.where(beyond, low, s), jnp.where(beyond, s, high)
        return low, high, jnp.where(beyond, at_low, now), jnp.where(beyond, now, at_high), root

    low, high = bracket
    return jax.lax.fori_loop(0, SECANTS, secant, (low, high, *ends, high))[1]
