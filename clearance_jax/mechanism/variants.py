"""Variants of joints: with other drives or play (a whole clearance, or a designer's numbers), or without them."""

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx

from clearance_jax.errors import ClearanceError, quote, unknown_name
from clearance_jax.joints import AbstractClearance, AbstractPin, Tolerance
from clearance_jax.joints.checks import check_sizes
from clearance_jax.joints.presets import BALL, FIT, GUIDE, OWN, PIN, SHAFT, Preset, radial_clearance_of
from clearance_jax.joints.seating import pose_at
from clearance_jax.laws import Flank
from clearance_jax.laws.stiffness import Stiffened
from clearance_jax.mechanism.actuators import AbstractActuator, DriveSpring, JointFriction
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.motion.drives import Constant
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw
from clearance_jax.mechanism.placement import Position, as_prepared
from clearance_jax.mechanism.tree.compounds import Ball, Cylindrical, Spherical
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed, Prismatic, Revolute
from clearance_jax.parameters import check_demands, replace
from clearance_jax.spatial import IDENTITY, UNIT, Term, add, is_zero, product, transpose


def drivable(joints: Iterable[AbstractJoint]) -> dict[str, Coordinate]:
    """The coordinates of joints of the tree that a drive may prescribe, by name: all but play and balls."""
    return {c.name: c for joint in joints for c in joint.own_coordinates() if _field(joint, c) is not None}


DRIVE, STOP, FRICTION = "{}_drive", "{}_stop", "{}_friction"
"""Names of the gaps of a coordinate: of its drive, of its stops, and of friction that sticks."""


def motor_of(name: str) -> str:
    """The name of the motor's coordinate in an elastic drive of the coordinate `name`."""
    return f"{name}_motor"


def motors_of(joints: Iterable[AbstractJoint]) -> dict[str, str]:
    """By coordinate of a link that of its motor, also where the drive between them is held."""
    return {joint.name: motor_of(joint.name) for joint in joints if getattr(joint, "motor", None) is not None}


def gives_way(motion: Motion | Ball) -> bool:
    """Whether it is the motion of a drive's spring."""
    return any(isinstance(actuator, DriveSpring) for actuator in motion.actuators)


def acting(motion: Motion) -> tuple[tuple[int, AbstractActuator], ...]:
    """The actuators of a motion that act as such, by number; others are contacts (see `mechanism.gaps`)."""
    every = enumerate(motion.actuators)
    return tuple((i, actuator) for i, actuator in every if not (has_gap(actuator) or rubs(actuator, motion)))


def has_gap(actuator: AbstractActuator) -> bool:
    """Whether it is the spring of a drive that is a contact: with backlash, an error, a loss, or corners."""
    if not isinstance(actuator, DriveSpring):
        return False
    return any(part is not None for part in (actuator.backlash, actuator.wave, actuator.loss, actuator.flank.efforts))


def rubs(actuator: AbstractActuator, motion: Motion) -> bool:
    """Whether it is friction that has a memory, or that acts on a link whose drive gives way."""
    return isinstance(actuator, JointFriction) and (actuator.law is not None or gives_way(motion))


def with_motions(joint: AbstractJoint, change: Callable[[Coordinate], Motion]) -> AbstractJoint:
    """The joint with changed motions of its coordinates (except play and balls)."""
    fields = ((_field(joint, coordinate), coordinate) for coordinate in joint.own_coordinates())
    changed = {field: change(c) for field, c in fields if field is not None}
    changed = {field: motion for field, motion in changed.items() if motion is not getattr(joint, field)}
    return dataclasses.replace(joint, **changed) if changed else joint


def with_drives(joint: AbstractJoint, drives: Mapping[str, AbstractMotionLaw | None]) -> AbstractJoint:
    """The joint with drives for its named coordinates (`None`: free), without their actuators; limits, say, stay."""

    def change(c: Coordinate) -> Motion:
        return dataclasses.replace(c.motion, drive=drives[c.name], actuators=()) if c.name in drives else c.motion

    return with_motions(joint, change)


