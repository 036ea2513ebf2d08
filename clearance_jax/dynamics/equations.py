"""The equations of motion of one state: what the joints exert, the accelerations, the forces of ideal closures."""

from typing import NamedTuple

from clearance_jax._sharing import shared
from clearance_jax._types import Scalar
from clearance_jax.dynamics.applied import applied_pairs
from clearance_jax.dynamics.conditions import conditions
from clearance_jax.dynamics.constraint import closing_pairs, constraint
from clearance_jax.dynamics.control import exerted
from clearance_jax.dynamics.inertia import Pair, generalised_load, mass_matrix
from clearance_jax.dynamics.kinematics import Frames, Play, frames, plays
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Action, PreparedClearance, each_joint
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import State
from clearance_jax.spatial import Term, minus, plus


class Balance(NamedTuple):
    """The equations of motion, solved: where everything is, what each clearance joint does (by name), the wrench pairs
    of clearances, springs and loads, the efforts of actuators and controllers, the accelerations of the free
    coordinates, and the wrenches of the ideal closures.
    """

    motion: Frames
    plays: dict[str, Play]
    actions: dict[str, Action]
    pairs: list[Pair]
    efforts: list[Term]
    acceleration: list[Term]
    closing: list[Pair]


def balance(mechanism: Mechanism, time: Scalar, state: State) -> Balance:
    """Where everything is, what the joints exert, the equations of motion."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, state)
    found, joints = plays(mechanism, time, state, motion), mechanism.clearance_joints()
    acting = [(joint.clearance, found[joint.name].relative, state.memory[joint.name]) for joint in joints]
    actions = dict(zip([joint.name for joint in joints], each_joint(PreparedClearance.act, acting), strict=True))
    pairs = contact_pairs(mechanism, found, actions) + applied_pairs(mechanism, time, motion)
    efforts = exerted(mechanism, time, state)
    acceleration, closing = accelerations(mechanism, motion, pairs, efforts)
    return Balance(motion, found, actions, pairs, efforts, shared(acceleration), closing)


def contact_pairs(mechanism: Mechanism, plays: dict[str, Play], actions: dict[str, Action]) -> list[Pair]:
    """Wrench pairs of the clearance joints."""
    pairs = []
    for joint in mechanism.clearance_joints():
        at, now = plays[joint.name], actions[joint.name]
        pairs.append(
            Pair(joint.parent, joint.child, at.rotation.apply(now.force), at.rotation.apply(now.torque), at.pin)
        )
    return pairs


def accelerations(
    mechanism: Mechanism, motion: Frames, pairs: list[Pair], efforts: list[Term]
) -> tuple[list[Term], list[Pair]]:
    """Accelerations of the free coordinates under wrenches between bodies and efforts of actuators, and the closures'
    wrenches.
    """
    inertia = mass_matrix(mechanism, motion)
    load = generalised_load(mechanism, motion, pairs)
    free = inertia.solve([plus(own, effort) for own, effort in zip(load, efforts, strict=True)])
    loops = mechanism.closures()
    if not loops:
        return free, []
    if not free:
        raise ClearanceError(
            f"The ideal loop `{loops[0].name}` joins bodies that are all prescribed: free one of them."
        )
    held = [conditions(loop, motion, len(free)) for loop in loops]
    every = [condition for own in held for condition in own]
    lag = [minus(minus(0.0, now.acceleration), now.reached(free)) for now in every]
    asked = constraint(inertia, every, mechanism)
    correction, forces = asked.closing(lag)
    closing = closing_pairs(loops, motion, held, forces)
    return [plus(a, b) for a, b in zip(free, correction, strict=True)], closing
