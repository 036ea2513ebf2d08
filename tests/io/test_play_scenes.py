"""Play of every kind in scene files, against the mechanisms that Python makes."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import slope
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.mechanism.state import layout

LAW = 'normal = { law = "hunt-crossley", stiffness = "1e9 N/m^1.5", damping_factor = "0.5 s/m" }'
RUBBING = 'friction = { law = "tanh", coefficient = 0.1, transition_speed = "10 mm/s" }'
# A block in a guide, a ball in a socket on it, and a shaft that slides in a bush, fitted and warm; all fall.
SCENE = f"""
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
[body.block]
mass = "2 kg"
inertia = ["2e-3 kg*m^2", "2e-3 kg*m^2", "2e-3 kg*m^2"]
[body.bob]
mass = "0.5 kg"
inertia = ["1e-4 kg*m^2", "1e-4 kg*m^2", "1e-4 kg*m^2"]
center_of_mass = ["0 m", "-0.1 m", "0 m"]
[body.shaft]
mass = "1 kg"
inertia = ["1e-4 kg*m^2", "2e-3 kg*m^2", "2e-3 kg*m^2"]
[joint.guide]
type = "prismatic"
parent = "ground"
child = "block"
velocity = "0.3 m/s"
side_clearance = "0.1 mm"
length = "60 mm"
height = "30 mm"
width = "40 mm"
guide_length = "200 mm"
eccentricity = ["0.02 mm", "-0.05 mm"]
{LAW}
{RUBBING}
[joint.hip]
type = "spherical"
parent = "block"
child = "bob"
radial_clearance = "0.1 mm"
ball_radius = "10 mm"
eccentricity = ["0 mm", "0 mm", "0.03 mm"]
{LAW}
[joint.bush]
type = "cylindrical"
parent = "block"
child = "shaft"
axis = "x"
turn = {{ velocity = "20 rad/s" }}
fit = "H8/e8"
pin_radius = "10 mm"
temperature = "80 degC"
length = "40 mm"
stations = 4
{LAW}
{RUBBING}
"""


@pytest.fixture
def written(tmp_path):
    def write(text, name="scene.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def by_hand() -> cj.Mechanism:
    law, rubbing = laws.HuntCrossley(1e9, 0.5), laws.TanhCoulomb(0.1, 0.01)
    bodies = (
        cj.Body("block", 2.0, cj.Inertia(2e-3, 2e-3, 2e-3)),
        cj.Body("bob", 0.5, cj.Inertia(1e-4, 1e-4, 1e-4), cj.Position(y=-0.1)),
        cj.Body("shaft", 1.0, cj.Inertia(1e-4, 2e-3, 2e-3)),
    )
    guide = cj.GuideClearance(1e-4, 0.06, 0.03, law, rubbing, 0.04, guide_length=0.2)
    # H8 at 20 mm is 0 to +33 um, e8 -73 to -40 um; bronze and steel, 60 K above 20 degC.
    hole, pin = 0.02 + np.array([0, 16.5, 33]) * 1e-6, 0.02 - np.array([40, 56.5, 73]) * 1e-6
    least, mean, greatest = (hole * (1 + 18e-6 * 60) - pin * (1 + 11.5e-6 * 60)) / 2
    made = cj.joints.Tolerance(least, greatest)
    sleeve = cj.SleeveClearance(mean, 0.01, 0.04, law, rubbing, stations=4, tolerance=made)
    joints = (
        cj.Prismatic(
            "guide", "ground", "block", motion=cj.Motion(velocity=0.3), clearance=guide,
            eccentricity=cj.Position(2e-5, -5e-5),
        ),
        cj.Spherical(
            "hip", "block", "bob", clearance=cj.SphericalClearance(1e-4, 0.01, law),
            eccentricity=cj.Position(z=3e-5),
        ),
        cj.Cylindrical("bush", "block", "shaft", turn=cj.Motion(velocity=20.0), axis="x", clearance=sleeve),
    )  # fmt: skip
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(y=-9.81), name="scene")


@pytest.mark.slow
def test_a_scene_with_play_of_every_kind_is_the_mechanism_made_by_hand(written):
    read, made = load_scene(written(SCENE)).mechanism, by_hand()
    assert jax.tree.structure(read) == jax.tree.structure(made)
    given, expected = cj.parameters(read), cj.parameters(made)
    assert list(given) == list(expected)
    for name, leaf in given.items():
        assert float(leaf.value) == pytest.approx(float(expected[name].value), rel=1e-10, abs=1e-18), name
    # Some play beyond its clearance: all three touch.
    plan = layout(read)
    state = np.zeros(plan.size)
    for i, name in enumerate(plan.positions):
        state[i] = 1.3e-4 if ".play_" in name else 1.0 if name == "hip.w" else 0.0
    state[len(plan.positions) :] = np.random.default_rng(3).normal(size=plan.size - len(plan.positions))
    field = jax.jit(slope)
    rates = [np.asarray(field(jnp.zeros(()), jnp.asarray(state), m.prepare())) for m in (read, made)]
    assert np.abs(rates[0]).max() > 1e3
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-9, atol=1e-9)


def test_the_scene_of_a_guide_that_closes_a_loop_is_the_mechanism_made_by_hand():
    play = cj.GuideClearance(1e-3, 0.1, 0.05, laws.HuntCrossley(1e9, 0.5))
    bodies = (
        cj.Body("crank", 0.038, 7.4e-5, cj.Position(0.0765)),
        cj.Body("rod", 0.038, 5.9e-4, cj.Position(0.153)),
        cj.Body("block", 0.076, 2.7e-6),
    )
    joints = (
        cj.Revolute("main", "ground", "crank", motion=cj.Motion(velocity=150.0)),
        cj.Revolute("elbow", "crank", "rod", at_parent=cj.Position(0.153), motion=cj.Motion(velocity=-225.0)),
        cj.Revolute("pin", "rod", "block", at_parent=cj.Position(0.306), motion=cj.Motion(velocity=75.0)),
    )
    guide = cj.Prismatic("guide", "ground", "block", clearance=play)
    made = cj.Mechanism(
        bodies,
        joints,
        (guide,),
        gravity=cj.Gravity(y=-9.81),
        points=(cj.Point("slider", "block"),),
        name="slider-crank with play in its guide",
    )
    read = cj.load("experiments/scenes/slider_crank_guide.toml")
    assert jax.tree.structure(read) == jax.tree.structure(made)
    np.testing.assert_allclose(jax.tree.leaves(read), jax.tree.leaves(made), rtol=1e-14)


def test_one_scene_of_a_fit_a_bearing_and_a_bush_says_what_they_are_made_between(written):
    text = """
