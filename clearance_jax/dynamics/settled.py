"""A start like a machine's: every pin at rest against the wall at which the joint's reaction presses it.

The reactions are those of the ideal joints, by the accelerations that the motion has at the start. A pin at its wall
moves the mechanism a little, which changes the reactions by the ratio of clearance to length, about: so a few rounds of
"close the loops, ask for the reactions, seat the pins" find where all of it holds at once. No contact is simulated.

As the motion goes on, the reactions turn and the pins ride along the walls. How fast, each round's own derivative along
the motion tells: it goes along with the rounds, and ends as the derivative of what they end at. (But for what the ride
itself changes in the reactions, which is the ratio of clearance to length of it.)

A pin rides along only where this is slow against the lowest frequency of the pose (see `dynamics.seated`). A sleeve
that bears little, or bears a moment that is about to change its side, has a place of rest that crosses its play faster
than its pin can: that pin begins at relative rest.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.dynamics.closures import HELD, StartErrors, correct
from clearance_jax.dynamics.deflected import deflect
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.reactions import held_reactions, hold_still
from clearance_jax.dynamics.seated import Seated, followers, lowest_frequency, play_mobility
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.seating import Load, Near, Seat, Turned, relative_at, seat, stiffness_at
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, parts, position_rates
from clearance_jax.spatial import as_array, dot, hamilton, scale

# Rounds with pins seated: each is nearer by the ratio of clearance to length.
ROUNDS = 16


class Seats(NamedTuple):
    """The ideal mechanism's state `[q, v]` with pins held at values of their `play` coordinates (play,) [m or rad]."""

    y: Array
    play: tuple[Array, ...]


def settle_start(time: Scalar, mechanism: PreparedMechanism) -> tuple[Array, StartErrors]:
    """The state `[q, v, memory]` in which every pin is pressed at its wall and rides along it,
    or is at relative rest there where it could not follow; and how far it is from that still.

    A pin that nothing presses starts at its `eccentricity`, as it does without this.

    **Raises:** `ClearanceError` where loops are not to be assembled, where the ideal joints hold each other, or where a
    normal law has no place of rest.
    """
    _check(mechanism)
    # What is sampled acts at the start as it would if it were not.
    mechanism = deflect(time, mechanism.without_sampling())
    joints, loops, plan = mechanism.clearance_joints(), mechanism.loops, layout(mechanism.ideal())
    begin = tuple(middle(joint) for joint in joints)
    sizes = [as_array([one.scale for one in joint.joint.play()]) for joint in joints]
    tilts = _tilts(joints, sizes)

    def loads_of(settle, time, now: Seats):
        held = hold_still(mechanism, {joint.name: tuple(own) for joint, own in zip(joints, now.play, strict=True)})
        y, opened = now.y, jnp.zeros(0)
        if loops:
            y, opened = correct(time, y, held, held.loops, settle=settle)
        # Of the state as it was before: so the kinematics stands once in the program, and is one round behind.
        motion = balance(held, time, plan.split(now.y))
        reactions = held_reactions(mechanism, time, motion).values()
        # Or else the compiler works the reactions out anew wherever a seat needs them.
        loads = jax.lax.optimization_barrier([(as_array(r.on_pin), as_array(r.turning)) for r in reactions])
        rates = as_array(position_rates(held, tuple(now.y[plan.q]), tuple(now.y[plan.v])))
        return y, loads, jnp.concatenate([rates, as_array(motion.acceleration)]), opened

    def seats_at(seated, now: Seats, y, loads, opened, slopes):
        turned = [own and Turned(own[0], own[1], play) for own, play in zip(slopes, now.play, strict=True)]
        found = seats_of(joints, loads, begin, turned=turned)
        pressed, left = tuple(one.presses for one in found), as_array([one.left for one in found])
        play = tuple(jnp.where(one.presses & seated, one.play, first) for one, first in zip(found, begin, strict=True))
        firm = tuple(one.stiffness for one in found)
        last = [jnp.linalg.norm((new - old) / size) for new, old, size in zip(play, now.play, sizes, strict=True)]
        errors = StartErrors(opened, left, as_array(last))
        return Seats(y, play), ((pressed, firm), errors)

    def once(k, carry):
        now, rate, _, _ = carry
        # Loops are closed with the pins where they were, and speeds belong to closed loops.
        seated, settle = k >= HELD, jnp.where(k >= HELD - 1, 1.0, 0.0)
        (y, loads, slope, opened), changes = _derivatives(
            lambda time, now: loads_of(settle, time, now), (time, now), (jnp.ones_like(time), rate), tilts
        )
        y_rate, loads_rate, _, opened_rate = jax.tree.map(lambda leaf: leaf[0], changes)
        slopes = _slopes(joints, changes[1], tilts)
        # Where a load is known changes with the pin, and so does the load there: its slope counts once.
        moved, change, (held, errors) = jax.jvp(
            lambda now, y, loads, opened: seats_at(seated, now, y, loads, opened, slopes),
            (now, y, loads, opened),
            (rate, y_rate, loads_rate, opened_rate),
            has_aux=True,
        )
        return moved, Seats(slope, change.play), (change, held), errors

    first = Seats(initial_values(mechanism.ideal()), begin)
    still = jax.tree.map(jnp.zeros_like, first)
    errors = StartErrors(*(jnp.zeros(len(those)) for those in (loops, joints, joints)))
    free = tuple(jnp.asarray(False) for _ in joints), tuple(jnp.zeros((len(size), len(size))) for size in sizes)
    carry = first, still, (still, free), errors
    begun = jax.lax.fori_loop(0 if loops else HELD, HELD + ROUNDS, once, carry)
    now, resting, (rate, (pressed, firm)), errors = begun
    paces = [own / size for own, size in zip(rate.play, sizes, strict=True)]
    seated = _keep_pace(mechanism, time, whole_state(mechanism, now, rate, pressed), paces, firm, sizes)
    rates = tuple(jnp.where(rest > 0, 0.0, p) for rest, p in zip(seated.rest, rate.play, strict=True))
    # Loops that are closed by pins at rest move as they do with pins held.
    y = jnp.where(jnp.any(seated.rest > 0), resting.y, rate.y) if loops else rate.y
    return whole_state(mechanism, now, Seats(y, rates), pressed), errors._replace(seated=seated)


