"""Location of events of the contact laws in a step: the joints' relative motion along the step, and the first change of
sign.

The relative motion is interpolated, not the gap, so that each joint's own geometry and laws define the events along one
curve. Bisection finds the place of a change.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Each, EachFlag, Rows
from clearance_jax._compile.alike import alike, stack_trees
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import each_lane, least, together
from clearance_jax.dynamics.kinematics import Groups, relative_accelerations, relative_motions
from clearance_jax.dynamics.relative_motion import turning_rows
from clearance_jax.joints import PreparedClearance, Relative
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.steps.interpolate import between, polynomial, quintic_coefficients, tops
from clearance_jax.spatial import add, dot, subtract, three

# Samples of a step.
SAMPLES = 4
# Where along a step its curves are checked: not in the middle, where the error of an odd motion is zero.
CHECKED = 0.4


# Coefficients of a polynomial over the fraction of a step, by power: of place and angle, in space of place and rows.
Coefficients: TypeAlias = tuple[Float[Array, "numbers *lanes"], ...]  # noqa: F821
PLANE = 3


class StepCurve(NamedTuple):
    """The relative motion of one joint along a step of size `h` (`rate`: 1 / h), as a polynomial of its pose."""

    pose: Coefficients
    h: Each
    rate: Each

    @staticmethod
    def of(pose: Sequence[Array], h: Each) -> "StepCurve":
        """The curve from the coefficients of its pose, the constant first."""
        return StepCurve(share(tuple(pose)), h, share(1 / h))

    def at(self, s: Each | float) -> Relative:
        """The relative motion at a fraction of the step; for several joints a fraction each."""
        s = jnp.asarray(s)
        s = s.reshape((1,) * (self.pose[0].ndim - s.ndim) + s.shape)
        pose, change = polynomial(self.pose, s)
        return relative_of(*share((pose, change * self.rate)))


def relative_of(pose: Array, twist: Array) -> Relative:
    """A pose and its rate as a relative motion."""
    if pose.shape[0] == PLANE:
        return Relative((pose[0], pose[1], 0.0), pose[2], (twist[0], twist[1], 0.0), (0.0, 0.0, twist[2]))
    rows, rates = (tuple(three(x[k : k + 3]) for k in (3, 6, 9)) for x in (pose, twist))
    spin = dot(rates[2], rows[1]), dot(rates[0], rows[2]), dot(rates[1], rows[0])
    return Relative(three(pose), 0.0, three(twist), spin, rows)


def pose_rates(at: Relative, rate: Relative) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """First and second rate of the pose."""
    if at.rows is None or rate.rows is None:
        return (*at.velocity[:2], at.spin[2]), (*rate.velocity[:2], rate.spin[2])
    bend = zip(turning_rows(rate.spin, at.rows), turning_rows(at.spin, rate.rows), strict=True)
    bent = itertools.chain(*(add(a, b) for a, b in bend))
    return (*at.velocity, *itertools.chain(*rate.rows)), (*rate.velocity, *bent)


def event_groups(mechanism: PreparedMechanism) -> Groups:
    """The contacts whose events are located together: each by itself, or alike ones of several points."""
    joints = mechanism.contacts()
    several = [i for i, joint in enumerate(joints) if joint.has_points]
    groups: list[int | list[int]] = [i for i, joint in enumerate(joints) if not joint.has_points]
    ways = [[(c.slides, c.turns) for c in joints[i].joint.own_coordinates()] for i in several]
    of_kind = alike([(joints[i].clearance, joints[i].in_tree, way) for i, way in zip(several, ways, strict=True)])
    return groups + [[several[k] for k in members] for members in of_kind]


def curves(times, ends, mechanism: PreparedMechanism) -> tuple[list[StepCurve], Each]:
    """The relative motion of every group of clearance joints along a step, and the largest misfit of the curves inside
    the step, over the clearance. `ends` (y0, y1, slope0, slope1).

    The error estimate sees only the state. A drive, or a body that turns freely, moves the surfaces of a loop without
    any error in the state, so a step could swing past a contact. (In the tree, play is a coordinate: the curve is the
    state's own.)
    """
    t0, h = times[0], times[1] - times[0]
    plan, joints, groups = layout(mechanism), mechanism.contacts(), event_groups(mechanism)
    y0, y1, slope0, slope1 = (y[: plan.size] for y in ends)

    begin, finish = at_both_ends(times, y0, y1, slope0, slope1, mechanism, groups)
    group_curves = [curve_between(a, b, h) for a, b in zip(begin, finish, strict=True)]
    if all(joint.in_tree for joint in joints):
        return group_curves, jnp.zeros_like(h)
    sizes = each_lane(lambda mechanism: [joint.size for joint in mechanism.contacts()], h)(mechanism)

    inside = between((y0, y1, slope0, slope1), h, CHECKED, plan)
    true = each_lane(relative_motions, h)(t0 + CHECKED * h, inside, mechanism)
    worst = jnp.zeros_like(h)
    for group, curve in zip(groups, group_curves, strict=True):
        place = curve.at(CHECKED).place
        places = (
            [(group, place)]
            if isinstance(group, int)
            else [(i, jax.tree.map(lambda x, k=k: x[k] if eqx.is_array(x) else x, place)) for k, i in enumerate(group)]
        )
        for i, here in places:
            off = subtract(here, true[i].place)
            miss = jnp.asarray(dot(off, off)) / sizes[i] ** 2
            worst = worst if joints[i].in_tree else jnp.maximum(worst, miss)
    return group_curves, jnp.sqrt(worst)


def at_both_ends(times, y0, y1, slope0, slope1, mechanism: PreparedMechanism, groups: Groups) -> tuple[list, list]:
    """The relative motions of groups of joints, and their rates, at the start and at the end of a step."""

    def motions(time, y, slope, mechanism):
        return relative_accelerations(time, y, slope, mechanism, groups)

    if mechanism.is_plane:
        of = each_lane(motions, times[0])
        return of(times[0], y0, slope0, mechanism), of(times[1], y1, slope1, mechanism)
    # In space they are a large part of a program: one copy serves both ends.
    both = each_lane(jax.vmap(motions, (0, 0, 0, None)), times[0])
    both_ends = both(jnp.stack(times), jnp.stack([y0, y1]), jnp.stack([slope0, slope1]), mechanism)
    begin, finish = (jax.tree.map(lambda x, k=k: x[k], both_ends) for k in (0, 1))
    return begin, finish


def curve_between(begin: tuple[Relative, Relative], end: tuple[Relative, Relative], h: Each) -> StepCurve:
    """The quintic through relative motions, each with its rate, at both ends of a step."""
    ends = []
    for at, rate in (begin, end):
        first, second = pose_rates(at, rate)
        pose = (*at.place[:2], at.angle) if at.rows is None else (*at.place, *itertools.chain(*at.rows))
        ends.append((together(pose, h), h * together(first, h), h * h * together(second, h)))
    return StepCurve.of(quintic_coefficients(*ends), h)


class EventJoints(NamedTuple):
    """A joint whose events are located, or several alike ones together: then every number has an axis of joints."""

    clearance: PreparedClearance
    curve: StepCurve
    memory: Rows

    @property
    def is_several(self) -> bool:
        """Whether there is an axis of joints, and one of points."""
        return self.clearance.joint.count > 1


def first_event(
    curve_of: list[StepCurve], y: Array, mechanism: PreparedMechanism, begin: Each
) -> tuple[EachFlag, Each]:
    """Whether any law changes regime inside a step, and the fraction of the step just past the first change.

    **Arguments:** `curve_of`: by group (`event_groups`); `y`: the state that has the laws' memory; `begin`: the part of
    the step just after its start. There the starting regime is read (the start itself is the last event). It is also
    the precision of the place.
    """
    joints, memory = mechanism.contacts(), layout(mechanism).split(y).memory
    first = jnp.full_like(begin, jnp.inf)
    every = [(joint.clearance, memory[joint.name]) for joint in joints]
    for group, curve in zip(event_groups(mechanism), curve_of, strict=True):
        clearance, remembered = every[group] if isinstance(group, int) else stack_trees([every[i] for i in group])
        first = jnp.minimum(first, first_of(EventJoints(clearance, curve, remembered), begin))
    return first <= 1, jnp.where(first <= 1, first, 1.0)


def first_of(joints: EventJoints, begin: Each) -> Each:
    """The fraction just past a first change of regime; infinite if there is none."""
    clearance, curve, memory = joints
    several, lanes = joints.is_several, begin.shape

    def each_joint(function):
        return each_lane(eqx.filter_vmap(function, in_axes=eqx.if_array(0)) if several else function, begin)

    points_at = each_joint(lambda joint, at: joint.points(at).law_view)
    functions_at = each_joint(PreparedClearance.event_functions)

    def points(s):
        return share(points_at(clearance, curve.at(s)))

    def signs(points, before):
        return share(jnp.where(jnp.stack(functions_at(clearance, points, memory, before)) > 0, 1.0, 0.0))

    # The starting regime is read at the first place.
    places = jnp.maximum(np.arange(SAMPLES + 1).reshape(-1, *[1] * begin.ndim) / SAMPLES, begin[None])
    depths, rates, sampled, before = samples(points, signs, places, in_turn=several and bool(lanes))

    def changed(signs):
        """Which joints have changed (for several), or whether the joint has."""
        same = jnp.where(signs == sampled[0], 1.0, 0.0)
        # (functions, joints, points, *lanes) for several.
        return least(jnp.moveaxis(same, 2, 1).reshape(-1, same.shape[1], *lanes) if several else same) == 0

    def earliest(changes, places):
        """The first of the places (for several joints one each) where there is a change; infinite without one."""
        behind = jnp.where(changes, places, jnp.inf)
        return least(behind.reshape(-1, *lanes)) if behind.ndim > begin.ndim else behind

    every = places[:, None] if several else places
    high = earliest(jax.vmap(changed)(sampled) & (every > begin), every)
    grazes = (most_likely_graze if several else graze)(places, depths, rates, curve.h)
    turns = jnp.isfinite(grazes)

    def beyond(s):
        return earliest(changed(signs(points(s), before)), s)

    def graze_fraction():
        return earliest(changed(signs(points(jnp.where(turns, grazes, 1.0)), before)) & turns, grazes)

    high = jnp.minimum(high, jax.lax.cond(jnp.any(turns), graze_fraction, lambda: jnp.full(lanes, jnp.inf)))
    if clearance.remembers:
        # The start may lie so little before the touch at which a step was cut, that the place where the regime is read
        # lies behind it: the laws have not been told.
        touched = each_joint(PreparedClearance.remembered_touch)(clearance, memory)
        unnoticed = (before.penetration > 0) & ~(touched > 0.5)
        high = jnp.minimum(high, earliest(unnoticed.reshape(-1, *lanes), begin))
    low = share(-least(-jnp.where(places < high, places, begin[None])))
    # Most steps cross nothing.
    return jax.lax.cond(jnp.any(high <= 1), lambda: locate(beyond, (low, high), begin), lambda: high)


def samples(points: Callable, signs: Callable, places: Array, in_turn: bool) -> tuple[Array, Array, Array, Any]:
    """Penetrations, their rates and the signs of the event functions at places (first axis), and the points at the
    first. `in_turn`: one place after the other, as many points and lanes do not stay in the cache together.
    """
    if not in_turn:
        now = jax.vmap(points)(places)
        before = jax.tree.map(lambda x: x[0], now)
        return now.penetration, now.penetration_rate, jax.vmap(signs, (0, None))(now, before), before

    def one(before, given):
        place, is_first = given
        now = points(place)
        before = jax.tree.map(lambda new, old: jnp.where(is_first, new, old), now, before)
        return before, (now.penetration, now.penetration_rate, signs(now, before))

    none = jax.tree.map(lambda x: jnp.zeros(x.shape), jax.eval_shape(points, places[0]))
    before, seen = jax.lax.scan(one, none, (places, jnp.arange(len(places)) == 0))
    return *seen, before


def graze(places: Array, depth: Array, rate: Array, h: Each) -> Each:
    """The place between two samples at which a penetration (of one point at all places, first axis) comes closest to a
    change of sign, where a graze would begin and end; infinite without an extremum.
    """
    place, height = closest(places, depth, rate, h)
    return jnp.where(height > -jnp.inf, place, jnp.inf)


def most_likely_graze(places: Array, depth: Array, rate: Array, h: Each) -> Array:
    """`graze` of each of several joints (joints, *lanes), at the point (depths: places, joints, points, *lanes) that
    comes closest to contact or goes furthest beyond; earlier grazes of others are located once the step has been cut
    there.
    """
    of_points = jax.vmap(closest, (None, 1, 1, None))
    place, height = jax.vmap(of_points, (None, 1, 1, None), 1)(places, depth, rate, h)
    best = jnp.argmax(height, axis=0, keepdims=True) if not h.ndim else first_highest(height)
    if not h.ndim:
        place, height = (jnp.take_along_axis(x, best, axis=0)[0] for x in (place, height))
    else:
        place, height = at(place, best), at(height, best)
    return jnp.where(height > -jnp.inf, place, jnp.inf)


def closest(places: Array, depth: Array, rate: Array, h: Each) -> tuple[Each, Each]:
    """Where a penetration comes closest to a change of sign between samples; how far beyond (negative: not quite)."""
    towards = jnp.where(depth[:1] <= 0, 1.0, -1.0)
    widths = jnp.diff(places, axis=0)
    x, height, bend = share(tops(towards * depth, towards * rate * h, widths))
    height = jnp.where(bend < 0, height, -jnp.inf)
    best = first_highest(height)
    return at(places, best) + at(x * widths, best), at(height, best)


# With lanes entry by entry, as `least`.
def first_highest(values: Array) -> Array:
    """The index of the first largest value along the first axis, by lane."""
    if values.ndim == 1:
        return jnp.argmax(values)
    best, place = values[0], jnp.zeros(values.shape[1:], int)
    for i, value in enumerate(values[1:], 1):
        higher = value > best
        best, place = jnp.where(higher, value, best), jnp.where(higher, i, place)
    return place


def at(values: Array, place: Array) -> Each:
    """The value at an index along the first axis, by lane."""
    if values.ndim == 1:
        return values[place]
    out = values[0]
    for i, value in enumerate(values[1:], 1):
        out = jnp.where(place == i, value, out)
    return out


def locate(beyond, bracket: tuple, precision: Each) -> Each:
    """The fraction just past the first change of regime in a bracket, by bisection.

    Secants on the event functions are unsafe: just before a pin leaves, a clipped force may act once more for a
    microsecond, and the functions at the bracket's ends do not show it.
    """
    low, high = bracket

    def halve(bracket):
        # The width halves in every case, and one selection moves the bracket. With two selections a compiler may
        # compute the comparison twice, round it differently, and never move either end.
        low, width = bracket
        # A lane is halved as often as it would be alone.
        going, half = width > precision, 0.5 * width
        moved = low + jnp.where(going & (beyond(low + half) == jnp.inf), half, 0.0)
        return moved, jnp.where(going, half, width)

    # A lane without an event (an infinite end) takes part without effect.
    width = jnp.where(high <= 1, high - low, 0.0)
    low, width = jax.lax.while_loop(lambda bracket: jnp.any(bracket[1] > precision), halve, (low, width))
    return jnp.where(high <= 1, low + width, high)
