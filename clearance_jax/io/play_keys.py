"""Every key of the play of a scene's joints: its geometry, how it is made, its contact laws."""

import dataclasses
from typing import Any

import numpy as np

from clearance_jax.io.fields import keys_of, kind_of, kinds_of, summary
from clearance_jax.io.kinds import LONGEST_PATH, Key, Quantities, QuantityKey, Sub, Text, Whole, Word
from clearance_jax.io.table import Keys
from clearance_jax.joints import (
    Fitting,
    GuideClearance,
    PressFit,
    RevoluteClearance,
    SleeveClearance,
    SphericalClearance,
)
from clearance_jax.joints.bearings import GROUPS
from clearance_jax.joints.elements import ELEMENTS
from clearance_jax.joints.presets import PINS
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, InternalHertz
from clearance_jax.mechanism.tree import Revolute

CONTACT = Keys(
    "joint.NAME",
    "Contact",
    "What every joint with clearance has: its laws, what else fills the play, where what plays starts.",
    (
        Sub(
            "normal",
            "law of the normal force; where there is clearance it must be there, but for a bearing and for a robot's "
            "joint",
            '{ law = "hertz", stiffness = "2.487e6 N/mm^1.5" }',
        ),
        Sub(
            "friction",
            'law of the friction, or "none"',
            '{ law = "tanh", coefficient = 0.1, transition_speed = "10 mm/s" }',
            form='table or "none"',
            absent="no friction",
        ),
        Sub(
            "element",
            "what fills the play and acts without touch",
            '{ type = "damper", radial = "2 kN*s/m", tilt = "0.5 N*m*s/rad" }',
            absent="nothing",
        ),
        *keys_of(Revolute, "eccentricity"),
    ),
)


def _optional(*keys: Key, **absent: str) -> tuple[Key, ...]:
    """The keys, made optional; `absent`: what their absence means, by name."""
    return tuple(dataclasses.replace(key, required=False, absent=absent.get(key.name, key.absent)) for key in keys)


IN_A_SLEEVE = Keys(
    "joint.NAME",
    "Pin in a sleeve",
    "Two of radial (or diametral) clearance, pin radius and sleeve radius, or a pin radius and a `fit`. Wear and line "
    "contacts spread their force over the `length`.",
    (
        *_optional(*keys_of(RevoluteClearance, "radial_clearance", "pin_radius")),
        QuantityKey("diametral_clearance", "twice the radial clearance, instead of it", '"0.2 mm"', unit="m"),
        QuantityKey("sleeve_radius", "radius of the sleeve", '"10.1 mm"', unit="m", absent="pin radius plus clearance"),
        *_optional(*keys_of(SleeveClearance, "length", "stations", "pin"), length="not known"),
        *_optional(*keys_of(Fitting)),
        Sub("press", "the housing into which the sleeve, a bush, is pressed", '{ fit = "H7/p6", diameter = "26 mm" }'),
    ),
)
_SHARED = {key.name for key in IN_A_SLEEVE.keys}
PIN = (
    Keys(
        "joint.NAME",
        "Clearance of a revolute joint",
        "A pin in a sleeve, or a `bearing`. In a joint of the kind `sleeve` the pin may tilt, in space, and slide "
        "along its axis where it has axial play too.",
        (
            Word(
                "kind",
                "what the pin may do: turn (`pin`), or tilt in a sleeve too",
                '"sleeve"',
                allowed=tuple(PINS),
                default="pin",
            ),
            *_optional(*(key for pin in PINS.values() for key in keys_of(pin) if key.name not in _SHARED)),
            Sub(
                "bearing",
                "a rolling bearing, instead: one with radial play, or one of an arm's joint, whose rings tilt too",
                '{ bore = "25 mm", balls = 9, ball_diameter = "7.94 mm" }',
            ),
            Sub("worn", "what its sleeve is worn off by", '{ file = "wear.nc" }', absent="round"),
        ),
        'type = "revolute"',
    )
    + IN_A_SLEEVE
    + CONTACT
)
SHAFT = (
    Keys(
        "joint.NAME",
        "Clearance of a cylindrical joint",
        "As of a revolute joint of the kind `sleeve`, without axial play: the pin slides.",
        (),
        'type = "cylindrical"',
    )
    + IN_A_SLEEVE
    + CONTACT
)
BALL = (
    Keys(
        "joint.NAME",
        "Clearance of a spherical joint",
        "A ball in a socket that is a little larger.",
        _optional(*keys_of(SphericalClearance)),
        'type = "spherical"',
    )
    + CONTACT
)
GUIDE = (
    Keys(
        "joint.NAME",
        "Clearance of a prismatic joint",
        "A block in a guide, whose corners meet the guide's walls. The guide has its own axes: z is the "
        "direction in which the joint slides. If this is the joint's x axis, the guide's x is the joint's y, and its y "
        "the joint's z.",
        _optional(*keys_of(GuideClearance)),
        'type = "prismatic"',
    )
    + CONTACT
)
PRESS = Keys(
    "joint.NAME.press",
    "Bush in a housing",
    "A bush pressed into its housing, which closes the bush's bore.",
    keys_of(PressFit),
)
WORN = Keys(
    "joint.NAME.worn",
    "Worn sleeve",
    "By how much the sleeve's radius has grown all around: a list, or a file. The first sector is in the direction of "
    "the sleeve's x, the others follow evenly.",
    (
        Quantities("depth", "the depths, at least 16 of them", '["1 um", "3 um", "2 um"]', unit="m"),
        Text(
            "file",
            "what a study of wear has written (.nc), or a CSV table of angle [deg] and depth, beside the scene",
            '"wear.nc"',
            longest=LONGEST_PATH,
        ),
        QuantityKey("cycles", "the age in cycles, of the file of a study", "20000", absent="the last one in it"),
        Text("unit", "unit of the depths, of a CSV table", '"um"'),
    ),
)
_TYPES = ("radial", "crossed-roller", "angular-contact-pair")
_TYPE = Word("type", "the kind of bearing", '"radial"', allowed=_TYPES, default=_TYPES[0])


