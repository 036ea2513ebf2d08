"""What fills a play: against closed forms of compliance and decay, with its energy in the balance; settled starts on
it, and the modes about them; presets of a robot's bearings against sums over their elements.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.optimize import brentq
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import joints, laws
from clearance_jax.cli.main import app
from clearance_jax.joints.seating import relative_at
from clearance_jax.spatial import as_array

MASS, GRAVITY = 2.0, 9.81
PAIR = cj.joints.PreloadedBearing(2e6, 1e6, 800.0, 60.0, 40.0, 0.5, 1e-5)


def held_pin(element, gravity=None):
    """A pin of two masses on its sleeve, which stands; its play is wide."""
    play = cj.RevoluteClearance(1e-4, 0.01, laws.Hertz(1e10), None, element)
    return cj.Mechanism(
        bodies=(cj.Body("pin", MASS, inertia=1e-3),),
        joints=(cj.Revolute("j", "ground", "pin", motion=cj.Motion(cj.drives.ConstantSpeed(0.0)), clearance=play),),
        gravity=cj.Gravity(0.0, -gravity) if gravity else cj.Gravity(),
    )


def spring_of(r):
    """What a bearing of 2 N/um bears [N] whose play opens at 50 N."""
    return 2e6 * r / np.sqrt(1 + (2e6 * r / 50) ** 2)


def sleeve(element):
    return cj.SleeveClearance(1e-4, 0.01, 0.03, laws.HuntCrossley(1e10, 0.0), None, 1e-4, element)


def test_a_damper_takes_its_work_and_bears_nothing_at_rest():
    m = held_pin(cj.joints.PlayDamper(30.0))
    s = cj.simulate(m, 0.2, y0=jnp.array([0.0, 0.0, 3e-4, -2e-4]), rtol=1e-9)
    decay = np.exp(-30.0 * 0.2 / MASS)
    np.testing.assert_allclose(s.final[2:4], decay * np.array([3e-4, -2e-4]), rtol=1e-8)
    assert float(s.energy_residual) < 1e-8
    still = (
        sleeve(cj.joints.PlayDamper(1e3, 2e3, 3.0)).prepare().act(relative_at(sleeve(None).play(), jnp.zeros(5)), ())
    )
    assert not np.any(as_array((*still.force, *still.torque)))


def test_a_preloaded_pin_rings_as_a_spring_and_damper():
    """Small motions: x = x0 exp(-z w t) (cos w' t + ...), w^2 = k / m, 2 z w = k T / m."""
    k, time = 2e6, 4e-5
    m = held_pin(cj.joints.PreloadedBearing(k, damping_time=time))
    x0, t = 1e-6, 0.013
    w = np.sqrt(k / MASS)
    z = 0.5 * w * time
    s = cj.simulate(m, t, y0=jnp.array([x0, 0.0, 0.0, 0.0]), rtol=1e-10)
    swing = w * np.sqrt(1 - z**2)
    exact = x0 * np.exp(-z * w * t) * (np.cos(swing * t) + z * w / swing * np.sin(swing * t))
    assert float(s.final[0]) == pytest.approx(exact, rel=1e-7)
    assert float(s.energy_residual) < 1e-8
    (first, second) = cj.seated_modes(m)
    assert first.frequency == pytest.approx(w / (2 * np.pi), rel=1e-9)
    assert first.ratio == pytest.approx(z, rel=1e-6)
    assert second.ratio == pytest.approx(z, rel=1e-6)


@pytest.mark.slow
def test_preload_closes_the_play_up_to_its_load():
    """At rest under a weight W < P: r = W / (k sqrt(1 - (W / P)^2)); beyond P the wall bears the rest."""
    element = cj.joints.PreloadedBearing(2e6, radial_preload=50.0)
    for weight in (5.0, 19.62, 45.0):
        m = held_pin(element, weight / MASS)
        final = cj.simulate(m, 1e-6, start="settled", rtol=1e-9).final
        exact = weight / (2e6 * np.sqrt(1 - (weight / 50) ** 2))
        np.testing.assert_allclose(final[:2], [0.0, -exact], rtol=1e-6, atol=1e-15)
    final = cj.simulate(held_pin(element, 200.0 / MASS), 1e-6, start="settled", rtol=1e-9).final
    at_wall = brentq(lambda r: spring_of(r) + 1e10 * (r - 1e-4) ** 1.5 - 200.0, 1e-4, 2e-4, xtol=1e-16)
    assert float(-final[1]) == pytest.approx(at_wall, rel=1e-9)


def random_pose(key, size):
    return size * jax.random.uniform(key, (5,), minval=-1.0, maxval=1.0)


@pytest.mark.parametrize("element", [PAIR, dataclasses.replace(PAIR, radial_preload=None, tilt_preload=None)])
def test_what_it_exerts_is_the_slope_of_its_energy_and_its_loss_is_that_of_its_dampers(element):
    """In every direction of a sleeve's play, tilted far more than any: power = -dE/dt - damping."""
    joint = sleeve(element)
    play = joint.play()
    size = jnp.array([5e-5, 5e-5, 5e-5, 0.3, 0.3])

    def relative(values, rates):
        at, turned = jax.jvp(lambda v: as_array(relative_at(play, v).place), (values,), (rates,))
        rows, change = jax.jvp(lambda v: jnp.array(relative_at(play, v).rows), (values,), (rates,))
        across = change @ rows.T
        spin = tuple(jnp.array([across[2, 1], across[0, 2], across[1, 0]]))
        return relative_at(play, values)._replace(velocity=tuple(turned), spin=spin), at

    @jax.jit
    def both(values, rates):
        now, _ = relative(values, rates)
        force, torque = element.wrench(joint.offset(now), joint.geometry())
        power = jnp.dot(as_array(force), as_array(now.velocity)) + jnp.dot(as_array(torque), as_array(now.spin))
        held = jax.jvp(
            lambda v: element.energy(joint.offset(relative_at(play, v)), joint.geometry()), (values,), (rates,)
        )[1]
        across = as_array(now.velocity) * jnp.array([2e6, 2e6, 1e6])
        turning = 800.0 * as_array(now.spin) * jnp.array([1.0, 1.0, 0.0])
        lost = 1e-5 * (jnp.dot(across, as_array(now.velocity)) + jnp.dot(turning, as_array(now.spin)))
        return power, -held - lost, jnp.abs(held) + lost

    for key in jax.random.split(jax.random.key(0), 20):
        one, other = jax.random.split(key)
        power, wanted, scale = both(random_pose(one, size), random_pose(other, size))
        assert abs(float(power - wanted)) < 1e-12 * float(scale)


@pytest.mark.slow
def test_a_sleeve_on_preloaded_rollers_keeps_its_books_and_settles_where_it_bears():
    """An arm in space on it: at rest it sags as its springs say, and its motion balances."""
    element = cj.joints.PreloadedBearing(2e6, 1e6, 4e3, 60.0, 40.0, 30.0, 2e-4)
    arm = cj.Mechanism(
        bodies=(cj.Body("arm", MASS, cj.Inertia(2e-2, 2e-2, 1e-3), cj.Position(z=0.1)),),
        joints=(
            cj.Revolute(
                "j", "ground", "arm", motion=cj.Motion(cj.drives.ConstantSpeed(0.0)), clearance=sleeve(element)
            ),
        ),
        gravity=cj.Gravity(0.0, -GRAVITY),
    )
    s = cj.simulate(arm, 5e-3, start="settled", rtol=1e-9)
    weight = MASS * GRAVITY
    force = weight / (2e6 * np.sqrt(1 - (weight / 60) ** 2))
    lean = weight * 0.1 / 4e3  # of the moment; its saturation is of second order
    begun = s.initial
    assert float(-begun[1]) == pytest.approx(force, rel=1e-5)
    assert float(begun[3]) == pytest.approx(lean, rel=5e-3)
    assert float(jnp.max(jnp.abs(s.final[:5] - begun[:5]))) < 1e-9
    assert float(s.energy_residual) < 1e-7


def summed(angle, radius, half, count, stiff, way):
    """Stiffness of two rows of springs along their lines, element by element, against a small motion of the ring."""
    total = 0.0
    for side in (1.0, -1.0):
        for turn in 2 * np.pi * np.arange(count) / count:
            out = np.array([np.cos(turn), np.sin(turn), 0.0])
            place = radius * out + np.array([0.0, 0.0, side * half])
            # Back to back: inwards, towards the axis, lines run apart.
            line = np.cos(angle) * out - side * np.sin(angle) * np.array([0.0, 0.0, 1.0])
            move = way[:3] + np.cross(way[3:], place)
            total += stiff * np.dot(line, move) ** 2
    return total


def test_presets_are_sums_over_their_elements():
    angle, radius, half, count, preload = np.deg2rad(40), 0.04, 0.015, 16, 500.0
    new: Any = joints.angular_contact_pair(
        2 * radius,
        balls=count,
        ball_diameter=10e-3,
        contact_angle=angle,
        spread=2 * half,
        radial_clearance=5e-6,
        preload=preload,
    )
    found = new.element
    # Palmgren of one ball, in N and mm.
    load = preload / (count * np.sin(angle))
    deep = 4.36e-4 * load ** (2 / 3) / 10 ** (1 / 3) * 1e-3
    stiff = 1.5 * load / deep
    ways = np.eye(6)
    for way, given in ((0, found.radial_stiffness), (2, found.axial_stiffness), (3, found.tilt_stiffness)):
        assert float(given) == pytest.approx(summed(angle, radius, half, count, stiff, ways[way]), rel=1e-9)
    # The first element is loose where the ring has moved so far that its line is shorter by what preload gave way.
    assert float(found.radial_preload / found.radial_stiffness) == pytest.approx(deep / np.cos(angle), rel=1e-9)
    lever = half * np.cos(angle) + radius * np.sin(angle)
    assert float(found.tilt_preload / found.tilt_stiffness) == pytest.approx(deep / lever, rel=1e-9)
    # An axial load takes three times the preload in springs (of balls as they are 2.83 times: Harris).
    assert float(found.axial_preload) == pytest.approx(3 * preload, rel=1e-9)
    # As the play ends along an element's line, across and tilted.
    assert float(new.largest_tilt) == pytest.approx(5e-6 * np.cos(angle) / lever, rel=1e-9)
    rolled: Any = joints.crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=5e-6, preload=preload)
    per = preload / (30 * np.sin(np.pi / 4))
    line = 7.68e-5 * per**0.9 / 6**0.8 * 1e-3
    assert float(rolled.element.radial_stiffness) == pytest.approx(30 * per / 0.9 / line * 0.5, rel=1e-9)
    assert joints.crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=2e-5).element is None
    for wrong in ({"rollers": 5}, {"radial_clearance": -1e-6}, {"preload": 0.0}):
        with pytest.raises(cj.ClearanceError):
            joints.crossed_roller(0.1, **({"rollers": 60, "roller_length": 6e-3, "radial_clearance": 5e-6} | wrong))


