"""Settled start: every pin is at rest against the wall at which the joint's reaction presses it.

The reactions are those of the ideal joints for the motion at the start. A pin at its wall displaces the mechanism a
little, which changes the reactions by about the ratio of clearance to length. So a few rounds of "close the loops,
compute the reactions, seat the pins" find a consistent state. No contact is simulated.

As the motion goes on, the reactions turn and the pins move along the walls. Each round also computes the derivative of
its result along the motion, which gives the pins' velocities. (The effect of these velocities on the reactions is left
out; it is smaller by the ratio of clearance to length.)

A pin follows its wall only where this is slow against the lowest frequency of the pose (`dynamics.seated`). Where a
sleeve bears little, or a moment that is about to change its side, the place of rest moves faster than the pin can: such
a pin begins at relative rest.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import HELD, StartErrors, correct
from clearance_jax.dynamics.deflected import deflect, has_drives, released, touching_gaps
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.reactions import by_joint, held_reactions, hold_still
from clearance_jax.dynamics.seated import Seated, followers, lowest_frequency
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.seating import Near, Seat, SeatLoad, Turned, relative_at, seat, size_of, stiffness_at
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, parts, place_rates
from clearance_jax.spatial import as_array, dot, hamilton, scale

# Rounds with pins seated: each reduces the error by the ratio of clearance to length.
ROUNDS = 16


class Seats(NamedTuple):
    """The ideal mechanism's state `[q, v]` with pins held at values of their `play` coordinates (play,) [m or rad]."""

    y: Array
    play: tuple[Array, ...]


def settle_start(time: Scalar, mechanism: PreparedMechanism) -> tuple[Array, StartErrors]:
    """The state `[q, v, memory]` in which every pin is pressed at its wall and moves along it, or is at relative rest
    there where it cannot follow; and the errors of that state.

    A pin that nothing presses starts at its `eccentricity`.

    **Raises:** `ClearanceError` where loops cannot be assembled, where the ideal joints hold each other, or where a
    normal law has no place of rest.
    """
    _check(mechanism)
    # At the start, sampled controllers act continuously.
    mechanism = mechanism.without_sampling()
    if has_drives(mechanism):
        moved = deflect(time, mechanism)
        y, errors = _settle(time, moved.held())
        return released(moved.mechanism, time, y, moved.places), errors
    return _settle(time, mechanism)


def _settle(time: Scalar, mechanism: PreparedMechanism) -> tuple[Array, StartErrors]:
    """`settle_start` of a mechanism whose drives do not give way."""
    joints, loops, plan = mechanism.clearance_joints(), mechanism.loops, layout(mechanism.ideal())
    begin, sizes = tuple(map(middle, joints)), [size_of(joint.joint.play()) for joint in joints]
    tilts = _tilts(joints, sizes)

    def loads_of(settle, time, now: Seats):
        fixed = hold_still(mechanism, by_joint(mechanism, now.play))
        y, opened = now.y, jnp.zeros(0)
        if loops:
            y, opened = correct(time, y, fixed, fixed.loops, settle=settle)
        # Reactions of the state before `correct`, whose kinematics they share: they are one round behind.
        motion = balance(fixed, time, plan.split(now.y))
        reactions = held_reactions(mechanism, time, motion).values()
        # Otherwise the compiler computes the reactions anew at every use.
        loads = jax.lax.optimization_barrier([(as_array(r.on_pin), as_array(r.turning)) for r in reactions])
        rates = jnp.concatenate([place_rates(fixed, now.y), as_array(motion.acceleration)])
        return y, loads, rates, opened

    def seats_at(seated, now: Seats, y, loads, opened, slopes):
        turned = [s and Turned(s[0], s[1], play) for s, play in zip(slopes, now.play, strict=True)]
        seats = seats_of(joints, loads, begin, turned=turned)
        play = tuple(jnp.where(s.presses & seated, s.play, first) for s, first in zip(seats, begin, strict=True))
        contacts = tuple(seat.presses for seat in seats), tuple(seat.stiffness for seat in seats)
        last = [jnp.linalg.norm((new - old) / size) for new, old, size in zip(play, now.play, sizes, strict=True)]
        return Seats(y, play), (contacts, StartErrors(opened, as_array([seat.left for seat in seats]), as_array(last)))

    def once(k, carry):
        # carry: the seats; their rates, `y` with all pins held; (rates as pins move, contacts); errors.
        now, resting, _, _ = carry
        # The first HELD rounds close the loops, with the pins where they were; the last of them gives velocities too.
        seated, settle = k >= HELD, jnp.where(k >= HELD - 1, 1.0, 0.0)
        (y, loads, slope, opened), changes = _derivatives(
            lambda time, now: loads_of(settle, time, now), (time, now), (jnp.ones_like(time), resting), tilts
        )
        y_rate, loads_rate, _, opened_rate = jax.tree.map(lambda leaf: leaf[0], changes)
        slopes = _slopes(joints, changes[1], tilts)
        # `loads_rate` includes the slopes times the pins' rates. `Turned` subtracts them: they count once.
        moved, change, (contacts, errors) = jax.jvp(
            lambda now, y, loads, opened: seats_at(seated, now, y, loads, opened, slopes),
            (now, y, loads, opened),
            (resting, y_rate, loads_rate, opened_rate),
            has_aux=True,
        )
        return moved, Seats(slope, change.play), (change, contacts), errors

    first = Seats(initial_values(mechanism.ideal()), begin)
    still = jax.tree.map(jnp.zeros_like, first)
    errors = StartErrors(jnp.zeros(len(loops)), jnp.zeros(len(joints)), jnp.zeros(len(joints)))
    apart = tuple(jnp.asarray(False) for _ in joints), tuple(jnp.zeros((len(size), len(size))) for size in sizes)
    begun = jax.lax.fori_loop(0 if loops else HELD, HELD + ROUNDS, once, (first, still, (still, apart), errors))
    now, resting, (rate, (pressed, firm)), errors = begun
    paces = [speed / size for speed, size in zip(rate.play, sizes, strict=True)]
    seated = _keep_pace(mechanism, time, whole_state(mechanism, time, now, rate, pressed), paces, firm, sizes)
    rates = tuple(jnp.where(rest > 0, 0.0, p) for rest, p in zip(seated.rest, rate.play, strict=True))
    # If pins are at rest and close loops, the velocities are those of the mechanism with all pins held.
    y = jnp.where(jnp.any(seated.rest > 0), resting.y, rate.y) if loops else rate.y
    return whole_state(mechanism, time, now, Seats(y, rates), pressed), errors._replace(seated=seated)


