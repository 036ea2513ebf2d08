"""Drives that give way: against closed forms of two inertias on a spring, and of a loaded spring; settled starts."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import clearance_jax as cj
from clearance_jax.dynamics.deflected import deflect
from clearance_jax.dynamics.field import energies, slope
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.dynamics.postures.chain import chain_of
from clearance_jax.mechanism.state import initial_values, layout

INERTIA, ROTOR, STIFFNESS = 0.03, 0.5, 800.0


def wheel(motion, **changes):
    joint = cj.Revolute("hub", "ground", "wheel", motion=motion, **changes)
    return cj.Mechanism(bodies=(cj.Body("wheel", 2.0, INERTIA),), joints=(joint,))


def test_a_motor_and_its_link_swing_against_each_other():
    """Under a constant torque T on the rotor: w^2 = k (1 / J + 1 / I), and it is -T / (J w^2) (1 - cos w t)."""
    torque, t = 3.0, 0.03
    m = cj.with_compliance(
        wheel(cj.Motion(actuators=(cj.actuators.ConstantEffort(torque),))), "hub", cj.Compliance(STIFFNESS, 0.0, ROTOR)
    )
    assert [c.name for c in m.coordinates()] == ["hub_motor", "hub"]
    s = cj.simulate(m, t, rtol=1e-10)
    w = np.sqrt(STIFFNESS * (1 / ROTOR + 1 / INERTIA))
    assert float(s["hub.position"]) == pytest.approx(-torque / (ROTOR * w**2) * (1 - np.cos(w * t)), rel=1e-8)
    # Both together as one: J motor' + I (motor' + link') = T t.
    motor, link = (float(s[f"{name}.velocity"]) for name in ("hub_motor", "hub"))
    assert ROTOR * motor + INERTIA * (motor + link) == pytest.approx(torque * t, rel=1e-9)
    ready = m.prepare()
    held = energies(jnp.asarray(t), s.final[:4], ready)
    assert float(held.kinetic) == pytest.approx(0.5 * ROTOR * motor**2 + 0.5 * INERTIA * (motor + link) ** 2, rel=1e-12)
    assert float(s.energy_residual) < 1e-8


def test_a_rotor_in_space_is_that_in_the_plane_in_every_form():
    """Unrolled and as arrays: a chain whose motors have rotors, against the same joint by joint."""
    from clearance_jax.dynamics.applied import inverse_dynamics

    robot = cj.load("experiments/scenes/six_axes.urdf").without_drives([f"axis_{i}" for i in range(1, 7)])
    turns = [joint for joint in robot.joints if isinstance(joint, cj.Revolute)]
    heavy = robot
    for i, joint in enumerate(turns):
        moved = cj.Motion(position=0.1 * (i + 1), velocity=0.3 - 0.1 * i, rotor_inertia=0.2 + 0.1 * i)
        heavy = heavy.with_joint(cj.Revolute(**{**vars(joint), "motion": moved}))
    light = heavy
    for joint in turns:
        own: Any = heavy.joint(joint.name)
        still = cj.Motion(position=own.motion.position, velocity=own.motion.velocity)
        light = light.with_joint(cj.Revolute(**{**vars(own), "motion": still}))
    y = initial_values(heavy)
    plan = layout(heavy)
    found = []
    for m in (heavy.prepare(), heavy.prepare().as_small_program()):
        found.append(np.asarray(slope(jnp.zeros(()), y, m)[plan.v]))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-11, atol=1e-12)
    # What the arm without rotors needs for these accelerations, plus J a, is nothing.
    needed = inverse_dynamics(light.prepare(), jnp.zeros(()), plan.split(y), list(found[0]))
    turning = {joint.name: 0.2 + 0.1 * i for i, joint in enumerate(turns)}
    rotors = np.array([turning.get(name, 0.0) for name in plan.velocities])
    balance = np.array([float(x) for x in needed]) + rotors * found[0]
    np.testing.assert_allclose(balance, 0.0, atol=1e-10)
    own = inverse_dynamics(heavy.prepare(), jnp.zeros(()), plan.split(y), list(found[0]))
    np.testing.assert_allclose(np.array([float(x) for x in own]), 0.0, atol=1e-10)


def pendulum(stiffness):
    play = cj.joints.pin_clearance(2e-5, pin_radius=0.015)
    arm = cj.Mechanism(
        bodies=(cj.Body("arm", 4.0, INERTIA, cj.Position(0.3)),),
        joints=(cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.Constant(0.4)), clearance=play),),
        gravity=cj.Gravity(0.0, -9.81),
    )
    return cj.with_compliance(arm, "hip", cj.Compliance(stiffness, 1.0))


@pytest.mark.slow
def test_a_settled_start_is_deflected_by_its_load():
    """-k d = m g l cos(angle + d); and there it stays, but for the pin's play."""
    stiffness = 500.0
    m = pendulum(stiffness)
    s = cj.simulate(m, 1e-3, start="settled", rtol=1e-9)
    load = 4.0 * 9.81 * 0.3
    found = brentq(lambda d: stiffness * d + load * np.cos(0.4 + d), -1.0, 1.0, xtol=1e-15)
    positions = layout(m).positions
    first = {name: float(s.initial[i]) for i, name in enumerate(positions)}
    assert first["hip"] == pytest.approx(found, abs=1e-4)  # the pin at its wall moves the arm a little
    hip = deflect(jnp.zeros(()), m.prepare()).places["hip"]
    assert float(hip) == pytest.approx(found, rel=1e-12)
    # Started without it, it swings by the whole deflection.
    loose = cj.simulate(m, 1e-2, rtol=1e-8)
    held = cj.simulate(m, 1e-2, start="settled", rtol=1e-8)
    assert abs(float(held["hip.velocity"])) < 0.02 * abs(float(loose["hip.velocity"]))


