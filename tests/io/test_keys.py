"""The reference of scene and study keys: complete, with examples that the readers take."""

import ast
import tomllib
from typing import Any

import jsonschema
import numpy as np
import pytest
from key_reference import example, reference, schema, unshared
from places import ROOT, refused

import clearance_jax as cj
from clearance_jax.errors import ClearanceError
from clearance_jax.io.keys import coupling as coupling_keys
from clearance_jax.io.keys import design as design_keys
from clearance_jax.io.keys import metric as metric_keys
from clearance_jax.io.keys import play as play_keys
from clearance_jax.io.keys import scene as scene_keys
from clearance_jax.io.keys import study as study_keys
from clearance_jax.io.keys import wear as wear_keys
from clearance_jax.io.keys.declare import Keys
from clearance_jax.io.keys.kinds import Key
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.io.study.study import load_study
from clearance_jax.io.table import TomlTable

pytestmark = pytest.mark.quick

READERS = (
    "scene/scene",
    "scene/joints",
    "scene/contact",
    "study/study",
    "study/file",
    "study/design",
    "study/wear",
    "study/calibrate",
)


def lines(values: dict[str, str]) -> str:
    return "".join(f"{name} = {value}\n" for name, value in values.items())


def inline(values: dict[str, str]) -> str:
    return "{ " + ", ".join(f"{name} = {value}" for name, value in values.items()) + " }"


def tables_of(module) -> list[Keys]:
    """Every declaration of a module, those in dictionaries too."""
    found = []
    for value in vars(module).values():
        found += [value] if isinstance(value, Keys) else []
        found += [v for v in value.values() if isinstance(v, Keys)] if isinstance(value, dict) else []
    return found


@pytest.mark.parametrize(
    "module",
    [scene_keys, coupling_keys, play_keys, study_keys, design_keys, metric_keys, wear_keys],
)
def test_every_declaration_is_in_the_reference(module):
    """A table's own keys in its section, which names the sections of those that it shares."""
    listed, declared = reference(), tables_of(module)
    assert declared
    for table in declared:
        (told,) = [one for one in listed if (one.name, one.title) == (table.name, table.title)]
        assert {key.name for key in told.keys} >= {key.name for key in unshared(table)}, table
        assert {key.name for key in table.keys} == {key.name for key in (*unshared(table), *_shared(table))}
        (shared,) = [kind.shared for kind in told.kinds if kind.help == table.help] or [told.shared]
        assert shared == [one.title for one in table.shared]
        assert set(shared) <= {one.title for one in listed}


def _shared(table: Keys) -> list[Key]:
    return [key for one in table.shared for key in one.keys]


def test_readers_know_no_key_that_is_not_declared():
    table = TomlTable({"mass": "1 kg"}, "body.x", scene_keys.BODY)
    assert table.get("mass") == 1.0
    for ask in (table.get, table.has, table.need):
        with pytest.raises(KeyError):
            ask("colour")
    with refused("body.x.masss", allowed="mass"):
        TomlTable({"masss": "1 kg"}, "body.x", scene_keys.BODY)


