"""Every key of a scene file. A new key is a line here (or a field with a help, where a class holds it), and its use."""

from clearance_jax.io.keys.coupling import FLANK_KEYS
from clearance_jax.io.keys.declare import Keys, family, keys_of, kind, kinds, summary, table
from clearance_jax.io.keys.kinds import Flag, Names, Sub, Text, Triple, VectorKey, Whole, Word, path, quantity, tables
from clearance_jax.io.keys.play import BALL, GUIDE, PIN, SHAFT
from clearance_jax.io.urdf.mechanism import BASES, INERTIAS, MIMICS
from clearance_jax.mechanism.actuators import ConstantEffort, JointFriction, JointSpring, Servo
from clearance_jax.mechanism.body import Body, Motion, Point, Spring, Stops, Wrench
from clearance_jax.mechanism.controllers import ComputedTorque
from clearance_jax.mechanism.imperfections import Compliance
from clearance_jax.mechanism.motion.drives import Constant, Quintic, Trapezoid
from clearance_jax.mechanism.motion.motion_laws import ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.placement import ORIGIN, Orientation, Position
from clearance_jax.mechanism.tree.compounds import Ball, Cylindrical, Free, Planar, Spherical, Universal
from clearance_jax.mechanism.tree.tree import Fixed, Prismatic, Revolute
from clearance_jax.solve.settings import MAX_STEPS, MOST_SAMPLES, OF_MOTIONS, SOLVER_WORDS, STARTS
from clearance_jax.solve.steps.tolerances import SMALLEST

DRIVES = {"constant": Constant, "constant-speed": ConstantSpeed, "step": StepSum, "step5": Step5Sum}
DRIVES |= {"harmonic": Harmonic, "trapezoid": Trapezoid, "quintic": Quintic, "spline": Spline}
ACTUATORS = {"constant": ConstantEffort, "servo": Servo, "spring": JointSpring, "friction": JointFriction}
JOINTS = {"revolute": Revolute, "prismatic": Prismatic, "fixed": Fixed, "spherical": Spherical}
JOINTS |= {"universal": Universal, "cylindrical": Cylindrical, "planar": Planar, "free": Free}
# Forms of a drive.
DRIVEN = "table or expression"
OF_THE_ROBOT = "those of the robot"

