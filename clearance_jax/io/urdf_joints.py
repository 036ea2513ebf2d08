"""Joints of a URDF as joints of a mechanism. What is exactly zero there, or along a coordinate axis, stays absent."""

from clearance_jax.io.urdf_parts import NOWHERE, Joint, Triple
from clearance_jax.mechanism.actuators import AbstractActuator, JointFriction, JointSpring
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.compounds import Ball, Free, Planar
from clearance_jax.mechanism.limits import Limits
from clearance_jax.mechanism.placement import ORIGIN, Axis, Orientation, Position, as_axis
from clearance_jax.mechanism.tree import AbstractJoint, Prismatic, Revolute


def joint_of(joint: Joint, name: str, parent: str, child: str) -> AbstractJoint:
    """The joint between two bodies, under the names that these have in the mechanism."""
    ends = {"name": name, "parent": parent, "child": child}
    ends |= {"at_parent": position_of(joint.xyz), "orientation": orientation_of(joint.rpy)}
    if joint.kind == "floating":
        damping = joint.damping if joint.damping > 0 else None
        slides = {f"slide_{letter}": Motion(actuators=_losses(joint)) for letter in "xyz"}
        return Free(**ends, **slides, motion=Ball(damping=damping))
    if joint.kind == "planar":
        motions = {name: Motion(actuators=_losses(joint)) for name in ("slide_x", "slide_y", "turn")}
        return Planar(**ends, **motions, axis=axis_of(joint.axis))
    kind = Prismatic if joint.kind == "prismatic" else Revolute
    return kind(**ends, axis=axis_of(joint.axis), motion=_motion(joint))


def _motion(joint: Joint) -> Motion:
    return Motion(position=_start(joint.limits or Limits()), actuators=_losses(joint), limits=joint.limits)


def _losses(joint: Joint) -> tuple[AbstractActuator, ...]:
    """Its damping and its friction, each along every coordinate of the joint."""
    damper = (JointSpring(0.0, joint.damping),) if joint.damping > 0 else ()
    return (*damper, JointFriction(joint.friction)) if joint.friction > 0 else damper


def _start(limits: Limits) -> float:
    """Zero where the limits hold it, or else their middle (of one limit: there)."""
    lower = -float("inf") if limits.lower is None else limits.lower
    upper = float("inf") if limits.upper is None else limits.upper
    if lower <= 0.0 <= upper:
        return 0.0
    ends = [end for end in (limits.lower, limits.upper) if end is not None]
    return sum(ends) / len(ends)


def axis_of(axis: Triple) -> Axis:
    """An axis, by its letter where it has one."""
    return as_axis(axis)


def position_of(xyz: Triple) -> Position:
    """A place [m], without components that are zero."""
    return ORIGIN if xyz == NOWHERE else Position(*_present(xyz))


def orientation_of(rpy: Triple) -> Orientation | None:
    """A turn [rad], without angles that are zero; none where all are."""
    return None if rpy == NOWHERE else Orientation(*_present(rpy))


def _present(numbers: Triple) -> list[float | None]:
    return [None if number == 0 else number for number in numbers]
