"""Backlash, stops and friction where they meet loops, play, friction, controllers and names: against programs and
closed forms of their own.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import clearance_jax as cj
from clearance_jax.design.judge.budget import error_budget
from clearance_jax.design.judge.static import static_weights
from clearance_jax.mechanism.state import layout
from tests.mechanism.test_gaps import hub, pendulum, toothed

P = cj.Position


def four_bar(drive, guess=(-0.04393053, 1.71447812), compliance=None):
    """A four-bar whose crank is driven through a gap; the guess closes it at a crank of 0.7 rad."""
    bodies = (
        cj.Body("crank", 0.5, 1e-3, P(0.05)),
        cj.Body("coupler", 1.0, 8e-3, P(0.15)),
        cj.Body("rocker", 1.0, 6e-3, P(0.125)),
    )
    joints = (
        cj.Revolute("A", "ground", "crank", motion=cj.Motion(drive)),
        cj.Revolute("B", "crank", "coupler", at_parent=P(0.1), motion=cj.Motion(position=guess[0])),
        cj.Revolute("D", "ground", "rocker", at_parent=P(0.35), motion=cj.Motion(position=guess[1])),
    )
    loops = (cj.Revolute("C", "coupler", "rocker", at_parent=P(0.3), at_child=P(0.25)),)
    compliance = cj.Compliance(2e3, 2.0, backlash=4e-3) if compliance is None else compliance
    whole = cj.Mechanism(bodies, joints, loops=loops, gravity=cj.Gravity(0, -9.81))
    return whole if compliance == "rigid" else cj.with_compliance(whole, "A", compliance)


@pytest.mark.parametrize("off", [0.0, 0.15])
def test_a_drive_with_backlash_in_a_loop_starts_in_the_middle_of_its_gap(off):
    """With the velocities of the rigid drive, also from a guess that is off."""
    drive = cj.drives.Harmonic(0.5, 12.0, 0.0, 0.7)
    begun = cj.simulate(four_bar(drive, (-0.04393053 + off, 1.71447812)), 1e-3)
    rigid = cj.simulate(four_bar(drive, compliance="rigid"), 1e-3)
    assert float(begun.initial[0]) == 0.0
    places, speeds = np.asarray(begun.initial[:3]), np.asarray(begun.initial[3:6])
    np.testing.assert_allclose(places[1:], rigid.initial[:2], atol=1e-8)
    np.testing.assert_allclose(speeds, [0.0, *rigid.initial[2:4]], atol=1e-7)


def test_a_follower_with_backlash_in_a_loop_starts_with_the_loop_closed():
    """Whatever velocity it is given beside its leader; one without leaves the velocities of the ideal coupling."""
    bar = four_bar(cj.drives.Constant(0.7), compliance="rigid")
    points = cj.Point("one", "coupler", P(0.3)), cj.Point("two", "rocker", P(0.25))
    wheel = cj.Revolute("W", "ground", "wheel", motion=cj.Motion(position=0.35, velocity=6.0))
    flank: Any = {"backlash": 2e-3, "flank": cj.laws.Flank(2e3, 1.0)}

    def begun(velocity, **gap):
        crank = dataclasses.replace(bar.joints[0], motion=cj.Motion(velocity=velocity))
        whole = dataclasses.replace(
            bar,
            bodies=(*bar.bodies, cj.Body("wheel", 1.0, 2e-3)),
            joints=(wheel, crank, *bar.joints[1:]),
            couplings=(cj.Coupling("mesh", "A", "W", 2.0, **gap),),
            points=points,
        )
        start = cj.simulate(whole, 1e-3, save_at=[0.0])
        np.testing.assert_allclose(start["one.velocity"], start["two.velocity"], atol=1e-9)
        np.testing.assert_allclose(start["one.position"], start["two.position"], atol=1e-12)
        return [float(start[f"{name}.velocity"][0]) for name in ("W", "A")]

    ideal, loose, faster = begun(0.0), begun(0.0, **flank), begun(3.0, **flank)
    np.testing.assert_allclose(loose, ideal, rtol=1e-9)
    assert faster[1] > 2.0 * faster[0] + 0.1


def test_a_settled_drive_in_a_loop_stays_where_it_starts():
    still = four_bar(cj.drives.Constant(0.7))
    begun = cj.simulate(still, 0.3, start="settled", rtol=1e-9)
    assert float(begun.initial[0]) == pytest.approx(-0.0022786, abs=2e-7)
    assert float(begun["A.position"]) == pytest.approx(float(begun.initial[0]), abs=1e-8)
    elastic = cj.simulate(
        four_bar(cj.drives.Constant(0.7), compliance=cj.Compliance(2e3, 2.0)), 0.3, start="settled", rtol=1e-9
    )
    assert float(elastic.initial[0]) == pytest.approx(-0.000278, abs=2e-6)
    assert float(elastic["A.position"]) == pytest.approx(float(elastic.initial[0]), abs=1e-8)


def test_play_in_a_loop_beside_a_drive_with_backlash():
    """Both are seated together, and there it stays."""
    play = cj.joints.RevoluteClearance(5e-5, 0.01, cj.laws.HuntCrossley(1e8, 0.5), None)
    still = four_bar(cj.drives.Constant(0.7))
    loop: Any = still.loops[0]
    still = dataclasses.replace(still, loops=(dataclasses.replace(loop, clearance=play),))
    begun = cj.simulate(still, 0.05, start="settled", rtol=1e-8)
    assert float(begun["A.position"]) == pytest.approx(float(begun.initial[0]), abs=1e-6)
    assert float(begun.initial[0]) == pytest.approx(-0.00228, abs=3e-5)


def balanced(integral, drive=None, bristles=True):
    """A four-bar with play in its loop whose rocker has a servo; its crank is free behind a gap, or driven."""
    friction = cj.laws.LuGre(0.2, 0.15, 0.01, 1e5, 10.0) if bristles else None
    play = cj.joints.RevoluteClearance(5e-5, 0.01, cj.laws.HuntCrossley(1e8, 0.5), friction)
    whole = four_bar(drive, compliance="rigid")
    servo = cj.actuators.Servo(cj.drives.Constant(1.73), 400.0, 4.0, integral=integral)
    if drive is None:
        whole = whole.with_joint(
            cj.Revolute("A", "ground", "crank", motion=cj.Motion(position=0.7, actuators=(servo,)))
        )
        law = cj.Compliance(2e3, 2.0, backlash=4e-3, rotor_inertia=1e-2, efficiency=0.8)
        whole = cj.with_compliance(whole, "A", law)
    else:
        rocker: Any = whole.joint("D")
        motion = dataclasses.replace(rocker.motion, actuators=(servo,))
        whole = whole.with_joint(dataclasses.replace(rocker, motion=motion))
    loop: Any = whole.loops[0]
    return dataclasses.replace(whole, loops=(dataclasses.replace(loop, clearance=play),))


@pytest.mark.parametrize("start", ["centre", "settled"])
def test_an_integral_begins_at_zero_beside_bristles_and_backlash(start):
    """All else begins as without it."""
    one, two = (cj.simulate(balanced(ki), 4e-3, start=start, rtol=1e-8) for ki in (900.0, None))
    assert layout(balanced(900.0)).index("A_motor.actuator0", "integral") == one.initial.size - 5  # and four of energy
    np.testing.assert_allclose(np.delete(one.initial, -5), two.initial, rtol=1e-12, atol=1e-14)
    assert float(one.initial[-5]) == 0.0
    assert abs(float(one["A_motor.actuator0.integral"])) > 1e-3
    assert float(one.energy_residual) < 1e-9
    assert "A_motor.actuator0.integral" in str(one)


def test_poses_know_no_integral():
    driven = cj.drives.Harmonic(0.5, 12.0, 0.0, 0.7)
    cj.simulate(balanced(None, driven, bristles=False), 0.02, fidelity="quasi-static")
    with refused("D.actuator0"):
        cj.simulate(balanced(900.0, driven, bristles=False), 0.02, fidelity="quasi-static")


def test_a_cubic_drive_settles_where_its_load_is_borne():
    load = 4.0 * 9.81 * 0.3
    for cubic in (1e5, 1e8, 1e10):
        for gap in (None, 1e-2):
            arm = pendulum(1e-2)
            bare = dataclasses.replace(arm.joint("hub"), motor=None, motion=cj.Motion(cj.drives.Constant(0.4)))  # pyright: ignore
            arm = cj.with_compliance(arm.with_joint(bare), "hub", cj.Compliance(50.0, 1.0, backlash=gap, cubic=cubic))
            half = 0.0 if gap is None else gap / 2

            def left(x, cubic=cubic, half=half):
                return 50 * x + cubic * x**3 - load * np.cos(0.4 - half - x)

            root: Any = brentq(left, 0, 1.0, xtol=1e-15)
            place = -half - root
            assert float(cj.simulate(arm, 1e-4, start="settled").initial[0]) == pytest.approx(place, rel=1e-9)


def test_a_spring_rests_where_it_says_with_and_without_backlash():
    for gap in (None, 1e-3):
        arm = cj.with_compliance(hub(drive=cj.drives.Constant(0.0)), "hub", cj.Compliance(1e3, 50.0, backlash=gap))
        arm = cj.replace(arm, {"hub.actuator.compliance.rest": 0.1})
        begun = cj.simulate(arm, 0.1, start="settled")
        assert float(begun["hub.position"]) == pytest.approx(0.1, abs=1e-12)


def test_friction_on_the_link_counts_in_starts_models_and_what_is_meant():
    turning = hub(inertia=0.1, drive=cj.drives.ConstantSpeed(1.0))
    for gap, place in ((1e-3, -0.0025), (None, -0.002)):
        rub = cj.actuators.JointFriction(2.0, 0.01)
        dragged = cj.with_compliance(turning, "hub", cj.Compliance(1e3, backlash=gap, friction=rub))
        begun = cj.simulate(dragged, 0.1, start="settled", rtol=1e-9)
        assert float(begun.initial[0]) == pytest.approx(place, rel=1e-9)
        assert float(begun["hub.position"]) == pytest.approx(place, rel=1e-6)
    # A model with the law is the model with the formula.
    errors = []
    for law in (None, cj.laws.TanhCoulomb(1.0, 0.05)):
        steered = hub(cj.actuators.JointFriction(2.0, 0.05, law=law), inertia=0.5)
        target = cj.drives.Harmonic(0.4, 6.0)
        control = cj.controllers.ComputedTorque("brain", (cj.controllers.Reference("hub", target),), 20.0)
        moved = cj.simulate(steered.with_controllers(control), 0.5, rtol=1e-9, save_at=11)
        errors.append(np.max(np.abs(np.asarray(moved["hub"]) - 0.4 * np.sin(6 * np.asarray(moved.time)))))
    assert errors[1] == pytest.approx(errors[0], rel=1e-6)


def test_the_friction_of_what_is_meant_is_that_of_the_link():
    """A servo against link friction: nearly rigid, the arm is where the rigid one is."""
    servo = cj.actuators.Servo(cj.drives.Harmonic(0.4, 6.0), 200.0, 20.0)
    rub = cj.actuators.JointFriction(2.0, 0.05)
    arm = dataclasses.replace(hub(servo, inertia=0.5), points=(cj.Point("tip", "wheel", P(0.6)),))
    stiff = cj.with_compliance(arm, "hub", cj.Compliance(1e6, 500.0, 0.1, friction=rub))
    asked = {"peak": cj.metrics.Peak(cj.metrics.PositionError("tip"))}
    assert float(cj.measure(stiff, asked, 0.5, rtol=1e-7)["peak"]) < 1e-4


def geared(backlash, follower_play=1e-5):
    """A heavy wheel behind a driven pinion, with a little play in its own bearing."""
    flanks: dict[str, Any] = {"backlash": backlash, "flank": cj.laws.Flank(2e4, 2.0)} if backlash else {}
    pinion = cj.Revolute("pin", "ground", "a", motion=cj.Motion(cj.drives.Harmonic(0.5, 2.0)))
    whole = cj.Mechanism(
        (cj.Body("a", 1.0, 2e-3), cj.Body("b", 1.0, 2e-2, P(0.2))),
        (pinion, cj.Revolute("w1", "ground", "b")),
        couplings=(cj.Gear("mesh", "w1", "pin", (20, 40), **flanks),),
        gravity=cj.Gravity(0, -9.81),
        points=(cj.Point("tip", "b", P(0.4)),),
    )
    return whole.with_clearance("w1", radial_clearance=follower_play, pin_radius=0.005, length=0.02)


def test_poses_and_budgets_know_the_backlash_of_gears():
    peak = {"p": cj.metrics.Peak(cj.metrics.PositionError("tip"))}
    moved = float(cj.measure(geared(3e-3), peak, 1.0, fidelity="dynamics", start="settled")["p"])
    posed = float(cj.measure(geared(3e-3), peak, 1.0, fidelity="quasi-static")["p"])
    # Half a gap of 3 mrad at 0.4 m, and the wind-up of 1.96 N m.
    assert posed == pytest.approx(0.4 * (1.5e-3 + 1.962 / 2e4), rel=0.02)
    assert moved == pytest.approx(posed, rel=0.1)
    assert error_budget(geared(3e-3), "tip", 1.0, dynamics=False).shares["mesh"] == pytest.approx(posed, rel=0.05)
    with pytest.raises(cj.ClearanceError):
        cj.measure(geared(3e-3), peak, 1.0, fidelity="static")


def test_chains_of_gears_of_which_one_has_backlash():
    """Free pinion, firm gear, gear with backlash: every wheel begins where the chain has it."""
    bodies = tuple(cj.Body(name, 1.0, 2e-3) for name in "abc")
    joints = tuple(
        cj.Revolute(f"w{i}", "ground", name, motion=cj.Motion(position=0.4, velocity=2.0) if i == 0 else cj.Motion())
        for i, name in enumerate("abc")
    )
    flank: Any = {"backlash": 2e-3, "flank": cj.laws.Flank(2e3, 1.0)}
    for first, second in (({}, flank), (flank, {})):
        couplings = (cj.Coupling("one", "w1", "w0", -0.5, **first), cj.Coupling("two", "w2", "w1", 3.0, **second))
        begun = cj.simulate(cj.Mechanism(bodies, joints, couplings=couplings), 1e-4)
        places, speeds = ([float(begun[f"w{i}.{what}"]) for i in range(3)] for what in ("position", "velocity"))
        np.testing.assert_allclose(places, np.array([1.0, -0.5, -1.5]) * places[0], rtol=1e-9)
        np.testing.assert_allclose(speeds, np.array([1.0, -0.5, -1.5]) * speeds[0], rtol=1e-9)


def test_a_coupling_may_name_a_joint_and_its_motor():
    soft = cj.with_compliance(hub(drive=cj.drives.ConstantSpeed(1.0)), "hub", cj.Compliance(1e4, 10.0))
    wheel = cj.Revolute("w", "ground", "other")
    for gap in ({}, {"backlash": 1e-3, "flank": cj.laws.Flank(1e4, 10.0)}):
        mesh = cj.Coupling("mesh", "w", "hub", 2.0, second="hub_motor", second_ratio=-0.5, **gap)
        whole = dataclasses.replace(
            soft, bodies=(*soft.bodies, cj.Body("other", 1.0, 0.01)), joints=(*soft.joints, wheel), couplings=(mesh,)
        )
        turned = cj.simulate(whole, 0.2, start="settled")
        wanted = 2 * (0.2 + float(turned["hub.position"])) - 0.5 * 0.2
        assert float(turned["w.position"]) == pytest.approx(wanted, abs=6e-4)


def test_a_guide_with_ends_beside_a_gap_moves():
    slide = cj.Prismatic("sl", "ground", "block", motion=cj.Motion(cj.drives.Harmonic(0.02, 10.0)))
    arm = cj.Revolute("arm", "block", "link", motion=cj.Motion(cj.drives.Constant(0.3)))
    whole = cj.Mechanism((cj.Body("block", 1.0, 1e-3), cj.Body("link", 0.2, 1e-3, P(0.1))), (slide, arm))
    whole = whole.with_clearance("sl", side_clearance=1e-4, length=0.05, height=0.02, guide_length=0.2)
    whole = cj.with_compliance(whole, "arm", cj.Compliance(1e3, 1.0, backlash=1e-3))
    assert bool(cj.simulate(whole, 0.02).succeeded)


def test_names_of_gaps_are_not_given_twice():
    arm = pendulum()
    with pytest.raises(cj.ClearanceError):
        dataclasses.replace(arm, points=(cj.Point("hub_drive", "wheel", P(0.6)),))


def test_an_average_of_an_error_by_backlash_alone_is_controlled():
    """Its scale is that of the gap, so that the integral converges."""
    mean = {"m": cj.metrics.Mean(cj.metrics.PositionError("tip"))}
    swing = cj.with_compliance(
        pendulum().with_joint(
            dataclasses.replace(pendulum().joint("hub"), motor=None, motion=cj.Motion(cj.drives.Harmonic(0.4, 15.0)))  # pyright: ignore
        ),
        "hub",
        cj.Compliance(500.0, 1.0, backlash=1e-2),
    )
    coarse, fine = (float(cj.measure(swing, mean, 0.5, rtol=rtol)["m"]) for rtol in (1e-6, 1e-9))
    assert coarse == pytest.approx(fine, rel=1e-5)


def test_a_follower_of_driven_coordinates_takes_no_stops():
    wheel = cj.Motion(stops=cj.Stops(0.1, flank=cj.laws.Flank(1e3)))
    pinion = cj.Revolute("pin", "ground", "a", motion=cj.Motion(cj.drives.ConstantSpeed(1.0)))
    bodies = cj.Body("a", 1.0, 1e-3), cj.Body("b", 1.0, 1e-3)
    parts = bodies, (pinion, cj.Revolute("w", "ground", "b", motion=wheel))
    with refused("w"):
        cj.Mechanism(*parts, couplings=(cj.Coupling("mesh", "w", "pin", -0.5),))
    # With backlash it may have them, and its ideal mechanism leaves them out.
    loose = cj.Coupling("mesh", "w", "pin", -0.5, backlash=1e-3, flank=cj.laws.Flank(1e3, 1.0))
    ideal = cj.Mechanism(*parts, couplings=(loose,)).ideal()
    assert [c.name for c in ideal.free_coordinates()] == []


def test_a_settled_start_that_is_not_found_is_refused():
    """A link that its weight turns over against a spring softer than that: no place of rest is near."""
    arm = pendulum(1e-2, stiffness=500.0)
    soft = cj.replace(arm, {"hub.actuator.compliance.stiffness": 3.0, "drive.hub_motor.value": 1.2})
    with pytest.raises(RuntimeError):
        cj.simulate(soft, 0.01, start="settled")


def test_gears_whose_circles_overlap_are_refused():
    with refused("mesh.base_radius"):
        toothed(module=3.2e-3)


MU, LAYER = 0.1, 2e-3


def rubbing(whole, law, **teeth):
    (mesh,) = whole.couplings
    made = cj.Gear("mesh", "wheel", "pinion", (20, 40), backlash=1e-3, flank=mesh.flank, module=2e-3, friction=law)
    return dataclasses.replace(whole, couplings=(dataclasses.replace(made, **teeth),))


@pytest.mark.parametrize(("counts", "angle"), [((20, 40), 20.0), ((12, 90), 25.0), ((17, 17), 20.0)])
def test_teeth_slide_by_the_mean_of_the_pairs_in_contact(counts, angle):
    """Pairs of teeth, a base pitch apart, move along the path of contact and share the force evenly."""
    angle, module = np.radians(angle), 2e-3
    sliding = cj.Gear(
        "mesh", "a", "b", counts, module=module, pressure_angle=angle, backlash=1e-3,
        flank=cj.laws.Flank(1e7), friction=cj.laws.TanhCoulomb(MU, LAYER),
    ).sliding  # fmt: skip
    pitch = np.pi * module * np.cos(angle)
    radii = module / 2 * np.asarray(counts, float)
    ends = np.sqrt((radii + module) ** 2 - (radii * np.cos(angle)) ** 2) - radii * np.sin(angle)
    at = np.linspace(0.0, pitch, 20_001)[:-1, None] + pitch * np.arange(-2, 2)
    inside = (at > -ends[1]) & (at < ends[0])
    pairs = inside.sum(axis=1)
    assert set(pairs) == {1, 2}
    assert float(sliding) == pytest.approx(np.mean((np.abs(at) * inside).sum(axis=1) / pairs), rel=1e-4)


@pytest.mark.parametrize("law", [cj.laws.TanhCoulomb(MU, LAYER), cj.laws.LuGre(MU, MU, 0.01, 1e4, 10.0, 0.0)])
def test_friction_of_teeth_takes_its_share_of_the_power(law):
    """F (r_b2 - mu s) on the loaded wheel, F (r_b1 + mu s) on the driven pinion, whatever plays; the books close."""
    base, slid = 2e-3 * 20 * np.cos(np.radians(20)), float(rubbing(toothed(), law).couplings[0].sliding)
    force = 5.0 / (base - MU * slid)
    for clearance in (None, 5e-5):
        solution = cj.simulate(rubbing(toothed(clearance=clearance), law), 0.2, rtol=1e-7)
        assert -float(solution["mesh_ahead.effort"]) == pytest.approx(force, rel=2e-5)
        assert float(solution["mesh.torque"]) == pytest.approx(-5.0, rel=2e-5)
        assert float(solution["pinion.drive_force"]) == pytest.approx(force * (base / 2 + MU * slid), rel=2e-5)
        assert float(solution.energy_residual) < 1e-8


def test_rubbing_teeth_move_as_by_an_equation_of_their_own():
    """Both flanks, while the pinion swings and the wheel crosses the gap."""
    law, swing = cj.laws.TanhCoulomb(MU, LAYER), cj.drives.Harmonic(0.2, 60.0)
    whole = rubbing(toothed(torque=0.0, law=cj.laws.Flank(1e7, damping=300.0)), law)
    pinion = dataclasses.replace(whole.joint("pinion"), motion=cj.Motion(swing))
    whole = dataclasses.replace(whole, joints=(pinion, whole.joint("wheel")))
    base, slid, end = 2e-3 * 20 * np.cos(np.radians(20)), float(whole.couplings[0].sliding), 0.15

    def field(t, y):
        turn, rate = 0.2 * np.sin(60 * t), 12 * np.cos(60 * t)
        lag, drift = base * (y[0] + turn / 2), base * (y[1] + rate / 2)
        torque = 0.0
        for side in (1.0, -1.0):
            depth = side * lag - base * 0.5e-3
            elastic = 1e7 * max(depth, 0.0)
            force = max(elastic + min(elastic, 300.0 * side * drift), 0.0) if depth > 0 else 0.0
            torque += -side * base * force - slid * MU * force * np.tanh(slid * (y[1] - rate) / LAYER)
        return [y[1], torque / 3e-4]

    start = cj.simulate(whole, end, rtol=1e-10, save_at=np.linspace(0.0, end, 31))
    first = [float(start["wheel.position"][0]), float(start["wheel.velocity"][0])]
    own = solve_ivp(field, (0, end), first, "DOP853", start.time, rtol=1e-11, atol=1e-14, max_step=1e-5)
    np.testing.assert_allclose(start["wheel.position"], own.y[0], atol=1e-9)
    np.testing.assert_allclose(start["wheel.velocity"], own.y[1], atol=1e-6)
    smooth = cj.simulate(rubbing(whole, cj.laws.TanhCoulomb(0.0, LAYER)), end, rtol=1e-8, save_at=start.time)
    assert np.max(np.abs(smooth["wheel.velocity"] - own.y[1])) > 1e-3  # friction matters here
    assert float(start.energy_residual) < 1e-9


def test_derivatives_by_the_friction_of_teeth():
    whole = rubbing(toothed(), cj.laws.TanhCoulomb(MU, LAYER))
    names = ("mesh.friction.coefficient", "mesh.sliding")
    at = jnp.asarray([float(cj.parameters(whole)[name].value) for name in names])

    def place(values):
        made = cj.replace(whole, dict(zip(names, values, strict=True)))
        return cj.simulate(made, 2e-3, rtol=1e-10)["wheel.position"]

    found, place = jax.jit(jax.grad(place))(at), jax.jit(place)
    for k, step in enumerate(1e-3 * at):
        ahead, back = (float(place(at.at[k].add(sign * step))) for sign in (1.0, -1.0))
        assert float(found[k]) == pytest.approx((ahead - back) / (2 * float(step)), rel=1e-5)


def test_friction_of_teeth_in_a_scene(tmp_path):
    text = (SCENES / "gears.toml").read_text(encoding="utf-8")
    rough = '\nfriction = { law = "tanh", coefficient = 0.1, transition_speed = "2 mm/s" }'
    old = 'stiffness = "20 kN*m/rad"\ndamping = "2 N*m*s/rad"'
    new = 'module = "2 mm"\nstiffness = "10 N/um"\ndamping = "300 N*s/m"'
    path = tmp_path / "gears.toml"
    path.write_text(text.replace(old, new + rough), encoding="utf-8")
    (mesh,) = cj.load(path).couplings
    assert mesh.friction == cj.laws.TanhCoulomb(MU, LAYER)
    assert float(mesh.sliding) == pytest.approx(0.0020806615914449, rel=1e-12)
    path.write_text(text.replace(old, old + rough), encoding="utf-8")
    with refused("mesh.friction"):
        cj.load(path)
    law = cj.laws.TanhCoulomb(MU, LAYER)
    with refused("mesh.friction"):  # of 14.5 degrees, more than two pairs are in contact
        cj.Gear(
            "mesh", "wheel", "pinion", (60, 60), module=2e-3, pressure_angle=np.radians(14.5), backlash=1e-3,
            flank=cj.laws.Flank(1e7), friction=law,
        )  # fmt: skip
    assert rubbing(toothed(), law).intended().gaps == ()


def test_what_acts_on_a_follower_of_a_driven_wheel_loads_its_teeth():
    """Its ideal mechanism moves the follower, but poses, settled starts and driving forces know the load."""
    stiffness = 1e8 * 0.0375**2
    whole = toothed(module=None, law=cj.laws.HuntCrossley(stiffness, 0.5 * 0.0375, 1.0))
    spring = cj.actuators.JointSpring(20.0)
    wheel: Any = whole.joint("wheel")
    wheel = dataclasses.replace(wheel, motion=cj.Motion(actuators=(*wheel.motion.actuators, spring)))
    whole = dataclasses.replace(whole, joints=(whole.joint("pinion"), wheel))
    times = np.array([0.0, 0.05, 0.1])
    torque = 5.0 + 20.0 * (5.0 * times - 0.5e-3)  # the wheel turns by -5 rad/s, and is ahead by half the gap
    posed = cj.simulate(whole, 0.1, fidelity="quasi-static", save_at=times)
    np.testing.assert_allclose(posed["mesh.position"], 0.5e-3 + torque / stiffness, rtol=5e-5)
    np.testing.assert_allclose(posed["pinion.drive_force"], torque / 2, rtol=1e-3)
    settled = cj.simulate(whole, 1e-4, start="settled")
    assert float(settled.initial[0]) == pytest.approx(0.5e-3 + torque[0] / stiffness, rel=1e-5)
    ideal = cj.simulate(whole.ideal(), 0.1, save_at=times)
    np.testing.assert_allclose(ideal["mesh.torque"], -(5.0 + 100.0 * times), rtol=1e-12)
    np.testing.assert_allclose(ideal["pinion.drive_force"], 2.5 + 50.0 * times, rtol=1e-12)
    assert float(ideal.energy_residual) < 1e-9


def test_poses_and_static_bounds_of_teeth_that_load_their_bearings_are_refused():
    whole = dataclasses.replace(toothed(), points=(cj.Point("rim", "large", P(0.04)),))
    with refused("fidelity"):
        cj.simulate(whole, 0.1, fidelity="quasi-static")
    with refused("base_radius"):
        static_weights(whole, "rim", 0.1)
