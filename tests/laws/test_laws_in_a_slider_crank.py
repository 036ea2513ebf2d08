"""The film of a short bearing and the standard linear solid in a slider-crank, against equations written by hand."""

import dataclasses

import numpy as np
import pytest
from catalogue import slider_crank
from scipy.integrate import solve_ivp

import clearance_jax as cj
from clearance_jax import laws

CRANK, ROD, CENTRE = 0.05, 0.12, 0.06
ROD_MASS, ROD_INERTIA, SLIDER_MASS = 0.21, 2.5e-4, 0.14
RADIUS, CLEARANCE, LENGTH = 0.01, 1e-4, 0.02
VISCOSITY, ROUGHNESS = 0.02, 2e-5
WALL, DAMPING = 1e9, 0.5
SOFT, SHARE, TIME = 1e7, 0.4, 2e-3
NODES, WEIGHTS = np.polynomial.legendre.leggauss(30)
AROUND = 2 * np.pi * np.arange(120) / 120


def film(x, y, u, v, turning):
    """Force and torque of the film on the pin, by quadrature of its pressure, in the sleeve's axes."""
    size = np.hypot(x, y)
    # The height is held above the roughness, from twice of it on: the integral of 1 - STEP5.
    least = ROUGHNESS / CLEARANCE
    begin = 1 - 2 * least
    s = np.clip((size / CLEARANCE - begin) / (2 * least), 0, 1)
    held = min(size / CLEARANCE, begin) + 2 * least * (s - 2.5 * s**4 + 3 * s**5 - s**6)
    if size > 0:
        x, y = held * CLEARANCE * x / size, held * CLEARANCE * y / size
    a, b = u + 0.5 * turning * y, v - 0.5 * turning * x
    angle = np.arctan2(b, a) + 0.5 * np.pi * NODES  # where the pressure is positive
    height = CLEARANCE - x * np.cos(angle) - y * np.sin(angle)
    pressure = VISCOSITY * LENGTH**3 / height**3 * (a * np.cos(angle) + b * np.sin(angle))
    load = 0.5 * np.pi * RADIUS * WEIGHTS * pressure
    fx, fy = -load @ np.cos(angle), -load @ np.sin(angle)
    height = CLEARANCE - x * np.cos(AROUND) - y * np.sin(AROUND)
    shear = -VISCOSITY * RADIUS**3 * LENGTH * turning * 2 * np.pi * np.mean(1 / height)
    # Beside the pin's own turning its surface has -h/2 dp/dx of shear: R/2 times the integral of p dh/dangle.
    return fx, fy, shear - 0.5 * (x * fy - y * fx)


def lubricated(x, y, u, v, turning, memory):
    """The film, and the wall by Hunt and Crossley."""
    fx, fy, torque = film(x, y, u, v, turning)
    size = np.hypot(x, y)
    if size > CLEARANCE:
        rate = (x * u + y * v) / size
        push = max(0.0, WALL * (size - CLEARANCE) ** 1.5 * (1 + DAMPING * rate))
        fx, fy = fx - push * x / size, fy - push * y / size
    return fx, fy, torque, []


def relaxing(x, y, u, v, turning, memory):
    """A standard linear solid; what flows is its memory."""
    size, (flow,) = np.hypot(x, y), memory
    deep = max(0.0, size - CLEARANCE)
    push = max(0.0, SOFT * (deep - SHARE * flow)) if deep > 0 else 0.0
    rate = (max(deep, SHARE * flow) - flow) / TIME
    return -push * x / size, -push * y / size, 0.0, [rate]


