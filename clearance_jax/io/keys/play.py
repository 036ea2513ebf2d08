"""Every key of the play of a scene's joints: its geometry, how it is made, its contact laws."""

import dataclasses
from typing import Any

import numpy as np

from clearance_jax import joints
from clearance_jax.io.keys.declare import family, keys_of, kind, kinds, optional, summary, table
from clearance_jax.io.keys.kinds import Key, Quantities, Sub, Text, Whole, Word, path, quantity
from clearance_jax.joints.bearings import GROUPS
from clearance_jax.joints.elements import ELEMENTS
from clearance_jax.joints.presets import PINS
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, InternalHertz
from clearance_jax.mechanism.tree.tree import Revolute

CONTACT = table(
    "joint.NAME",
    "Contact",
    "What every joint with clearance has: its laws, what else fills the play, where what plays starts.",
    normal=Sub(
        "law of the normal force; where there is clearance it must be there, but for a bearing and for a robot's joint",
        '{ law = "hertz", stiffness = "2.487e6 N/mm^1.5" }',
    ),
    friction=Sub(
        'law of the friction, or "none"',
        '{ law = "tanh", coefficient = 0.1, transition_speed = "10 mm/s" }',
        "no friction",
        kind='table or "none"',
    ),
    element=Sub(
        "what fills the play and acts without touch",
        '{ type = "damper", radial = "2 kN*s/m", tilt = "0.5 N*m*s/rad" }',
        "nothing",
    ),
    **keys_of(Revolute, "eccentricity"),
)
IN_A_SLEEVE = table(
    "joint.NAME",
    "Pin in a sleeve",
    "Two of radial (or diametral) clearance, pin radius and sleeve radius, or a pin radius and a `fit`. Wear and line "
    "contacts spread their force over the `length`.",
    **optional(keys_of(joints.RevoluteClearance, "radial_clearance", "pin_radius")),
    diametral_clearance=quantity("twice the radial clearance, instead of it", '"0.2 mm"', "m"),
    sleeve_radius=quantity("radius of the sleeve", '"10.1 mm"', "m", "pin radius plus clearance"),
    **optional(keys_of(joints.SleeveClearance, "length", "stations", "pin"), length="not known"),
    **optional(keys_of(joints.Fitting)),
    press=Sub("the housing into which the sleeve, a bush, is pressed", '{ fit = "H7/p6", diameter = "26 mm" }'),
)
_SHARED = {key.name for key in IN_A_SLEEVE.keys}
_OF_PINS = {name: key for pin in PINS.values() for name, key in keys_of(pin).items() if name not in _SHARED}
PIN = table(
    "joint.NAME",
    "Clearance of a revolute joint",
    "A pin in a sleeve, or a `bearing`. In a joint of the kind `sleeve` the pin may tilt, in space, and slide along "
    "its axis where it has axial play too.",
    IN_A_SLEEVE,
    CONTACT,
    choice='type = "revolute"',
    kind=Word(
        "what the pin may do: turn (`pin`), or tilt in a sleeve too", '"sleeve"', allowed=tuple(PINS), default="pin"
    ),
    **optional(_OF_PINS),
    bearing=Sub(
        "a rolling bearing, instead: one with radial play, or one of an arm's joint, whose rings tilt too",
        '{ bore = "25 mm", balls = 9, ball_diameter = "7.94 mm" }',
    ),
    worn=Sub("what its sleeve is worn off by", '{ file = "wear.nc" }', "round"),
)
SHAFT = table(
    "joint.NAME",
    "Clearance of a cylindrical joint",
    "As of a revolute joint of the kind `sleeve`, without axial play: the pin slides.",
    IN_A_SLEEVE,
    CONTACT,
    choice='type = "cylindrical"',
)
BALL = table(
    "joint.NAME",
    "Clearance of a spherical joint",
    "A ball in a socket that is a little larger.",
    CONTACT,
    choice='type = "spherical"',
    **optional(keys_of(joints.SphericalClearance)),
)
GUIDE = table(
    "joint.NAME",
    "Clearance of a prismatic joint",
    "A block in a guide, whose corners meet the guide's walls. The guide has its own axes: z is the direction in which "
    "the joint slides. If this is the joint's x axis, the guide's x is the joint's y, and its y the joint's z.",
    CONTACT,
    choice='type = "prismatic"',
    **optional(keys_of(joints.GuideClearance)),
)
PRESS = table(
    "joint.NAME.press",
    "Bush in a housing",
    "A bush pressed into its housing, which closes the bush's bore.",
    **keys_of(joints.PressFit),
)
WORN = table(
    "joint.NAME.worn",
    "Worn sleeve",
    "By how much the sleeve's radius has grown all around: a list, or a file. The first sector is in the direction of "
    "the sleeve's x, the others follow evenly.",
    depth=Quantities("the depths, at least 16 of them", '["1 um", "3 um", "2 um"]', unit="m"),
    file=path(
        "what a study of wear has written (.nc), or a CSV table of angle [deg] and depth, beside the scene", '"wear.nc"'
    ),
    cycles=quantity("the age in cycles, of the file of a study", "20000", absent="the last one in it"),
    unit=Text("unit of the depths, of a CSV table", '"um"'),
)


