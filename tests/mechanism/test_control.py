"""What acts from outside and what commands: loads, payloads that come and go, servos, controllers, digital ones."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import metrics
from clearance_jax.cli.main import app
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism._base import breaks_near, sampling_periods

# Two carts on a line: a motor, and a link on it behind a spring.
MOTOR, LINK, SPRING, DAMPING = 2.0, 1.0, 400.0, 3.0
GAIN, RATE_GAIN, GOAL, PERIOD, END = 150.0, 25.0, 0.1, 0.013, 0.5


def carts(encoder=(), period=None, stiffness=GAIN, integral=None):
    """The motor's cart under a servo, the link's cart on it."""
    goal = cj.drives.Constant(GOAL)
    servo = cj.actuators.Servo(goal, stiffness, RATE_GAIN, encoder=encoder, period=period, integral=integral)
    motor = cj.Prismatic("motor", "ground", "rotor", motion=cj.Motion(actuators=(servo,)))
    spring = cj.actuators.JointSpring(SPRING, DAMPING)
    link = cj.Prismatic("link", "rotor", "arm", motion=cj.Motion(velocity=0.2, actuators=(spring,)))
    return cj.Mechanism((cj.Body("rotor", MOTOR), cj.Body("arm", LINK)), (motor, link))


def integrated(integral, encoder) -> Any:
    """The carts under a servo with an integral, solved exactly: motor, link, their rates, integral of the error."""
    inverse = np.linalg.inv(np.array([[MOTOR + LINK, LINK], [LINK, LINK]]))
    seen, whole = np.array([1.0, 1.0 if encoder else 0.0]), np.zeros((6, 6), complex)
    whole[0, 2] = whole[1, 3] = 1
    # Forces on the motor and on the link by the state, of which the last component is 1.
    forces = np.zeros((2, 6), complex)
    forces[0] = [*(-GAIN * seen), *(-RATE_GAIN * seen), integral, GAIN * GOAL]
    forces[1, 1], forces[1, 3] = -SPRING, -DAMPING
    whole[2:4], whole[4, :2], whole[4, 5] = inverse @ forces, -seen, GOAL
    return (expm(whole * END) @ np.array([0, 0, 0, 0.2, 0, 1], complex))[:5]


@pytest.mark.parametrize("encoder", [(), ("motor", "link")])
def test_a_servo_integrates_its_error(encoder):
    """Against matrix exponentials, with the derivative by the gain; alone, in lanes, and in two parts."""
    m, gain, name = carts(encoder, integral=900.0), 900.0, "motor.0.integral"

    def end(gain):
        return cj.simulate(cj.replace(m, {name: gain}), END, rtol=1e-11).final[:5]

    exact = integrated(gain + 1e-20j, encoder)
    np.testing.assert_allclose(end(gain), exact.real, rtol=0, atol=1e-11)
    np.testing.assert_allclose(jax.jacfwd(end)(gain), exact.imag / 1e-20, rtol=0, atol=1e-11)
    np.testing.assert_allclose(jax.vmap(end)(jnp.array([300.0, gain]))[1], exact.real, rtol=0, atol=1e-11)
    begun = cj.simulate(m, 0.3 * END, rtol=1e-11)
    ended = cj.simulate(m, END, t0=0.3 * END, y0=begun.final, rtol=1e-11)
    np.testing.assert_allclose(ended.final[:5], exact.real, rtol=0, atol=1e-11)
    assert float(ended["motor.actuator0.integral"]) == pytest.approx(exact[4].real, abs=1e-11)
    assert float(ended.energy_residual) < 1e-10
    assert cj.parameters(m)[name].unit == "N/(m*s)"


def test_an_integral_is_beside_memory_and_held_efforts():
    """The layout has memory, then integrals, then held efforts: each cart moves as it does alone."""
    law = cj.laws.LuGre(1.0, 0.8, 0.01, 1e4, 10.0)
    goal = cj.drives.Constant(GOAL)
    servos = {
        "x": (cj.actuators.Servo(goal, GAIN, RATE_GAIN, integral=900.0),),
        "y": (cj.actuators.JointFriction(0.5, law=law), cj.actuators.ConstantEffort(2.0)),
        "z": (cj.actuators.Servo(goal, GAIN, RATE_GAIN, period=PERIOD),),
    }
    bodies = [cj.Body(f"{name}_cart", MOTOR) for name in servos]
    joints = [
        cj.Prismatic(name, "ground", f"{name}_cart", motion=cj.Motion(actuators=acts)) for name, acts in servos.items()
    ]
    every = cj.simulate(cj.Mechanism(tuple(bodies), tuple(joints)), 0.1, rtol=1e-10)
    for body, joint in zip(bodies, joints, strict=True):
        alone = cj.simulate(cj.Mechanism((body,), (joint,)), 0.1, rtol=1e-10)
        more = ["x.actuator0.integral"] if joint.name == "x" else []
        for name in (f"{joint.name}.position", f"{joint.name}.velocity", *more):
            np.testing.assert_allclose(every[name], alone[name], rtol=1e-9)


def linear(stiffness, encoder, period) -> Any:
    """The carts as x' = A x + B u with u = K (goal - C x), solved exactly; x = (motor, link, their rates)."""
    # M (a_motor, a_link) = (u, -k link - b link'), of the mass matrix of relative coordinates.
    inverse = np.linalg.inv(np.array([[MOTOR + LINK, LINK], [LINK, LINK]]))
    a, b = np.zeros((4, 4), complex), np.zeros(4, complex)
    a[0, 2] = a[1, 3] = 1
    a[2:, 1], a[2:, 3] = -inverse[:, 1] * SPRING, -inverse[:, 1] * DAMPING
    b[2:] = inverse[:, 0]
    seen = np.array([1.0, 1.0 if encoder else 0.0])
    gains = np.concatenate([stiffness * seen, RATE_GAIN * seen])
    x, push = np.array([0, 0, 0, 0.2], complex), stiffness * GOAL

    def held(duration):
        """State and constant input after a time: the exponential of both together."""
        whole = np.zeros((5, 5), complex)
        whole[:4, :4], whole[:4, 4] = a * duration, b * duration
        return expm(whole)

    if period is None:
        whole = np.zeros((5, 5), complex)
        whole[:4, :4], whole[:4, 4] = (a - np.outer(b, gains)) * END, b * push * END
        return (expm(whole) @ np.append(x, 1))[:4]
    steps = int(END / period)
    for duration in [period] * steps + [END - steps * period]:
        x = (held(duration) @ np.append(x, push - gains @ x))[:4]
    return x


