"""Play that is no play, in Python, in scenes and on the command line: a message in words, and nothing is loaded."""

import re
from typing import Any

import jax
import pytest
from places import refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.cli.main import app
from clearance_jax.mechanism.variants import with_play
from clearance_jax.parameters import bounds_hold, check_values

pytestmark = pytest.mark.quick

NAN = float("nan")
LAW: Any = laws.HuntCrossley(1e9, 0.5)
BODY = (cj.Body("arm", 1.0, cj.Inertia(1e-3, 1e-3, 1e-3)),)


def alone(kind, **options) -> Any:
    return cj.Mechanism(BODY, (kind("hip", "ground", "arm", **options),))


@pytest.mark.parametrize(
    ("kind", "numbers", "words"),
    [
        (
            cj.Fixed,
            {"radial_clearance": 1e-4},
            r"`hip` is of a kind that has no play \(fixed\). These have: revolute, prismatic",
        ),
        (cj.Universal, {"radial_clearance": 1e-4}, r"no play \(universal\)"),
        (
            cj.Revolute,
            {},
            "is ideal: give its whole clearance, or its numbers: radial_clearance, pin_radius, length, axial_",
        ),
        (cj.Revolute, {"radial_clearance": 1e-4}, "needs the `pin_radius`, or the `length`"),
        (cj.Revolute, {"pin_radius": 0.01}, "needs its `radial_clearance`, or a `fit`"),
        (
            cj.Revolute,
            {"radial_clearance": 1e-4, "pin_radius": 0.01, "axial_clearance": 1e-4},
            "is that of a sleeve: give `kind`",
        ),
        (
            cj.Revolute,
            {"radial_clearance": 1e-4, "length": 0.04, "axial_clearance": -1e-4},
            "`axial_clearance` must be greater than 0 m, .* -0.0001 m. Parts that grip .*`JointFriction`",
        ),
        (cj.Revolute, {"radial_clearance": NAN, "length": 0.04}, "`radial_clearance` must be finite, but it is nan"),
        (cj.Revolute, {"radial_clearance": 1e-4, "length": 0.0}, "`length` must be greater than 0 m"),
        (
            cj.Revolute,
            {"radial_clearance": "0.1 mm", "length": 0.04},
            "`radial_clearance` must be a number in m, but it is '0.1 mm'",
        ),
        (
            cj.Revolute,
            {"radial_clearance": 0.02, "pin_radius": 0.015},
            "`pin_radius` must be greater than the radial clearance",
        ),
        (
            cj.Revolute,
            {"radial_clearance": 1e-3, "pin_radius": 0.015, "length": 0.01, "kind": "sleeve"},
            "`hip.length` must be greater than 0.0173 m",
        ),
        (cj.Revolute, {"fit": "H7/s6", "pin_radius": 0.01}, "`fit` H7/s6 leaves no play"),
        (
            cj.Revolute,
            {"fit": "H7/g6", "radial_clearance": 1e-4, "pin_radius": 0.01},
            "by `radial_clearance` or by a `fit`",
        ),
        (
            cj.Revolute,
            {"temperature": 350.0, "radial_clearance": 1e-4, "pin_radius": 0.01},
            "`temperature` is that of a `fit`",
        ),
        (
            cj.Revolute,
            {"fit": "H7/g6", "pin_radius": 0.01, "temperature": -80.0},
            "`temperature` must be greater than 0 K",
        ),
        (
            cj.Revolute,
            {"side_clearance": 1e-4, "length": 0.04},
            "`hip` has no number `side_clearance`. Did you mean `axial_clearance`",
        ),
        (cj.Revolute, {"kind": "sleeve", "radial_clearance": 1e-4, "pin_radius": 0.01}, "A sleeve needs its `length`"),
        (cj.Revolute, {"kind": "bush", "radial_clearance": 1e-4, "pin_radius": 0.01}, "`kind` must be pin or sleeve"),
        (cj.Cylindrical, {"radial_clearance": 1e-4, "pin_radius": 0.01}, "A sleeve needs its `length`"),
        (
            cj.Cylindrical,
            {"radial_clearance": 1e-4, "length": 0.02, "axial_clearance": 1e-4},
            "has no number `axial_clearance`",
        ),
        (cj.Spherical, {"radial_clearance": 1e-4}, "needs its `radial_clearance` and its `ball_radius`"),
        (
            cj.Spherical,
            {"radial_clearance": 0.01, "ball_radius": 0.01},
            "`ball_radius` must be greater than the radial clearance",
        ),
        (cj.Prismatic, {"side_clearance": 1e-4}, "needs its `side_clearance` and its `length`"),
        (
            cj.Prismatic,
            {"side_clearance": 1e-4, "length": 0.3, "guide_length": 0.2},
            "`hip.length` must be no greater than .* 0.2",
        ),
        (
            cj.Prismatic,
            {"side_clearance": 5e-3, "length": 0.01, "height": 0.03},
            "`hip.length` must be greater than 0.0265 m",
        ),
        (
            cj.Prismatic,
            {"side_clearance": 0.02, "length": 0.1, "height": 0.03},
            "`hip.height` must be greater than twice",
        ),
    ],
)
def test_python_refuses(kind, numbers, words):
    with pytest.raises(cj.ClearanceError, match=words):
        alone(kind).with_clearance("hip", **numbers)


