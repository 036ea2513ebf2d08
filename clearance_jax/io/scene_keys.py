"""Every key of a scene file. A new key is a line here (or a field with a help, where a class holds it), and its use."""

from clearance_jax.io.asking_keys import SOLVING
from clearance_jax.io.fields import keys_of, kind_of, kinds_of, summary
from clearance_jax.io.kinds import LONGEST_PATH, Flag, Names, QuantityKey, Sub, Text, Triple, VectorKey, Whole, Word
from clearance_jax.io.play_keys import BALL, GUIDE, LAW_TABLES, PIN, PLAY_TABLES, SHAFT
from clearance_jax.io.table import Keys
from clearance_jax.io.urdf.mechanism import BASES, MIMICS
from clearance_jax.mechanism.actuators import ConstantEffort, JointFriction, JointSpring, Servo
from clearance_jax.mechanism.body import Body, Motion, Point, Spring
from clearance_jax.mechanism.compliance import Compliance
from clearance_jax.mechanism.compounds import Ball, Cylindrical, Free, Planar, Spherical, Universal
from clearance_jax.mechanism.controllers import ComputedTorque
from clearance_jax.mechanism.loads import Wrench
from clearance_jax.mechanism.motion_laws import ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.profiles import Constant, Quintic, Trapezoid
from clearance_jax.mechanism.tree import Fixed, Prismatic, Revolute
from clearance_jax.solve.settings import MOST_SAMPLES, OF_MOTIONS

DRIVES = {
    "constant": Constant,
    "constant-speed": ConstantSpeed,
    "step": StepSum,
    "step5": Step5Sum,
    "harmonic": Harmonic,
    "trapezoid": Trapezoid,
    "quintic": Quintic,
    "spline": Spline,
}
ACTUATORS = {"constant": ConstantEffort, "servo": Servo, "spring": JointSpring, "friction": JointFriction}
JOINTS = {
    "revolute": Revolute,
    "prismatic": Prismatic,
    "fixed": Fixed,
    "spherical": Spherical,
    "universal": Universal,
    "cylindrical": Cylindrical,
    "planar": Planar,
    "free": Free,
}

SCENE = Keys(
    "scene",
    "Top of a scene",
    "What stands in a scene file before its first table.",
    (
        Text("name", "name of the mechanism", '"slider-crank"', absent="the file's name"),
        VectorKey("gravity", "acceleration of free fall", '["0 m/s^2", "-9.81 m/s^2"]', unit="m/s^2", absent="none"),
        Flag(
            "assemble",
            "whether a solve starts by closing the loops; off: from exactly the given initial values",
            "false",
            default=True,
        ),
        Sub("solve", "how it wants to be solved", '{ t1 = "24 ms", rtol = 1e-8 }'),
        Sub("robot", "a robot's file, to which the scene adds", '{ file = "arm.urdf" }', absent="none"),
        Sub(
            "body",
            "the bodies by name",
            '{ slider = { mass = "0.14 kg" } }',
            form="tables by name",
            absent="those of the robot",
        ),
        Sub(
            "joint",
            "the joints by name: one that places a body no earlier joint has placed belongs to the tree, another "
            "closes a loop",
            '{ guide = { type = "prismatic", parent = "ground", child = "slider" } }',
            form="tables by name",
            absent="those of the robot",
        ),
        Sub(
            "spring",
            "springs between points of two bodies, by name",
            '{ coil = { body_a = "ground", body_b = "slider", stiffness = "4530 N/m" } }',
            form="tables by name",
        ),
        Sub(
            "point",
            "points whose motion is reported, by name",
            '{ piston = { body = "slider" } }',
            form="tables by name",
        ),
        Sub(
            "wrench",
            "loads from outside, by name",
            '{ cut = { body = "slider", force = ["-100 N", "0 N"] } }',
            form="tables by name",
        ),
        Names(
            "misalignment",
            "joints whose places, axes and zeros can be off, by numbers that are zero at first",
            '["axis_2"]',
            absent="none",
        ),
        Sub(
            "compliance",
            "drives that give way, by the joint that they drive",
            '{ axis_2 = { stiffness = "50 kN*m/rad" } }',
            form="tables by name",
            absent="drives are followed exactly",
        ),
        Sub(
            "controller",
            "controllers of several joints, by name",
            '{ control = { frequency = "50 rad/s", target = { hip = "0.2 * time" } } }',
            form="tables by name",
        ),
    ),
)

