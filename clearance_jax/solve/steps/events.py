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
from clearance_jax._compile.alike import MANY, alike, stack_trees
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import each_lane, entry, first_highest, least, together
from clearance_jax.dynamics.kinematics import Groups, relative_accelerations, relative_motions
from clearance_jax.dynamics.relative_motion import turning_rows
from clearance_jax.joints import PreparedClearance, Relative
from clearance_jax.joints.contact import ContactPoint
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

    def of_joint(self, joint: Array) -> "StepCurve":
        """The curve of one of several joints, by its index (by lane)."""
        return self._replace(pose=tuple(entry(jnp.moveaxis(numbers, 1, 0), joint) for numbers in self.pose))


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


def event_groups(mechanism: PreparedMechanism, time: Each) -> Groups:
    """The contacts whose events are located together: each by itself, or alike ones of several points, or many."""
    joints = mechanism.contacts()
    ways = [[(c.slides, c.turns) for c in joint.joint.own_coordinates()] for joint in joints]
    kinds = alike([(joint.clearance, joint.in_tree, way) for joint, way in zip(joints, ways, strict=True)])
    together = [group for group in kinds if joints[group[0]].has_points or (len(group) >= MANY and not jnp.ndim(time))]
    alone: list[int | list[int]] = sorted({*range(len(joints))} - {i for group in together for i in group})
    return alone + together


def curves(times, ends, mechanism: PreparedMechanism) -> tuple[list[StepCurve], Each]:
    """The relative motion of every group of clearance joints along a step, and the largest misfit of the curves inside
    the step, over the clearance. `ends` (y0, y1, slope0, slope1).

    The error estimate sees only the state. A drive, or a body that turns freely, moves the surfaces of a loop without
    any error in the state, so a step could swing past a contact. (In the tree, play is a coordinate: the curve is the
    state's own.)
    """
    t0, h = times[0], times[1] - times[0]
    plan, joints, groups = layout(mechanism), mechanism.contacts(), event_groups(mechanism, h)
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
        members, place = ([group] if isinstance(group, int) else group), curve.at(CHECKED).place
        for k, i in enumerate(() if joints[members[0]].in_tree else members):
            here = place if members is not group else jax.tree.map(lambda x, k=k: x[k] if eqx.is_array(x) else x, place)
            off = subtract(here, true[i].place)
            worst = jnp.maximum(worst, jnp.asarray(dot(off, off)) / sizes[i] ** 2)
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
    """A joint whose events are located, or several alike ones together: numbers have axes of joints and points then."""

    clearance: PreparedClearance
    curve: StepCurve
    memory: Rows

    @property
    def is_several(self) -> bool:
        """Whether there is an axis of joints."""
        return self.curve.pose[0].ndim > 1 + self.curve.h.ndim

    def each(self, function: Callable) -> Callable:
        """A function of one joint, of each joint and lane."""
        several = eqx.filter_vmap(function, in_axes=eqx.if_array(0)) if self.is_several else function
        return each_lane(several, self.curve.h)

    def points(self, s: Each) -> ContactPoint:
        """The contact points at a fraction of the step (for several joints one each), as the laws see them."""
        return share(self.each(lambda joint, at: joint.points(at).law_view)(self.clearance, self.curve.at(s)))

    def signs(self, points: ContactPoint, before: ContactPoint) -> Array:
        """Whether each event function is above zero, as numbers; `before`: the points at the step's start."""
        functions = self.each(PreparedClearance.event_functions)(self.clearance, points, self.memory, before)
        return share(jnp.where(jnp.stack(functions) > 0, 1.0, 0.0))

    def by_point(self, numbers: Array, joints: int) -> Array:
        """Numbers whose axis of joints is that one, with an axis of points behind it also where each has one point."""
        has_axis = not self.is_several or self.clearance.joint.count > 1
        return numbers if has_axis else jnp.expand_dims(numbers, joints + 1)

    def differ(self, signs: Array, others: Array) -> EachFlag:
        """Which joints (for several), or whether the joint, has other signs."""
        same = self.by_point(jnp.where(signs == others, 1.0, 0.0), 1)
        # (functions, joints, points, *lanes) for several.
        same, joints = (jnp.moveaxis(same, 2, 1), same.shape[1:2]) if self.is_several else (same, ())
        return least(same.reshape(-1, *joints, *self.curve.h.shape)) == 0


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
    for group, curve in zip(event_groups(mechanism, begin), curve_of, strict=True):
        clearance, remembered = every[group] if isinstance(group, int) else stack_trees([every[i] for i in group])
        first = jnp.minimum(first, first_of(EventJoints(clearance, curve, remembered), begin))
    return first <= 1, jnp.where(first <= 1, first, 1.0)