def _check(mechanism: PreparedMechanism) -> None:
    """Raise for what has no settled start."""
    for joint in mechanism.clearance_joints():
        if not joint.clearance.normal.law.has_static_force:
            raise ClearanceError(
                f'`start = "settled"` does not know how far `{type(joint.clearance.normal.law).__name__}` in the joint '
                f'`{joint.name}` has given way before. Use `start = "centre"`.'
            )
    if not mechanism.assemble:
        raise ClearanceError(
            '`start = "settled"` puts every pin at its wall, but `assemble = false` asks for exactly the given initial '
            "values. Leave one of them out."
        )


def _tilts(joints: tuple[ClearanceJoint, ...], sizes: list[Array]) -> tuple[Array, ...]:
    """Unit tangents of all play coordinates that turn a pin, by joint (tilts, play): by these, and next to nothing
    else, the load of a pin changes as that pin moves.
    """
    own = [[one.slides is None and is_searched(joint) for one in joint.joint.play()] for joint in joints]
    places = np.flatnonzero([turns for part in own for turns in part])
    units = np.eye(sum(map(len, sizes)))[places]
    return tuple(jnp.asarray(part) for part in np.split(units, np.cumsum([len(size) for size in sizes])[:-1], axis=1))


def _derivatives(function: Callable, at: tuple, rate: tuple, tilts: tuple[Array, ...]) -> tuple[Any, Any]:
    """What a function of time and `Seats` is, and its derivatives: first along `rate`, then by each of the `tilts`."""
    if not len(tilts[0]):
        value, change = jax.jvp(function, at, rate)
        return value, jax.tree.map(lambda leaf: leaf[None], change)
    now = at[1]
    nothing = jnp.zeros(len(tilts[0])), Seats(jnp.zeros((len(tilts[0]), *now.y.shape)), tilts)
    along = jax.tree.map(lambda one, others: jnp.concatenate([one[None], others]), rate, nothing)
    values, changes = jax.vmap(lambda tangent: jax.jvp(function, at, tangent))(along)
    return jax.tree.map(lambda leaf: leaf[0], values), changes


def _slopes(
    joints: tuple[ClearanceJoint, ...], changes: list, tilts: tuple[Array, ...]
) -> list[tuple[Array, Array] | None]:
    """How force and moment of each pin that tilts change as that pin does, (3, play) each, by derivatives (1 + tilts,
    3) of its force and its moment.
    """
    out = []
    for k, joint in enumerate(joints):
        turns = is_searched(joint) and any(one.turns is not None for one in joint.joint.play())
        force, moment = changes[k]
        out.append((force[1:].T @ tilts[k], moment[1:].T @ tilts[k]) if turns else None)
    return out