SOLVE = (
    Keys(
        "solve",
        "How a scene is solved",
        "Each may be overruled on the command line.",
        (
            QuantityKey("t0", "start of the motion", '"0 s"', unit="s", absent="0 s"),
            QuantityKey("t1", "end of the motion", '"24 ms"', unit="s", absent="to be given on the command line"),
            Whole("samples", "number of output times", "2001", least=2, most=MOST_SAMPLES, absent="1001"),
            Word(
                "fidelity",
                "the model of the motion: the equations of motion, or a pose at every instant (see "
                "[quasi-static motions](../quasi_static.md))",
                '"quasi-static"',
                allowed=OF_MOTIONS,
                absent="dynamics",
            ),
        ),
    )
    + SOLVING
)
BODY = Keys("body.NAME", "Bodies", summary(Body), keys_of(Body))
POINT = Keys("point.NAME", "Points", summary(Point), keys_of(Point))
SPRING = Keys("spring.NAME", "Springs", summary(Spring), keys_of(Spring))

PAYLOAD = (
    Keys(
        "robot.payload.NAME",
        "Payloads of a robot",
        "A body on a fixed joint `NAME_grip`.",
        (
            Text("on", "the robot's body, or its point, that carries it", '"tcp"', required=True),
            VectorKey("at", "where its frame is in that of what carries it", '["0 mm", "0 mm", "80 mm"]', unit="m"),
            Triple("orientation", "its roll, pitch and yaw there", '["0 deg", "90 deg", "0 deg"]', unit="rad"),
        ),
    )
    + BODY
)
ROBOT = Keys(
    "robot",
    "Robot",
    "A robot's URDF file. What else the scene has (bodies, joints, springs, points, ...) may name the robot's parts.",
    (
        Text("file", "the URDF file, beside the scene", '"arm.urdf"', required=True, longest=LONGEST_PATH),
        Word("base", "whether its base is the ground, or moves freely", '"free"', allowed=BASES, default="fixed"),
        Word(
            "mimic",
            "whether joints that follow others are refused, or move by themselves",
            '"independent"',
            allowed=MIMICS,
            default="refuse",
        ),
        Names("end_effector", "links whose frames are points", '["tcp"]', absent="every link at the end of a limb"),
        Text(
            "trajectory",
            "a CSV file of times and values, beside the scene, that drives the joints that it names",
            '"lift.csv"',
            longest=LONGEST_PATH,
        ),
        Sub("payload", "what it carries, by name", '{ cutter = { on = "tcp", mass = "3 kg" } }', form="tables by name"),
        Sub(
            "joint",
            "how its joints start, are driven or forced, and their play, by their names: as joints of that kind; where "
            "there is play without `normal` of steel in bronze",
            '{ axis_2 = { position = "30 deg" }, '
            'axis_5 = { kind = "sleeve", radial_clearance = "50 um", axial_clearance = "1 mm", length = "40 mm" } }',
            form="tables by name",
        ),
    ),
    renamed={"clearance": "robot.joint"},
)
WRENCH = Keys(
    "wrench.NAME",
    "Loads",
    summary(Wrench),
    (
        *keys_of(Wrench),
        Sub(
            "course",
            "a factor on both as a function of time: as a drive, without unit",
            '"step(time, 0.1, 0, 0.2, 1)"',
            form="table or expression",
            absent="they are constant",
        ),
    ),
)
CONTROLLER = Keys(
    "controller.NAME",
    "Controllers",
    summary(ComputedTorque),
    (
        *keys_of(ComputedTorque),
        Sub(
            "target",
            "where it steers each free coordinate, by their names: as a drive",
            '{ hip = "0.2 * time" }',
            form="tables by name",
            required=True,
        ),
    ),
)
JOINT = Keys("joint.NAME", "Place of a joint", "What every joint has.", keys_of(Fixed))
MOTION = Keys(
    "joint.NAME.slide, .turn, ...",
    "Motion of a coordinate",
    "Driven, or free under any number of actuators: in the table of a revolute or prismatic joint itself, else in that "
    "of each slide and turn. A joint that closes a loop takes none of these.",
    (
        Sub(
            "drive",
            "prescribes the coordinate: a table of numbers, or an ADAMS expression of `step`, `step5`, `time`",
            '"step(time, 0, 0, 0.5, 90 d)"',
            form="table or expression",
            absent="free",
        ),
        *keys_of(Motion),
        Sub(
            "actuator",
            "forces along a free coordinate, by name",
            '{ load = { type = "constant", effort = "-12 N*m" } }',
            form="tables by name",
        ),
    ),
)
COMPLIANCE = Keys(
    "compliance.NAME",
    "Compliance of a drive",
    "A joint whose drive, or motor under actuators, moves it through a spring and a damper: `NAME_motor` is what the "
    "drive moves, `NAME` how far the link gives way.",
    keys_of(Compliance),
)
_TYPE = Word("type", "the kind of joint", '"revolute"', allowed=tuple(JOINTS), required=True)
# Beside what the class of a joint holds.
_OF_JOINTS = {Revolute: (MOTION, PIN), Prismatic: (MOTION, GUIDE), Spherical: (BALL,), Cylindrical: (SHAFT,)}