def first_of(joints: EventJoints, begin: Each) -> Each:
    """The fraction just past a first change of regime; infinite if there is none."""
    several = joints.is_several
    # The starting regime is read at the first place.
    places = jnp.maximum(np.arange(SAMPLES + 1).reshape(-1, *[1] * begin.ndim) / SAMPLES, begin[None])
    depths, rates, sampled, before = samples(joints, places)
    known = sampled[0]
    every = places[:, None] if several else places
    changed = jax.vmap(joints.differ, (0, None))(sampled, known) & (every > begin)
    first = least(jnp.where(changed, every, jnp.inf))
    grazes = likely_grazes(joints, places, depths, rates)
    turns = jnp.isfinite(grazes)

    def graze_fraction():
        there = joints.signs(joints.points(jnp.where(turns, grazes, 1.0)), before)
        return jnp.where(joints.differ(there, known) & turns, grazes, jnp.inf)

    first = jnp.minimum(first, jax.lax.cond(jnp.any(turns), graze_fraction, lambda: jnp.full_like(first, jnp.inf)))
    if joints.clearance.remembers:
        # The start may lie so little before the touch at which a step was cut, that the place where the regime is read
        # lies behind it: the laws have not been told.
        touched = joints.each(PreparedClearance.remembered_touch)(joints.clearance, joints.memory)
        told = joints.by_point(jnp.where((before.penetration > 0) & ~(touched > 0.5), 0.0, 1.0), 0)
        unnoticed = (least(jnp.moveaxis(told, 1, 0)) if several else told) == 0
        first = jnp.minimum(first, jnp.where(unnoticed, begin, jnp.inf))
    high = least(first) if several else first
    low = share(-least(-jnp.where(places < high, places, begin[None])))

    def place():
        if not several:
            return locate(joints, (before, known), (low, high), begin)
        until = least(jnp.where(places >= high, places, jnp.inf))
        start = before, jnp.moveaxis(known, 1, 0)
        return locate_by_joint(joints, start, (low, jnp.where(first <= until, first, jnp.inf)), begin)

    # Most steps cross nothing.
    return jax.lax.cond(jnp.any(high <= 1), place, lambda: high)


def samples(joints: EventJoints, places: Array) -> tuple[Array, Array, Array, ContactPoint]:
    """Penetrations, their rates and signs of the event functions at places (first axis); the points at the first."""
    if not (joints.is_several and joints.curve.h.ndim):
        now = jax.vmap(joints.points)(places)
        before = jax.tree.map(lambda x: x[0], now)
        return now.penetration, now.penetration_rate, jax.vmap(joints.signs, (0, None))(now, before), before

    # One place after the other: as many points and lanes do not stay in the cache together.
    def one(before, given):
        place, is_first = given
        now = joints.points(place)
        before = jax.tree.map(lambda new, old: jnp.where(is_first, new, old), now, before)
        return before, (now.penetration, now.penetration_rate, joints.signs(now, before))

    none = jax.tree.map(lambda x: jnp.zeros(x.shape), jax.eval_shape(joints.points, places[0]))
    before, seen = jax.lax.scan(one, none, (places, jnp.arange(len(places)) == 0))
    return *seen, before