def _keep_pace(
    mechanism: PreparedMechanism, time: Scalar, y: Array, rates: list[Array], firm: tuple, sizes: list[Array]
) -> Seated:
    """Which pins can follow where they are pressed, by rates of that in units of their play."""
    numbers, rest = eqx.partition((mechanism, time, y, rates, firm, sizes), eqx.is_array)
    mechanism, time, y, rates, firm, sizes = eqx.combine(jax.lax.stop_gradient(numbers), rest)
    mechanism = mechanism.as_small_program()
    pace = as_array([jnp.max(jnp.abs(own)) for own in rates])
    size = jnp.concatenate(sizes)
    inverse = play_mobility(mechanism, time, y) / (size[:, None] * size[None, :])
    frequency = lowest_frequency(jax.scipy.linalg.block_diag(*firm), inverse)
    return Seated(followers(pace, frequency, bool(mechanism.loops)), pace, frequency)


def middle(joint: ClearanceJoint) -> Array:
    """Where a pin starts that nothing presses, by its play."""
    start = joint.joint.eccentricity.vector
    return as_array([0.0 if one.slides is None else dot(start, one.slides) for one in joint.joint.play()])


def is_searched(joint: ClearanceJoint) -> bool:
    """Whether it takes a search to find where its pin rests: of a pin in the plane the force's direction says it."""
    play, element = joint.joint.play(), joint.clearance.joint.element
    held = element is not None and element.stiff
    return held or len(play) != 2 or any(one.slides is None for one in play)


def seats_of(
    joints: tuple[ClearanceJoint, ...],
    loads: list,
    begin: tuple[Array, ...],
    near: tuple[Near, ...] | None = None,
    turned: Sequence[Turned | None] | None = None,
) -> list[Seat]:
    """Where each pin is pressed by force and moment; of pins in the plane by the force's direction, without a search.
    The search for joints of one kind stands once in the program. `near`: places near those that are searched;
    `turned`: how their loads change as they move.
    """
    found: dict[int, Seat] = {}
    alike: dict[Any, list[int]] = {}
    for k, (joint, (force, _)) in enumerate(zip(joints, loads, strict=True)):
        if not is_searched(joint):
            place, pressed = joint.clearance.seat((force[0], force[1]))
            at = as_array(place)
            firm = jnp.where(pressed, stiffness_at(joint.clearance, at), 0.0)
            found[k] = Seat(at, pressed, jnp.zeros(()), firm)
        else:
            alike.setdefault(jax.tree.structure(joint.clearance), []).append(k)
    for own in alike.values():
        known = [None if near is None else near[k] for k in own]
        loaded = [Load(tuple(loads[k][0]), tuple(loads[k][1])) for k in own]
        changes = [None if turned is None else turned[k] for k in own]
        asked = [
            (joints[k].clearance, load, begin[k], at, change)
            for k, load, at, change in zip(own, loaded, known, changes, strict=True)
        ]
        if len(own) == 1:
            found[own[0]] = seat(*asked[0])
            continue
        several = jax.lax.map(lambda one: seat(*one), jax.tree.map(lambda *leaves: jnp.stack(leaves), *asked))
        found |= {k: jax.tree.map(lambda leaf, i=i: leaf[i], several) for i, k in enumerate(own)}
    return [found[k] for k in range(len(joints))]


def whole_state(mechanism: PreparedMechanism, now: Seats, rate: Seats, pressed: tuple[Array, ...]) -> Array:
    """The state of the mechanism with its play; what is pressed has been touching."""
    found: dict[str, tuple[Any, Any]] = {}
    for c, q, _ in parts(mechanism.ideal()):
        at, moving = tuple(now.y[q]), tuple(rate.y[q])
        if c.is_ball:  # q' = q (0, spin) / 2
            w, *rest = at
            moving = scale(2.0, hamilton((w, *scale(-1.0, tuple(rest))), moving))[1:]
        found[c.name] = at, moving
    memory = []
    for joint, place, speed, presses in zip(mechanism.clearance_joints(), now.play, rate.play, pressed, strict=True):
        play = joint.joint.play()
        for k, one in enumerate(play):
            found[joint.name + one.suffix] = (place[k],), (speed[k],)
        depths, _ = joint.clearance.depths(relative_at(play, place))
        touching = jnp.where(presses & (depths > 0), 1.0, 0.0)
        width = len(joint.clearance.remembers) // joint.clearance.joint.count
        for i, name in enumerate(joint.clearance.remembers):
            memory.append(touching[i // width] if name.startswith("touching") else 0.0)
    values = [found[coordinate.name] for coordinate in mechanism.free_coordinates()]
    return as_array([x for place, _ in values for x in place] + [x for _, speed in values for x in speed] + memory)