def test_a_film_damps_as_the_short_bearing_does():
    """Against Reynolds' equation of the short bearing, integrated over a pin's film by numbers."""
    viscosity, radius, length, play = 0.1, 0.01, 0.012, 5e-5
    found = cj.joints.PlayDamper.film(viscosity, radius, length, play)
    z, turn = (np.linspace(-0.5, 0.5, 2001) * length, np.linspace(0, 2 * np.pi, 2001))
    # h^3 p'' = 12 m dh/dt; of a speed across dh/dt = -cos(turn), of a spin -z cos(turn).
    p = 6 * viscosity / play**3 * (length**2 / 4 - z**2)
    q = 2 * viscosity / play**3 * (z * length**2 / 4 - z**3)
    around = np.trapezoid(np.cos(turn) ** 2, turn) * radius
    assert float(found.radial) == pytest.approx(np.trapezoid(p, z) * around, rel=1e-5)
    assert float(found.tilt) == pytest.approx(np.trapezoid(q * z, z) * around, rel=1e-5)


SCENE = """
[body.arm]
mass = "1 kg"
inertia = "0.01 kg*m^2"

[joint.pin]
type = "revolute"
parent = "ground"
child = "arm"
radial_clearance = "0.1 mm"
pin_radius = "10 mm"
normal = { law = "hertz", stiffness = "1e5 N/mm^1.5" }
drive = "90 d * time"
element = ELEMENT
"""


