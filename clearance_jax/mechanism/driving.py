"""Changes of the drives of joint coordinates, by name."""

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping

from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.mechanism.actuators import DriveSpring
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.compounds import Ball
from clearance_jax.mechanism.coordinate import Coordinate
from clearance_jax.mechanism.motion_laws import AbstractMotionLaw
from clearance_jax.mechanism.tree import AbstractJoint


def drivable(joints: Iterable[AbstractJoint]) -> dict[str, Coordinate]:
    """The coordinates of joints of the tree that a drive may prescribe, by name: all but play and balls."""
    return {c.name: c for joint in joints for c in joint.own_coordinates() if _field(joint, c) is not None}


def motor_of(name: str) -> str:
    """The name of the motor's coordinate in an elastic drive of the coordinate `name`."""
    return f"{name}_motor"


def gives_way(motion: Motion | Ball) -> bool:
    """Whether it is the motion of a drive's spring."""
    return any(isinstance(actuator, DriveSpring) for actuator in motion.actuators)


def with_motions(joint: AbstractJoint, change: Callable[[Coordinate], Motion]) -> AbstractJoint:
    """The joint with changed motions of its coordinates (except play and balls)."""
    fields = ((_field(joint, coordinate), coordinate) for coordinate in joint.own_coordinates())
    changed = {field: change(c) for field, c in fields if field is not None}
    changed = {field: motion for field, motion in changed.items() if motion is not getattr(joint, field)}
    return dataclasses.replace(joint, **changed) if changed else joint


def with_drives(joint: AbstractJoint, drives: Mapping[str, AbstractMotionLaw]) -> AbstractJoint:
    """The joint with drives for its named coordinates."""

    def change(coordinate: Coordinate) -> Motion:
        if coordinate.name not in drives:
            return coordinate.motion
        # The rest of the motion (limits, for example) stays; actuators would have no effect.
        return dataclasses.replace(coordinate.motion, drive=drives[coordinate.name], actuators=())

    return with_motions(joint, change)


def without_sampling(joint: AbstractJoint) -> AbstractJoint:
    """The joint whose sampled actuators act continuously."""

    def change(coordinate: Coordinate) -> Motion:
        actuators = tuple(actuator.without_sampling() for actuator in coordinate.motion.actuators)
        return dataclasses.replace(coordinate.motion, actuators=actuators)

    return with_motions(joint, change)


def without_drives(joint: AbstractJoint, names: Collection[str]) -> AbstractJoint:
    """The joint with its named coordinates free, without drives and actuators."""

    def change(coordinate: Coordinate) -> Motion:
        if coordinate.name not in names:
            return coordinate.motion
        return dataclasses.replace(coordinate.motion, drive=None, actuators=())

    return with_motions(joint, change)


def check_freed(joints: Iterable[AbstractJoint], names: Collection[str]) -> None:
    """Raise for an unknown coordinate and for one whose drive gives way."""
    known = drivable(joints)
    for name in names:
        _check_driven(known, name, "be freed", "without drives its spring would be gone. Free")


def check_drives(joints: Iterable[AbstractJoint], drives: Mapping[str, object]) -> None:
    """Raise for a coordinate that cannot be driven, and for a value that is no drive."""
    known = drivable(joints)
    for name, drive in drives.items():
        _check_driven(known, name, "drive", "a drive of this coordinate would take its spring away. Drive")
        if not isinstance(drive, AbstractMotionLaw):
            raise ClearanceError(
                f"`{name}` must be driven by a drive, for instance `Constant(0.5)`, but it was given {quote(drive)}."
            )


def _check_driven(known: Mapping[str, Coordinate], name: str, to: str, instead: str) -> None:
    """Raise for an unknown coordinate, or one whose drive gives way; `to`: the intended use; `instead`: the advice for
    its motor.
    """
    if name not in known:
        raise ClearanceError(f"There is no coordinate `{name}` to {to}. " + suggest(str(name), known))
    if gives_way(known[name].motion):
        raise ClearanceError(f"The drive of `{name}` gives way, and {instead} its motor, `{motor_of(name)}`.")


def _field(joint: AbstractJoint, coordinate: Coordinate) -> str | None:
    """The joint's field that holds the motion of its coordinate."""
    for field in dataclasses.fields(joint):
        value = getattr(joint, field.name)
        if isinstance(value, Motion) and value is coordinate.motion:
            return field.name
    return None
