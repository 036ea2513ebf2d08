"""Loads on the pins of a mechanism at an instant of its ideal motion, with friction in the joints.

An ideal joint has no friction. Where a pin turns or slides in its sleeve, friction bears a part of its load. In a loop
this changes the loads of all joints: its moment about a joint's axis, and its force along a guide, act on the motion.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import correct
from clearance_jax.dynamics.equations import Balance, accelerations, balance
from clearance_jax.dynamics.frames import Frames, Pair
from clearance_jax.dynamics.kinematics import across_loop, pin_and_axes
from clearance_jax.dynamics.reactions import held_reactions, hold_still
from clearance_jax.joints.seating import FreeMotion, SeatLoad, relative_at
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, position_rates
from clearance_jax.spatial import ZERO, as_array, subtract


class PinLoads(NamedTuple):
    """Loads of the ideal joints with pins held.

    - `y`: the ideal state; `rates`: of its positions; `opened`: how far loops are open [m].
    - By joint, in the sleeve's axes: `loads`, the force and moment that the sleeve must exert on the pin; `friction`,
      the part of them that friction exerts; `free`, how the pin moves there.
    """

    y: Array
    rates: Array
    opened: Array
    loads: tuple[SeatLoad, ...]
    friction: tuple[SeatLoad, ...]
    free: tuple[FreeMotion, ...]


def pin_loads(time: Scalar, mechanism: PreparedMechanism, play: tuple[Array, ...], y: Array) -> PinLoads:
    """Loads of the ideal joints with pins held at values of their play; `y`: a state near the ideal mechanism's."""
    joints, loops, plan = mechanism.clearance_joints(), mechanism.loops, layout(mechanism.ideal())
    fixed = hold_still(mechanism, {joint.name: tuple(values) for joint, values in zip(joints, play, strict=True)})
    opened = jnp.zeros(0)
    if loops:
        y, opened = correct(time, y, fixed, fixed.loops)
    now = balance(fixed, time, plan.split(y))
    free = tuple(_free_motion(joint, now.motion) for joint in joints)
    friction = tuple(map(_friction, joints, play, free))
    rubs = loops and any(joint.clearance.friction is not None for joint in joints)
    if rubs:
        now = _rubbed(now, joints, friction)
    reactions = held_reactions(mechanism, time, now)
    loads = tuple(SeatLoad(reactions[joint.name].on_pin, reactions[joint.name].turning) for joint in joints)
    if rubs:
        loads = tuple(load.plus(rub) for load, rub in zip(loads, friction, strict=True))
    rates = as_array(position_rates(fixed, tuple(y[plan.q]), tuple(y[plan.v])))
    return PinLoads(y, rates, opened, loads, friction, free)


def _free_motion(joint: ClearanceJoint, motion: Frames) -> FreeMotion:
    """How a pin moves in its sleeve while its play is held."""
    pin, axes = pin_and_axes(joint, motion)
    relative = across_loop(joint, pin, axes, motion)
    slides = joint.joint.joint_constraint().along is not None
    return FreeMotion((0.0, 0.0, relative.velocity[2]) if slides else ZERO, relative.spin)


def _friction(joint: ClearanceJoint, play: Array, free: FreeMotion) -> SeatLoad:
    """Force and moment of friction on a pin, in the sleeve's axes."""
    if joint.clearance.friction is None:
        return SeatLoad(ZERO, ZERO)
    at = relative_at(joint.joint.play(), play, free)
    memory = tuple(jnp.zeros(()) for _ in joint.clearance.remembers)
    whole = joint.clearance.act(at, memory)
    smooth = joint.clearance.without_friction()
    bare = smooth.act(at, memory[: len(smooth.remembers)])
    return SeatLoad(subtract(whole.force, bare.force), subtract(whole.torque, bare.torque))


def _rubbed(now: Balance, joints: tuple[ClearanceJoint, ...], friction: tuple[SeatLoad, ...]) -> Balance:
    """The balance with friction in the joints. Its reactions are what joints bear beside friction."""
    pairs = list(now.pairs)
    for joint, rub in zip(joints, friction, strict=True):
        if joint.clearance.friction is not None:
            pin, axes = pin_and_axes(joint, now.motion)
            pairs.append(Pair(joint.parent, joint.child, axes.apply(rub.force), axes.apply(rub.moment), pin))
    acceleration, closing = accelerations(now.motion, pairs, now.efforts)
    return now._replace(pairs=pairs, acceleration=acceleration, closing=closing)