def test_a_scene_says_what_fills_a_play(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(SCENE.replace("ELEMENT", '{ type = "damper", radial = "2 kN*s/m" }'), encoding="utf-8")
    found = cj.load(path)
    assert float(cj.parameters(found)["pin.element.radial"].value) == 2000.0
    bearing = '{ type = "preloaded-bearing", radial_stiffness = "20 N/um", radial_preload = "80 N" }'
    text = SCENE.replace("ELEMENT", bearing)
    path.write_text(text, encoding="utf-8")
    found = cj.load(path)
    assert float(cj.parameters(found)["pin.element.radial_stiffness"].value) == pytest.approx(2e7)
    path.write_text(text.replace("preloaded-bearing", "preload"), encoding="utf-8")
    with refused("joint.pin.element.type", "preload", "preloaded-bearing"):
        cj.load(path)


@pytest.mark.slow
def test_modes_of_a_pin_whose_arm_a_digital_servo_holds_are_those_of_an_analogue_one(tmp_path):
    """And the command says them, with a warning of those that nothing damps."""
    play = cj.RevoluteClearance(2e-5, 0.01, laws.HuntCrossley(1e9, 0.0))

    def held(period):
        servo = cj.actuators.Servo(cj.drives.Constant(0.0), 500.0, 20.0, period=period)
        joint = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(actuators=(servo,)), clearance=play)
        arm = cj.Body("arm", 2.0, 0.03, cj.Position(0.2))
        return cj.Mechanism(bodies=(arm,), joints=(joint,), gravity=cj.Gravity(0.0, -GRAVITY))

    found, wanted = (np.array(cj.seated_modes(held(period))) for period in (1e-3, None))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
    with pytest.raises(cj.ClearanceError, match="no modes"):
        cj.seated_modes(held(None).ideal())
    for element, warns in (("", True), ('element = { type = "damper", radial = "5 kN*s/m" }', False)):
        path = tmp_path / "arm.toml"
        top = 'gravity = ["0 m/s^2", "-9.81 m/s^2"]\n'
        path.write_text(top + SCENE.replace("element = ELEMENT", element), encoding="utf-8")
        said = CliRunner().invoke(app, ["info", str(path)]).output
        assert "modes of the play about its settled pose" in said
        assert ("below 1 %" in " ".join(said.split())) is warns
