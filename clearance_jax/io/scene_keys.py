"""Every key of a scene file. A new key is a line here (or a field with a help, where a class holds it), and its use."""

from clearance_jax.io.fields import keys_of, kinds_of, summary
from clearance_jax.io.kinds import LONGEST_PATH, Direction, Flag, Names, Place, Quantity, Sub, Text, Triple, Whole, Word
from clearance_jax.io.play_keys import BALL, GUIDE, LAW_TABLES, PIN, PLAY_TABLES, SHAFT
from clearance_jax.io.table import Keys
from clearance_jax.io.urdf import BASES, MIMICS
from clearance_jax.mechanism.actuators import ConstantEffort, JointFriction, JointSpring, Servo
from clearance_jax.mechanism.body import Body, Motion, Point, Spring
from clearance_jax.mechanism.compliance import Compliance
from clearance_jax.mechanism.compounds import Ball, Cylindrical, Free, Planar, Spherical, Universal
from clearance_jax.mechanism.controllers import ComputedTorque
from clearance_jax.mechanism.drives import ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.loads import Wrench
from clearance_jax.mechanism.profiles import Constant, Quintic, Trapezoid
from clearance_jax.mechanism.tree import Fixed, Prismatic, Revolute
from clearance_jax.solve.attempt import STARTS
from clearance_jax.solve.settings import FIDELITIES, MOST_SAMPLES, SOLVERS

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
JOINTS = {"revolute": Revolute, "prismatic": Prismatic, "fixed": Fixed}
JOINTS |= {
    "spherical": Spherical,
    "universal": Universal,
    "cylindrical": Cylindrical,
    "planar": Planar,
    "free": Free,
}
COMPOUNDS = {word: cls for word, cls in JOINTS.items() if word not in ("revolute", "prismatic", "fixed")}