def _joint(word: str, cls: type) -> Keys:
    shared = (JOINT, *_OF_JOINTS.get(cls, ()))
    elsewhere = {key.name for table in shared for key in table.keys}
    keys = (*keys_of(cls), *(keys_of(Ball) if cls in (Spherical, Free) else ()))
    table = kind_of(
        "joint.NAME", "Joints", _TYPE, word, summary(cls), *(key for key in keys if key.name not in elsewhere)
    )
    return sum(shared, start=table)


JOINT_TABLES = {word: _joint(word, cls) for word, cls in JOINTS.items()}
DRIVE_TABLES = kinds_of(
    "joint.NAME.drive",
    "Drive",
    Word("type", "the kind of drive", '"constant-speed"', allowed=tuple(DRIVES), required=True),
    DRIVES,
)
SPLINE_FILE = Keys(
    "joint.NAME.drive",
    "Drive",
    "A spline through a table in a file, instead of `times` and `values`.",
    (
        DRIVE_TABLES["spline"].keys[0],
        Text(
            "file",
            "CSV file of time [s] and value, beside the scene",
            '"motion.csv"',
            required=True,
            longest=LONGEST_PATH,
        ),
        Text("unit", "unit of the values", '"deg"', required=True),
        *keys_of(Spline, "ends"),
    ),
    'type = "spline"',
)
_TARGET = Sub("target", "where it steers to: as a drive", '"90 d * time"', form="table or expression", required=True)
ACTUATOR_TABLES = kinds_of(
    "joint.NAME.actuator.NAME",
    "Actuator",
    Word("type", "the kind of actuator", '"constant"', allowed=tuple(ACTUATORS), required=True),
    ACTUATORS,
    {"servo": (_TARGET,)},
)
SCENE_TABLES = (
    SCENE,
    SOLVE,
    SOLVING,
    BODY,
    *JOINT_TABLES.values(),
    JOINT,
    MOTION,
    *PLAY_TABLES,
    COMPLIANCE,
    *DRIVE_TABLES.values(),
    SPLINE_FILE,
    *ACTUATOR_TABLES.values(),
    *LAW_TABLES,
    SPRING,
    POINT,
    WRENCH,
    CONTROLLER,
    ROBOT,
    PAYLOAD,
)
"""Every table of a scene, in the order of the reference."""