def test_former_names_are_told_apart_from_what_there_never_was():
    for kind, name, words in (
        (cj.Revolute, "radial", "no number `radial`. It is called `radial_clearance` now."),
        (cj.Revolute, "diameter", "no number `diameter`. It is called `pin_radius` now, half of it."),
        (cj.Spherical, "diameter", "It is called `ball_radius` now, half of it."),
        (cj.Prismatic, "side", "It is called `side_clearance` now."),
        (cj.Prismatic, "radial", "no number `radial`. Allowed: "),
    ):
        numbers: Any = {name: 1e-4}
        with pytest.raises(cj.ClearanceError, match=re.escape(words)):
            alone(kind).with_clearance("hip", **numbers)


def test_a_length_alone_makes_no_sleeve():
    """It is that of the contact; which kind of joint it is, is said."""
    pin = alone(cj.Revolute).with_clearance("hip", radial_clearance=1e-4, length=0.04).joint("hip").clearance
    assert isinstance(pin, cj.RevoluteClearance)
    assert (float(pin.length), float(pin.pin_radius)) == (0.04, 0.02)
    with pytest.raises(cj.ClearanceError, match="`hip` has play of another kind, `pin`"):
        alone(cj.Revolute, clearance=pin).with_clearance("hip", kind="sleeve", length=0.05)


def test_a_whole_clearance_must_be_of_the_joints_kind():
    axial = cj.SleeveClearance(1e-4, 0.01, 0.04, LAW, axial_clearance=1e-4)
    box = cj.GuideClearance(1e-4, 0.06, 0.03, LAW, width=0.03)
    for kind, play, name in (
        (cj.Cylindrical, axial, "play_z"),
        (cj.Prismatic, cj.SphericalClearance(1e-4, 0.01, LAW), "play_z"),
        (cj.Revolute, box, "tilt_z"),
        (cj.Spherical, axial, "tilt_x"),
    ):
        with refused(f"hip.{name}"):
            alone(kind, clearance=play)
        with refused(f"hip.{name}"):
            alone(kind).with_clearance("hip", play)
    short = cj.SleeveClearance(1e-3, 0.015, 0.01, LAW)
    with refused("hip.length"):
        alone(cj.Revolute).with_clearance("hip", short)
    with pytest.raises(cj.ClearanceError, match="a whole clearance and numbers of one"):
        alone(cj.Revolute).with_clearance("hip", axial, radial_clearance=1e-4)
    for size in (1e-4, -1e-5, "0.1 mm"):
        with refused("hip.clearance"):
            with_play(alone(cj.Revolute).joint("hip"), size, {})
    socket = alone(cj.Revolute, clearance=cj.SphericalClearance(1e-4, 0.01, LAW))
    with pytest.raises(cj.ClearanceError, match="of a kind that has no `fit`"):
        socket.with_clearance("hip", fit="H7/g6")
    with refused("hip.axial_clearance"):
        alone(cj.Revolute).with_clearance("hip", cj.RevoluteClearance(1e-4, 0.01, LAW)).with_clearance(
            "hip", axial_clearance=1e-4
        )