@pytest.mark.parametrize("module", READERS)
def test_readers_read_through_declared_tables_only(module):
    """No reader makes up a declaration of its own, and none reads a file's values past its table."""
    tree = ast.parse((ROOT / "clearance_jax" / "io" / f"{module}.py").read_text())
    made = [n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
    assert not {"Keys", "Quantity", "Sub", "Text", "Word", "Whole", "Flag", "Place", "Triple", "Names"} & set(made)
    assert not {"table", "kind", "family", "quantity", "path", "tables"} & set(made)


def test_the_reference_is_complete_and_plain():
    for table in reference():
        assert table.title
        assert table.help
        names = [(key.name, key.help) for key in table.keys]
        assert {name for kind in table.kinds for name in kind.keys} <= {key.name for key in table.keys}
        assert len(names) == len(set(names))
        for key in table.keys:
            assert all(isinstance(part, str) for part in (key.name, key.unit, key.kind, key.default, key.example))
            assert key.help, (table.name, key.name)
            assert key.required == (key.default == "")
            assert "\n" not in key.help
            tomllib.loads(f"{key.name} = {key.example}")


SCENE = """
[body.crank]
[body.slider]
{body}
[joint.main]
type = "{kind}"
parent = "ground"
child = "crank"
{main}
[joint.pin]
type = "revolute"
parent = "crank"
child = "slider"
{pin}
[point.piston]
body = "slider"
at = ["80 mm", "0 mm"]
"""
PIN = {"radial_clearance": '"0.1 mm"', "pin_radius": '"10 mm"'}
HERTZ = inline(example(play_keys.NORMAL_TABLES["hertz"]))


def load(tmp_path, text) -> Any:
    path = tmp_path / "s.toml"
    path.write_text(text)
    return load_scene(path)


def scene(body="", kind="revolute", main="", pin=""):
    return SCENE.format(body=body, kind=kind, main=main, pin=pin)


def test_examples_of_the_top_a_body_a_spring_and_a_solve_are_read(tmp_path):
    parts = (
        "solve",
        "body",
        "joint",
        "spring",
        "point",
        "wrench",
        "coupling",
        "controller",
        "robot",
        "compliance",
        "misalignment",
    )
    top = lines(example(scene_keys.SCENE, *parts))
    rest = "[spring.coil]\n" + lines(example(scene_keys.SPRING)) + "[solve]\n" + lines(example(scene_keys.SOLVE))
    rest += "[wrench.cut]\n" + lines(example(scene_keys.WRENCH))
    read = load(tmp_path, top + scene(lines(example(scene_keys.BODY, "picked_up", "put_down"))) + rest)
    assert set(read.solve) == {key.name for key in scene_keys.SOLVE.keys}
    assert read.mechanism.springs[0].free_length == pytest.approx(0.07785)
    assert not read.mechanism.assemble
    assert float(read.mechanism.wrenches[0].force.x) == -100
    assert np.asarray(read.mechanism.wrenches[0].course(0.2)[0]) == 1


def test_examples_of_a_robot_and_of_a_controller_are_read(tmp_path):
    urdf = ROOT / "experiments" / "scenes" / "six_axes.urdf"
    (tmp_path / "arm.urdf").write_bytes(urdf.read_bytes())
    (tmp_path / "lift.csv").write_text("time, axis_1 [deg]\n0, 0\n1, 1\n2, 0\n3, 5\n")
    robot = "[robot]\n" + lines(example(scene_keys.ROBOT, "payload", "base"))
    payload = "[robot.payload.cutter]\n" + lines(example(scene_keys.PAYLOAD))
    free = [f"axis_{i}" for i in range(2, 7)] + ["finger_left", "finger_right"]
    targets = "[controller.control.target]\n" + lines(dict.fromkeys(free, '"0.2 * time"'))
    control = "[controller.control]\n" + lines(example(scene_keys.CONTROLLER, "target")) + targets
    read = load(tmp_path, robot + payload + control)
    mechanism = read.mechanism
    assert read.trajectory.span == (0.0, 3.0)
    assert float(mechanism.joints[1].motion.position) == pytest.approx(np.pi / 6)
    assert [reference.name for reference in mechanism.controllers[0].references] == free
    assert mechanism.bodies[-1].name == "cutter"
    (loose,) = mechanism.clearance_joints()
    assert (loose.name, loose.clearance.count) == ("axis_5", 16)
    geared = robot.replace('position = "30 deg" }', 'position = "30 deg", rotor_inertia = "1.5 kg*m^2" }')
    assert float(load(tmp_path, geared + control).mechanism.joints[1].motion.rotor_inertia) == 1.5
    whole = robot.replace('length = "40 mm" }', f'length = "40 mm", pin_radius = "9 mm", normal = {HERTZ} }}')
    assert float(load(tmp_path, whole + control).mechanism.clearance_joints()[0].clearance.pin_radius) == pytest.approx(
        0.009
    )
    few = robot.replace('length = "40 mm" }', 'length = "40 mm", stations = 4, pin = "inside" }')
    few = load(tmp_path, few + control)
    assert few.mechanism.clearance_joints()[0].clearance.count == 12
    with refused("robot.joint.axis_7", "axis_7"):
        load(tmp_path, robot.replace("axis_5 = { kind", "axis_7 = { kind") + control)
    with pytest.raises(cj.ClearanceError, match="has the free coordinate `axis_2`"):
        load(tmp_path, robot + payload + control.replace('axis_2 = "0.2 * time"\n', ""))
    with refused("robot.payload.cutter.on", "tpc", "tcp"):
        load(tmp_path, robot + payload.replace('"tcp"', '"tpc"'))
    with refused("robot.clearance"):
        load(tmp_path, robot + "clearance.axis_5.radial_clearance = '50 um'\n")
    with refused("robot.joint.axis_9", "axis_9"):
        load(tmp_path, robot.replace("axis_2 =", "axis_9 ="))


@pytest.mark.parametrize("word", play_keys.NORMAL_TABLES)
@pytest.mark.parametrize("stiffness", ["given", "from materials"])
def test_examples_of_normal_laws_are_read(word, stiffness, tmp_path):
    values = example(play_keys.NORMAL_TABLES[word])
    if stiffness == "from materials":
        if word == "winkler":
            values["stiffness"] = inline(example(play_keys.STIFFNESS))
            with refused("joint.pin.normal.stiffness"):
                load(tmp_path, scene(pin=lines({**PIN, "normal": inline(values)})))
            return
        if "stiffness" not in values:  # such a law has its materials itself
            assert {"pin_modulus", "sleeve_modulus"} <= set(values)
            return
        values["stiffness"] = inline(example(play_keys.STIFFNESS))
    read = load(tmp_path, scene(pin=lines({**PIN, "normal": inline(values)})))
    (joint,) = read.mechanism.clearance_joints()
    assert {f"pin.normal.{name}" for name in values if name not in ("law", "clipped", "stiffness")} <= set(
        cj.parameters(read.mechanism)
    )
    assert joint.clearance.friction is None


@pytest.mark.parametrize("word", play_keys.FRICTION_TABLES)
def test_examples_of_friction_laws_are_read(word, tmp_path):
    values = example(play_keys.FRICTION_TABLES[word])
    read = load(tmp_path, scene(pin=lines({**PIN, "normal": HERTZ, "friction": inline(values)})))
    assert {f"pin.friction.{name}" for name in values if name != "law"} <= set(cj.parameters(read.mechanism))


# With which flanks have forces [N] and lengths [m].
TEETH = ("module", "pressure_angle", "base_radius", "friction", "sliding")
# What contradicts other numbers of a flank.
OTHER_FLANKS = ("damping_factor", "cubic", "efforts")


@pytest.mark.parametrize("more", [{}, {"stiffness": '["1 kN*m/rad", "2 kN*m/rad"]', "efforts": '["3 N*m"]'}])
def test_examples_of_stops_are_read(more, tmp_path):
    values = example(scene_keys.STOPS, *OTHER_FLANKS) | more
    read = load(tmp_path, scene(main=f"stops = {inline(values)}"))
    stops = read.mechanism.joint("main").motion.stops
    assert float(stops.upper) == pytest.approx(np.radians(170.0))
    assert np.shape(stops.flank.stiffness) == ((2,) if more else ())


def test_examples_of_a_compliance_are_read(tmp_path):
    rest = "[compliance.main]\n" + lines(example(scene_keys.COMPLIANCE, "rotor_inertia", *OTHER_FLANKS))
    read = load(tmp_path, scene(main='drive = "0.4 * time"') + rest)
    (spring,) = read.mechanism.joint("main").motion.actuators
    assert float(spring.flank.stiffness) == pytest.approx(50e3)
    assert float(spring.backlash) == pytest.approx(np.pi / 3600)
    rest = "[compliance.main]\n" + lines(example(scene_keys.COMPLIANCE, *OTHER_FLANKS))
    torque = 'actuator.motor = { type = "constant", effort = "3 N*m" }'
    read = load(tmp_path, scene(main=torque) + rest)
    assert float(cj.parameters(read.mechanism)["main_motor.rotor_inertia"].value) == 1.5
    # The actuator's name is part of its parameters' names; its place among them was before, and still does.
    assert "main_motor.actuator.motor.effort" in cj.parameters(read.mechanism)
    for name in ("main_motor.actuator.motor.effort", "main_motor.0.effort"):
        changed = cj.replace(read.mechanism, {name: 4.0})
        assert float(cj.parameters(changed)["main_motor.actuator.motor.effort"].value) == 4.0


@pytest.mark.parametrize("word", coupling_keys.COUPLING_TABLES)
def test_examples_of_couplings_are_read(word, tmp_path):
    values = example(coupling_keys.COUPLING_TABLES[word], "second", "second_ratio", *OTHER_FLANKS, *TEETH)
    coordinates = {
        key: f'"{name}"' for key, name in zip(("leader", "sun", "left"), ("main",) * 3, strict=True) if key in values
    }
    coordinates |= {key: '"pin"' for key in ("ring", "right") if key in values} | {"follower": '"turn"'}
    coordinates |= {key: '"turn"' for key in ("carrier", "cage") if key in values}
    third = '[body.third]\nmass = "1 kg"\ninertia = "1 kg*m^2"\n[joint.turn]\nparent = "ground"\nchild = "third"\n'
    third += f'type = "{"prismatic" if word in ("rack", "screw") else "revolute"}"\n'
    read = load(tmp_path, scene() + third + "[coupling.mesh]\n" + lines(values | coordinates))
    (coupling,) = read.mechanism.couplings
    assert (coupling.name, coupling.follower) == ("mesh", "turn")
    unit = cj.parameters(read.mechanism)["mesh.ratio"].unit
    assert unit == ("m/rad" if word in ("rack", "screw") else "")


# Of a drive with two sets of keys those of the other one.
OTHERS = {"trapezoid": (("speed", "acceleration"), ("duration", "cruise"))}


@pytest.mark.parametrize(("word", "skip"), [(w, s) for w in scene_keys.DRIVE_TABLES for s in OTHERS.get(w, ((),))])
def test_examples_of_drives_are_read(word, skip, tmp_path):
    values = inline(example(scene_keys.DRIVE_TABLES[word], *skip))
    driven = load(tmp_path, scene(main=f"drive = {values}"))
    servo = example(scene_keys.ACTUATOR_TABLES["servo"], "target", "encoder", "rate_encoder", "period")
    steered = load(tmp_path, scene(main=f"actuator.s = {inline({**servo, 'target': values})}"))
    assert type(driven.mechanism.joints[0].motion.drive) is type(steered.mechanism.joints[0].motion.actuators[0].target)


@pytest.mark.parametrize("word", scene_keys.ACTUATOR_TABLES)
def test_examples_of_actuators_and_motions_are_read(word, tmp_path):
    # A digital servo has no integral.
    values = example(scene_keys.ACTUATOR_TABLES[word], *(["integral"] if word == "servo" else []))
    values |= {"encoder": '["main", "pin"]', "rate_encoder": '["main"]'} if word == "servo" else {}
    main = example(scene_keys.MOTION, "drive", "actuator", "stops") | {"angle": '"90 deg"'}
    read = load(tmp_path, scene(main=lines(main) + f"actuator.a = {inline(values)}"))
    motion = read.mechanism.joints[0].motion
    assert (float(motion.position), float(motion.velocity)) == (pytest.approx(0.5235988), 10.0)
    assert len(motion.actuators) == 1


def test_examples_of_a_spline_from_a_file_are_read(tmp_path):
    (tmp_path / "motion.csv").write_text("time,angle\n0,0\n1,90\n2,0\n3,5\n")
    read = load(tmp_path, scene(main=f"drive = {inline(example(scene_keys.SPLINE_FILE))}"))
    assert float(read.mechanism.joints[0].motion.drive.values[1]) == pytest.approx(1.5707963)


def only(read) -> Any:
    (joint,) = read.mechanism.clearance_joints()
    return joint.clearance


BY_FIT = ("fit", "temperature", "pin_expansion", "sleeve_expansion", "press")
RADII = ("radial_clearance", "diametral_clearance", "sleeve_radius")


@pytest.mark.parametrize("skip", ["diametral_clearance", "radial_clearance,pin_radius"])
def test_examples_of_clearances_are_read(skip, tmp_path):
    values = example(play_keys.PIN, *BY_FIT, "bearing", "worn", *skip.split(","))
    assert float(only(load(tmp_path, scene(pin=lines(values)))).radial_clearance) == pytest.approx(1e-4)


def test_examples_of_fits_and_bearings_are_read(tmp_path):
    values = example(play_keys.PIN, *RADII, "bearing", "worn") | {"press": inline(example(play_keys.PRESS))}
    fitted = only(load(tmp_path, scene(pin=lines(values))))
    assert float(fitted.tolerance.least) < float(fitted.radial_clearance) < float(fitted.tolerance.greatest)
    # Of the two sets of keys that a bearing may have one each.
    for skip, own in (
        (("rollers", "roller_length", "internal_clearance"), {"group": "C3", "balls": 9, "ball_diameter": 0.00794}),
        (("balls", "ball_diameter", "group"), {"internal_clearance": 1e-5, "rollers": 60, "roller_length": 0.009}),
    ):
        values = {"bearing": inline(example(play_keys.BEARINGS["radial"], *skip))}
        bearing = only(load(tmp_path, scene(pin=lines(values))))
        expected: Any = cj.joints.rolling_bearing(0.025, **own)
        assert float(bearing.normal.stiffness) == pytest.approx(float(expected.normal.stiffness), rel=1e-12)
        assert float(bearing.radial_clearance) == pytest.approx(float(expected.radial_clearance), rel=1e-12)


def test_examples_of_an_arms_bearings_are_read(tmp_path):
    robot = f'[robot]\nfile = "{ROOT / "experiments" / "scenes" / "six_axes.urdf"}"\n[robot.joint.axis_2]\n'
    for kind, expected in (
        (
            "crossed-roller",
            cj.joints.crossed_roller(0.1, rollers=60, roller_length=9e-3, radial_clearance=5e-6, preload=500.0),
        ),
        (
            "angular-contact-pair",
            cj.joints.angular_contact_pair(
                0.1,
                balls=9,
                ball_diameter=7.94e-3,
                contact_angle=np.deg2rad(25.0),
                spread=0.04,
                radial_clearance=5e-6,
                preload=500.0,
            ),
        ),
    ):
        given: Any = expected
        bearing = only(load(tmp_path, f"{robot}bearing = {inline(example(play_keys.BEARINGS[kind]))}\n"))
        assert type(bearing) is type(given)
        for word in ("radial_clearance", "pin_radius", "length"):
            assert float(getattr(bearing, word)) == pytest.approx(float(getattr(given, word)), rel=1e-12)
        assert float(bearing.element.tilt_stiffness) == pytest.approx(float(given.element.tilt_stiffness), rel=1e-12)
    with refused("robot.joint.axis_2.bearing.radial_clearance"):
        load(tmp_path, robot + 'bearing = { type = "crossed-roller", pitch_diameter = "0.1 m" }\n')


def test_an_arms_bearing_that_cannot_be_meant_is_refused(tmp_path):
    """A damper in the place of the preload, a forgotten type, bearings that cannot be built."""
    robot = f'[robot]\nfile = "{ROOT / "experiments" / "scenes" / "six_axes.urdf"}"\n[robot.joint.axis_2]\n'
    crossed = example(play_keys.BEARINGS["crossed-roller"])
    pair = example(play_keys.BEARINGS["angular-contact-pair"])
    damper = 'element = { type = "damper", radial = "2 kN*s/m" }\n'
    worn = {key: value for key, value in crossed.items() if key != "preload"}
    assert type(only(load(tmp_path, f"{robot}bearing = {inline(worn)}\n{damper}")).element) is cj.joints.PlayDamper
    untyped = {key: value for key, value in crossed.items() if key != "type"}
    for values, rest, words in (
        (crossed, damper, "element would take the place of the bearing's `preload`"),
        (untyped, "", r"bearing\.\w+ is not a known key of the type `radial`, .*`crossed-roller`.* add the key `type`"),
        (crossed | {"rollers": "61"}, "", "`rollers` must be even"),
        (pair | {"ball_diameter": '"80 mm"'}, "", "do not fit on a circle"),
    ):
        with pytest.raises(ClearanceError, match=words):
            load(tmp_path, f"{robot}bearing = {inline(values)}\n{rest}")


STUDY = """
scene = "{scene}"
t1 = "105 ms"
[metric.piston]
{metric}
[design.variable."wrist.radial_clearance"]
lower = "10 um"
upper = "1 mm"
cost = {cost}
[design.limit.piston]
{limit}
"""
COST = inline(example(design_keys.COST_TABLES["reciprocal"]))
PEAK = lines(example(metric_keys.METRIC_KINDS["peak"], "body", "joint", "quantity", "times", "since"))
LIMIT = lines(example(design_keys.LIMIT, "cycles"))
WEAR = "[wear]\n" + lines(example(wear_keys.WEAR, "cycles", "longest", "until", "journal"))


def study(tmp_path, rest="", cost=COST, metric=PEAK, limit=LIMIT) -> Any:
    path = tmp_path / "study.toml"
    crank = ROOT / "experiments" / "scenes" / "slider_crank.toml"
    path.write_text(STUDY.format(scene=crank, cost=cost, metric=metric, limit=limit) + rest)
    return load_study(path).design


@pytest.mark.parametrize("word", design_keys.COST_TABLES)
def test_examples_of_costs_are_read(word, tmp_path):
    values = example(design_keys.COST_TABLES[word])
    (cost,) = study(tmp_path, cost=inline(values)).problem.specification.costs
    assert float(cost(1e-4)) < float(cost(2e-5))


def test_the_example_of_a_limit_is_read(tmp_path):
    asked = study(tmp_path, WEAR, limit=lines(example(design_keys.LIMIT))).problem.specification
    (limit,) = asked.limits
    assert limit.title == "piston"
    assert limit.ages == (", after 0 cycles of wear", ", after 20000 cycles of wear")
    assert float(asked.worth("wear.coefficient")) == pytest.approx(6e-14)
    assert float(asked.worth("wrist.length")) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("cycles", "wear", "about"),
    [
        ("[0, 100]", "", ("design.limit.piston.cycles", None)),
        ("", WEAR, ("wear",)),
        ("[100, 100]", WEAR, ("design.limit.piston.cycles", "[100, 100]")),
        ("[0, 100]", WEAR.replace('"wrist"', '"rist"'), ("wear.joint", "rist", "wrist")),
        ("[0, 100]", WEAR.replace('"12 ms"', '"-1 ms"'), ("wear.cycle", -1e-3, "greater than the scene's t0 = 0 s")),
        ("[0, 100]", WEAR + "until = 3\n", ("wear.until",)),
        (
            "[0, 100]",
            WEAR + '[design.condition.a]\n"wear.coefficient" = "1 m"\n',
            ("design.condition.a.wear.coefficient", "1 m", "1/Pa"),
        ),
    ],
)
def test_a_wrong_wear_of_a_design_is_said(cycles, wear, about, tmp_path):
    with refused(*about):
        study(tmp_path, wear, limit=LIMIT + (f"cycles = {cycles}\n" if cycles else ""))