def without_actuators(joint: AbstractJoint, names: Collection[str]) -> AbstractJoint:
    """The joint whose named coordinates have neither actuators nor stops."""

    def change(c: Coordinate) -> Motion:
        return dataclasses.replace(c.motion, actuators=(), stops=None) if c.name in names else c.motion

    return with_motions(joint, change)


def without_sampling(joint: AbstractJoint) -> AbstractJoint:
    """The joint whose sampled actuators act continuously, and whose servos have no integrals."""

    def change(c: Coordinate) -> Motion:
        return dataclasses.replace(c.motion, actuators=tuple(a.without_sampling() for a in c.motion.actuators))

    return with_motions(joint, change)


def check_freed(joints: Iterable[AbstractJoint], names: Collection[str], followers: Collection[str]) -> None:
    """Raise for an unknown coordinate, for one whose drive gives way, and for one that follows another."""
    known = drivable(joints)
    for name in names:
        if name in followers:
            raise ClearanceError(f"`{name}` follows another coordinate by a coupling. Free that one.").about(name)
        _check_driven(known, name, "be freed", "without drives its spring would be gone. Free")


def check_drives(joints: Iterable[AbstractJoint], drives: Mapping[str, object]) -> None:
    """Raise for a coordinate that cannot be driven, and for a value that is no drive."""
    known = drivable(joints)
    for name, drive in drives.items():
        _check_driven(known, name, "drive", "a drive of this coordinate would take its spring away. Drive")
        if not isinstance(drive, AbstractMotionLaw):
            text = f"`{name}` must be driven by a drive, for instance `Constant(0.5)`, but it was given {quote(drive)}."
            raise ClearanceError(text).about(name, drive)


def _check_driven(known: Mapping[str, Coordinate], name: str, to: str, instead: str) -> None:
    """Raise for an unknown coordinate, or one whose drive gives way: `instead` advises to use its motor."""
    if name not in known:
        raise unknown_name(f"There is no coordinate `{name}` to {to}.", str(name), known)
    if gives_way(known[name].motion):
        raise ClearanceError(f"The drive of `{name}` gives way, and {instead} its motor, `{motor_of(name)}`.")


def _field(joint: AbstractJoint, coordinate: Coordinate) -> str | None:
    """The joint's field that holds the motion of its coordinate; `None` for play, which has no field, and for balls."""
    if not isinstance(coordinate.motion, Motion):
        return None
    names = (field.name for field in dataclasses.fields(joint))
    return next((name for name in names if getattr(joint, name) is coordinate.motion), None)


PRESETS: Mapping[type[AbstractPlayed], Preset] = {Revolute: PIN, Prismatic: GUIDE, Spherical: BALL, Cylindrical: SHAFT}
"""Presets of play, by the kind of joint."""


def with_play(joint: AbstractJoint, clearance: Any, numbers: Mapping[str, Any]) -> AbstractPlayed:
    """The joint with a whole `clearance`, one made of a designer's `numbers`, or some of its own replaced. **Raises**
    `ClearanceError` for a joint without play, numbers of another kind, and what is missing or contradicts itself.
    """
    if not isinstance(joint, AbstractPlayed):
        raise no_play_reason(joint)
    numbers = {name: value for name, value in numbers.items() if value is not None}
    if clearance is None:
        clearance = _make(joint, numbers)
    elif numbers:
        raise ClearanceError(f"Joint `{joint.name}` is given a whole clearance and numbers of one. Give one of them.")
    elif not isinstance(clearance, AbstractClearance):
        raise ClearanceError(
            f"The clearance of joint `{joint.name}` is a whole one, such as `RevoluteClearance(...)`, not "
            f"{quote(clearance)}. Give a number of it by its name: "
            f"`with_clearance({joint.name!r}, radial_clearance=1e-4)`, say."
        ).about(f"{joint.name}.clearance", clearance)
    check_demands(clearance, f"{joint.name}.")
    return dataclasses.replace(joint, clearance=clearance)