def test_what_would_have_no_effect_is_refused():
    with refused("collar_radius"):
        cj.SleeveClearance(1e-4, 0.01, 0.04, LAW, collar_radius=0.02)
    along, pin = cj.Position(z=5e-5), cj.RevoluteClearance(1e-4, 0.01, LAW)
    with refused("hip.eccentricity", "z"):
        alone(cj.Revolute, clearance=pin, eccentricity=along)
    with refused("hip.eccentricity", "z"):
        alone(cj.Revolute, eccentricity=along).with_clearance("hip", pin)
    alone(cj.Revolute, clearance=cj.SleeveClearance(1e-4, 0.01, 0.04, LAW, axial_clearance=1e-4), eccentricity=along)
    aside = cj.Position(y=5e-5)
    with refused("hip.eccentricity", "y"):
        alone(cj.Prismatic, clearance=cj.GuideClearance(1e-4, 0.06, 0.03, LAW), eccentricity=aside)
    alone(cj.Prismatic, clearance=cj.GuideClearance(1e-4, 0.06, 0.03, LAW, width=0.03), eccentricity=aside)


def test_the_door_of_a_solve_knows_what_numbers_must_be_for_one_another():
    """Also of numbers that were replaced, and of traced ones (then a flag)."""
    loose = alone(cj.Revolute).with_clearance("hip", kind="sleeve", radial_clearance=1e-4, length=0.04)
    check_values(loose)
    # The least length is sqrt(20 r c) = 6.32 mm: the section of the pin is an ellipse, longer by r (2c/L)^2 / 2.
    short = cj.replace(loose, {"hip.length": 0.0063})
    with refused("hip.length"):
        cj.simulate(short, 1e-3)
    holds = jax.jit(lambda length: bounds_hold(cj.replace(loose, {"hip.length": length})))
    assert [bool(holds(length)) for length in (0.0063, 0.0064, -1.0)] == [False, True, False]


def test_the_least_length_of_a_sleeve_is_where_its_tilt_is_a_tenth_wrong():
    """A cylinder tilted by t in a bore touches both edges where L tan t + 2 r (1 / cos t - 1) = 2 c: of the sleeve's
    largest tilt 2 c / L this is short by a tenth of 2 c (to the order of t^2).
    """
    import numpy as np

    radius, clearance = 0.02, 1e-5
    length = np.sqrt(20 * radius * clearance)
    tilt = 2 * clearance / length
    exact = length * np.tan(tilt) + 2 * radius * (1 / np.cos(tilt) - 1)
    assert exact / (2 * clearance) - 1 == pytest.approx(0.1, abs=2e-3)


SCENE = """
[body.arm]
mass = "1 kg"
inertia = ["1e-3 kg*m^2", "1e-3 kg*m^2", "1e-3 kg*m^2"]
[joint.hip]
type = "{kind}"
parent = "ground"
child = "arm"
normal = {{ law = "hertz", stiffness = "1e9 N/m^1.5" }}
"""
SLEEVE = {"radial_clearance": '"0.1 mm"', "pin_radius": '"10 mm"', "length": '"40 mm"', "kind": '"sleeve"'}
GUIDE = {"side_clearance": '"0.1 mm"', "length": '"60 mm"', "height": '"30 mm"'}
BALL = {"radial_clearance": '"0.1 mm"', "ball_radius": '"10 mm"'}
FIT = {"fit": '"H7/g6"', "pin_radius": '"10 mm"'}
BEARING = '{ bore = "25 mm", balls = 9, ball_diameter = "8 mm"'