@pytest.mark.slow
@pytest.mark.parametrize("encoder", [(), ("motor", "link")])
@pytest.mark.parametrize("period", [None, PERIOD])
def test_a_servo_measures_on_either_side_of_a_spring_and_holds_its_force(encoder, period):
    m = carts(encoder, period)

    def end(stiffness):
        return cj.simulate(cj.replace(m, {"motor.0.stiffness": stiffness}), END, rtol=1e-11).final[:4]

    slope = jax.jacfwd(end)(GAIN)
    # By a step along the imaginary axis the derivative of an analytic function is exact to round-off.
    exact = linear(GAIN + 1e-20j, encoder, period)
    np.testing.assert_allclose(end(GAIN), exact.real, rtol=0, atol=1e-11)
    np.testing.assert_allclose(slope, exact.imag / 1e-20, rtol=0, atol=1e-11)


def test_a_digital_servo_ends_steps_where_it_measures_and_lanes_do_as_single_solves():
    m = carts((), PERIOD)
    s = cj.simulate(m, END, rtol=1e-6)
    assert sampling_periods(m) == (PERIOD,)
    assert int(s.steps) >= END / PERIOD
    assert float(s.energy_residual) < 1e-7
    stiffness = jnp.array([100.0, 150.0, 200.0])
    lanes = jax.vmap(lambda k: cj.simulate(cj.replace(m, {"motor.0.stiffness": k}), END, rtol=1e-6).final[:4])
    np.testing.assert_allclose(lanes(stiffness)[1], s.final[:4], rtol=0, atol=1e-14)
    # Before, at and after an instant the next one is among those that are looked at.
    for k in (1, 7, 38, 12345):
        for time in np.nextafter(k * PERIOD, [0, k * PERIOD, 1e9]):
            near = np.asarray(breaks_near(m, jnp.asarray(time)))
            assert np.any((near > time) & (near <= (k + 1) * PERIOD))
    efforts = observe(jnp.zeros(()), cj.simulate(m, 1e-9, rtol=1e-6).final, m.prepare())
    np.testing.assert_allclose(efforts["actuator_effort"], [GAIN * GOAL, -DAMPING * 0.2], rtol=1e-6)
    held = cj.trace(m, 3 * PERIOD, save_at=7, rtol=1e-6).solution["motor.actuator0.motor"]
    # What is held changes at instants and nowhere else.
    np.testing.assert_array_equal(held[1::2], held[:6:2])
    np.testing.assert_allclose(held[0], GAIN * GOAL)
    assert np.all(np.abs(np.diff(held[:6:2])) > 0.1)


