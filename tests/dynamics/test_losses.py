"""Every loss of a joint, damper and ball is in the energy balance, against books of its own."""

import numpy as np
import pytest
from places import refused
from scipy.integrate import simpson

import clearance_jax as cj
from clearance_jax import metrics

FRICTION = cj.actuators.JointFriction(2.0, 0.01)
TIMES = np.linspace(0.0, 0.5, 4001)


def rubbed(friction, speed):
    """The energy that it takes until the end [J]."""
    power = friction.effort * np.tanh(np.asarray(speed) / friction.transition_speed) * np.asarray(speed)
    return simpson(power, x=TIMES)


def test_a_wheel_that_its_brake_stops_has_lost_all_it_had():
    """I w^2 / 2 = 20 J."""
    motion = cj.Motion(velocity=10.0, actuators=(FRICTION,))
    wheel = cj.Mechanism((cj.Body("wheel", 1.0, 0.4),), (cj.Revolute("axle", "ground", "wheel", motion=motion),))
    assert float(metrics.EnergyLost()(wheel, 3.0, rtol=1e-9)) == pytest.approx(20.0, rel=1e-7)


def test_what_a_load_gives_and_a_drive_takes_is_exchanged():
    """15 W for 0.1 s by each. Counted together they are nothing, and the residual was round-off over round-off."""
    axle = cj.Revolute("axle", "ground", "wheel", motion=cj.Motion(cj.drives.ConstantSpeed(5.0)))
    load = cj.Wrench("load", "wheel", torque=cj.Torque(z=3.0))
    wheel = cj.Mechanism((cj.Body("wheel", 1.0, 0.01),), (axle,), wrenches=(load,))
    found = cj.simulate(wheel, 0.1, save_at=[0.1])
    assert float(found["exchanged"][-1]) == pytest.approx(3.0, rel=1e-12)
    assert abs(float(found["drive_work"][-1])) < 1e-14


def test_losses_in_a_loop_are_those_of_its_friction_and_its_dampers():
    """An engine: a torque on the crank, friction in its pins, a spring and damper in its guide, another one outside."""
    friction, guide = cj.actuators.JointFriction(0.05, 0.1), cj.actuators.JointSpring(300.0, 4.0, 0.15)
    engine = cj.Mechanism(
        bodies=(
            cj.Body("crank", 0.3, 1e-3),
            cj.Body("conrod", 0.21, 2.5e-4, cj.Position(0.06)),
            cj.Body("slider", 0.14),
        ),
        joints=(
            cj.Revolute("main", "ground", "crank", motion=cj.Motion(actuators=(cj.actuators.ConstantEffort(0.8),))),
            cj.Revolute(
                "crankpin", "crank", "conrod", at_parent=cj.Position(0.05), motion=cj.Motion(actuators=(friction,))
            ),
            cj.Prismatic("guide", "ground", "slider", motion=cj.Motion(position=0.17, actuators=(guide,))),
        ),
        loops=(cj.Revolute("wrist", "conrod", "slider", at_parent=cj.Position(0.12)),),
        springs=(cj.Spring("buffer", "ground", "slider", 50.0, 3.0, 0.1),),
    )
    found = cj.simulate(engine, 0.5, rtol=1e-9, save_at=TIMES)
    turn, slide = (np.asarray(found[f"{name}.velocity"]) for name in ("crankpin", "guide"))
    place, main = np.asarray(found["guide.position"]), np.asarray(found["main.velocity"])
    lost = rubbed(friction, turn)
    damped = simpson((4.0 + 3.0) * slide**2, x=TIMES)
    assert min(lost, damped) > 0.01
    assert float(found["friction_loss"][-1]) == pytest.approx(lost, rel=1e-6)
    assert float(found["damping_loss"][-1]) == pytest.approx(damped, rel=1e-6)
    work = simpson(0.8 * main - 300.0 * (place - 0.15) * slide, x=TIMES)
    assert float(found["drive_work"][-1]) == pytest.approx(work, rel=1e-6)
    assert float(found.energy_residual) < 1e-7


def test_losses_in_space_beside_a_joint_that_is_prescribed():
    """A flap with friction on a table that a drive turns, and a ball whose spin is damped: w = w0 exp(-b t / I)."""
    friction, damping = cj.actuators.JointFriction(0.1, 0.2), 0.02
    even = cj.Inertia(0.05, 0.05, 0.05)
    hinge = cj.Motion(position=1.0, actuators=(friction,))
    ball = cj.Spherical("ball", "ground", "top", motion=cj.Ball(spin=cj.Spin(3.0, 4.0, 12.0), damping=damping))
    scene = cj.Mechanism(
        bodies=(cj.Body("table", 1.0, even), cj.Body("flap", 0.5, cj.Inertia(4e-3, 4e-3, 1e-3), cj.Position(0.1)),
                cj.Body("top", 1.0, even)),
        joints=(
            cj.Revolute("turn", "ground", "table", motion=cj.Motion(cj.drives.ConstantSpeed(5.0))),
            cj.Revolute("hinge", "table", "flap", axis="y", motion=hinge),
            ball,
        ),
        gravity=cj.Gravity(z=-9.81),
    )  # fmt: skip
    found = cj.simulate(scene, 0.5, rtol=1e-9, save_at=TIMES)
    lost = rubbed(friction, found["hinge.velocity"])
    assert lost > 0.05
    assert float(found["friction_loss"][-1]) == pytest.approx(lost, rel=1e-6)
    damped = 0.5 * 0.05 * 13.0**2 * (1 - np.exp(-2 * damping * 0.5 / 0.05))
    assert float(found["damping_loss"][-1]) == pytest.approx(damped, rel=1e-7)
    assert float(found.energy_residual) < 1e-7


def test_a_joint_has_a_drive_or_actuators():
    motion = cj.Motion(cj.drives.ConstantSpeed(1.0), actuators=(FRICTION,))
    with refused("axle"):
        cj.Mechanism((cj.Body("wheel", 1.0, 0.4),), (cj.Revolute("axle", "ground", "wheel", motion=motion),))