def no_play_reason(joint: AbstractJoint) -> ClearanceError:
    """The error for play in a joint of a kind that has none."""
    kinds = ", ".join(kind.__name__.lower() for kind in PRESETS)
    text = f"Joint `{joint.name}` is of a kind that has no play ({type(joint).__name__.lower()}). These have: {kinds}."
    return ClearanceError(text).about(joint.name, type(joint).__name__.lower())


def _make(joint: AbstractPlayed, numbers: Mapping[str, Any]) -> Any:
    """A clearance by a designer's numbers, or the joint's own with these numbers."""
    kind, preset = numbers.get("kind"), PRESETS.get(type(joint))
    if isinstance(kind, type) and issubclass(kind, AbstractClearance):
        preset = OWN.with_sizes(kind)
    if preset is None:
        raise ClearanceError(f"Joint `{joint.name}` is of a kind that is given its whole clearance only.")
    if joint.clearance is not None:
        preset = preset.with_sizes(type(joint.clearance))
    for name in numbers:
        if name not in preset.numbers:
            message = f"The play of joint `{joint.name}` has no number `{name}`. " + preset.instead(name)
            raise ClearanceError(message).about(f"{joint.name}.{name}")
    if joint.clearance is not None:
        return _change(joint, preset, numbers)
    if not numbers:
        listed = ", ".join(preset.numbers)
        raise ClearanceError(f"Joint `{joint.name}` is ideal: give its whole clearance, or its numbers: {listed}.")
    return preset.make(**numbers)


def _change(joint: AbstractPlayed, preset: Preset, numbers: Mapping[str, Any]) -> Any:
    """The joint's own clearance with other numbers."""
    clearance: Any = joint.clearance
    sizes = {name: value for name, value in numbers.items() if name in preset.fields}
    check_sizes(**sizes)
    kind = clearance.kind or type(clearance).__name__
    if numbers.get("kind", kind) not in (kind, type(clearance)):
        raise ClearanceError(f"Joint `{joint.name}` has play of another kind, `{kind}`. Give it a whole clearance.")
    if any(word in numbers for word in FIT):
        if not isinstance(clearance, AbstractPin):
            raise ClearanceError(f"The clearance of joint `{joint.name}` is of a kind that has no `fit`.")
        fit = numbers.get("fit"), numbers.get("temperature")
        radius = sizes.get("pin_radius", clearance.pin_radius)
        sizes["radial_clearance"], tolerance = radial_clearance_of(sizes.get("radial_clearance"), radius, *fit)
        clearance = _with_tolerance(clearance, tolerance)
    elif {"radial_clearance", "pin_radius"} & sizes.keys() and getattr(clearance, "tolerance", None) is not None:
        clearance = _with_tolerance(clearance, None)  # it was that of a fit, which other numbers do not have
    for name in sizes:
        if getattr(clearance, name, None) is None:
            text = f"The clearance of joint `{joint.name}` has no `{name}` to be replaced. Give it a whole clearance."
            raise ClearanceError(text).about(f"{joint.name}.{name}")
    return replace(clearance, sizes)


def _with_tolerance(clearance: Any, tolerance: Tolerance | None) -> Any:
    """The clearance with another tolerance."""
    return eqx.tree_at(lambda c: c.tolerance, clearance, tolerance, is_leaf=lambda x: x is None)


def without_play(joint: AbstractJoint, values: Sequence[Term] | None) -> AbstractJoint:
    """The ideal joint, its pin held at values of its play coordinates [m or rad] (`None`: in the middle)."""
    if not isinstance(joint, AbstractPlayed) or joint.clearance is None:
        return joint
    ideal = eqx.tree_at(lambda j: j.clearance, joint, None)
    if values is None:
        return ideal
    pose = pose_at(joint.play(), values)
    # The sleeve's axes are the parent's, turned by the joint's own angle.
    turned = joint.turned if joint.sleeve is UNIT else joint.turned.compose(joint.sleeve)
    x, y, z = add(joint.at_parent.vector, turned.apply(pose.place))
    changed: dict[str, Any] = {"at_parent": Position(x, y, joint.at_parent.z if is_zero(z) else z)}
    if pose.rotation.rows is not UNIT:
        tilt = product(joint.sleeve, product(pose.rotation.rows, transpose(joint.sleeve)))
        if joint.own_coordinates()[0].play is None:  # it slides before it has play
            child = IDENTITY if joint.child_orientation is None else joint.child_orientation.rotation
            changed["child_orientation"] = as_prepared(product(child.rows, transpose(tilt)))
        else:
            changed |= {"angle": None, "orientation": as_prepared(product(joint.turned.rows, tilt))}
    return dataclasses.replace(ideal, **changed)