@pytest.mark.parametrize("word", metric_keys.SIGNALS)
def test_a_signal_says_what_it_is_of(word, tmp_path):
    of = {"orientation-error": "body", "contact-force": "joint", "quantity": "quantity"}
    of = of.get(word, "joint" if "joint" in word else "point")
    name = {"body": "slider", "joint": "wrist", "point": "piston", "quantity": "wrist.penetration"}[of]
    bounds = {"rad": '"1 deg"', "N": '"1 kN"', "N m": '"1 N*m"', "m/s^2": '"5 m/s^2"'}
    unit = "N" if word == "contact-force" else metric_keys.SIGNALS[word].unit
    bound = bounds.get(unit, '"1 mm"')
    limit = f"bound = {bound}\n"
    metric = f'kind = "peak"\nsignal = "{word}"\n{of} = "{name}"\n'
    (asked,) = study(tmp_path, metric=metric, limit=limit).problem.specification.limits
    assert getattr(asked.metric.signal, of) == name
    other = "body" if of != "body" else "joint"
    with refused(f"metric.piston.{other}"):
        study(tmp_path, metric=metric + f'{other} = "slider"\n', limit=limit)


@pytest.mark.parametrize(
    ("metric", "name", "kind"),
    [
        (PEAK + 'times = ["1 ms"]\n', "times", "at"),
        (PEAK.replace('"peak"', '"at"'), "times", None),
        (PEAK.replace('"peak"', '"at"') + 'times = ["1 ms"]\nsince = "0 s"\n', "since", "peak"),
    ],
)
def test_times_belong_to_values_at_them(metric, name, kind, tmp_path):
    with refused(f"metric.piston.{name}", allowed=kind):
        study(tmp_path, metric=metric)


