"""Forces in the joints: of a state, and of the ideal mechanism, whose reactions press the pins."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.equations import Balance, balance
from clearance_jax.dynamics.frames import SpatialForce
from clearance_jax.dynamics.kinematics import sleeve_axes
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.spatial import Term, Vector, add, cross, scale, subtract


class Reaction(NamedTuple):
    """Reaction of a joint on the pin (its child): `force` [N] in the world's axes, `on_pin` the same force in the
    sleeve's axes, `turning` the moment about the pin's centre there [N m], `at` the pin's centre in the world [m]. (The
    torque about the sleeve's axis that turns the pin is its drive's or actuator's.)
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


def held_reactions(mechanism: PreparedMechanism, time: Scalar, now: Balance) -> dict[str, Reaction]:
    """The reactions in the clearance joints, from a balance of the mechanism with pins held."""
    ideal = mechanism.ideal().at(time)
    exerted = dict(zip([j.name for j in ideal.all_joints()], reactions(ideal, now), strict=True))
    out = {}
    for joint in mechanism.clearance_joints():
        force, moment = exerted[joint.name]
        turned = sleeve_axes(joint.joint, now.motion)
        at = now.motion[joint.child].point(joint.joint.at_child.vector)
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


def reactions(mechanism: PreparedMechanism, now: Balance) -> list[SpatialForce]:
    """Force and moment on the child of every joint, tree then loops, in the world's axes, from the momentum of what
    hangs on it. The moment is about the joint's place on the child. It includes the effort of a driven or actuated
    joint, and both contact and holding forces of a joint with clearance.
    """
    wrenches = now.motion.wrenches(now.acceleration)
    by_name = dict(zip(now.actions, now.pairs, strict=False))
    by_name |= dict(zip([j.name for j in mechanism.closures()], now.closing, strict=True))
    out: list[SpatialForce] = []
    for joint in mechanism.joints:
        pivot, missing = now.motion[joint.child].pivot, wrenches[joint.child]
        force, moment = scale(-1.0, missing.force), scale(-1.0, missing.moment)
        beyond, joint_pair = mechanism.beyond(joint.child), by_name.get(joint.name)
        for pair in (*now.pairs, *now.closing):
            if pair is joint_pair:
                continue
            inside = float((pair.child in beyond) - (pair.parent in beyond))
            force = subtract(force, scale(inside, pair.force))
            turning = add(cross(subtract(pair.at, pivot), pair.force), pair.torque)
            moment = subtract(moment, scale(inside, turning))
        out.append(SpatialForce(force, moment))
    return out + [SpatialForce(by_name[loop.name].force, by_name[loop.name].torque) for loop in mechanism.loops]
