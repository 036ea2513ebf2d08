"""Forces in the joints: of a state, and of the ideal mechanism, whose joints tell where real pins are pressed."""

from collections.abc import Mapping
from typing import NamedTuple

from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.dynamics.equations import Balance, balance
from clearance_jax.dynamics.inertia import Extra, Wrench, inertial_wrenches
from clearance_jax.dynamics.kinematics import sleeve_axes
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.spatial import Pair, Vector, add, cross, scale, subtract


class Reaction(NamedTuple):
    """What a joint exerts on the pin (its child): `force` [N] in the world's axes, `on_pin` the same force in the
    sleeve's axes, `at` the pin's centre in the world [m]. (About its own centre a pin in the plane is not turned:
    the torque that turns it is its drive's or actuator's.)
    """

    force: Vector
    on_pin: Pair
    at: Vector


def joint_reactions(
    mechanism: Mechanism, time: Scalar, y: Array, places: Mapping[str, Pair] | None = None
) -> dict[str, Reaction]:
    """What each joint with clearance would exert if it were ideal, by name: by the accelerations that drives, weight,
    springs and actuators give the ideal mechanism, without any contact law.

    **Arguments:** `time` [s]; `y`: the ideal mechanism's state `[q, v]`, its loops closed; `places`: where the pins are
    held in their sleeves [m], in the sleeves' axes (default: in the middle).

    **Raises:** `ClearanceError` where the ideal joints hold each other (their reactions are not determined).
    """
    return held_reactions(mechanism, time, held_balance(mechanism, time, y, places or {}))


def held_balance(mechanism: Mechanism, time: Scalar, y: Array, places: Mapping[str, Pair]) -> Balance:
    """The equations of motion of the mechanism with its pins held, see `joint_reactions`."""
    held = determined(mechanism.prepared().held(places).unsampled()).at(time)
    return balance(held, time, layout(held).split(y))


def held_reactions(mechanism: Mechanism, time: Scalar, now: Balance) -> dict[str, Reaction]:
    """The reactions in the joints with clearance, of a balance of the mechanism with its pins held."""
    ideal = mechanism.ideal().at(time)
    forces = dict(zip([j.name for j in ideal.all_joints()], (w.force for w in reactions(ideal, now)), strict=True))
    out = {}
    for joint in mechanism.clearance_joints():
        force, pin = forces[joint.name], now.motion[joint.child]
        turned = sleeve_axes(joint.joint, now.motion)
        out[joint.name] = Reaction(force, turned.undo(force)[:2], pin.point(joint.joint.at_child.vector))
    return out


def determined(ideal: Mechanism) -> Mechanism:
    """The ideal mechanism, if its loops demand no more than its joints can give; else raises `ClearanceError`."""
    if ideal.is_plane and 2 * len(ideal.closures()) > layout(ideal).free:
        raise ClearanceError(
            "Without its clearances this mechanism is over-constrained: how its ideal joints share the load is not "
            'determined. Free more coordinates, or start it by `start = "centre"`.'
        )
    return ideal


def reactions(mechanism: Mechanism, now: Balance) -> list[Wrench]:
    """Force and moment on the child in every joint, tree then loops, in the world's axes: by the momentum of what hangs
    on it. The moment is that about the joint's place on the child; of a driven or actuated joint the effort is in it.
    """
    wrenches = inertial_wrenches(mechanism, now.motion, Extra(now.acceleration), every=True)
    by_name = dict(zip(now.actions, now.pairs, strict=False))
    by_name |= dict(zip([j.name for j in mechanism.closures()], now.closing, strict=True))
    out: list[Wrench] = []
    for joint in mechanism.joints:
        if joint.name in now.actions:
            pair = by_name[joint.name]
            out.append(Wrench(pair.force, pair.torque))
            continue
        pivot, missing = now.motion[joint.child].pivot, wrenches[joint.child]
        force, moment = scale(-1.0, missing.force), scale(-1.0, missing.moment)
        beyond = mechanism.beyond(joint.child)
        for pair in (*now.pairs, *now.closing):
            inside = float((pair.child in beyond) - (pair.parent in beyond))
            force = subtract(force, scale(inside, pair.force))
            turning = add(cross(subtract(pair.at, pivot), pair.force), pair.torque)
            moment = subtract(moment, scale(inside, turning))
        out.append(Wrench(force, moment))
    return out + [Wrench(by_name[loop.name].force, by_name[loop.name].torque) for loop in mechanism.loops]
