"""Forces in the joints: of a state, and of the ideal mechanism, whose reactions press the pins.

An ideal joint has no friction. Where a pin turns or slides in its sleeve, friction bears a part of its load. In a loop
this changes the loads of all joints: its moment about a joint's axis, and its force along a guide, act on the motion.
`pin_loads` reckons with it.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import correct
from clearance_jax.dynamics.equations import Balance, accelerations, balance
from clearance_jax.dynamics.forms.frames import Frames, Pair, SpatialForce
from clearance_jax.dynamics.kinematics import across_loop, pin_and_axes
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.seating import FreeMotion, SeatLoad, relative_at
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, place_rates
from clearance_jax.spatial import ZERO, Term, Vector, add, cross, scale, subtract


class Reaction(NamedTuple):
    """Reaction of a joint on the pin (its child): `force` [N] in the world's axes; `on_pin`, the same in the sleeve's
    axes, and `turning`, the moment about the pin's centre there [N m], of which the part about the sleeve's axis is the
    effort of a drive or an actuator; `at`: the pin's centre in the world [m].
    """

    force: Vector
    on_pin: Vector
    turning: Vector
    at: Vector


def joint_reactions(
    mechanism: PreparedMechanism, time: Scalar, y: Array, play: Mapping[str, Sequence[Term]] | None = None
) -> dict[str, Reaction]:
    """The reactions of the joints with clearance if they were ideal, by name: from the accelerations that drives,
    weight, springs and actuators give the ideal mechanism, without any contact law.

    **Arguments:** `time` [s]; `y`: the ideal mechanism's state `[q, v]`, its loops closed; `play`: by the name of a
    joint at which values of its play coordinates its pin is held [m or rad] (default: in the middle).

    **Raises:** `ClearanceError` where the ideal joints hold each other (their reactions are not determined).
    """
    fixed = hold_still(mechanism, play or {})
    return held_reactions(mechanism, time, balance(fixed, time, layout(fixed).split(y)))


def hold_still(mechanism: PreparedMechanism, play: Mapping[str, Sequence[Term]]) -> PreparedMechanism:
    """The ideal mechanism with its pins held and nothing sampled, see `joint_reactions`."""
    return determinate(mechanism.hold_pins(play).without_sampling()).as_small_program()


def by_joint(mechanism: PreparedMechanism, play: Sequence[Array]) -> dict[str, Sequence[Term]]:
    """Values of the play coordinates by the names of joints."""
    return {joint.name: tuple(p) for joint, p in zip(mechanism.clearance_joints(), play, strict=True)}


def held_reactions(mechanism: PreparedMechanism, time: Scalar, now: Balance) -> dict[str, Reaction]:
    """The reactions in the clearance joints, from a balance of the mechanism with pins held."""
    joints = mechanism.clearance_joints()
    exerted = reactions(mechanism.ideal().at(time), now, [joint.name for joint in joints])
    out = {}
    for joint in joints:
        (force, moment), (at, turned) = exerted[joint.name], pin_and_axes(joint, now.motion)
        out[joint.name] = Reaction(force, turned.undo(force), turned.undo(moment), at)
    return out


def determinate(ideal: PreparedMechanism) -> PreparedMechanism:
    """The ideal mechanism. **Raises** `ClearanceError` if its loops have more conditions than free coordinates."""
    if ideal.is_plane and 2 * len(ideal.closures()) > layout(ideal).free:
        raise ClearanceError(
            "Without its clearances this mechanism is over-constrained: how its ideal joints share the load is not "
            'determined. Free more coordinates, or start it by `start = "centre"`.'
        )
    return ideal


def reactions(
    mechanism: PreparedMechanism, now: Balance, asked: Collection[str] | None = None
) -> dict[str, SpatialForce]:
    """Force and moment on the child of every joint (or of those `asked` for), by name, tree then loops, in the world's
    axes, from the momentum of what hangs on it. The moment is about the joint's place on the child. It includes the
    effort of a driven or actuated joint, and both contact and holding forces of a joint with clearance.
    """
    wrenches = now.motion.wrenches(now.acceleration)
    # The first pairs are those of the clearance joints.
    by_name = dict(zip(now.plays, now.pairs, strict=False))
    by_name |= dict(zip([j.name for j in mechanism.closures()], now.closing, strict=True))
    out: dict[str, SpatialForce] = {}
    for joint in mechanism.joints:
        if asked is not None and joint.name not in asked:
            continue
        pivot, missing = now.motion[joint.child].pivot, wrenches[joint.child]
        force, moment = scale(-1.0, missing.force), scale(-1.0, missing.moment)
        beyond, joint_pair = mechanism.beyond(joint.child), by_name.get(joint.name)
        for pair in (*now.pairs, *now.closing):
            inside = float((pair.child in beyond) - (pair.parent in beyond))
            if pair is joint_pair or not inside:
                continue
            force = subtract(force, scale(inside, pair.force))
            turning = add(cross(subtract(pair.at, pivot), pair.force), pair.torque)
            moment = subtract(moment, scale(inside, turning))
        out[joint.name] = SpatialForce(force, moment)
    loops = [loop.name for loop in mechanism.loops if asked is None or loop.name in asked]
    return out | {name: SpatialForce(by_name[name].force, by_name[name].torque) for name in loops}


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
    joints, loops, opened = mechanism.clearance_joints(), mechanism.loops, jnp.zeros(0)
    fixed = hold_still(mechanism, by_joint(mechanism, play))
    if loops:
        y, opened = correct(time, y, fixed, fixed.loops)
    now = balance(fixed, time, layout(mechanism.ideal()).split(y))
    free = tuple(_free_motion(joint, now.motion) for joint in joints)
    friction = tuple(map(_friction, joints, play, free))
    rubs = loops and any(joint.clearance.friction is not None for joint in joints)
    if rubs:
        now = _rubbed(now, joints, friction)
    reactions = held_reactions(mechanism, time, now)
    loads = tuple(SeatLoad(reactions[joint.name].on_pin, reactions[joint.name].turning) for joint in joints)
    if rubs:
        loads = tuple(load.plus(rub) for load, rub in zip(loads, friction, strict=True))
    return PinLoads(y, place_rates(fixed, y), opened, loads, friction, free)


def _free_motion(joint: ClearanceJoint, motion: Frames) -> FreeMotion:
    """How a pin moves in its sleeve while its play is held."""
    relative = across_loop(joint, *pin_and_axes(joint, motion), motion)
    slides = joint.joint.joint_constraint().along is not None
    return FreeMotion((0.0, 0.0, relative.velocity[2]) if slides else ZERO, relative.spin)


def _friction(joint: ClearanceJoint, play: Array, free: FreeMotion) -> SeatLoad:
    """Force and moment of friction on a pin, in the sleeve's axes."""
    if joint.clearance.friction is None:
        return SeatLoad(ZERO, ZERO)
    at, smooth = relative_at(joint.joint.play(), play, free), joint.clearance.without_friction()
    whole, bare = joint.clearance.act(at, joint.clearance.blank), smooth.act(at, smooth.blank)
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
