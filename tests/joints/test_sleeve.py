"""Play in space: a pin of some length in a sleeve, against closed forms, the plane joint, and itself."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.spatial.transform import Rotation
from sleeves import AXIAL, FRICTION, HERTZ, LENGTH, RADIAL, RADIUS, act, checked, random_states, relative, sleeve
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import relative_accelerations
from clearance_jax.joints import Relative
from clearance_jax.joints.sleeve import lobatto
from clearance_jax.mechanism.state import layout


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_without_tilt_it_is_the_plane_joint(pin):
    plane = cj.RevoluteClearance(RADIAL, RADIUS, HERTZ, FRICTION)
    at = relative((0.9e-4, 0.8e-4, 0.0), velocity=(0.02, -0.01, 0.0), spin=(0.0, 0.0, 3.0))
    ours, theirs = act(sleeve(pin), at), act(plane, at)
    assert float(theirs.normal_force) > 50
    np.testing.assert_allclose(ours.force, theirs.force, rtol=1e-12)
    np.testing.assert_allclose(ours.torque, theirs.torque, rtol=0, atol=1e-14)
    np.testing.assert_allclose(ours.elastic_energy, theirs.elastic_energy, rtol=1e-12)


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_rates_are_those_of_the_penetrations_and_power_is_that_of_the_wrench(pin):
    """Of any pose and twist: so the energy balance closes, tilted too."""
    for at in random_states(20):
        assert float(checked(sleeve(pin), at).friction_power) >= 0


def test_edges_and_faces_touch_where_geometry_says():
    stiff, limit = laws.Hertz(1e9), 2 * RADIAL / LENGTH
    for pin in ("through", "inside"):
        joint = sleeve(pin, axial=None, friction=None, normal=stiff)
        for factor, touches in ((0.999, False), (1.001, True)):
            points = joint.points(relative((0.0, 0.0, 0.0), (0.0, factor * limit, 0.0)))
            # Tilted about y the pin meets both edges of the sleeve, on opposite sides: none of the stations between.
            assert list(np.flatnonzero(points.penetration > 0)) == ([0, 7] if touches else [])
        pressed = act(joint, relative((0.0, 0.0, 0.0), (0.0, 1.05 * limit, 0.0)))
        np.testing.assert_allclose(pressed.force, 0.0, atol=1e-9 * abs(float(pressed.torque[1])))
        assert float(pressed.torque[1]) < 0
        # The depth at each edge is five hundredths of the play; its share of the law acts at an arm of half a sleeve.
        share = lobatto(8)[1][0]
        edge = share * 1e9 * (0.05 * RADIAL) ** 1.5
        assert float(pressed.torque[1]) == pytest.approx(-2 * edge * LENGTH / 2, rel=3e-3)
        joint = sleeve(pin, friction=None, normal=stiff)
        poses = {
            0: relative((0.9 * RADIAL, 0.0, 0.0)),
            1: relative((0.9 * RADIAL, 0.0, 0.0), (0.0, 0.2 * limit, 0.0)),
            2: relative((1.05 * RADIAL, 0.0, 0.0)),
            3: relative((0.0, 0.0, 0.0), (0.0, 1.05 * limit, 0.0)),
            4: relative((0.0, 0.0, 1.2 * AXIAL)),
            6: relative((1.05 * RADIAL, 0.0, 1.2 * AXIAL)),
        }
        flat = sleeve(pin, axial=20 * AXIAL, friction=None, normal=stiff)
        for code, at in poses.items():
            tell = joint if code > 3 else flat
            assert float(tell.pattern(tell.points(at))) == code
        aside = act(joint, relative((0.0, 0.0, 1.2 * AXIAL)))
        np.testing.assert_allclose(aside.force, [0, 0, -1e9 * (0.2 * AXIAL) ** 1.5], rtol=1e-9, atol=1e-12)
        tilted = act(joint, relative((0.0, 0.0, 0.99 * AXIAL), (1e-3, 0.0, 0.0)))
        assert float(tilted.torque[0]) * 1e-3 < 0  # one side of the collar bears and turns it back


def test_how_far_the_end_of_an_arm_may_go():
    """Of all poses in which nothing touches: c within half the sleeve's length, 2 c l / L beyond."""
    joint, rng = sleeve("inside", axial=None, friction=None), np.random.default_rng(3)
    places, tilts = rng.uniform(-1, 1, 4000) * RADIAL, rng.uniform(-1, 1, 4000) * 2 * RADIAL / LENGTH
    corners = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
    places = np.append(places, [0.9999 * RADIAL * a for a, _ in corners])
    tilts = np.append(tilts, [0.9999 * 2 * RADIAL / LENGTH * b for _, b in corners])

    @jax.vmap
    def deepest(place, tilt):
        s, c = jnp.sin(tilt), jnp.cos(tilt)
        rows = ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))
        at = Relative((place, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), rows)
        return jnp.max(joint.points(at).penetration)

    free = np.asarray(deepest(jnp.asarray(places), jnp.asarray(tilts))) <= 0
    assert 500 < free.sum() < 4000
    for arm_length, bound in ((0.3 * LENGTH, RADIAL), (LENGTH / 2, RADIAL), (5 * LENGTH, 10 * RADIAL)):
        reached = np.abs(places + arm_length * np.sin(tilts))[free].max()
        assert reached == pytest.approx(bound, rel=2e-4)
        assert reached <= bound