def arm(*motions, **more):
    """Two links that swing about y, under weight."""
    bodies = (
        cj.Body("upper", 2.0, cj.Inertia(1e-3, 0.04, 0.04), cj.Position(x=0.25)),
        cj.Body("lower", 1.0, cj.Inertia(1e-3, 0.013, 0.013), cj.Position(x=0.2)),
    )
    first, second = motions or (cj.Motion(velocity=1.5), cj.Motion(velocity=-1.0))
    joints = (
        cj.Revolute("shoulder", "ground", "upper", axis="y", motion=first),
        cj.Revolute("elbow", "upper", "lower", cj.Position(x=0.5), axis="y", motion=second),
    )
    bodies, joints = bodies + more.pop("bodies", ()), joints + more.pop("joints", ())
    points = (cj.Point("end", "lower", cj.Position(x=0.4)),)
    return cj.Mechanism(bodies, joints, points=points, gravity=cj.Gravity(z=-9.81), **more)


TARGETS = (
    cj.controllers.Reference("shoulder", cj.drives.Harmonic(0.5, 3.0)),
    cj.controllers.Reference("elbow", cj.drives.Harmonic(0.8, 2.0)),
)


@pytest.mark.slow
def test_computed_torque_makes_every_error_an_oscillator_of_its_own():
    w, d = 12.0, 0.6
    controlled = arm().with_controllers(cj.controllers.ComputedTorque("control", TARGETS, frequency=w, damping=d))
    s = cj.simulate(controlled, 1.0, rtol=1e-10, save_at=41)
    assert float(s.energy_residual) < 1e-9
    t, damped = np.asarray(s.time), w * np.sqrt(1 - d * d)
    # Errors e = target - q begin at zero, with the rate of the target minus that of the joint.
    for name, goal, rate in (("shoulder", 0.5 * np.sin(3 * t), 0.0), ("elbow", 0.8 * np.sin(2 * t), 1.6 + 1.0)):
        error = rate * np.exp(-d * w * t) * np.sin(damped * t) / damped
        np.testing.assert_allclose(np.asarray(s[name]), goal - error, rtol=0, atol=2e-10)
    # A controller that believes in another mass is off; its beliefs are numbers of their own.
    light = cj.replace(arm(), {"upper.mass": 1.6, "lower.mass": 0.8})
    wrong = arm().with_controllers(
        cj.controllers.ComputedTorque("control", TARGETS, frequency=w, damping=d, model=light)
    )
    assert float(cj.parameters(wrong)["control.model.upper.mass"].value) == pytest.approx(1.6)
    assert float(cj.parameters(wrong)["upper.mass"].value) == 2.0
    off = cj.simulate(wrong, 1.0, rtol=1e-6).final[0] - s.final[0]
    assert 1e-3 < abs(float(off)) < 0.1