SCENE = table(
    "scene",
    "Top of a scene",
    "What stands in a scene file before its first table.",
    name=Text("name of the mechanism", '"slider-crank"', "the file's name"),
    gravity=VectorKey("acceleration of free fall", '["0 m/s^2", "-9.81 m/s^2"]', "none", unit="m/s^2"),
    assemble=Flag(
        "whether a solve starts by closing the loops; off: from exactly the given initial values", "false", default=True
    ),
    solve=Sub("how it wants to be solved", '{ t1 = "24 ms", rtol = 1e-8 }'),
    robot=Sub("a robot's file, to which the scene adds", '{ file = "arm.urdf" }', "none"),
    body=tables("the bodies by name", '{ slider = { mass = "0.14 kg" } }', OF_THE_ROBOT),
    joint=tables(
        "the joints by name: one that places a body no earlier joint has placed belongs to the tree, another closes a "
        "loop",
        '{ guide = { type = "prismatic", parent = "ground", child = "slider" } }',
        OF_THE_ROBOT,
    ),
    spring=tables(
        "springs between points of two bodies, by name",
        '{ coil = { body_a = "ground", body_b = "slider", stiffness = "4530 N/m" } }',
    ),
    point=tables("points whose motion is reported, by name", '{ piston = { body = "slider" } }'),
    wrench=tables("loads from outside, by name", '{ cut = { body = "slider", force = ["-100 N", "0 N"] } }'),
    misalignment=Names(
        "joints whose places, axes and zeros can be off, by numbers that are zero at first", '["axis_2"]', "none"
    ),
    compliance=tables(
        "drives that give way, by the joint that they drive",
        '{ axis_2 = { stiffness = "50 kN*m/rad" } }',
        "drives are followed exactly",
    ),
    coupling=tables(
        "coordinates of joints that follow others, by gears and the like, by name",
        '{ mesh = { type = "gear", follower = "wheel", leader = "pinion", teeth = [20, 40] } }',
    ),
    controller=tables(
        "controllers of several joints, by name",
        '{ control = { frequency = "50 rad/s", target = { hip = "0.2 * time" } } }',
    ),
)
SOLVING = table(
    "solve",
    "Accuracy and solver",
    "The same in a scene and in a study.",
    rtol=quantity("accuracy: the relative tolerance of the solve", "1e-8", absent="1e-8", least=SMALLEST, below=1.0),
    solver=Word(
        "the solver: `dopri8` for rtol of 1e-6 or less, `tsit5`, or `auto`, which chooses by rtol",
        '"dopri8"',
        "auto",
        allowed=SOLVER_WORDS,
    ),
    start=Word(
        "where pins start: in the middle of their sleeves, or at the walls where the joints' forces press them",
        '"settled"',
        "centre",
        allowed=STARTS,
    ),
    max_steps=Whole("steps after which a solve gives up", "100000", str(MAX_STEPS), least=1),
)
SOLVE = table(
    "solve",
    "How a scene is solved",
    "Each may be overruled on the command line.",
    SOLVING,
    t0=quantity("start of the motion", '"0 s"', "s", "0 s"),
    t1=quantity("end of the motion", '"24 ms"', "s", "to be given on the command line"),
    samples=Whole("number of output times", "2001", "1001", least=2, most=MOST_SAMPLES),
    fidelity=Word(
        "the model of the motion: the equations of motion, or a pose at every instant (see [quasi-static "
        "motions](../quasi_static.md))",
        '"quasi-static"',
        "dynamics",
        allowed=OF_MOTIONS,
    ),
)
BODY = table("body.NAME", "Bodies", summary(Body), **keys_of(Body))
POINT = table("point.NAME", "Points", summary(Point), **keys_of(Point))
SPRING = table("spring.NAME", "Springs", summary(Spring), **keys_of(Spring))
WRENCH = table(
    "wrench.NAME",
    "Loads",
    summary(Wrench),
    **keys_of(Wrench),
    course=Sub(
        "a factor on both as a function of time: as a drive, without unit",
        '"step(time, 0.1, 0, 0.2, 1)"',
        "they are constant",
        kind=DRIVEN,
    ),
)
CONTROLLER = table(
    "controller.NAME",
    "Controllers",
    summary(ComputedTorque),
    **keys_of(ComputedTorque),
    target=tables(
        "where it steers each free coordinate, by their names: as a drive", '{ hip = "0.2 * time" }', required=True
    ),
)

ROBOT = table(
    "robot",
    "Robot",
    "A robot's URDF or MJCF file. What else the scene has (bodies, joints, springs, ...) may name the robot's parts.",
    file=path("the URDF or MJCF file, beside the scene", '"arm.urdf"', required=True),
    base=Word("whether its base is the ground, or moves freely", '"free"', allowed=BASES, default="fixed"),
    mimic=Word(
        "whether joints that mimic others follow them, or move by themselves",
        '"independent"',
        allowed=MIMICS,
        default="follow",
    ),
    inertia=Word(
        "whether links whose inertia no body has, and bodies without mass, are refused; whether such a link takes the "
        "mean of its moments, or both the inertia of their shapes (see [robots](../robots.md#masses-and-inertias))",
        '"from-geometry"',
        allowed=INERTIAS,
        default="refuse",
    ),
    density=quantity(
        "of the shapes of bodies without mass, with `from-geometry`",
        '"2700 kg/m^3"',
        "kg/m^3",
        "1000 kg/m^3",
        above=0.0,
    ),
    end_effector=Names("links whose frames are points", '["tcp"]', "every link at the end of a limb"),
    trajectory=path(
        "a CSV file of times and values, beside the scene, that drives the joints that it names", '"lift.csv"'
    ),
    payload=tables("what it carries, by name", '{ cutter = { on = "tcp", mass = "3 kg" } }'),
    joint=tables(
        "how its joints start, are driven or forced, and their play, by their names: as joints of that kind; where "
        "there is play without `normal` of steel in bronze",
        '{ axis_2 = { position = "30 deg" }, '
        'axis_5 = { kind = "sleeve", radial_clearance = "50 um", axial_clearance = "1 mm", length = "40 mm" } }',
    ),
    renamed={"clearance": "robot.joint"},
)
PAYLOAD = table(
    "robot.payload.NAME",
    "Payloads of a robot",
    "A body on a fixed joint `NAME_grip`.",
    BODY,
    on=Text("the robot's body, or its point, that carries it", '"tcp"', required=True),
    at=VectorKey(
        "where its frame is in that of what carries it",
        '["0 mm", "0 mm", "80 mm"]',
        unit="m",
        default=ORIGIN,
        record=Position,
    ),
    orientation=Triple("its roll, pitch and yaw there", '["0 deg", "90 deg", "0 deg"]', unit="rad", record=Orientation),
)