def test_what_all_stations_bear_converges_with_their_number():
    """A pin that lies askew bears over part of the sleeve: more stations, the same force."""
    at = relative((1.02e-4, 0.0, 0.0), (0.0, 4e-4, 0.0))
    exact = float(act(sleeve(stations=64, axial=None), at).force[0])
    errors = [abs(float(act(sleeve(stations=n, axial=None), at).force[0]) / exact - 1) for n in (4, 8, 16, 32)]
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[1] < 0.1
    assert errors[3] < 5e-3
    places, weights = lobatto(6)
    for power in range(0, 9, 2):
        assert weights @ places**power == pytest.approx(1 / (power + 1), rel=1e-13)


def arm(clearance, axis="z", gravity=(0.0, -3.0, -9.81), off=0.02):
    """An arm that swings on its pin, its centre of mass out of the middle."""
    body = cj.Body("arm", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, None, off or None))
    motion = cj.Motion(cj.drives.Harmonic(0.35, 30.0))
    hip = cj.Revolute("hip", "ground", "arm", motion=motion, clearance=clearance, axis=axis)
    x, y, z = gravity
    return cj.Mechanism(
        (body,), (hip,), points=(cj.Point("tip", "arm", cj.Position(0.4)),), gravity=cj.Gravity(x, y, z)
    )


def solved(mechanism, rtol, **names):
    return cj.simulate(cj.replace(mechanism, names), 0.02, rtol=rtol)


@pytest.mark.slow
def test_the_error_of_an_arm_on_a_sleeve_follows_rtol_and_its_books_close():
    m = arm(sleeve())
    best = solved(m, 1e-12).final[:10]
    scale = np.array([RADIAL, RADIAL, AXIAL, 2 * RADIAL / LENGTH, 2 * RADIAL / LENGTH])
    for rtol in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        s = solved(m, rtol)
        error = np.abs(s.final[:5] - best[:5]) / scale
        assert error.max() < 1e3 * rtol, rtol
        assert float(s.energy_residual) < 10 * rtol


def tilted(effort=0.0):
    """A sphere on a pin in its middle, which stands tilted, and its state."""
    body = cj.Body("arm", 2.0, cj.Inertia(0.01, 0.01, 0.01))
    motion = cj.Motion(actuators=(cj.actuators.ConstantEffort(effort),))
    hip = cj.Revolute("hip", "ground", "arm", motion=motion, clearance=sleeve(), orientation=cj.Orientation(0.2, 0.3))
    m = cj.Mechanism((body,), (hip,))
    values = {"hip.tilt_x": 1e-3, "hip.tilt_y": -2e-3, "hip": 0.7}
    plan = layout(m)
    return m, jnp.zeros(plan.size).at[plan.q].set(jnp.asarray([values.get(name, 0.0) for name in plan.positions]))