def _check(mechanism: PreparedMechanism) -> None:
    """Raise for a mechanism that has no settled start."""
    for joint in mechanism.contacts():
        if not joint.clearance.normal.law.has_static_force:
            raise ClearanceError(
                f'`start = "settled"` does not know how far `{type(joint.clearance.normal.law).__name__}` in the joint '
                f'`{joint.name}` has given way before. Use `start = "centre"`.'
            ).about(joint.name, type(joint.clearance.normal.law).__name__)
    if not mechanism.assemble:
        raise ClearanceError(
            '`start = "settled"` puts every pin at its wall, but `assemble = false` asks for exactly the given initial '
            "values. Leave one of them out."
        ).about("assemble", False)


def _tilts(joints: tuple[ClearanceJoint, ...], sizes: list[Array]) -> tuple[Array, ...]:
    """By joint (tilts, play): unit vectors of turns of searched pins. Other play hardly changes the loads."""
    turning = [[c.slides is None and is_searched(joint) for c in joint.joint.play()] for joint in joints]
    places = np.flatnonzero([turns for joint in turning for turns in joint])
    units = np.eye(sum(map(len, sizes)))[places]
    return tuple(jnp.asarray(part) for part in np.split(units, np.cumsum([len(size) for size in sizes])[:-1], axis=1))


def _derivatives(function: Callable, at: tuple, rate: tuple, tilts: tuple[Array, ...]) -> tuple[Any, Any]:
    """A function of time and `Seats`, and its derivatives: first along `rate`, then by each of the `tilts`."""
    if not len(tilts[0]):
        value, change = jax.jvp(function, at, rate)
        return value, jax.tree.map(lambda leaf: leaf[None], change)
    now = at[1]
    nothing = jnp.zeros(len(tilts[0])), Seats(jnp.zeros((len(tilts[0]), *now.y.shape)), tilts)
    along = jax.tree.map(lambda first, others: jnp.concatenate([first[None], others]), rate, nothing)
    values, changes = jax.vmap(lambda tangent: jax.jvp(function, at, tangent))(along)
    return jax.tree.map(lambda leaf: leaf[0], values), changes


def _slopes(joints: tuple[ClearanceJoint, ...], changes: list, tilts: tuple[Array, ...]) -> list:
    """By joint that tilts: how force and moment of its pin change by its play, (3, play) each; else `None`."""
    turns = [is_searched(joint) and any(c.turns is not None for c in joint.joint.play()) for joint in joints]
    return [
        (force[1:].T @ tilt, moment[1:].T @ tilt) if turning else None
        for (force, moment), tilt, turning in zip(changes, tilts, turns, strict=True)
    ]