def flow_of(bearing, speed):
    """Rates of the rod's angle, the slider's place, and both their speeds, with a bearing's memory."""

    def flow(t, state):
        angle, place, spin, velocity, *memory = state
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        crank = CRANK * np.array([np.cos(speed * t), np.sin(speed * t)])
        moving = speed * np.array([-crank[1], crank[0]])
        # The sleeve is at the rod's end, and the pin at the slider.
        apart = np.array([place, 0.0]) - crank - ROD * along
        relative = np.array([velocity, 0.0]) - moving - ROD * spin * across - spin * np.array([-apart[1], apart[0]])
        seen = (axis @ vector for vector in (apart, relative) for axis in (along, across))
        *force, torque, rates = bearing(*seen, -spin, memory)
        fx, fy = force[0] * along + force[1] * across
        arm = np.array([place, 0.0]) - crank
        moment = -(arm[0] * fy - arm[1] * fx) - torque + ROD_MASS * CENTRE * speed**2 * (across @ crank)
        inertia = ROD_INERTIA + ROD_MASS * CENTRE**2
        return [spin, velocity, moment / inertia, fx / SLIDER_MASS, *rates]

    return flow


def machine(play, speed):
    changed = cj.replace(slider_crank(CLEARANCE), {"drive.main.speed": speed})
    return changed.with_joint(dataclasses.replace(changed.joint("wrist"), clearance=play))


def reference(motion, bearing, speed, memory=()):
    """Angle of the rod and place of the slider at the motion's samples, from its start."""
    time = np.asarray(motion.time)
    rod, rate = float(motion["crankpin"][0]), float(motion["crankpin.velocity"][0]) + speed
    start = [rod, float(motion["guide"][0]), rate, float(motion["guide.velocity"][0]), *memory]
    out = solve_ivp(
        flow_of(bearing, speed), (0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-11, atol=1e-14, max_step=1e-4
    )
    return out.y


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "end"), [(30.0, 0.02), (800.0, 0.003)], ids=["light", "heavy"])
def test_a_film_carries_a_light_load_and_hands_a_heavy_one_over(speed, end):
    law, oil = laws.HuntCrossley(WALL, DAMPING), cj.joints.ShortBearing(VISCOSITY, ROUGHNESS)
    play = cj.RevoluteClearance(CLEARANCE, RADIUS, law, None, oil, LENGTH)
    motion = cj.simulate(machine(play, speed), end, rtol=1e-10, save_at=9)
    found = reference(motion, lubricated, speed)
    np.testing.assert_allclose(motion["guide"], found[1], rtol=0, atol=1e-7 * CLEARANCE)
    np.testing.assert_allclose(motion["crankpin"] + speed * motion.time, found[0], rtol=0, atol=1e-7 * CLEARANCE / ROD)
    assert float(motion.energy_residual) < 1e-8
    deepest = float(np.max(motion["wrist.penetration"]))
    assert -0.9 * CLEARANCE < deepest < -0.1 * CLEARANCE if speed < 100 else deepest > 0.1 * CLEARANCE


def test_a_solid_that_relaxes_in_a_slider_crank():
    speed = 5000 * np.pi / 30
    play = cj.RevoluteClearance(CLEARANCE, RADIUS, laws.StandardLinearSolid(SOFT, SHARE, TIME))
    motion = cj.simulate(machine(play, speed), 4e-3, rtol=1e-10, save_at=9)
    found = reference(motion, relaxing, speed, (0.0,))
    np.testing.assert_allclose(motion["guide"], found[1], rtol=0, atol=1e-7 * CLEARANCE)
    np.testing.assert_allclose(motion["crankpin"] + speed * motion.time, found[0], rtol=0, atol=1e-7 * CLEARANCE / ROD)
    assert float(motion.energy_residual) < 1e-8
    assert np.min(motion["wrist.penetration"]) < 0 < np.max(motion["wrist.penetration"])
    assert found[4].max() > 1e-6

    # A flow that changes no force chooses no steps: as many as where nothing flows.
    weak = cj.replace(machine(play, speed), {"wrist.normal.relaxing_share": 1e-3})
    still = cj.replace(weak, {"wrist.normal.relaxation_time": 1e3})
    steps = [int(cj.simulate(m, 4e-3, rtol=1e-10, save_at=9).steps) for m in (weak, still)]
    assert steps[0] < 1.5 * steps[1]