@pytest.mark.parametrize("form", ["written out", "table"])
def test_a_drive_acts_about_the_bisector_of_the_axes_of_sleeve_and_pin(form):
    """Of the axes z and p the torque T q is T (z + p) / (1 + z p): its power is that of its turn, whatever tilts."""
    m, y = tilted(5.0)
    ready = m.prepare().as_table() if form == "table" else m.prepare()
    now = jnp.zeros(())
    ((at, rate),) = relative_accelerations(now, y, slope(now, y, ready), ready)
    z, p = np.array([0.0, 0.0, 1.0]), np.array(at.axis, float)
    assert np.hypot(p[0], p[1]) == pytest.approx(np.hypot(1e-3, 2e-3), rel=1e-5)
    np.testing.assert_allclose(np.asarray(rate.spin), 5.0 / 0.01 * (z + p) / (1 + z @ p), rtol=1e-12, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("moved", ["driven", "actuated"])
def test_how_frames_stand_about_the_axis_of_a_sleeve_does_not_change_the_motion(moved):
    """Both frames turned by one angle: nothing physical. (The points of a face stand at angles of the sleeve.)"""
    m = arm(sleeve(axial=None))
    hip: Any = m.joint("hip")
    stands = cj.Orientation(0.0, 0.0, 0.0)
    motion = hip.motion if moved == "driven" else cj.Motion(actuators=(cj.actuators.ConstantEffort(5.0),))
    hip = dataclasses.replace(hip, motion=motion, orientation=stands, child_orientation=stands)
    m = m.with_joint(hip)

    def run(angle):
        turned = {"hip.orientation.yaw": angle, "hip.child_orientation.yaw": angle}
        s = cj.simulate(cj.replace(m, turned), 0.02, rtol=1e-10)
        return np.concatenate([s["tip.position"], [s["hip.position"], s["hip.contact_force"] * 1e-9]])

    straight = run(0.0)
    for angle in (0.7, np.pi / 2, 2.5):
        np.testing.assert_allclose(run(angle), straight, atol=1e-7 * RADIAL, rtol=0.0)


@pytest.mark.slow
def test_derivatives_of_an_arm_on_a_sleeve():
    m = arm(sleeve())
    names = {
        "hip.radial_clearance": RADIAL,
        "hip.axial_clearance": AXIAL,
        "hip.friction.coefficient": 0.1,
        "arm.mass": 2.0,
        "arm.center_of_mass.z": 0.02,
    }
    found = jax.jacfwd(lambda values: solved(m, 1e-9, **values).final[:5])(names)
    for name, value in names.items():

        def end(x, name=name):
            return solved(m, 1e-12, **{name: x}).final[:5]

        step = 1e-4 * value
        far, near = ((end(value + h) - end(value - h)) / (2 * h) for h in (step, step / 2))
        exact = (4 * near - far) / 3
        size = np.abs(exact).max()
        np.testing.assert_allclose(found[name], exact, rtol=1e-6, atol=1e-6 * size, err_msg=name)


@pytest.mark.slow
def test_radial_play_only_in_space_is_the_plane_scene():
    """The same arm as a plane mechanism, and in space about another axis, under its own names."""
    play = cj.RevoluteClearance(RADIAL, RADIUS, HERTZ, FRICTION)
    flat = cj.Mechanism(
        (cj.Body("arm", 2.0, 0.03, cj.Position(0.2)),),
        (cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)), clearance=play),),
        gravity=cj.Gravity(y=-3.0),
    )
    space = arm(play, gravity=(None, -3.0, None), off=0.0)
    assert flat.is_plane
    assert not space.is_plane
    best = cj.simulate(flat, 0.05, rtol=1e-11).final
    np.testing.assert_allclose(cj.simulate(space, 0.05, rtol=1e-11).final[:4], best[:4], rtol=0, atol=1e-9 * RADIAL)
    # About x: what was x is y, what was y is z. The sleeve's own axes say it all.
    body = cj.Body("arm", 2.0, cj.Inertia(0.03, 0.03, 2e-3), cj.Position(None, 0.2))
    hip = cj.Revolute(
        "hip", "ground", "arm", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)), clearance=play, axis="x"
    )
    turned = cj.Mechanism((body,), (hip,), gravity=cj.Gravity(z=-3.0))
    np.testing.assert_allclose(cj.simulate(turned, 0.05, rtol=1e-11).final[:4], best[:4], rtol=0, atol=1e-9 * RADIAL)