# A loose arm on a pin whose motor swings: mass, arm, gravity, play, pin, contact and friction.
MASS, ARM, FALL, PLAY, PIN = 4.0, 0.3, 9.81, 1e-4, 0.015
HARD, DAMPED, RUB, TURNOVER = 1e7, 2e3, 0.15, 0.05
SWING, FAST, END = 0.5, 30.0, 0.06


def swinging(stiffness):
    """The library's, of the elasticity where there is one."""
    normal = cj.laws.LinearKelvinVoigt(HARD, DAMPED)
    play = cj.joints.RevoluteClearance(PLAY, PIN, normal, cj.laws.TanhCoulomb(RUB, TURNOVER))
    swing = cj.Motion(cj.drives.Harmonic(SWING, FAST))
    arm = cj.Mechanism(
        bodies=(cj.Body("arm", MASS, INERTIA, cj.Position(ARM)),),
        joints=(
            cj.Revolute("hip", "ground", "arm", motion=swing, clearance=play, eccentricity=cj.Position(0.0, -PLAY)),
        ),
        gravity=cj.Gravity(0.0, -FALL),
        points=(cj.Point("tip", "arm", cj.Position(2 * ARM)),),
    )
    return arm if stiffness is None else cj.with_compliance(arm, "hip", cj.Compliance(stiffness, 5.0))


def own_swing(stiffness, damping):
    """Newton and Euler of the arm on a sleeve that stands: its pin's place, its deflection, and what friction takes."""

    def rate(t, y):
        x, z, d, vx, vz, w, _ = y
        angle, spin = SWING * np.sin(FAST * t) + d, SWING * FAST * np.cos(FAST * t) + w
        far = np.hypot(x, z)
        n = np.array([x, z]) / far
        along = np.array([-n[1], n[0]])
        reach = PLAY + PIN - far
        slip = along @ [vx, vz] + reach * spin
        press = max(0.0, HARD * (far - PLAY) + DAMPED * (n @ [vx, vz])) if far > PLAY else 0.0
        rub = RUB * press * np.tanh(slip / TURNOVER)
        force = -press * n - rub * along
        turning = -reach * rub - stiffness * d - damping * w
        # m (a + l (e' spin_rate - e spin^2)) = F + m g and I spin_rate = turning - l e' . F of the centre of mass.
        e, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        spin_rate = (turning - ARM * across @ force) / INERTIA
        a = force / MASS + [0, -FALL] - ARM * (across * spin_rate - e * spin**2)
        prescribed = -SWING * FAST**2 * np.sin(FAST * t)
        return [vx, vz, w, *a, spin_rate - prescribed, rub * slip]

    at = [0.0, -PLAY, 0.0, 0.0, 0.0, 0.0, 0.0]
    return solve_ivp(rate, (0, END), at, "Radau", rtol=1e-7, atol=1e-11).y[:, -1]


@pytest.mark.slow
def test_the_sleeve_of_an_elastic_drive_stands_on_its_parent():
    """The pin slips by the motor's turn and the spring's: against own equations; where it is stiff, the rigid drive."""
    soft = swinging(1e4)

    def run(stiffness):
        return cj.simulate(cj.replace(soft, {"hip.actuator.compliance.stiffness": stiffness}), END, rtol=1e-7)

    found, own = run(1e4), own_swing(1e4, 5.0)
    assert float(found["friction_loss"]) == pytest.approx(own[6], rel=1e-5)
    assert float(found["hip"]) == pytest.approx(own[2], rel=1e-5)
    at = [float(found["hip.play_x"]), float(found["hip.play_y"])]
    np.testing.assert_allclose(at, own[:2], atol=1e-4 * PLAY)
    stiff, rigid = run(1e8), cj.simulate(swinging(None), END, rtol=1e-7)
    assert float(stiff["friction_loss"]) == pytest.approx(float(rigid["friction_loss"]), rel=1e-3)
    gap = np.asarray(stiff["tip.position"]) - np.asarray(rigid["tip.position"])
    assert np.max(np.abs(gap)) < 1e-2 * PLAY
    assert float(stiff["hip_motor.drive_force"]) == pytest.approx(float(rigid["hip.drive_force"]), rel=1e-2)
    assert float(stiff.energy_residual) < 1e-6