@pytest.mark.slow
def test_a_sampled_computed_torque_of_a_large_mechanism_errs_by_its_period():
    """Seventeen turning links are a table; inverse dynamics and sampling are the same there."""
    count = 17
    bodies = tuple(cj.Body(f"b{i}", 1.0, cj.Inertia(0.01, 0.02, 0.02), cj.Position(x=0.1)) for i in range(count))
    joints = tuple(
        cj.Revolute(
            f"j{i}", f"b{i - 1}" if i else "ground", f"b{i}", cj.Position(x=0.2 if i else 0.0), axis="yz"[i % 2]
        )
        for i in range(count)
    )
    chain = cj.Mechanism(bodies, joints, gravity=cj.Gravity(z=-9.81))
    assert chain.form.is_table
    targets = tuple(
        cj.controllers.Reference(f"j{i}", cj.drives.Harmonic(0.3, 2.0, phase=0.3 * i, offset=-0.3 * np.sin(0.3 * i)))
        for i in range(count)
    )
    errors = []
    for period in (4e-3, 2e-3):
        controlled = chain.with_controllers(
            cj.controllers.ComputedTorque("control", targets, frequency=40.0, period=period)
        )
        s = cj.simulate(controlled, 0.2, rtol=1e-8, energy_balance=False)
        goal = np.array([float(r.target(s.time[-1])[0]) for r in targets])
        errors.append(np.abs(np.asarray(s.final[:count]) - goal).max())
    # The start's rate is off and decays; what is left beside goes with the period.
    assert errors[1] < errors[0] < 5e-3


def carrying(picked_up, put_down):
    load = cj.Body("load", 3.0, cj.Inertia(0.01, 0.02, 0.015), cj.Position(z=0.05), picked_up, put_down)
    return arm(bodies=(load,), joints=(cj.Fixed("grip", "lower", "load", cj.Position(x=0.4)),))


@pytest.mark.slow
def test_a_payload_comes_and_goes_as_if_the_solve_were_cut_there():
    m = carrying(0.3, 0.6)
    s = cj.simulate(m, 1.0, rtol=1e-11)
    assert float(s.energy_residual) < 1e-9
    y = cj.simulate(arm(), 0.3, rtol=1e-12, energy_balance=False).final
    y = cj.simulate(carrying(None, None), 0.6, t0=0.3, y0=y, rtol=1e-12, energy_balance=False).final
    y = cj.simulate(arm(), 1.0, t0=0.6, y0=y, rtol=1e-12, energy_balance=False).final
    np.testing.assert_allclose(s.final[:4], y, rtol=0, atol=1e-9)

    def end(time):
        return cj.simulate(cj.replace(m, {"load.picked_up": time}), 1.0, rtol=1e-11, energy_balance=False).final[:4]

    differences = (end(0.3 + 1e-4) - end(0.3 - 1e-4)) / 2e-4
    finer = (end(0.3 + 5e-5) - end(0.3 - 5e-5)) / 1e-4
    np.testing.assert_allclose(jax.jacfwd(end)(0.3), (4 * finer - differences) / 3, rtol=1e-6, atol=1e-6)


def test_a_servo_that_rests_at_its_target_has_the_derivatives_of_one_that_moves():
    """What is linear has one derivative everywhere, also where the motion, and what is held, stay what they are."""
    m = cj.replace(carts((), PERIOD), {"link.velocity": 0.0})

    def end(goal):
        return cj.simulate(cj.replace(m, {"motor.0.target.value": goal}), 0.1, rtol=1e-4).final[:2]

    resting, moving = (jax.jacfwd(end)(goal) for goal in (0.0, 1.0))
    np.testing.assert_allclose(resting, moving, rtol=1e-4)
    assert float(moving[0]) > 0.1


def lifting(picked_up=None, put_down=None):
    """A link that swings freely in the plane, with a load at its end for a while."""
    load = cj.Body("load", 1.0, 1e-3, picked_up=picked_up, put_down=put_down)
    hip = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(position=0.3, velocity=1.0))
    joints = (hip, cj.Fixed("grip", "arm", "load", cj.Position(0.4)))
    return cj.Mechanism((cj.Body("arm", 2.0, 0.03, cj.Position(0.2)), load), joints, gravity=cj.Gravity(0.0, -9.81))


@pytest.mark.parametrize(("load", "t0"), [((0.2, None), 0.0), ((None, 0.2), 0.0), ((0.1, None), 0.1)])
def test_the_books_close_where_a_solve_begins_or_ends_as_a_payload_is_handed_over(load, t0):
    assert float(cj.simulate(lifting(*load), 0.2, t0=t0).energy_residual) < 1e-6