@pytest.mark.parametrize(
    ("kind", "keys", "words"),
    [
        ("fixed", {}, r"joint.hip.normal is not a known key"),
        ("planar", SLEEVE, r"joint.hip.normal is not a known key"),
        ("revolute", {}, r"joint.hip.normal belongs to a joint with clearance: add `radial_clearance`"),
        ("prismatic", {}, r"joint.hip.normal belongs to a joint with clearance: add `side_clearance`"),
        ("prismatic", SLEEVE, r"joint.hip.radial_clearance is not a known key"),
        ("revolute", SLEEVE | {"axial_clearance": '"-0.1 mm"'}, r"axial_clearance must be .*-0.1 mm\. Parts that grip"),
        ("revolute", SLEEVE | {"length": '"0 mm"'}, r"joint.hip.length must be greater than 0 m"),
        ("revolute", SLEEVE | {"length": '"nan mm"'}, r"joint.hip.length must be finite"),
        ("revolute", SLEEVE | {"length": '"4 mm"'}, r"joint.hip: `length` must be greater than 0.00447 m"),
        (
            "revolute",
            SLEEVE | {"pin_radius": '"0.05 mm"'},
            r"joint.hip: `pin_radius` must be greater than the",
        ),
        (
            "revolute",
            SLEEVE | {"collar_radius": '"9 mm"', "axial_clearance": '"1 mm"'},
            "`collar_radius` must be",
        ),
        (
            "revolute",
            {**FIT, "radial_clearance": '"0.1 mm"'},
            r"joint.hip.radial_clearance has no effect beside a",
        ),
        ("revolute", {"fit": '"H7/g6"'}, "lacks the key `pin_radius`, half the nominal diameter"),
        ("revolute", FIT | {"fit": '"H7/s6"'}, r"joint.hip.fit: The `fit` H7/s6 leaves no play"),
        ("revolute", FIT | {"fit": '"H7"'}, r"joint.hip.fit: .* must be a hole and a shaft"),
        ("revolute", FIT | {"temperature": '"-300 degC"'}, r"joint.hip.temperature must be greater than 0 K"),
        ("revolute", FIT | {"press": '{ fit = "H7/p6" }'}, r"joint.hip.press lacks the key `diameter`"),
        (
            "revolute",
            FIT | {"press": '{ fit = "H7/p6", diameter = "15 mm" }'},
            "`diameter` must be greater than the",
        ),
        ("revolute", {**SLEEVE, "temperature": '"80 degC"'}, r"joint.hip.temperature belongs to a fit: add `fit`"),
        ("revolute", {"bearing": BEARING + " }"}, r"joint.hip.normal has no effect beside a `bearing`"),
        ("revolute", SLEEVE | {"collar_radius": '"9 mm"'}, "hip.collar_radius has no effect without `axial_clearance`"),
        (
            "revolute",
            SLEEVE | {"kind": '"pin"', "stations": "8"},
            'hip.stations belongs to a sleeve: add `kind = "sleeve"`',
        ),
        ("revolute", SLEEVE | {"kind": '"bush"'}, "joint.hip.kind must be"),
        ("revolute", SLEEVE | {"ring": "8"}, "joint.hip.ring has no effect without `axial_clearance`"),
        ("revolute", FIT | {"pin_expansion": '"1e-5 1/K"'}, "hip.pin_expansion has no effect without `temperature`"),
        ("revolute", FIT | {"sleeve_expansion": '"1e-5 1/K"'}, "sleeve_expansion has no effect without `temperature`"),
        (
            "revolute",
            SLEEVE | {"eccentricity": '["0 mm", "0 mm", "0.1 mm"]'},
            "`eccentricity` of joint `hip` along z of its sleeve has no effect",
        ),
        ("prismatic", GUIDE | {"eccentricity": '["0 mm", "0.1 mm"]'}, "`hip` along y of its sleeve has no effect"),
        ("cylindrical", {**FIT}, r"joint.hip lacks the key `length`"),
        ("cylindrical", {"axial_clearance": '"1 mm"', **SLEEVE}, r"joint.hip.axial_clearance is not a known key"),
        ("spherical", {"radial_clearance": '"0.1 mm"'}, r"joint.hip lacks the key `ball_radius`"),
        (
            "spherical",
            BALL | {"ball_radius": '"0.01 mm"'},
            r"joint.hip: `ball_radius` must be greater than the",
        ),
        ("prismatic", GUIDE | {"guide_length": '"50 mm"'}, r"joint.hip: `length` must be no greater than the guide's"),
        ("prismatic", GUIDE | {"length": '"2 mm"'}, r"joint.hip: `length` must be greater than 0.00347 m, or the"),
        ("prismatic", {"side_clearance": '"1 mm"', "length": '"60 mm"'}, r"joint.hip lacks the key `height`"),
    ],
)
def test_scenes_refuse(kind, keys, words, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(SCENE.format(kind=kind) + "".join(f"{key} = {value}\n" for key, value in keys.items()))
    with pytest.raises(cj.ClearanceError, match=words) as caught:
        cj.load(path)
    assert str(path) in str(caught.value)


ROBOT = """<robot name="lift"><link name="base"/><link name="block"/><link name="arm"/><link name="tool"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>
<joint name="hip" type="continuous"><parent link="block"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="foot" type="planar"><parent link="arm"/><child link="tool"/><axis xyz="0 1 0"/></joint></robot>"""
LINK = '<inertial><mass value="1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "lift.urdf"
    text = ROBOT
    for name in ("block", "arm", "tool"):
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{LINK}</link>')
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("hop", SLEEVE, r"robot.joint.hop: the robot has no joint of this name. Did you mean `hip`"),
        ("foot", SLEEVE, r"robot.joint.foot must be a revolute or prismatic joint of the robot"),
        ("hip", {"normal": '{ law = "hertz" }'}, r"robot.joint.hip.normal belongs to a joint with clearance: add"),
        ("hip", GUIDE, r"robot.joint.hip.side_clearance is not a known key"),
        ("hip", {"radial_clearance": '"0.1 mm"'}, r"robot.joint.hip lacks the key `pin_radius`"),
        ("hip", SLEEVE | {"length": '"4 mm"'}, r"robot.joint.hip: `length` must be greater than 0.00447 m"),
        ("slide", SLEEVE, r"robot.joint.slide.radial_clearance is not a known key"),
        ("slide", {"side_clearance": '"0.1 mm"'}, r"robot.joint.slide lacks the key `length`"),
        ("slide", GUIDE | {"guide_length": '"50 mm"'}, r"robot.joint.slide: `length` must be no greater"),
    ],
)
def test_scenes_refuse_for_robots(name, keys, words, robot):
    path = robot.parent / "bad.toml"
    body = "".join(f"{key} = {value}\n" for key, value in keys.items())
    path.write_text(f'[robot]\nfile = "lift.urdf"\n[robot.joint.{name}]\n{body}')
    with pytest.raises(cj.ClearanceError, match=words):
        cj.load(path)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("foot:radial_clearance=0.1mm,length=40mm", "`foot` is of a kind that has no play (planar)"),
        ("hop:radial_clearance=0.1mm", "There is no joint `hop`. Did you mean `hip`"),
        ("hip:radial_clearance=0.1mm,length=40mm,axial_clearance=-0.1mm", "`axial_clearance` must be greater than 0 m"),
        ("hip:radial_clearance=nan mm,length=40mm", "radial_clearance must be finite"),
        ("hip:radial_clearance=0.1mm,length=0mm", "`length` must be greater than 0 m"),
        (
            "hip:radial_clearance=1mm,length=5mm,pin_radius=10mm,kind=sleeve",
            "`hip.length` must be greater than 0.0141 m",
        ),
        ("hip:radial_clearance=1mm,pin_radius=0.5mm", "`pin_radius` must be greater than the radial clearance"),
        ("hip:fit=H7/s6,pin_radius=10mm", "`fit` H7/s6 leaves no play"),
        ("hip:fit=H7/g6,pin_radius=10mm,temperature=80mm", "temperature must be in K"),
        ("hip:side_clearance=0.1mm,length=60mm", "is no NUMBER=VALUE. Did you mean `axial_clearance`"),
        ("hip:radial=0.1mm", "'radial=0.1mm' is no NUMBER=VALUE. It is called `radial_clearance` now."),
        ("slide:radial_clearance=0.1mm", "is no NUMBER=VALUE. Did you mean `side_clearance`"),
        (
            "slide:side_clearance=0.1mm,length=60mm,guide_length=50mm",
            "`slide.length` must be no greater than the guide's 0.05 m",
        ),
        ("slide:side_clearance=20mm,length=60mm,height=30mm", "`slide.height` must be greater than twice the play"),
    ],
)
def test_the_command_line_refuses(given, words, robot):
    failed = CliRunner().invoke(app, ["info", str(robot), "--clearance", given])
    assert failed.exit_code != 0
    assert words in str(failed.exception), failed.exception
