"""A scene as it is read: bodies, joints as rows that they hold or drive, springs, loads. SI units."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .drives import Drive, drive
from .gears import MOTOR, Coupling, Gap, couplings, gaps
from .play import Play, play
from .quantities import Vector, about, number, roll_pitch_yaw, vector

GROUND = "ground"
LISTS = ("begin", "end", "rise", "times", "values", "duration", "depth", "stiffness", "efforts", "teeth", "radii")
"""Keys of lists that are no vectors."""
DIRECTIONS = {"x": 0, "y": 1, "z": 2}
# What an ideal joint holds: slides along and turns about the axes of its frame on the parent.
HELD = {
    "revolute": ("x", "y", "z", "turn x", "turn y"),
    "prismatic": ("y", "z", "turn x", "turn y", "turn z"),
    "spherical": ("x", "y", "z"),
    "cylindrical": ("x", "y", "turn x", "turn y"),
    "fixed": ("x", "y", "z", "turn x", "turn y", "turn z"),
    "free": (),
}
# Its own coordinates, by their ends in a name.
COORDINATES = {
    "revolute": {"": "turn z"},
    "prismatic": {"": "x"},
    "cylindrical": {"_slide": "z", "_turn": "turn z"},
}


class Body(NamedTuple):
    """Mass [kg], inertia about the centre of mass [kg m^2], and where that is in the body's frame [m]."""

    mass: float
    inertia: Vector
    centre: Vector


def _nothing(rate: float) -> float:
    return 0.0


class Effort(NamedTuple):
    """An actuator: its effort at a time, coordinate and rate, and of this rate the power that its damper and its
    friction take, which is no work of the drives; what a servo measures if not its own coordinate; its period; the gain
    of the integral of its error, and this error at a time and coordinate (none: it has no integral).
    """

    of: Callable[[float, float, float], float]
    damped: Callable[[float], float] = _nothing
    rubbed: Callable[[float], float] = _nothing
    breaks: tuple[float, ...] = ()
    encoder: tuple[str, ...] = ()
    rate_encoder: tuple[str, ...] = ()
    period: float = 0.0
    gain: float = 0.0
    error: Callable[[float, float], float] | None = None


class Coordinate(NamedTuple):
    """A joint's own slide or turn: its initial value and rate, its drive, rotor inertia and actuators."""

    name: str
    direction: str
    start: float
    rate: float
    drive: Drive | None
    rotor: float
    efforts: tuple[Effort, ...]


class Joint(NamedTuple):
    """A joint: its frames on parent and child (place and matrix), what it holds, its coordinates, its play with the
    place where the pin starts; of a ball the initial orientation and spin.
    """

    name: str
    kind: str
    parent: str
    child: str
    at_parent: Vector
    at_child: Vector
    on_parent: Vector
    on_child: Vector
    held: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    play: Play | None
    eccentricity: Vector
    ball: tuple[Vector, Vector]


class Spring(NamedTuple):
    """A spring and damper between two points."""

    bodies: tuple[str, str]
    ends: tuple[Vector, Vector]
    stiffness: float
    damping: float
    free_length: float


class Load(NamedTuple):
    """A force on a point of a body and a torque, in world axes or those of the body, times a course."""

    body: str
    at: Vector
    force: Vector
    torque: Vector
    turns_along: bool
    course: Drive