def likely_grazes(joints: EventJoints, places: Array, depth: Array, rate: Array) -> Array:
    """The place between two samples at which a penetration (places, *joints, *points, *lanes) comes closest to a change
    of sign, where a graze would begin and end; infinite without an extremum. Of each of several joints that of the
    likeliest point; earlier grazes of others are located once the step has been cut there.
    """
    h = joints.curve.h
    if not joints.is_several:
        place, height = closest(places, depth, rate, h)
        return jnp.where(height > -jnp.inf, place, jnp.inf)
    depth, rate = (joints.by_point(x, 1) for x in (depth, rate))
    of_points = jax.vmap(closest, (None, 1, 1, None))
    place, height = jax.vmap(of_points, (None, 1, 1, None), 1)(places, depth, rate, h)
    if h.ndim:
        best = first_highest(height)
        place, height = entry(place, best), entry(height, best)
    else:
        best = jnp.argmax(height, axis=0, keepdims=True)
        place, height = (jnp.take_along_axis(x, best, axis=0)[0] for x in (place, height))
    return jnp.where(height > -jnp.inf, place, jnp.inf)


def closest(places: Array, depth: Array, rate: Array, h: Each) -> tuple[Each, Each]:
    """Where a penetration comes closest to a change of sign between samples; how far beyond (negative: not quite)."""
    towards = jnp.where(depth[:1] <= 0, 1.0, -1.0)
    widths = jnp.diff(places, axis=0)
    x, height, bend = share(tops(towards * depth, towards * rate * h, widths))
    height = jnp.where(bend < 0, height, -jnp.inf)
    best = first_highest(height)
    return entry(places, best) + entry(x * widths, best), entry(height, best)


def locate_by_joint(joints: EventJoints, start: tuple, brackets: tuple, precision: Each) -> Each:
    """`locate` of several joints, one after the other, as most steps cross events of one. `start` by joint; `brackets`:
    where they begin, and where each joint has changed, (joints, *lanes); infinite where it has not.
    """
    by_joint, (low, ends) = (joints.clearance, joints.memory, *start), brackets

    def next_joint(state):
        ends, best = state
        joint = first_highest(-ends)
        clearance, memory, *begun = jax.tree.map(lambda x: entry(x, joint) if eqx.is_array(x) else x, by_joint)
        chosen = EventJoints(clearance, joints.curve.of_joint(joint), memory)
        end = entry(ends, joint)
        # A lane with no joint left takes part without effect.
        high = jnp.where(end < jnp.inf, jnp.minimum(end, best), jnp.inf)
        place = locate(chosen, (begun[0], begun[1]), (low, high), precision)
        done = jnp.arange(len(ends)).reshape(-1, *[1] * best.ndim) == joint
        return jnp.where(done, jnp.inf, ends), jnp.minimum(best, place)

    begin = ends, jnp.full_like(precision, jnp.inf)
    return jax.lax.while_loop(lambda state: jnp.any(state[0] < jnp.inf), next_joint, begin)[1]


def locate(joint: EventJoints, start: tuple[ContactPoint, Array], bracket: tuple[Each, Each], precision: Each) -> Each:
    """The fraction just past the first change of a joint's regime in a bracket, by bisection. `start`: its points, and
    the signs of its event functions, where the step begins.

    Secants on the event functions are unsafe: just before a pin leaves, a clipped force may act once more for a
    microsecond, and the functions at the bracket's ends do not show it.
    """
    (before, known), (low, high) = start, bracket

    def halve(bracket):
        # The width halves in every case, and one selection moves the bracket. With two selections a compiler may
        # compute the comparison twice, round it differently, and never move either end.
        low, width = bracket
        # A lane is halved as often as it would be alone.
        going, half = width > precision, 0.5 * width
        has_changed = joint.differ(joint.signs(joint.points(low + half), before), known)
        return low + jnp.where(going & ~has_changed, half, 0.0), jnp.where(going, half, width)

    # A lane without an event (an infinite end) takes part without effect.
    width = jnp.where(high <= 1, high - low, 0.0)
    low, width = jax.lax.while_loop(lambda bracket: jnp.any(bracket[1] > precision), halve, (low, width))
    return jnp.where(high <= 1, low + width, high)