JOINT = table("joint.NAME", "Place of a joint", "What every joint has.", **keys_of(Fixed))
MOTION = table(
    "joint.NAME.slide, .turn, ...",
    "Motion of a coordinate",
    "Driven, or free under any number of actuators: in the table of a revolute or prismatic joint itself, else in that "
    "of each slide and turn. A joint that closes a loop takes none of these.",
    drive=Sub(
        "prescribes the coordinate: a table of numbers, or an ADAMS expression of `step`, `step5`, `time`",
        '"step(time, 0, 0, 0.5, 90 d)"',
        "free",
        kind=DRIVEN,
    ),
    **keys_of(Motion),
    actuator=tables("forces along a free coordinate, by name", '{ load = { type = "constant", effort = "-12 N*m" } }'),
    stops=Sub(
        "what a free coordinate hits at the ends of its range",
        '{ upper = "90 deg", stiffness = "20 kN*m/rad" }',
        "none",
    ),
)
STOPS = table(
    "joint.NAME.stops",
    "Stops",
    "Contacts at the ends of the range of a free coordinate, `NAME_stop`. Where a robot's joint has neither `lower` "
    "nor `upper`, they are those of its file.",
    **keys_of(Stops),
    **FLANK_KEYS,
)
COMPLIANCE = table(
    "compliance.NAME",
    "Compliance and backlash of a drive",
    "A joint whose drive, or motor under actuators, moves it through a spring and a damper, with or without a gap: "
    "`NAME_motor` is what the drive moves, `NAME` how far the link gives way. `NAME_drive` is the contact in the gap.",
    **keys_of(Compliance) | {"stiffness": FLANK_KEYS["stiffness"]},
)
# Beside what the class of a joint holds.
_OF_JOINTS = {Revolute: (MOTION, PIN), Prismatic: (MOTION, GUIDE), Spherical: (BALL,), Cylindrical: (SHAFT,)}


def _joint(cls: type) -> Keys:
    shared = (JOINT, *_OF_JOINTS.get(cls, ()))
    elsewhere = {key.name for other in shared for key in other.keys}
    keys = keys_of(cls) | (keys_of(Ball) if cls in (Spherical, Free) else {})
    return kind(summary(cls), *shared, **{name: key for name, key in keys.items() if name not in elsewhere})


JOINT_TABLES = family(
    "joint.NAME", "Joints", "type", "the kind of joint", {word: _joint(cls) for word, cls in JOINTS.items()}
)
DRIVE_TABLES = family("joint.NAME.drive", "Drive", "type", "the kind of drive", kinds(DRIVES))
SPLINE_FILE = table(
    "joint.NAME.drive",
    "Drive",
    "A spline through a table in a file, instead of `times` and `values`.",
    choice='type = "spline"',
    type=DRIVE_TABLES["spline"].keys[0],
    file=path("CSV file of time [s] and value, beside the scene", '"motion.csv"', required=True),
    unit=Text("unit of the values", '"deg"', required=True),
    **keys_of(Spline, "ends"),
)
_TARGET = Sub("where it steers to: as a drive", '"90 d * time"', kind=DRIVEN, required=True)
ACTUATOR_TABLES = family(
    "joint.NAME.actuator.NAME",
    "Actuator",
    "type",
    "the kind of actuator",
    kinds(ACTUATORS, {"servo": {"target": _TARGET}}),
)
