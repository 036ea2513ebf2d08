"""Mechanisms with elastic drives, and with joints that are off their places and directions.

In an elastic drive a motor turns its link through gears and shafts, modelled as a spring and a damper. The joint then
has two coordinates about its axis. `NAME_motor` is that of the motor, which moves as the joint's drive or actuators
say; `NAME` is the deflection of the spring, by which the link is ahead of it. The sleeve is on the parent, and the pin
turns in it with the link, by the sum of both. A motor moved by actuators has the inertia of its rotor as seen through
its gears, `Motion.rotor_inertia`. (The flexible joint of Spong, Modeling and control of elastic joint robots, ASME
Journal of Dynamic Systems, Measurement, and Control 109, 1987.)

A misaligned joint has errors of link lengths, axes and zeros of coordinates. It gets two frames without mass:
`NAME_frame` is where it is meant to be, the joint `NAME_misalignment` places `NAME_axis` on it, and the joint itself is
on `NAME_axis`. The ideal mechanism has no misalignment, so errors of position and orientation include its effect.
"""

import dataclasses
from collections.abc import Iterable
from typing import Any

from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.laws import AbstractNormalLaw, Flank
from clearance_jax.mechanism.actuators import SLOW, DriveLoss, DriveSpring, JointFriction, Wave
from clearance_jax.mechanism.body import Body, Motion, Motor, Stops
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import ORIGIN, Orientation, Position
from clearance_jax.mechanism.tree.tree import AbstractJoint, Fixed, Misalignment, Prismatic, Revolute
from clearance_jax.mechanism.variants import motor_of
from clearance_jax.parameters import Demand, Parametrised, check_demands, physical


def like(cls: type, name: str, **changes) -> Any:
    """A field like that of another class, with changes of its metadata."""
    given = {field.name: field for field in dataclasses.fields(cls)}[name]
    return dataclasses.field(default=changes.pop("default", given.default), metadata={**given.metadata, **changes})


class Compliance(Parametrised):
    """The elasticity between a motor and its link, and its backlash.

    **Arguments:**

    - `stiffness` [N m/rad] and `damping` [N m s/rad], seen from the link; of a slide [N/m] and [N s/m]. Several
      stiffnesses, in an array, hold each up to the next of the rising `efforts` [N m] or [N], as of a harmonic drive.
    - `backlash` [rad or m]: the whole gap, seen from the link. Its flanks have the law `laws.Flank` of these numbers;
      `damping_factor` and `limited` are further ones of this law. The drive touches at either end of the gap, in
      contacts like those of a clearance joint, by the name `NAME_drive`.
    - `rotor_inertia` [kg m^2], or [kg]: of a motor that actuators move: the inertia of the rotor times the square of
      the gear ratio.
    - `cubic` [N m/rad^3]: a further effort, with the third power of the deflection; beside one stiffness only.
    - `error` A [rad or m], `error_order` n [1/rad or 1/m], `error_phase` p: a transmission error A sin(n q_motor + p),
      by which the link is ahead of its motor. Of one error in a turn of the motor n is the ratio of the gear.
    - `efficiency` eta, above 0 and at most 1: a loss (1 - eta) |T| tanh(w / w_t) against the motor, of the effort T of
      the spring or its flanks, the motor's speed w, and `efficiency_speed` w_t [rad/s or m/s]. It acts whichever way
      power flows: a motor that moves a load bears 2 - eta times T, one that a load moves eta times T.
    - `friction`: on the link's side of the spring. (Friction among the joint's own actuators is on the motor's side.)
    """

    stiffness: Scalar = like(Flank, "stiffness", help="stiffness, of several pieces in an array")
    damping: Scalar = like(Flank, "damping")
    rotor_inertia: Scalar | None = physical(
        "effort*s^2/coordinate",
        "inertia of the motor's rotor, seen through the gears",
        '"1.5 kg*m^2"',
        "a drive that is followed exactly",
        above=0.0,
        default=None,
    )
    backlash: Scalar | None = like(DriveSpring, "backlash", lifted=False)
    efforts: Float[Array, " pieces"] | None = like(Flank, "efforts")
    damping_factor: Scalar | None = like(Flank, "damping_factor")
    limited: bool = like(Flank, "limited")
    cubic: Scalar | None = like(Flank, "cubic")
    error: Scalar | None = like(Wave, "error", default=None)
    error_order: Scalar | None = like(Wave, "error_order", absent="there is no `error`", default=None)
    error_phase: Scalar = like(Wave, "error_phase")
    friction: JointFriction | None = None
    efficiency: Scalar | None = like(DriveLoss, "efficiency", default=None)
    efficiency_speed: Scalar = like(DriveLoss, "efficiency_speed")

    def __check_init__(self):
        if (self.error is None) != (self.error_order is None):
            raise ClearanceError("A transmission error needs `error` and `error_order`, or neither.").about("error")
        if self.error is None and not isinstance(self.error_phase, Tracer) and float(self.error_phase) != 0:
            raise ClearanceError("`error_phase` has no effect without `error`. Leave it out.").about("error_phase")
        speed = self.efficiency_speed
        if self.efficiency is None and not isinstance(speed, Tracer) and float(speed) != SLOW:
            text = "`efficiency_speed` has no effect without `efficiency`. Leave it out."
            raise ClearanceError(text).about("efficiency_speed")

    def demands(self):
        yield from self.flank.demands()
        if self.loss is not None:
            yield from self.loss.demands()
        if self.damping_factor is not None:
            words = "belongs to a `backlash`: leave it out, or give that too"
            yield Demand("damping_factor", self.backlash is not None, lambda: words)

    @property
    def flank(self) -> Flank:
        """The law of its flanks."""
        return Flank(self.stiffness, self.damping, self.damping_factor, self.efforts, self.limited, self.cubic)

    @property
    def wave(self) -> Wave | None:
        """Its transmission error."""
        if self.error is None or self.error_order is None:
            return None
        return Wave(self.error, self.error_order, self.error_phase)

    @property
    def loss(self) -> DriveLoss | None:
        """The friction of its gear under load."""
        return None if self.efficiency is None else DriveLoss(self.efficiency, self.efficiency_speed)