def without_gaps(joint: AbstractJoint) -> AbstractJoint:
    """The joint without backlash in its drive, and without stops."""

    def firm(actuator: Any) -> Any:
        return dataclasses.replace(actuator, backlash=None, wave=None, loss=None) if has_gap(actuator) else actuator

    def change(c: Coordinate) -> Motion:
        actuators = tuple(firm(actuator) for actuator in c.motion.actuators)
        changed = c.motion.stops is not None or any(
            a is not b for a, b in zip(actuators, c.motion.actuators, strict=True)
        )
        return dataclasses.replace(c.motion, actuators=actuators, stops=None) if changed else c.motion

    return with_motions(joint, change)


def rigid(joint: AbstractJoint, at: Mapping[str, Any], moves_friction: bool = False) -> AbstractJoint:
    """The joint whose drive does not give way; `at`: by name of a drive's gap the place at which its link is held;
    `moves_friction`: whether friction of the link becomes its motor's, if that moves freely.
    """
    motor, motion = getattr(joint, "motor", None), getattr(joint, "motion", None)
    if motor is None or motion is None or not gives_way(motion):
        return joint
    still = Constant(at.get(DRIVE.format(joint.name), 0.0)).prepare()
    rubbing = tuple(actuator for actuator in motion.actuators if isinstance(actuator, JointFriction))
    if moves_friction and motor.is_free and rubbing:
        named = tuple(dataclasses.replace(rub, name=None) for rub in rubbing)
        motor = dataclasses.replace(motor, actuators=(*motor.actuators, *named))
    changed: dict[str, Any] = {"motor": motor}
    changed["motion"] = dataclasses.replace(motion, drive=still, actuators=(), stops=None)
    return dataclasses.replace(joint, **changed)


def change_drives(mechanism: Any, *, stiffer: float = 1.0, closer: float = 1.0, truer: float = 1.0) -> Any:
    """The mechanism with factors on stiffnesses of drives and flanks, on backlash, and on transmission errors."""

    def flank_of(flank: Any) -> Any:
        if not isinstance(flank, Flank):
            return Stiffened(flank, stiffer)
        numbers = {name: getattr(flank, name) for name in ("stiffness", "damping", "efforts", "cubic")}
        return dataclasses.replace(flank, **{name: stiffer * x for name, x in numbers.items() if x is not None})

    def made(actuator: Any) -> Any:
        if not isinstance(actuator, DriveSpring):
            return actuator
        wave = actuator.wave
        wave = None if wave is None else dataclasses.replace(wave, error=truer * wave.error)
        gap = None if actuator.backlash is None else closer * actuator.backlash
        return dataclasses.replace(actuator, flank=flank_of(actuator.flank), backlash=gap, wave=wave)

    def change(c: Coordinate) -> Motion:
        return dataclasses.replace(c.motion, actuators=tuple(map(made, c.motion.actuators)))

    changed = mechanism._with_joints(lambda joint: with_motions(joint, change))
    couplings = tuple(
        c if c.backlash is None else dataclasses.replace(c, backlash=closer * c.backlash, flank=flank_of(c.flank))
        for c in mechanism.couplings
    )
    return dataclasses.replace(changed, couplings=couplings)


def change_each_play(mechanism: Any, change: Callable[[Any], Any]) -> Any:
    """The mechanism with `change(clearance)` in the place of every clearance."""
    for joint in mechanism.clearance_joints():
        old = mechanism.joint(joint.name)
        mechanism = mechanism.with_joint(dataclasses.replace(old, clearance=change(joint.clearance)))
    return mechanism
