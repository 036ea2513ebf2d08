"""A start like a machine's: every pin at rest against the wall at which the joint's reaction presses it.

The reactions are those of the ideal joints, by the accelerations that the motion has at the start. A pin at its wall
moves the mechanism a little, which changes the reactions by the ratio of clearance to length, about: so a few rounds of
"close the loops, ask for the reactions, seat the pins" find where all of it holds at once. No contact is simulated.

As the motion goes on, the reactions turn and the pins ride along the walls. How fast, each round's own derivative along
the motion tells: it goes along with the rounds, and ends as the derivative of what they end at. (But for what the ride
itself changes in the reactions, which is the ratio of clearance to length of it.)
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.closures import HELD, corrected
from clearance_jax.dynamics.reactions import held_balance, held_reactions
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import ClearanceJoint, Mechanism
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.spatial import ZERO, Pair, as_array, dot

# Rounds with pins seated: each is nearer by the ratio of clearance to length.
ROUNDS = 16


class Seats(NamedTuple):
    """The ideal mechanism's state `[q, v]` with pins held at their `places` in the sleeves (joints, 2) [m]."""

    y: Array
    places: Array


def settled_start(time: Scalar, mechanism: Mechanism) -> tuple[Array, Float[Array, " loops"]]:
    """The state `[q, v, memory]` of a prepared mechanism in which every pin is pressed at its wall and rides along it,
    and how far each loop is open [m].

    A pin that nothing presses starts at its `eccentricity`, as it does without this.

    **Raises:** `ClearanceError` where loops are not to be assembled, or where the ideal joints hold each other.
    """
    if not mechanism.assemble:
        raise ClearanceError(
            '`start = "settled"` puts every pin at its wall, but `assemble = false` asks for exactly the given initial '
            "values. Leave one of them out."
        )
    turning = [j.name for j in mechanism.clearance_joints() if any(play.turns is not None for play in j.joint.play())]
    if not mechanism.is_plane or turning:
        raise ClearanceError(
            '`start = "settled"` is for pins in a plane mechanism: not for blocks in guides, and not in space. Start '
            'by `start = "centre"`.'
        )
    mechanism = mechanism.unsampled()  # which acts at the start as it would if it were not
    joints, loops, plan = mechanism.clearance_joints(), mechanism.loops, layout(mechanism.ideal())
    begin = jnp.stack([as_array(joint.joint.eccentricity.vector[:2]) for joint in joints])

    def round_of(seated, settle, time, now: Seats):
        at, y = _by_name(joints, now.places), now.y
        opened = jnp.zeros(0)
        if loops:
            held = mechanism.held(at)
            y, opened = corrected(time, y, held, held.loops, settle=settle)
        # Of the state as it was before: so the kinematics stands once in the program, and is one round behind.
        motion = held_balance(mechanism, time, now.y, at)
        reactions = held_reactions(mechanism, time, motion)
        # Or else the compiler works the reactions out anew wherever a seat needs them.
        forces = jax.lax.optimization_barrier(jnp.stack([as_array(list(r.on_pin)) for r in reactions.values()]))
        seats = [joint.clearance.seat((f[0], f[1])) for joint, f in zip(joints, forces, strict=True)]
        pressed = jnp.stack([presses for _, presses in seats])
        places = jnp.stack([as_array(list(place)) for place, _ in seats])
        places = jnp.where((pressed & seated)[:, None], places, begin)
        slope = jnp.concatenate([now.y[plan.v], as_array(motion.acceleration)])
        return Seats(y, places), (slope, pressed, opened)

    def once(k, carry):
        now, rate, _, _ = carry
        # Loops are closed with the pins where they were, and speeds belong to closed loops.
        seated, settle = k >= HELD, jnp.where(k >= HELD - 1, 1.0, 0.0)
        moved, change, (slope, pressed, opened) = jax.jvp(
            lambda time, now: round_of(seated, settle, time, now),
            (time, now),
            (jnp.ones_like(time), rate),
            has_aux=True,
        )
        return moved, Seats(slope, change.places), (change, pressed), opened

    first = Seats(initial_values(mechanism.ideal()), begin)
    still = jax.tree.map(jnp.zeros_like, first)
    carry = first, still, (still, jnp.zeros(len(joints), bool)), jnp.zeros(len(loops))
    now, _, (rate, pressed), opened = jax.lax.fori_loop(0 if loops else HELD, HELD + ROUNDS, once, carry)
    return _whole(mechanism, now, rate, pressed), opened


def _by_name(joints: tuple[ClearanceJoint, ...], places: Array) -> dict[str, Pair]:
    return {joint.name: (place[0], place[1]) for joint, place in zip(joints, places, strict=True)}


def _whole(mechanism: Mechanism, now: Seats, rate: Seats, pressed: Array) -> Array:
    """The state of the mechanism with its play; what is pressed has been touching."""
    found = {name: (now.y[i], rate.y[i]) for i, name in enumerate(layout(mechanism.ideal()).positions)}
    memory = []
    for i, joint in enumerate(mechanism.clearance_joints()):
        place, speed = ((own[i, 0], own[i, 1]) for own in (now.places, rate.places))
        for play in joint.joint.play():
            along = (play.slides or ZERO)[:2]
            found[joint.name + play.suffix] = dot(along, place), dot(along, speed)
        touching = jnp.where(pressed[i], 1.0, 0.0)
        memory += [touching if name.startswith("touching") else 0.0 for name in joint.clearance.remembers]
    values = [found[coordinate.name] for coordinate in mechanism.free_coordinates()]
    return as_array([place for place, _ in values] + [speed for _, speed in values] + memory)
