"""Wrenches of springs and of loads from outside on the bodies."""

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.frames import Frames, Pair
from clearance_jax.dynamics.kinematics import spring_state
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.loads import Wrench
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.spatial import ZERO, Term, dot, plus, scale, total


def applied_pairs(mechanism: PreparedMechanism, time: Scalar, motion: Frames) -> list[Pair]:
    """Wrench pairs of springs and loads."""
    pairs = []
    for spring in mechanism.springs:
        now = spring_state(spring, motion)
        # Along the line through both points the place of application does not matter: one point serves both bodies.
        end = motion[spring.body_b].point(spring.at_b.vector)
        pairs.append(Pair(spring.body_a, spring.body_b, scale(-now.tension, now.along), ZERO, end))
    return pairs + [load_pair(wrench, time, motion) for wrench in mechanism.wrenches]


def load_pair(wrench: Wrench, time: Scalar, motion: Frames) -> Pair:
    """A load as a wrench pair between the ground and its body."""
    frame = motion[wrench.body]
    force, torque = wrench.now(time)
    if wrench.axes == "body":
        force, torque = frame.rotation.apply(force), frame.rotation.apply(torque)
    return Pair(GROUND, wrench.body, force, torque, frame.point(wrench.at.vector))


def load_power(mechanism: PreparedMechanism, time: Scalar, motion: Frames) -> Term:
    """Power of the loads from outside [W]."""
    powers = []
    for wrench in mechanism.wrenches:
        frame, pair = motion[wrench.body], load_pair(wrench, time, motion)
        powers.append(plus(dot(pair.force, frame.velocity_at(pair.at)), dot(pair.torque, frame.spin)))
    return total(powers)