def with_compliance(mechanism: Mechanism, name: str, compliance: Compliance) -> Mechanism:
    """The same mechanism with an elastic drive in the joint `name`. Its drive or its actuators then belong to the
    coordinate `NAME_motor`.

    **Arguments:** `mechanism`; `name`: of a revolute or prismatic joint of the tree; `compliance`: spring and damper.

    **Raises:** `ClearanceError` for a joint of another kind, for a joint that nothing drives, for a rotor's inertia
    under a drive (which prescribes the rotor's motion), for its lack under actuators, and where the drive gives way
    already.
    """
    joint = mechanism.joint(name)
    if not isinstance(joint, Revolute | Prismatic) or joint not in mechanism.joints:
        raise ClearanceError(f"The drive of joint `{name}` cannot give way: only those of pins and slides of the tree.")
    if joint.motor is not None:
        raise ClearanceError(f"The drive of joint `{name}` gives way already.")
    if joint.motion.is_free and not joint.motion.actuators:
        raise ClearanceError(f"Nothing drives joint `{name}`: give it a drive or an actuator before it gives way.")
    if joint.motion.is_free and compliance.rotor_inertia is None:
        raise ClearanceError(f"The motor of joint `{name}` is moved by actuators: give its `rotor_inertia`.")
    if not joint.motion.is_free and compliance.rotor_inertia is not None:
        text = f"`rotor_inertia` has no effect in joint `{name}`: its drive is followed exactly, whatever its motor is."
        raise ClearanceError(text)
    inertia = {"rotor_inertia": compliance.rotor_inertia, "name": motor_of(name)}
    check_demands(compliance, f"{name}.", joint.units)
    drive = DriveSpring(
        compliance.flank, compliance.backlash, wave=compliance.wave, loss=compliance.loss, name="compliance"
    )
    spring = Motion(actuators=(drive,))
    if compliance.friction is not None:
        rub = (
            compliance.friction
            if compliance.friction.name
            else dataclasses.replace(compliance.friction, name="friction")
        )
        spring = dataclasses.replace(spring, actuators=(*spring.actuators, rub))
    moved = vars(joint.motion) | {"stops": None}
    spring = dataclasses.replace(spring, stops=joint.motion.stops)
    return mechanism.with_joint(dataclasses.replace(joint, motor=Motor(**moved | inertia), motion=spring))