def _keep_pace(
    mechanism: PreparedMechanism, time: Scalar, y: Array, rates: list[Array], firm: tuple, sizes: list[Array]
) -> Seated:
    """Which pins can follow their place of rest; `rates`: of that place, in units of their play."""
    mechanism, time, y, rates, firm, sizes = without_derivatives((mechanism, time, y, rates, firm, sizes))
    pace = as_array([jnp.max(jnp.abs(speed)) for speed in rates])
    frequency = lowest_frequency(mechanism, time, y, firm, sizes)
    return Seated(followers(pace, frequency, bool(mechanism.loops)), pace, frequency)


def middle(joint: ClearanceJoint) -> Array:
    """Where a pin starts that nothing presses, in its play coordinates."""
    start = joint.joint.eccentricity.vector
    return as_array([0.0 if c.slides is None else dot(start, c.slides) for c in joint.joint.play()])


def is_searched(joint: ClearanceJoint) -> bool:
    """Whether a pin's place of rest needs a search. In the plane the direction of the force gives it."""
    play, element = joint.joint.play(), joint.clearance.joint.element
    stiff = element is not None and element.stiff
    return stiff or len(play) != 2 or any(c.slides is None for c in play)


def seats_of(
    joints: tuple[ClearanceJoint, ...],
    loads: list,
    begin: tuple[Array, ...],
    near: tuple[Near, ...] | None = None,
    turned: Sequence[Turned | None] | None = None,
) -> list[Seat]:
    """Where force and moment press each pin; for pins in the plane without a search. Joints of one kind share one
    search in the program. `near`: places near those that are searched; `turned`: how their loads change as they move.
    """
    seats: dict[int, Seat] = {}
    alike: dict[Any, list[int]] = {}
    for k, (joint, (force, _)) in enumerate(zip(joints, loads, strict=True)):
        if not is_searched(joint):
            place, pressed = joint.clearance.seat((force[0], force[1]))
            at = as_array(place)
            firm = jnp.where(pressed, stiffness_at(joint.clearance, at), 0.0)
            seats[k] = Seat(at, pressed, jnp.zeros(()), firm)
        else:
            alike.setdefault(jax.tree.structure(joint.clearance), []).append(k)
    for group in alike.values():
        asked = [
            (joints[k].clearance, SeatLoad(*map(tuple, loads[k])), begin[k], near and near[k], turned and turned[k])
            for k in group
        ]
        if len(group) == 1:
            seats[group[0]] = seat(*asked[0])
            continue
        several = jax.lax.map(lambda args: seat(*args), jax.tree.map(lambda *leaves: jnp.stack(leaves), *asked))
        seats |= {k: jax.tree.map(lambda leaf, i=i: leaf[i], several) for i, k in enumerate(group)}
    return [seats[k] for k in range(len(joints))]


def whole_state(
    mechanism: PreparedMechanism, time: Scalar, now: Seats, rate: Seats, pressed: tuple[Array, ...]
) -> Array:
    """The state of the mechanism with its play; a pressed contact counts as touching."""
    by_name: dict[str, tuple[Any, Any]] = {}
    for c, q, _ in parts(mechanism.ideal()):
        at, moving = tuple(now.y[q]), tuple(rate.y[q])
        if c.is_ball:  # q' = q (0, spin) / 2
            w, *rest = at
            moving = scale(2.0, hamilton((w, *scale(-1.0, tuple(rest))), moving))[1:]
        by_name[c.name] = at, moving
    memory = []
    for joint, place, speed, presses in zip(mechanism.clearance_joints(), now.play, rate.play, pressed, strict=True):
        play = joint.joint.play()
        for k, coordinate in enumerate(play):
            by_name[joint.name + coordinate.suffix] = (place[k],), (speed[k],)
        depths, _ = joint.clearance.depths(relative_at(play, place))
        touching = jnp.where(presses & (depths > 0), 1.0, 0.0)
        width = len(joint.clearance.remembers) // joint.clearance.joint.count
        for i, name in enumerate(joint.clearance.remembers):
            memory.append(touching[i // width] if name.startswith("touching") else 0.0)
    values = [by_name[coordinate.name] for coordinate in mechanism.free_coordinates()]
    y = as_array([x for place, _ in values for x in place] + [x for _, speed in values for x in speed] + memory)
    return jnp.concatenate([y, as_array(touching_gaps(mechanism, time, y))]) if mechanism.gaps else y
