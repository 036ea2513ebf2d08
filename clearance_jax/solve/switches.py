"""Where a step crosses a switch of the contact laws: the joints' relative motion along the step, and the first change
of a sign.

The relative motion is interpolated, not the gap: so each joint's own geometry and laws say what is a switch, along one
curve. The place of a change is found by bisection.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._sharing import shared
from clearance_jax._types import Each, EachFlag, Rows
from clearance_jax.dynamics.kinematics import relative_accelerations, relative_motions
from clearance_jax.joints import PreparedClearance, Relative
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.interpolate import between, polynomial, quintic_coefficients
from clearance_jax.solve.lane_axis import each_lane

# Samples of a step, and secants to the extremum of a penetration.
SAMPLES, EXTREMUM = 10, 3
# Where along a step its curves are checked: not symmetric about the middle, where the error of an odd motion is zero.
CHECKED = (0.3, 0.6)


class Curve(NamedTuple):
    """The relative motion of one joint along a step of size `h`: coefficients (6, 3, *lanes) of its pose over the
    fraction.
    """

    coefficients: Float[Array, "6 3 *lanes"]
    h: Each

    def at(self, s: Each) -> Relative:
        """The relative motion at a fraction of the step."""
        pose, slope = shared(polynomial(tuple(self.coefficients[k] for k in range(6)), s))
        return relative_of(pose, slope / self.h)


def relative_of(pose: Array, twist: Array) -> Relative:
    """A pose (place, angle) and twist as a relative motion."""
    return Relative((pose[0], pose[1]), pose[2], (twist[0], twist[1]), twist[2])


def curves(times, ends, mechanism: Mechanism) -> tuple[list[Curve], Each]:
    """The relative motion of every clearance joint along a step, and how far it is inside the step from where the
    surfaces truly are, over the clearance: the largest. `ends` (y0, y1, slope0, slope1).

    The error estimate sees only the state. What a drive prescribes, or a body that turns freely, moves the surfaces of
    a loop without any error in the state: a step could swing past a contact and not know. (Where play is a coordinate
    of the tree its curve is the state's own.)
    """
    (t0, t1), h = times, times[1] - times[0]
    plan, joints = layout(mechanism), mechanism.clearance_joints()
    y0, y1, slope0, slope1 = (y[: plan.size] for y in ends)

    accelerations = each_lane(relative_accelerations, h)
    begin = accelerations(t0, y0, slope0, mechanism)
    finish = accelerations(t1, y1, slope1, mechanism)
    found = [curve_between(a, b, h) for a, b in zip(begin, finish, strict=True)]
    loops = [i for i, joint in enumerate(joints) if joint.play is None]
    if not loops:
        return found, jnp.zeros_like(h)
    sizes = each_lane(lambda mechanism: [joint.size for joint in mechanism.clearance_joints()], h)(mechanism)

    def check(k, worst):
        s = jnp.asarray(CHECKED)[k]
        inside = between((y0, y1, slope0, slope1), h, s, plan)
        true = each_lane(relative_motions, h)(t0 + s * h, inside, mechanism)
        for i in loops:
            x, y = (a - b for a, b in zip(found[i].at(s).place, true[i].place, strict=True))
            worst = jnp.maximum(worst, (x * x + y * y) / sizes[i] ** 2)
        return worst

    return found, jnp.sqrt(jax.lax.fori_loop(0, len(CHECKED), check, jnp.zeros_like(h)))


def curve_between(begin: tuple[Relative, Relative], end: tuple[Relative, Relative], h: Each) -> Curve:
    """The quintic through relative motions, each with its rate, at both ends of a step."""
    ends = [
        (
            jnp.stack([*at.place, at.angle]),
            h * jnp.stack([*at.velocity, at.spin]),
            h * h * jnp.stack([*rate.velocity, rate.spin]),
        )
        for at, rate in (begin, end)
    ]
    return Curve(shared(jnp.stack(quintic_coefficients(*ends))), h)


def first_switch(curve_of: list[Curve], y: Array, mechanism: Mechanism, begin: Each) -> tuple[EachFlag, Each]:
    """Whether any law changes regime inside a step, and the fraction of the step at which the first one just has.

    **Arguments:** `y`: the state that has the laws' memory; `begin`: the fraction just after the start, at which the
    regime is read that the step starts in (the start itself is the last switch), and to which a place is sought.
    """
    memory = layout(mechanism).split(y).memory
    first = jnp.full_like(begin, jnp.inf)
    for joint, curve in zip(mechanism.clearance_joints(), curve_of, strict=True):
        first = jnp.minimum(first, first_of(joint.clearance, curve, memory[joint.name], begin))
    return first <= 1, jnp.where(first <= 1, first, 1.0)


def first_of(clearance: PreparedClearance, curve: Curve, memory: Rows, begin: Each) -> Each:
    """The fraction at which one joint's first change of regime just has been; infinite where there is none."""
    points_at = each_lane(lambda own, at: own.joint.points(at), begin)
    switches_at = each_lane(PreparedClearance.switches, begin)

    def points(s):
        return shared(points_at(clearance, curve.at(s)))

    before = points(begin)
    started = shared(tuple(_sign(f) for f in switches_at(clearance, before, memory, before)))

    def changed(points):
        now = switches_at(clearance, points, memory, before)
        return jnp.any(jnp.stack([_sign(f) != start for f, start in zip(now, started, strict=True)]), axis=0)

    def beyond(s):
        return changed(points(s))

    samples = np.arange(1, SAMPLES + 1).reshape(-1, *[1] * begin.ndim) / SAMPLES * jnp.ones_like(begin)
    sampled = jax.vmap(points)(samples)
    switched = jnp.where(jax.vmap(changed)(sampled) & (samples > begin), samples, jnp.inf)
    high = functools.reduce(jnp.minimum, shared(switched))
    depth, rate = (
        jnp.concatenate([jnp.stack(first)[None], jnp.stack(others, axis=1)])
        for first, others in (
            ([p.penetration for p in before], [p.penetration for p in sampled]),
            ([p.penetration_rate for p in before], [p.penetration_rate for p in sampled]),
        )
    )

    def turning(s, k):
        return points(s)[k].penetration_rate

    places = jnp.concatenate([begin[None], samples])
    high = shared(jnp.minimum(high, extremum(places, depth, rate, turning, beyond)))
    low = shared(functools.reduce(jnp.maximum, jnp.where(samples < high, samples, begin)))
    # Most steps cross nothing.
    return jax.lax.cond(jnp.any(high <= 1), lambda: located(beyond, (low, high), begin), lambda: high)


def _sign(value: Array) -> Array:
    """1 where a function is positive, else 0."""
    return jnp.where(value > 0, 1.0, 0.0)


def extremum(places: Array, depth: Array, rate: Array, turning, beyond) -> Each:
    """The fraction, between two places of a step, at which a penetration comes closest to a change of sign, if the
    regime has changed there (a graze begins and ends there); infinite otherwise.

    **Arguments:** `depth`, `rate`: at every place (first axis), of every point; `turning(s, k)`: the rate of point `k`;
    `beyond(s)`: whether the regime is another there.
    """
    near, last = jnp.where(depth[:1] <= 0, depth, -depth), len(places) - 1
    none = jnp.full_like(places[0], jnp.inf)
    found = none
    for k in range(depth.shape[1]):
        best = first_highest(near[:, k])
        before, after = jnp.maximum(best - 1, 0), jnp.minimum(best + 1, last)
        ends = shared((*(at(places, i) for i in (before, after)), *(at(rate[:, k], i) for i in (before, after))))
        turns = ends[2] * ends[3] < 0

        def turned(ends=ends, turns=turns, k=k):
            s = shared(root(lambda s: turning(s, k), ends))
            return jnp.where(turns & beyond(s), s, jnp.inf)

        found = jnp.minimum(found, jax.lax.cond(jnp.any(turns), turned, lambda: none))
    return found


# Both entry by entry: an argmax, a gather and a reduction over places are loops of their own for every lane.
def first_highest(values: Array) -> Array:
    """The first place, along the first axis, of each lane's largest value."""
    best, place = values[0], jnp.zeros(values.shape[1:], int)
    for i, value in enumerate(values[1:], 1):
        higher = value > best
        best, place = jnp.where(higher, value, best), jnp.where(higher, i, place)
    return place


def at(values: Array, place: Array) -> Each:
    """The value, along the first axis, at a place of each lane's own."""
    out = values[0]
    for i, value in enumerate(values[1:], 1):
        out = jnp.where(place == i, value, out)
    return out


def root(function, ends: tuple) -> Each:
    """Where a function changes sign between two places (a, b, its values there), by secants that keep a bracket."""

    def secant(_, bracket):
        a, b, fa, fb = bracket
        s = shared(a - fa * (b - a) / jnp.where(fb != fa, fb - fa, 1.0))
        f = shared(function(s))
        left = fa * f > 0
        # Illinois: the end that stays counts half, or it would stay for ever.
        new_a, new_b = jnp.where(left, s, a), jnp.where(left, b, s)
        return new_a, new_b, jnp.where(left, f, 0.5 * fa), jnp.where(left, 0.5 * fb, f)

    a, b, fa, fb = jax.lax.fori_loop(0, EXTREMUM, secant, ends)
    return jnp.where(jnp.abs(fa) < jnp.abs(fb), a, b)


def located(beyond, bracket: tuple, precision: Each) -> Each:
    """The fraction just past the first change of regime in a bracket, by bisection.

    Not by secants on the functions that change: just before a pin leaves, a clipped force may act once more for a
    microsecond, and the functions at the bracket's ends do not know of it (tried: solves 30 times worse, now and then).
    """
    low, high = bracket

    def wide(bracket):
        return jnp.any(bracket[1] > 0.25 * precision)

    def halve(bracket):
        # The width halves whatever is found, and one selection moves the bracket: a compiler may compute a comparison
        # twice, round the two otherwise, and so move neither of two ends that are chosen apart, for ever.
        low, width = bracket
        # A lane is halved as often as alone, however long the others take.
        going, half = width > 0.25 * precision, 0.5 * width
        moved = low + jnp.where(going & ~beyond(low + half), half, 0.0)
        return moved, jnp.where(going, half, width)

    # A lane without a switch (an infinite end) comes along.
    width = jnp.where(high <= 1, high - low, 0.0)
    low, width = jax.lax.while_loop(wide, halve, (low, width))
    return jnp.where(high <= 1, low + width, high)