def _size(name: str, help: str, example: str, unit: str = "m", **more: Any) -> Key:
    return QuantityKey(name, help, example, unit=unit, bounds={"above": 0.0} | more.pop("bounds", {}), **more)


def _bearing(word: str, help: str, *keys: Key) -> Keys:
    return kind_of("joint.NAME.bearing", "Rolling bearing", _TYPE, word, help, *keys)


def _count(name: str, help: str, example: str, least: int) -> Key:
    return Whole(name, help, example, least=least, most=1000)


def _required(*keys: Key) -> tuple[Key, ...]:
    return tuple(dataclasses.replace(key, required=True) for key in keys)


_BALLS = (
    _count("balls", "how many balls, of a pair in each row", "9", 3),
    _size("ball_diameter", "diameter of a ball", '"7.94 mm"'),
)
_ROLLER = _size("roller_length", "effective length of a roller", '"9 mm"')
_ROLLERS = "rollers", "how many rollers in all", "60"
_OF_AN_ARM = (
    _size("pitch_diameter", "diameter of the circle of the elements' centres", '"100 mm"', required=True),
    _size("radial_clearance", "radial play that is left where the preload is overcome", '"5 um"', required=True),
    _size("preload", "axial force with which the rows press on each other", '"500 N"', "N", absent="none: worn off"),
)
BEARINGS = {
    "radial": _bearing(
        "radial",
        "Radial play of a deep-groove ball bearing (`balls`) or a cylindrical roller bearing (`rollers`), with the "
        "stiffness that Palmgren has for it.",
        _size("bore", "bore of the bearing", '"25 mm"', required=True),
        Word("group", "group of internal clearance of ISO 5753-1", '"C3"', allowed=GROUPS, default="CN"),
        _size(
            "internal_clearance",
            "radial internal clearance, at the diameter, as it is when mounted and warm",
            '"10 um"',
            absent="the mean of the group",
        ),
        *_BALLS,
        _count(*_ROLLERS, 3),
        _ROLLER,
    ),
    "crossed-roller": _bearing(
        "crossed-roller",
        "The bearing of an industrial arm's joint, as new (with `preload`) or worn: a sleeve whose pin tilts, in "
        "space.",
        *_OF_AN_ARM,
        *_required(_count(*_ROLLERS, 6), _ROLLER),
    ),
    "angular-contact-pair": _bearing(
        "angular-contact-pair",
        "Two angular-contact ball bearings back to back, as new (with `preload`) or worn: a sleeve whose pin tilts, "
        "in space.",
        *_OF_AN_ARM,
        *_required(*_BALLS),
        _size(
            "contact_angle",
            "angle of the balls' lines to the plane of the rings",
            '"25 deg"',
            "rad",
            bounds={"below": np.pi / 2},
            required=True,
        ),
        _size("spread", "distance between the two rows of balls", '"40 mm"', required=True),
    ),
}
NORMAL_TABLES = kinds_of(
    "joint.NAME.normal",
    "Normal law",
    Word("law", "the law of the normal force", '"adams-impact"', allowed=tuple(NORMAL_LAWS), required=True),
    NORMAL_LAWS,
)
FRICTION_TABLES = kinds_of(
    "joint.NAME.friction",
    "Friction law",
    Word("law", "the law of friction", '"tanh"', allowed=tuple(FRICTION_LAWS), required=True),
    FRICTION_LAWS,
)
ELEMENT_TABLES = kinds_of(
    "joint.NAME.element",
    "Filled play",
    Word("type", "what fills the play", '"damper"', allowed=tuple(ELEMENTS), required=True),
    ELEMENTS,
)
STIFFNESS = Keys(
    "joint.NAME.normal.stiffness",
    "Stiffness from geometry and materials",
    summary(InternalHertz) + " Instead of a quantity.",
    keys_of(InternalHertz),
)
PLAY_TABLES = (PIN, SHAFT, BALL, GUIDE, IN_A_SLEEVE, CONTACT, PRESS, *BEARINGS.values(), WORN, *ELEMENT_TABLES.values())
"""What makes play, in the order of the reference."""
LAW_TABLES = (*NORMAL_TABLES.values(), STIFFNESS, *FRICTION_TABLES.values())
"""The laws of contact, in that order."""