[body.arm]
mass = "1 kg"
inertia = "1e-3 kg*m^2"
[body.fore]
mass = "1 kg"
inertia = "1e-3 kg*m^2"
[joint.hip]
type = "revolute"
parent = "ground"
child = "arm"
bearing = { bore = "25 mm", group = "C3", balls = 9, ball_diameter = "7.94 mm" }
[joint.knee]
type = "revolute"
parent = "arm"
child = "fore"
fit = "H7/f7"
pin_radius = "10 mm"
press = { fit = "H7/p6", diameter = "26 mm" }
normal = { law = "hertz", stiffness = "1e9 N/m^1.5" }
"""
    path = written(text)
    said = " ".join(CliRunner().invoke(app, ["info", str(path)]).output.split())
    # C3 at 25 mm: 13 to 28 um at the diameter.
    assert "clearance joint hip: HuntCrossley (class C1), no friction, radial clearance as made 6.5 um to 14 um" in said
    assert "the tightest of them have no play" in said
    knee: Any = cj.load(path).clearance_joints()[1].clearance
    # H7/f7 at 20 mm: 20 to 62 um at the diameter, from which the bush's bore takes part of 1 to 35 um.
    part = float(cj.joints.PressFit("H7/p6", 0.026).part(0.02))
    expected = (np.array([20, 41, 62]) - part * np.array([35, 18, 1])) * 1e-6 / 2
    np.testing.assert_allclose(
        [knee.tolerance.least, knee.radial_clearance, knee.tolerance.greatest], expected, rtol=1e-9
    )


ARM: Any = cj.Mechanism(
    (cj.Body("block", 1.0, cj.Inertia(1e-3, 1e-3, 1e-3)),), (cj.Prismatic("slide", "ground", "block"),)
)


@pytest.mark.slow
def test_a_robots_slide_gets_play_by_a_scene_a_command_and_python(written, tmp_path):
    urdf = """<robot name="lift"><link name="base"/><link name="block"><inertial><mass value="1"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="slide" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="100" velocity="1"/></joint></robot>"""
    robot = written(urdf, "lift.urdf")
    scene = written('[robot]\nfile = "lift.urdf"\n[robot.joint.slide]\nside_clearance = "0.05 mm"\n'
                    'length = "60 mm"\nheight = "30 mm"\nwidth = "30 mm"\n')  # fmt: skip
    numbers: Any = {"side_clearance": 5e-5, "length": 0.06, "height": 0.03, "width": 0.03}
    python = cj.load(robot).with_clearance("slide", **numbers)
    (read,), (made,) = cj.load(scene).clearance_joints(), python.clearance_joints()
    assert jax.tree.structure(read.clearance) == jax.tree.structure(made.clearance)
    assert jax.tree.leaves(read.clearance) == jax.tree.leaves(made.clearance)
    # Four corners of a side bear together as a flat punch does: E* sqrt(60 mm x 30 mm) / 0.95.
    modulus = 1 / ((1 - 0.29**2) / 207e9 + (1 - 0.34**2) / 103e9)
    assert 4 * float(made.clearance.normal.stiffness) == pytest.approx(modulus * np.sqrt(0.0018) / 0.95, rel=1e-12)
    given = "slide:side_clearance=0.05mm,length=60mm,height=30mm,width=30mm"
    said = CliRunner().invoke(app, ["info", str(robot), "--clearance", given])
    assert said.exit_code == 0
    assert "slide.side_clearance │ 5e-05 │ m" in " ".join(said.output.split())


def test_a_designers_numbers_make_play_of_every_kind_and_change_it():
    bodies = (cj.Body("block", 1.0, cj.Inertia(1e-3, 1e-3, 1e-3)),)

    def alone(joint) -> Any:
        return cj.Mechanism(bodies, (joint("j", "ground", "block"),))

    pin = alone(cj.Revolute).with_clearance(
        "j", kind="sleeve", fit="H7/g6", pin_radius=0.01, length=0.03, temperature=353.15
    )
    assert isinstance(pin.joint("j").clearance, cj.SleeveClearance)
    wide = pin.with_clearance("j", fit="H8/e8").joint("j").clearance
    assert (float(wide.radial_clearance), float(wide.tolerance.greatest)) == pytest.approx((36.5e-6, 53e-6))
    # A tolerance is that of the fit: other radii have none, another length changes nothing of it.
    for radii in ({"radial_clearance": 2e-5}, {"pin_radius": 0.015}):
        assert pin.with_clearance("j", **radii).joint("j").clearance.tolerance is None
    assert pin.with_clearance("j", length=0.04).joint("j").clearance.tolerance is not None
    ball = alone(cj.Spherical).with_clearance("j", radial_clearance=1e-4, ball_radius=0.01)
    assert float(ball.with_clearance("j", ball_radius=0.015).joint("j").clearance.ball_radius) == pytest.approx(0.015)
    shaft = alone(cj.Cylindrical).with_clearance("j", radial_clearance=1e-4, length=0.04).joint("j").clearance
    assert float(shaft.pin_radius) == pytest.approx(0.02)
    guide = ARM.with_clearance("slide", side_clearance=1e-4, length=0.06).with_clearance("slide", side_clearance=2e-4)
    play = guide.joint("slide").clearance
    assert (float(play.side_clearance), float(play.height), play.width) == (2e-4, 0.06, None)
    warm = jax.grad(
        lambda t: (
            alone(cj.Revolute)
            .with_clearance("j", fit="H7/g6", pin_radius=0.01, temperature=t)
            .joint("j")
            .clearance.radial_clearance
        )
    )(350.0)
    assert float(warm) == pytest.approx(0.01 * 6.5e-6, rel=5e-3)
