"""Converts URDF joints to joints of a mechanism. Numbers that are exactly zero become `None`."""

from clearance_jax.io.urdf_parts import NOWHERE, Joint, Triple
from clearance_jax.mechanism.actuators import AbstractActuator, JointFriction, JointSpring
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.compounds import Ball, Free, Planar
from clearance_jax.mechanism.limits import Limits
from clearance_jax.mechanism.placement import ORIGIN, Orientation, Position, as_axis
from clearance_jax.mechanism.tree import AbstractJoint, Prismatic, Revolute


def joint_of(joint: Joint, name: str, parent: str, child: str) -> AbstractJoint:
    """The joint of a mechanism between two bodies, with the names that it and they have there."""
    ends = {"name": name, "parent": parent, "child": child}
    ends |= {"at_parent": position_of(joint.xyz), "orientation": orientation_of(joint.rpy)}
    if joint.kind == "floating":
        damping = joint.damping if joint.damping > 0 else None
        slides = {f"slide_{letter}": Motion(actuators=_losses(joint)) for letter in "xyz"}
        return Free(**ends, **slides, motion=Ball(damping=damping))
    if joint.kind == "planar":
        motions = {name: Motion(actuators=_losses(joint)) for name in ("slide_x", "slide_y", "turn")}
        return Planar(**ends, **motions, axis=as_axis(joint.axis))
    kind = Prismatic if joint.kind == "prismatic" else Revolute
    return kind(**ends, axis=as_axis(joint.axis), motion=_motion(joint))


def _motion(joint: Joint) -> Motion:
    rotor = joint.rotor if joint.rotor > 0 else None
    start = _start(joint.limits or Limits())
    return Motion(position=start, actuators=_losses(joint), limits=joint.limits, rotor_inertia=rotor)


def _losses(joint: Joint) -> tuple[AbstractActuator, ...]:
    """Actuators for its spring, damping and friction, along each coordinate of the joint."""
    spring = JointSpring(joint.stiffness, joint.damping, joint.rest)
    damper = (spring,) if joint.damping > 0 or joint.stiffness > 0 else ()
    return (*damper, JointFriction(joint.friction)) if joint.friction > 0 else damper


def _start(limits: Limits) -> float:
    """The initial coordinate: 0 if it is within the limits, else their middle, or the only one."""
    lower = -float("inf") if limits.lower is None else limits.lower
    upper = float("inf") if limits.upper is None else limits.upper
    if lower <= 0.0 <= upper:
        return 0.0
    ends = [end for end in (limits.lower, limits.upper) if end is not None]
    return sum(ends) / len(ends)


def position_of(xyz: Triple) -> Position:
    """A position [m]; zero components become `None`."""
    return ORIGIN if xyz == NOWHERE else Position(*_present(xyz))


def orientation_of(rpy: Triple) -> Orientation | None:
    """An orientation [rad]; zero angles become `None`, as does a zero rotation."""
    return None if rpy == NOWHERE else Orientation(*_present(rpy))


def _present(numbers: Triple) -> list[float | None]:
    return [None if number == 0 else number for number in numbers]