@pytest.mark.parametrize("kind", ["sleeve", "guide"])
def test_an_undeflected_drive_moves_the_pin_in_its_sleeve_as_a_rigid_one(kind):
    """In space: what the contacts see of a sleeve, and of a guide, whose block the drive slides."""
    drive = cj.Motion(cj.drives.Harmonic(0.1, 3.0))
    if kind == "sleeve":
        joint = cj.Revolute("main", "ground", "arm", motion=drive, axis=cj.Axis("y"))
        play: dict[str, Any] = {"kind": "sleeve", "pin_radius": 0.01, "length": 0.03, "radial_clearance": 5e-5}
        play["axial_clearance"] = 5e-5
    else:
        joint = cj.Prismatic("main", "ground", "arm", motion=drive)
        play = {"side_clearance": 5e-5, "length": 0.04, "height": 0.02}
    body = cj.Body("arm", MASS, cj.Inertia(0.01, 0.02, 0.03) if kind == "sleeve" else INERTIA)
    rigid = cj.Mechanism(bodies=(body,), joints=(joint,)).with_clearance("main", **play)
    soft = cj.with_compliance(rigid, "main", cj.Compliance(1e5, 5.0))
    time, found = jnp.asarray(0.2), []
    for m in (rigid, soft):
        plan = layout(m)
        names = [name for name in plan.positions if name != "main"]
        values = {"main": 0.0} | dict(zip(names, 1e-5 * np.arange(1, 20), strict=False))
        y = jnp.asarray([values[name] for name in plan.positions] * 2 + [0.0] * plan.remembered)
        found += relative_motions(time, y, m.prepare())
    for one, other in zip(jax.tree.leaves(found[0]), jax.tree.leaves(found[1]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-18)
    # And not by its deflection alone: the drive slides or turns it by a tenth.
    assert np.max(np.abs(np.asarray(found[1].velocity)) if kind == "guide" else np.abs(found[1].spin[2])) > 0.2


SCENE = """
gravity = ["0 m/s^2", "-9.81 m/s^2"]
[body.arm]
mass = "4 kg"
inertia = "0.03 kg*m^2"
center_of_mass = ["0.3 m", "0 m"]
[joint.hip]
type = "revolute"
parent = "ground"
child = "arm"
drive = "0.4 * time"
[compliance.hip]
stiffness = "500 N*m/rad"
damping = "1 N*m*s/rad"
"""


def test_a_scene_says_which_drive_gives_way(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(SCENE, encoding="utf-8")
    m = cj.load(path)
    assert [c.name for c in m.coordinates()] == ["hip_motor", "hip"]
    assert [c.name for c in m.free_coordinates()] == ["hip"]
    for wrong, said in (
        ("[compliance.hip]", "[compliance.knee]"),
        ('damping = "1 N*m*s/rad"', 'rotor_inertia = "1 kg*m^2"'),
        ('drive = "0.4 * time"', ""),
        ('stiffness = "500 N*m/rad"', ""),
    ):
        path.write_text(SCENE.replace(wrong, said), encoding="utf-8")
        with pytest.raises(cj.ClearanceError, match="compliance"):
            cj.load(path)


def test_a_trajectory_moves_the_motor_and_the_spring_stays(tmp_path):
    soft = cj.with_compliance(wheel(cj.Motion(cj.drives.Constant(0.0))), "hub", cj.Compliance(STIFFNESS, 2.0))
    file = tmp_path / "move.csv"
    file.write_text("time [s], hub [deg]\n0, 0\n0.1, 1\n0.2, 3\n0.3, 4\n")
    drives = cj.read_trajectory(file, soft)
    assert list(drives) == ["hub_motor"]
    moved = soft.with_drives(drives)
    assert [c.name for c in moved.free_coordinates()] == ["hub"]
    with refused("hub", None):
        soft.with_drives({"hub": cj.drives.Constant(0.0)})
    file.write_text("time [s], hub [deg], hub_motor [deg]\n0, 0, 0\n0.1, 1, 1\n0.2, 3, 3\n0.3, 4, 4\n")
    with refused("hub", "hub_motor"):
        cj.read_trajectory(file, soft)


def test_a_path_moves_the_motor_and_not_its_spring():
    soft = cj.with_compliance(swinging(None), "hip", cj.Compliance(1e4))
    chain = chain_of(soft, "tip", None)
    assert chain.joints == ("hip_motor",)
    # Its spring is no drive that could be taken away.
    with refused("hip", None):
        chain_of(soft, "tip", ["hip"])
    with refused("hop", allowed="hip"):
        soft.without_drives(["hop"])


def test_what_gives_way_does_so_once():
    soft = swinging(1e4)
    with refused("hip") as caught:
        cj.with_compliance(soft, "hip", cj.Compliance(1e4))
    assert "gives way already" in str(caught.value)
    with refused("hip_motor"):
        cj.with_compliance(
            dataclasses.replace(swinging(None), points=(cj.Point("hip_motor", "arm"),)), "hip", cj.Compliance(1e4)
        )