def _size(help: str, example: str, unit: str = "m", absent: str = "", **more: Any) -> Key:
    return quantity(help, example, unit, absent, above=0.0, **more)


def _count(help: str, example: str, least: int) -> Key:
    return Whole(help, example, least=least, most=1000)


def _required(**keys: Key) -> dict[str, Key]:
    return {name: dataclasses.replace(key, required=True) for name, key in keys.items()}


_BALLS = {
    "balls": _count("how many balls, of a pair in each row", "9", 3),
    "ball_diameter": _size("diameter of a ball", '"7.94 mm"'),
}
_ROLLERS = "how many rollers in all", "60"
_ROLLER = _size("effective length of a roller", '"9 mm"')
_OF_AN_ARM = {
    "pitch_diameter": _size("diameter of the circle of the elements' centres", '"100 mm"', required=True),
    "radial_clearance": _size("radial play that is left where the preload is overcome", '"5 um"', required=True),
    "preload": _size("axial force with which the rows press on each other", '"500 N"', "N", "none: worn off"),
}
BEARINGS = family(
    "joint.NAME.bearing",
    "Rolling bearing",
    "type",
    "the kind of bearing",
    {
        "radial": kind(
            "Radial play of a deep-groove ball bearing (`balls`) or a cylindrical roller bearing (`rollers`), with the "
            "stiffness that Palmgren has for it.",
            bore=_size("bore of the bearing", '"25 mm"', required=True),
            group=Word("group of internal clearance of ISO 5753-1", '"C3"', allowed=GROUPS, default="CN"),
            internal_clearance=_size(
                "radial internal clearance, at the diameter, as it is when mounted and warm",
                '"10 um"',
                absent="the mean of the group",
            ),
            **_BALLS,
            rollers=_count(*_ROLLERS, 3),
            roller_length=_ROLLER,
        ),
        "crossed-roller": kind(
            "The bearing of an industrial arm's joint, as new (with `preload`) or worn: a sleeve whose pin tilts, in "
            "space.",
            **_OF_AN_ARM,
            **_required(rollers=_count(*_ROLLERS, 6), roller_length=_ROLLER),
        ),
        "angular-contact-pair": kind(
            "Two angular-contact ball bearings back to back, as new (with `preload`) or worn: a sleeve whose pin "
            "tilts, in space.",
            **_OF_AN_ARM,
            **_required(**_BALLS),
            contact_angle=_size(
                "angle of the balls' lines to the plane of the rings", '"25 deg"', "rad", below=np.pi / 2, required=True
            ),
            spread=_size("distance between the two rows of balls", '"40 mm"', required=True),
        ),
    },
    default="radial",
)


NORMAL_TABLES = family("joint.NAME.normal", "Normal law", "law", "the law of the normal force", kinds(NORMAL_LAWS))
FRICTION_TABLES = family("joint.NAME.friction", "Friction law", "law", "the law of friction", kinds(FRICTION_LAWS))
ELEMENT_TABLES = family("joint.NAME.element", "Filled play", "type", "what fills the play", kinds(ELEMENTS))
STIFFNESS = table(
    "joint.NAME.normal.stiffness",
    "Stiffness from geometry and materials",
    summary(InternalHertz) + " Instead of a quantity.",
    **keys_of(InternalHertz),
)