class Model(NamedTuple):
    """A mechanism."""

    bodies: dict[str, Body]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...]
    loads: tuple[Load, ...]
    points: dict[str, tuple[str, Vector]]
    gravity: Vector
    plane: bool
    motors: tuple[Coordinate, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    gaps: tuple[Gap, ...] = ()

    @property
    def plays(self) -> tuple[Joint, ...]:
        """The joints with play."""
        return tuple(joint for joint in self.joints if joint.play is not None)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Instants at which a derivative of the motion jumps."""
        found = [t for load in self.loads for t in load.course.breaks]
        for coordinate in (*(c for joint in self.joints for c in joint.coordinates), *self.motors):
            found += coordinate.drive.breaks if coordinate.drive is not None else ()
            found += [t for effort in coordinate.efforts for t in effort.breaks]
        return tuple(sorted(set(found)))


def read(scene: dict) -> Model:
    """The model of a scene."""
    plane = _is_plane(scene)
    joints = tuple(_joint(name, table) for name, table in scene["joint"].items())
    every = couplings(scene)
    joints, motors = _behind_motors(joints, scene.get("compliance", {}))
    joints = _following(joints, motors, every)
    return Model(
        {name: _body(table) for name, table in scene["body"].items()},
        joints,
        tuple(_spring(table) for table in scene.get("spring", {}).values()),
        tuple(_load(table) for table in scene.get("wrench", {}).values()),
        {name: (table["body"], vector(table.get("at"))) for name, table in scene.get("point", {}).items()},
        vector(scene.get("gravity")),
        plane,
        motors,
        tuple(one for one in every if not one.slack),
        gaps(scene, every),
    )


def _behind_motors(joints, tables) -> tuple[tuple[Joint, ...], tuple[Coordinate, ...]]:
    """The joints whose drives give way move freely, and start where their motors do."""
    out, motors = [], []
    for joint in joints:
        if joint.name in tables:
            (own,) = joint.coordinates
            start, rate = (own.start, own.rate) if own.drive is None else own.drive.at(0.0)[:2]
            rotor = number(tables[joint.name].get("rotor_inertia", 0.0))
            motors.append(own._replace(name=MOTOR.format(own.name), start=start, rate=rate, rotor=rotor))
            own = own._replace(start=start, rate=rate, drive=None, efforts=(), rotor=0.0)
            joint = joint._replace(coordinates=(own,))
        out.append(joint)
    return tuple(out), tuple(motors)


def _following(joints, motors, every: tuple[Coupling, ...]) -> tuple[Joint, ...]:
    """Followers start by their leaders, with backlash by as much further as they say. What only follows drives is
    driven too: its motor and its friction are left out.
    """
    own = {one.name: one for one in (*(c for joint in joints for c in joint.coordinates), *motors)}
    driven, left = {name for name, one in own.items() if one.drive is not None}, list(every)
    while left:
        waited = {one.follower for one in left}
        one = next(one for one in left if not waited & (one.form.terms.keys() - {one.follower}))
        left.remove(one)
        leaders = {name: -factor for name, factor in one.form.terms.items() if name != one.follower}
        start, rate = one.form.offset, 0.0
        for name, ratio in leaders.items():
            drive = own[name].drive
            place, speed = (own[name].start, own[name].rate) if drive is None else drive.at(0.0)[:2]
            start, rate = start + ratio * place, rate + ratio * speed
        follower = own[one.follower]
        if one.slack:
            start, rate = start + follower.start, rate + follower.rate
        elif leaders.keys() <= driven:
            driven.add(one.follower)
            follower = follower._replace(efforts=(), rotor=0.0)
        own[one.follower] = follower._replace(start=start, rate=rate)
    return tuple(joint._replace(coordinates=tuple(own[c.name] for c in joint.coordinates)) for joint in joints)


def _is_plane(scene) -> bool:
    """A scene is in space if anything in it leaves the plane."""

    def leaves(value, key="") -> bool:
        if isinstance(value, dict):
            return any(leaves(entry, name) for name, entry in value.items())
        if isinstance(value, list) and key not in LISTS:
            return len(value) == 3 and not (key == "torque" and not any(map(number, value[:2])))
        return key == "kind" and value == "sleeve"

    return not leaves(scene)


def _body(table) -> Body:
    given = table.get("inertia", 0.0)
    if not isinstance(given, list):
        tensor = np.diag([0.0, 0.0, number(given)])
    else:
        xx, yy, zz, xy, xz, yz = ([number(x) for x in given] + [0.0] * 3)[:6]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(number(table["mass"]), tensor, vector(table.get("center_of_mass")))


def _joint(name, table) -> Joint:
    kind, own = table["type"], play(table)
    on_parent = roll_pitch_yaw(table.get("orientation"))
    if "angle" in table:
        on_parent = about(2, number(table["angle"]))
    held = HELD[kind]
    if own is not None:
        # The axes of a guide are others than the joint's.
        letters = ["xyz"[own.axes[:, k].argmax()] for k in range(3)]
        held = tuple(way[:-1] + letters["xyz".index(way[-1])] for way in own.held)
    coordinates = tuple(
        _coordinate(name + end, direction, table if not end else table.get(end[1:], {}))
        for end, direction in COORDINATES.get(kind, {}).items()
    )
    spin = vector(table.get("spin"))
    start = roll_pitch_yaw(table.get("start")) if kind in ("spherical", "free") else np.eye(3)
    return Joint(
        name,
        kind,
        table["parent"],
        table["child"],
        vector(table.get("at_parent")),
        vector(table.get("at_child")),
        on_parent,
        roll_pitch_yaw(table.get("child_orientation")),
        held,
        coordinates,
        own,
        vector(table.get("eccentricity")),
        (start, spin),
    )


def _coordinate(name, direction, table) -> Coordinate:
    efforts = tuple(EFFORTS[actuator["type"]](actuator) for actuator in table.get("actuator", {}).values())
    prescribed = drive(table["drive"]) if "drive" in table else None
    return Coordinate(
        name,
        direction,
        number(table.get("position", 0.0)),
        number(table.get("velocity", 0.0)),
        prescribed,
        number(table.get("rotor_inertia", 0.0)),
        efforts,
    )


def _servo(table) -> Effort:
    """K (target - q) + b (target' - q'), and with an integral its gain times that of target - q."""
    target, (k, b) = drive(table["target"]), _gains(table)

    def of(t, q, rate):
        value, speed, _ = target.at(t)
        return k * (value - q) + b * (speed - rate)

    places, rates = (tuple(table.get(key, ())) for key in ("encoder", "rate_encoder"))
    seen = Effort(of, breaks=target.breaks, encoder=places, rate_encoder=rates, period=number(table.get("period", 0.0)))
    if "integral" not in table:
        return seen
    return seen._replace(gain=number(table["integral"]), error=lambda t, q: target.at(t)[0] - q)


def _gains(table):
    return number(table["stiffness"]), number(table.get("damping", 0.0))


def _rest(table) -> Effort:
    (k, b), rest = _gains(table), number(table.get("rest", 0.0))
    return Effort(lambda t, q, rate: -k * (q - rest) - b * rate, damped=lambda rate: b * rate * rate)


def _constant(table) -> Effort:
    effort = number(table["effort"])
    return Effort(lambda t, q, rate: effort)


def _friction(table) -> Effort:
    effort, speed = number(table["effort"]), number(table.get("transition_speed", 0.01))
    return Effort(
        lambda t, q, rate: -effort * np.tanh(rate / speed), rubbed=lambda rate: effort * np.tanh(rate / speed) * rate
    )


EFFORTS: dict[str, Callable[[dict], Effort]] = {
    "constant": _constant,
    "servo": _servo,
    "spring": _rest,
    "friction": _friction,
}


def _spring(table) -> Spring:
    return Spring(
        (table["body_a"], table["body_b"]),
        (vector(table.get("at_a")), vector(table.get("at_b"))),
        number(table["stiffness"]),
        number(table.get("damping", 0.0)),
        number(table.get("free_length", 0.0)),
    )


def _load(table) -> Load:
    course = drive(table["course"]) if "course" in table else drive({"type": "constant", "value": 1.0})
    force, torque, at = (vector(table.get(key)) for key in ("force", "torque", "at"))
    return Load(table["body"], at, force, torque, table.get("axes") == "body", course)