def test_a_sleeve_closes_a_loop_as_it_does_in_a_tree():
    """A pin that is free in space on the one hand, on the joint's own play coordinates on the other: one field."""
    clearance = sleeve()
    tree = arm(clearance)
    driven = cj.Revolute("motor", "ground", "sleeve", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)))
    loop = cj.Mechanism(
        (cj.Body("sleeve"), *tree.bodies),
        (driven, cj.Free("float", "ground", "arm")),
        (cj.Revolute("hip", "sleeve", "arm", clearance=clearance),),
        gravity=tree.gravity,
    )
    now, place, tilt = 0.1, np.array([1.05e-4, 2e-5, -1e-5]), np.array([1e-3, -2e-3])
    turned = 0.35 * np.sin(3.0)
    sleeve_axes = Rotation.from_rotvec([0, 0, turned])
    size = np.linalg.norm(tilt)
    pin = sleeve_axes * Rotation.from_rotvec(2 * np.arctan(size / 2) / size * np.array([*tilt, 0.0]))
    x, y, z, real = pin.as_quat()
    spin = pin.inv().apply([0, 0, 0.35 * 30 * np.cos(3.0)])
    origin = sleeve_axes.apply(place)
    velocity = np.cross([0, 0, 0.35 * 30 * np.cos(3.0)], origin)
    state = jnp.array([*origin, real, x, y, z, *velocity, *spin])
    hip = cj.Revolute("hip", "sleeve", "arm", clearance=clearance)
    fixed = cj.Mechanism((cj.Body("sleeve"), *tree.bodies), (driven, hip), gravity=tree.gravity)
    rate = slope(jnp.asarray(now), state, loop.prepare())[7:]
    own = jnp.array([*place, *tilt, *np.zeros(7)])
    expected = slope(jnp.asarray(now), own, fixed.prepare())[6:]
    # The pin's acceleration over the sleeve's own point there, in the sleeve's axes.
    w0, a0 = np.array([0, 0, 0.35 * 30 * np.cos(3.0)]), np.array([0, 0, -0.35 * 900 * np.sin(3.0)])
    there = np.cross(a0, origin) + np.cross(w0, np.cross(w0, origin))
    np.testing.assert_allclose(
        sleeve_axes.inv().apply(np.asarray(rate[:3]) - there), expected[:3], rtol=1e-9, atol=1e-7
    )


@pytest.mark.slow
def test_a_solve_of_a_loop_in_space_is_that_of_the_tree():
    """On a plate that tumbles: what event location interpolates at a loop, with the sleeve's own turning, is what a
    tree's is.
    """
    motor = cj.Revolute("motor", "ground", "plate", axis="x", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)))
    hip = cj.Revolute("hip", "plate", "arm", clearance=sleeve())
    floats = cj.Free("float", "ground", "arm", motion=cj.Ball(spin=cj.Spin(x=0.35 * 30.0)))
    one = arm(sleeve())
    bodies = (cj.Body("plate"), *one.bodies)
    tree = cj.Mechanism(bodies, (motor, hip), points=one.points, gravity=one.gravity)
    loop = cj.Mechanism(bodies, (motor, floats), (hip,), points=one.points, gravity=one.gravity)
    ends = []
    for mechanism in (tree, loop):
        s = cj.simulate(mechanism, 0.02, rtol=1e-8)
        assert float(s.energy_residual) < 1e-7
        ends.append(s["tip.position"])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_command_line_gives_a_robots_joint_play():
    robot = "experiments/scenes/six_axes.urdf"
    given = "axis_5:kind=sleeve,radial_clearance=0.05mm,axial_clearance=0.1mm,length=40mm"
    said = CliRunner().invoke(app, ["info", robot, "--clearance", given])
    assert said.exit_code == 0
    for name, value in (("axis_5.radial_clearance", "5e-05"), ("axis_5.length", "0.04"), ("axis_5.pin_radius", "0.02")):
        assert name in said.output
        assert value in said.output
    for wrong, words in {
        "axis_9:radial_clearance=0.1mm,length=40mm": "There is no joint `axis_9`",
        "axis_5:radial_clearance=0.1mm": "needs the `pin_radius`, or the `length`",
        "axis_5:radial_clearance=0.1,length=40mm": "needs a unit: write it as",
        "axis_5:kind=sleeve,axial_clearance=-0.1mm,radial_clearance=0.1mm,length=1cm": "`axial_clearance` must be",
        "axis_5:play=0.1mm": "is no NUMBER=VALUE",
        "axis_5": "must read JOINT:radial_clearance=0.1mm",
    }.items():
        failed = CliRunner().invoke(app, ["info", robot, "--clearance", wrong])
        assert failed.exit_code != 0
        assert words in str(failed.exception) + failed.output, wrong
    fixed = cj.Mechanism((cj.Body("b", 1.0, 0.1),), (cj.Fixed("weld", "ground", "b"),))
    with refused("weld", "fixed"):
        fixed.with_clearance("weld", radial_clearance=1e-4)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stations", 1),
        ("ring", 2),
    ],
)
def test_what_is_no_sleeve_is_refused(name, value):
    with refused(name, value):
        cj.SleeveClearance(RADIAL, RADIUS, LENGTH, HERTZ, **{name: value})
    with refused("hip.axial_clearance", -1e-5):
        cj.simulate(arm(sleeve(axial=-1e-5)), 0.01)