SCENE = Keys(
    "scene",
    "Top of a scene",
    "What stands in a scene file before its first table.",
    (
        Text("name", "name of the mechanism", '"slider-crank"', absent="the file's name"),
        Place("gravity", "acceleration of free fall", '["0 m/s^2", "-9.81 m/s^2"]', unit="m/s^2", absent="none"),
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

SOLVE = Keys(
    "solve",
    "How a scene is solved",
    "Each may be overruled on the command line.",
    (
        Quantity("t0", "start of the motion", '"0 s"', unit="s", absent="0 s"),
        Quantity("t1", "end of the motion", '"24 ms"', unit="s", absent="to be given on the command line"),
        Quantity(
            "rtol",
            "accuracy: the relative tolerance of the solve",
            "1e-8",
            bounds={"above": 0.0, "below": 1.0},
            absent="1e-8",
        ),
        Whole("samples", "number of output times", "2001", least=2, most=MOST_SAMPLES, absent="1001"),
        Word("solver", "the solver: `dopri8` for rtol below 1e-8", '"dopri8"', allowed=tuple(SOLVERS), absent="tsit5"),
        Word(
            "start",
            "where pins start: in the middle of their sleeves, or at the walls where the joints' forces press them",
            '"settled"',
            allowed=STARTS,
            absent="centre",
        ),
        Word(
            "fidelity",
            "the model of the motion: the equations of motion, or a pose at every instant (see "
            "[quasi-static motions](../quasi_static.md))",
            '"quasi-static"',
            allowed=FIDELITIES,
            absent="dynamics",
        ),
    ),
)

_LINK = Text("on", "the robot's body, or its point, that carries it", '"tcp"', required=True)
PAYLOAD = Keys(
    "robot.payload.NAME",
    "Payloads of a robot",
    "A body on a fixed joint `NAME_grip`.",
    (
        _LINK,
        *keys_of(Body),
        Place("at", "where its frame is in that of what carries it", '["0 mm", "0 mm", "80 mm"]', unit="m"),
        Triple("orientation", "its roll, pitch and yaw there", '["0 deg", "90 deg", "0 deg"]', unit="rad"),
    ),
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
            "clearance",
            "play of its joints, by their names: as of a joint of that kind; without `normal` of steel in bronze",
            '{ axis_5 = { kind = "sleeve", radial_clearance = "50 um", axial_clearance = "1 mm", length = "40 mm" } }',
            form="tables by name",
        ),
        Sub(
            "joint",
            "how its joints start, are driven or forced, by their names: as a revolute or prismatic joint",
            '{ axis_2 = { position = "30 deg" } }',
            form="tables by name",
        ),
    ),
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
BODY = Keys("body.NAME", "Bodies", summary(Body), keys_of(Body))
POINT = Keys("point.NAME", "Points", summary(Point), keys_of(Point))
SPRING = Keys("spring.NAME", "Springs", summary(Spring), keys_of(Spring))

_TYPE = Word("type", "the kind of joint", '"revolute"', allowed=tuple(JOINTS), required=True)
JOINT = Keys(
    "joint.NAME",
    "Joints",
    "What every joint has: revolute (a pin), prismatic (a slide along the x axis of its frame) or fixed; in space also "
    "spherical (a ball), universal (a cardan), cylindrical, planar or free.",
    (_TYPE, *keys_of(Fixed)),
)
MOTION = Keys(
    "joint.NAME",
    "Motion of a revolute or prismatic joint",
    "Driven, or free under any number of actuators. A joint that closes a loop takes none of these.",
    (
        Sub(
            "drive",
            "prescribes the coordinate: a table of numbers, or an ADAMS expression of `step`, `step5`, `time`",
            '"step(time, 0, 0, 0.5, 90 d)"',
            form="table or expression",
            absent="free",
        ),
        *keys_of(Motion),
        Direction(
            "axis",
            "what it turns about or slides along, an axis of its frame: a letter, or three numbers",
            '"z"',
            absent="z of a revolute joint, x of a prismatic one",
        ),
        Sub(
            "actuator",
            "forces along a free coordinate, by name",
            '{ load = { type = "constant", effort = "-12 N*m" } }',
            form="tables by name",
        ),
    ),
    'type = "revolute" or "prismatic"',
)
OF_ONE = Keys(
    "joint.NAME.slide, .turn, ...",
    "Motion of one coordinate of a joint that has several",
    "As that of a revolute or prismatic joint.",
    tuple(key for key in MOTION.keys if key.name != "axis"),
)
COMPLIANCE = Keys(
    "compliance.NAME",
    "Compliance of a drive",
    "A joint whose drive, or motor under actuators, moves it through a spring and a damper: `NAME_motor` is what the "
    "drive moves, `NAME` how far the link gives way.",
    keys_of(Compliance),
)
# What each joint of several coordinates has beside what every joint has.
COMPOUND_TABLES = {
    word: Keys(
        "joint.NAME",
        f"Joint `{word}`",
        summary(cls),
        (
            *(key for key in keys_of(cls) if key.name not in {k.name for k in JOINT.keys}),
            *(keys_of(Ball) if cls in (Spherical, Free) else ()),
        ),
        f'type = "{word}"',
    )
    for word, cls in COMPOUNDS.items()
}
JOINT_TABLES = {"revolute": JOINT + MOTION + PIN, "prismatic": JOINT + MOTION + GUIDE, "fixed": JOINT}
JOINT_TABLES |= {word: JOINT + table for word, table in COMPOUND_TABLES.items()}
JOINT_TABLES["spherical"] += BALL
JOINT_TABLES["cylindrical"] += SHAFT


DRIVE_TABLES = kinds_of(
    "joint.NAME.drive",
    "Drive",
    Word("type", "the kind of drive", '"constant-speed"', allowed=tuple(DRIVES), required=True),
    DRIVES,
)
SPLINE_FILE = Keys(
    "joint.NAME.drive",
    "Drive `spline` from a file",
    "A cubic spline through a table in a file, instead of `times` and `values`.",
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
    'type = "spline" with `file`',
)
ACTUATOR_TABLES = kinds_of(
    "joint.NAME.actuator.NAME",
    "Actuator",
    Word("type", "the kind of actuator", '"constant"', allowed=tuple(ACTUATORS), required=True),
    ACTUATORS,
)
_TARGET = Sub("target", "where it steers to: as a drive", '"90 d * time"', form="table or expression", required=True)
ACTUATOR_TABLES["servo"] += Keys("", "", "", (_TARGET,))
SCENE_TABLES = (
    SCENE,
    SOLVE,
    BODY,
    JOINT,
    MOTION,
    *PLAY_TABLES,
    *COMPOUND_TABLES.values(),
    OF_ONE,
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
