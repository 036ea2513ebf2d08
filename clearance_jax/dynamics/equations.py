"""The equations of motion of one state: what the joints exert, the accelerations, the forces of ideal closures."""

from typing import NamedTuple

from clearance_jax._sharing import shared
from clearance_jax._types import Scalar
from clearance_jax.dynamics.conditions import conditions
from clearance_jax.dynamics.constraint import closing_pairs, constraint
from clearance_jax.dynamics.inertia import Pair, generalised_load, mass_matrix
from clearance_jax.dynamics.kinematics import Frames, Play, frames, play, spring_state
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Action
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import State
from clearance_jax.spatial import ZERO, Term, minus, plus, scale


class Balance(NamedTuple):
    """The equations of motion, solved: where everything is, what each clearance joint does (by name), the wrench pairs
    of clearances and springs, the accelerations of the free coordinates, and the wrenches of the ideal closures.
    """

    motion: Frames
    plays: dict[str, Play]
    actions: dict[str, Action]
    pairs: list[Pair]
    acceleration: list[Term]
    closing: list[Pair]


def balance(mechanism: Mechanism, time: Scalar, state: State) -> Balance:
    """Where everything is, what the joints exert, the equations of motion."""
    motion = frames(mechanism, time, state)
    plays = {joint.name: play(joint, motion, state) for joint in mechanism.clearance_joints()}
    actions = {
        joint.name: shared(joint.clearance.act(plays[joint.name].relative, state.memory[joint.name]))
        for joint in mechanism.clearance_joints()
    }
    pairs = wrench_pairs(mechanism, motion, plays, actions)
    acceleration, closing = accelerations(mechanism, time, state, motion, pairs)
    return Balance(motion, plays, actions, pairs, shared(acceleration), closing)


def wrench_pairs(
    mechanism: Mechanism, motion: Frames, plays: dict[str, Play], actions: dict[str, Action]
) -> list[Pair]:
    """Wrench pairs of the clearance joints and springs."""
    pairs = []
    for joint in mechanism.clearance_joints():
        at, now = plays[joint.name], actions[joint.name]
        pairs.append(
            Pair(joint.parent, joint.child, at.rotation.apply((*now.force, 0.0)), (0.0, 0.0, now.torque), at.pin)
        )
    for spring in mechanism.springs:
        now = spring_state(spring, motion)
        # Along the line through both points the place of application does not matter: one point serves both bodies.
        end = motion[spring.body_b].point(spring.at_b.vector)
        pairs.append(Pair(spring.body_a, spring.body_b, scale(-now.tension, now.along), ZERO, end))
    return pairs


def accelerations(
    mechanism: Mechanism, time: Scalar, state: State, motion: Frames, pairs: list[Pair]
) -> tuple[list[Term], list[Pair]]:
    """Accelerations of the free coordinates under the given internal wrenches, and the closures' wrenches."""
    inertia = mass_matrix(mechanism, motion)
    free = inertia.solve(generalised_load(mechanism, time, state, motion, pairs))
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