@pytest.mark.slow
def test_the_work_of_a_payload_has_derivatives_by_when_it_is_handed_over():
    def work(times):
        changed = cj.replace(lifting(0.1, 0.15), {"load.picked_up": times[0], "load.put_down": times[1]})
        return cj.simulate(changed, 0.2, rtol=1e-11)["drive_work"]

    times, off = np.array([0.1, 0.15]), 1e-4 * np.eye(2)
    differences = [(work(times + h) - work(times - h)) / 2e-4 for h in off]
    np.testing.assert_allclose(jax.jacfwd(work)(times), differences, rtol=1e-6)


@pytest.mark.slow
def test_a_controller_knows_when_a_payload_comes_and_what_it_believes_of_that_has_derivatives():
    target = cj.controllers.Reference("hip", cj.drives.Harmonic(0.3, 5.0))
    start = {"hip.position": 0.0, "hip.velocity": 1.5}

    def controlled(model):
        control = cj.controllers.ComputedTorque("control", (target,), frequency=40.0, model=model)
        return cj.replace(lifting(0.1, 0.16), start).with_controllers(control)

    s = cj.simulate(controlled(None), 0.2, rtol=1e-9, save_at=9)
    np.testing.assert_allclose(s["hip"], 0.3 * np.sin(5 * s.time), rtol=0, atol=1e-9)
    late = controlled(lifting(0.13))

    def end(time):
        return cj.simulate(cj.replace(late, {"control.model.load.picked_up": time}), 0.2, rtol=1e-10).final[0]

    np.testing.assert_allclose(jax.jacfwd(end)(0.13), (end(0.13 + 1e-4) - end(0.13 - 1e-4)) / 2e-4, rtol=1e-5)


def test_a_load_that_has_not_come_weighs_on_no_joint():
    """On a link that is held level the joint bears the weight of what is there."""
    load = cj.Body("load", 1.0, picked_up=0.1)
    joints = (
        cj.Revolute("hip", "ground", "arm", motion=cj.Motion(drive=cj.drives.Constant(0.0))),
        cj.Fixed("grip", "arm", "load", cj.Position(0.4)),
    )
    m = cj.Mechanism((cj.Body("arm", 2.0, 0.03), load), joints, gravity=cj.Gravity(0.0, -10.0))
    for end, weight in ((0.08, 20.0), (0.2, 30.0)):
        peak = metrics.Peak(metrics.JointReaction("hip"))(m, end)
        np.testing.assert_allclose(peak, weight, rtol=1e-12)


def test_a_load_from_outside_pushes_in_the_world_or_with_its_body():
    """A disc that spins evenly, under a thrust that turns with it; a brick under a force that is switched on."""
    thrust = cj.Wrench("thrust", "disc", force=cj.Force(x=2.0), axes="body")
    wind = cj.Wrench("wind", "disc", force=cj.Force(y=3.0), course=cj.drives.StepSum([0.2], [0.5], [1.0]))
    brake = cj.Wrench("brake", "disc", torque=cj.Torque(z=-0.5))
    planar = cj.Planar("floor", "ground", "disc", turn=cj.Motion(velocity=4.0))
    m = cj.Mechanism((cj.Body("disc", 0.5, 0.1),), (planar,), wrenches=(thrust, wind))
    assert m.is_plane
    s = cj.simulate(m, 1.0, rtol=1e-11)
    w = 4.0
    # x'' = 4 cos(4 t), y'' = 4 sin(4 t) + 6 step(t): integrals of the step, of a step's ramp 3 u^2 - 2 u^3.
    along = 4.0 * (1 - np.cos(w)) / w**2, 4.0 * (1 / w - np.sin(w) / w**2)
    ramp = 0.3
    pushed = 6.0 * (0.15 * ramp**2 + (1 - 0.5) * 0.5 * ramp + 0.5 * 0.5**2)
    np.testing.assert_allclose(s.final[:3], [along[0], along[1] + pushed, 4.0], rtol=0, atol=1e-9)
    assert float(s.energy_residual) < 1e-9
    stopped = dataclasses.replace(m, wrenches=(brake,))
    np.testing.assert_allclose(
        cj.simulate(stopped, 0.8, rtol=1e-9, energy_balance=False).final[2], 4 * 0.8 - 5 * 0.8**2 / 2
    )
    assert not dataclasses.replace(m, wrenches=(cj.Wrench("up", "disc", force=cj.Force(z=1.0)),)).is_plane