def with_stops(mechanism: Mechanism, flank: AbstractNormalLaw, names: Iterable[str] | None = None) -> Mechanism:
    """The same mechanism with stops at the limits of its free coordinates, as a robot's file has them.

    **Arguments:** `mechanism`; `flank`: the law of all stops, with efforts [N m] of angles, [N] of lengths; `names`: of
    revolute or prismatic joints of the tree; `None`: every free one that has limits.

    **Raises:** `ClearanceError` for a joint of another kind, one that moves by a drive, one without limits, and, where
    no names are given, if angles and lengths would share the law.
    """
    known = {j.name: j for j in mechanism.joints if isinstance(j, Revolute | Prismatic)}
    wanted = [name for name, j in known.items() if _ends(j) and j.motion.is_free] if names is None else list(names)
    kinds = {type(known[name]) for name in wanted if name in known}
    if names is None and len(kinds) > 1:
        raise ClearanceError("Angles and lengths cannot have one law of stops. Name those of one kind: `names`.")
    for name in wanted:
        if name not in known:
            raise unknown_name(f"There is no revolute or prismatic joint `{name}` of the tree.", name, known)
        joint = known[name]
        if not _ends(joint) or not joint.motion.is_free:
            what = "no limits" if not _ends(joint) else "a drive"
            raise ClearanceError(f"Joint `{name}` has {what}, so it cannot have stops.").about(name)
        motion = dataclasses.replace(joint.motion, stops=Stops(**_ends(joint), flank=flank))
        mechanism = mechanism.with_joint(dataclasses.replace(joint, motion=motion))
    return mechanism


def _ends(joint: Revolute | Prismatic) -> dict[str, float]:
    """The limits of a joint, those that it has."""
    limits = joint.motion.limits
    ends = {} if limits is None else {"lower": limits.lower, "upper": limits.upper}
    return {name: float(value) for name, value in ends.items() if value is not None}


def with_misalignment(mechanism: Mechanism, names: Iterable[str] | None = None) -> Mechanism:
    """The same mechanism whose joints can be off their intended places and directions. These errors are zero at first:
    scatter them by name. Those of the joint `hip` are

    - `hip_misalignment.at_parent.x`, `.y`, `.z` [m]: the place of its frame, along the frame's own axes;
    - `hip_misalignment.orientation.roll`, `.pitch`, `.yaw` [rad]: turns of its frame about its own axes. The one about
      the joint's axis (`yaw` for z) is the error of its zero that a calibration did not remove.

    In the plane these are `x`, `y` and `yaw`.

    **Arguments:** `mechanism`; `names`: of joints of the tree; `None`: all that move.

    **Raises:** `ClearanceError` for an unknown joint, one that closes a loop, and one that is misaligned already.
    """
    known = [joint.name for joint in mechanism.joints]
    moving = [joint.name for joint in mechanism.joints if joint.own_coordinates()]
    wanted = moving if names is None else list(names)
    for name in wanted:
        if name not in known:
            raise unknown_name(f"There is no joint `{name}` of the tree to be misaligned.", name, known)
        if f"{name}_misalignment" in known:
            raise ClearanceError(f"Joint `{name}` has a misalignment already. Name it once.")
    plane, bodies, joints = mechanism.is_plane, list(mechanism.bodies), []
    for joint in mechanism.joints:
        if joint.name in wanted:
            bodies += [Body(f"{joint.name}_frame"), Body(f"{joint.name}_axis")]
            joints += _misaligned(joint, plane)
        else:
            joints.append(joint)
    return dataclasses.replace(mechanism, bodies=tuple(bodies), joints=tuple(joints))


def _misaligned(joint: AbstractJoint, plane: bool) -> list[AbstractJoint]:
    """The joint's nominal frame, its misalignment, and the joint on it."""
    meant, axis, name = f"{joint.name}_frame", f"{joint.name}_axis", f"{joint.name}_misalignment"
    place = Fixed(f"{joint.name}_place", joint.parent, meant, joint.at_parent, ORIGIN, joint.angle, joint.orientation)
    none = None if plane else 0.0
    off = Misalignment(name, meant, axis, Position(0.0, 0.0, none), ORIGIN, None, Orientation(none, none, 0.0))
    changed = {"parent": axis, "at_parent": ORIGIN, "angle": None, "orientation": None}
    return [place, off, dataclasses.replace(joint, **changed)]  # pyright: ignore[reportArgumentType]