def test_examples_of_the_rest_of_a_design_are_read(tmp_path):
    skip = "variable", "limit", "condition", "manufacture", "verify", "trajectory"
    rest = "[solve]\n" + lines(example(study_keys.SOLVE)) + "[design]\n" + lines(example(design_keys.DESIGN, *skip))
    rest += '[scatter."slider.mass"]\ndeviation = "2 percent"\n[design.verify]\n' + lines(example(design_keys.VERIFY))
    for word, values in design_keys.MANUFACTURE_TABLES.items():
        read = study(tmp_path, rest + "[design.manufacture]\n" + lines(example(values)))
        assert type(read.problem.specification.manufacture).__name__.lower() == word
        assert set(read.solve) == {"method", "starts", "most"}
        assert set(read.verify) == {key.name for key in design_keys.VERIFY.keys}
    given = '[design.condition.slow]\n"drive.main.speed" = "3000 rpm"\n[set]\n"slider.mass" = "0.2 kg"\n'
    slow = study(tmp_path, given)
    assert slow.problem.specification.conditions["slow"] == {"drive.main.speed": pytest.approx(314.159265)}


# Schema --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", ["scene", "study"])
def test_every_file_of_the_repository_is_what_the_schema_says(file):
    paths = sorted((ROOT / "experiments" / "scenes").glob("*.toml"))
    if file == "study":
        paths = sorted(ROOT.glob("*/studies/*.toml"))
    assert len(paths) > 5
    validator = jsonschema.Draft202012Validator(schema(file))
    for path in paths:
        text = path.read_text(encoding="utf-8")
        assert [error.message for error in validator.iter_errors(tomllib.loads(text))] == [], path.name
        wrong = tomllib.loads(text)
        wrong["solve"] = {"tolerance": 1e-6}
        assert any("'tolerance' was unexpected" in error.message for error in validator.iter_errors(wrong))