def steered(mechanism, *names):
    references = tuple(cj.controllers.Reference(name, cj.drives.Constant(0.0)) for name in names)
    return dataclasses.replace(mechanism, controllers=(cj.controllers.ComputedTorque("c", references, frequency=9.0),))


def twice(mechanism):
    (one,) = steered(mechanism, "motor").controllers
    return mechanism.with_controllers(dataclasses.replace(one, name="b"), one)


def swinging_load():
    load = cj.Body("load", 1.0, 0.1, picked_up=0.1)
    return arm(bodies=(load,), joints=(cj.Spherical("grip", "lower", "load"),))


def test_the_targets_of_a_controller_have_the_units_of_what_they_steer():
    slid = dataclasses.replace(steered(carts(), "motor", "link"), name="slides")
    turned = arm().with_controllers(cj.controllers.ComputedTorque("control", TARGETS, frequency=9.0, model=arm()))
    assert cj.parameters(slid)["target.motor.value"].unit == "m"
    assert cj.parameters(turned)["target.elbow.amplitude"].unit == "rad"
    inside = arm().with_controllers(cj.controllers.ComputedTorque("control", TARGETS, frequency=9.0, model=turned))
    assert cj.parameters(inside)["control.model.target.elbow.amplitude"].unit == "rad"
    known = (*cj.parameters(slid).values(), *cj.parameters(inside).values())
    assert not any("coordinate" in leaf.unit or "effort" in leaf.unit for leaf in known)


WRONG = {
    "Load `push` acts on the ground, which nothing moves": lambda: cj.Wrench("push", "ground"),
    "measures `lnk`, but there is no such coordinate": lambda: carts("lnk"),
    "commands `motor`, which controller `c` commands already": lambda: steered(carts(), "motor", "motor"),
    "A servo must have a `period` greater than zero": lambda: cj.actuators.Servo(
        cj.drives.Constant(0.0), 1.0, 1.0, period=0.0
    ),
    "A digital servo (`period`) has no `integral`": lambda: carts(period=PERIOD, integral=1.0),
    "measures `lnk`, but there is no such coordinate. Did you mean `link`": lambda: carts(("motor", "lnk")),
    "commands `moto`, which is no free coordinate. Did you mean `motor`": lambda: steered(carts(), "moto"),
    "commands `motor`, which controller `b` commands already": lambda: twice(carts()),
    "has the free coordinate `elbow`, and its references do not": lambda: steered(arm(), "shoulder").prepare(),
    "needs a list of `Reference(coordinate, drive)`": lambda: steered(arm()),
    "`load.put_down` must be later than `load.picked_up`": lambda: carrying(0.5, 0.2),
    "joint `grip`, which carries it, must be fixed": swinging_load,
    "`push.body` must name a body, but `low` is not one": lambda: arm(wrenches=(cj.Wrench("push", "low"),)),
}


@pytest.mark.parametrize("said", WRONG)
def test_what_does_not_fit_is_named(said):
    with pytest.raises(cj.ClearanceError) as raised:
        WRONG[said]()
    assert said in str(raised.value)


@pytest.mark.slow
def test_a_scene_gives_a_robot_what_it_carries_and_what_pushes_it():
    m = cj.load("experiments/scenes/pick_up.toml")
    load, grip = m.bodies[-1], m.joints[-1]
    assert (load.name, float(load.mass), float(load.picked_up), load.put_down) == ("load", 2.0, 0.1, None)
    assert (grip.name, grip.parent, grip.child) == ("load_grip", m.points[0].body, "load")
    np.testing.assert_allclose(float(grip.at_parent.z or 0) - float(m.points[0].at.z or 0), 0.03)
    assert sampling_periods(m) == (1e-3,)
    assert float(m.gravity.z) == -9.81
    assert [c.name for c in m.free_coordinates()] == ["axis_5"]
    assert m.wrenches[0].body == "load"
    said = CliRunner().invoke(app, ["info", "experiments/scenes/pick_up.toml"]).output
    for words in ("Servo on axis_5, sampled every 0.001 s", "load push on load", "payload load, picked up at 0.1 s"):
        assert words in said
