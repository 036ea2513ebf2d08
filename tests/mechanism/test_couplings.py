"""Gears and the like: against closed forms, Lagrange's equations with followers eliminated, a stiff spring in their
place, and what each refuses.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lagrangian import accelerations, mass_matrix
from places import refused
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import clearance_jax as cj
from clearance_jax import ClearanceError
from clearance_jax.dynamics.applied import exert
from clearance_jax.dynamics.field import energies, slope
from clearance_jax.dynamics.postures.chain import chain_of
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism.state import initial_values, layout

NOW = jnp.zeros(())
WHEEL = 3e-4


def pendulum_and_wheel(ratio=-6.0, angle=1.0, **wheel):
    """A pendulum geared to a flywheel; `angle` from hanging."""
    bodies = (cj.Body("arm", 1.2, 0.01, cj.Position(0.25)), cj.Body("wheel", 1.0, WHEEL))
    joints = (
        cj.Revolute("hip", "ground", "arm", motion=cj.Motion(position=angle - np.pi / 2)),
        cj.Revolute("spin", "ground", "wheel", at_parent=cj.Position(0.5), motion=cj.Motion(**wheel)),
    )
    gears = (cj.Coupling("mesh", "spin", "hip", ratio),)
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(0.0, -9.81), couplings=gears)


def test_a_pendulum_that_turns_a_flywheel():
    """I = I_arm + k^2 J: its period at an amplitude of 1 rad, and the torque in the mesh as it is let go."""
    m = pendulum_and_wheel()
    period = 4 * ellipk(np.sin(0.5) ** 2) / 5.542585184002
    assert period == pytest.approx(1.208817806483, rel=1e-12)
    s = cj.simulate(m, period, rtol=1e-11)
    assert float(s["hip"]) + np.pi / 2 == pytest.approx(1.0, abs=1e-9)
    assert float(s["spin"]) == pytest.approx(-6.0 * float(s["hip"]), rel=1e-14)
    assert float(s.energy_residual) < 1e-9
    first = observe(NOW, initial_values(m), m.prepare())
    assert float(slope(NOW, initial_values(m), m.prepare())[1]) == pytest.approx(-25.8501994602, rel=1e-11)
    assert float(first["torque"][0]) == pytest.approx(0.0465303590, rel=1e-9)
    held = energies(NOW, jnp.array([0.3, 2.0]), m.prepare())
    assert float(held.kinetic) == pytest.approx(0.5 * (0.01 + 1.2 * 0.25**2 + 36 * WHEEL) * 4.0, rel=1e-13)


def test_two_pendulums_geared_to_each_other():
    bodies = (cj.Body("a", 2.0, 0.02, cj.Position(0.3)), cj.Body("b", 1.0, 0.005, cj.Position(0.2)))
    joints = (
        cj.Revolute("first", "ground", "a", angle=-np.pi / 2, motion=cj.Motion(position=0.9)),
        cj.Revolute("second", "ground", "b", at_parent=cj.Position(1.0), angle=-np.pi / 2),
    )
    m = cj.Mechanism(bodies, joints, gravity=cj.Gravity(0.0, -9.81))
    m = dataclasses.replace(m, couplings=(cj.Coupling("mesh", "second", "first", -1.5, offset=0.4),))
    s = cj.simulate(m, 2.0, rtol=1e-12)
    assert float(s["first"]) == pytest.approx(0.023523263122, abs=1e-10)
    assert float(s["first.velocity"]) == pytest.approx(4.40087758567, rel=1e-10)
    rest = observe(NOW, jnp.array([0.113854189943, 0.0]), m.prepare())
    assert float(rest["torque"][0]) == pytest.approx(0.445799250, rel=1e-8)


def test_a_planetary_train_by_its_torques():
    """Sun, ring and carrier as wheels on one axis: 1 : R : -(1 + R), and the inertia at the sun with the ring fixed."""
    inertias = {"sun": 1e-5, "ring": 2e-5, "carrier": 8e-5}
    bodies = tuple(cj.Body(name, 1.0, inertia) for name, inertia in inertias.items())
    turns = {
        "ring": cj.Motion(cj.drives.Constant(0.0)),
        "sun": cj.Motion(actuators=(cj.actuators.ConstantEffort(0.7),)),
    }
    joints = tuple(cj.Revolute(f"at_{n}", "ground", n, motion=turns.get(n, cj.Motion())) for n in inertias)
    train = cj.Planetary("train", "at_sun", "at_ring", "at_carrier", (24, 60))
    m = cj.Mechanism(bodies, joints, couplings=(train,))
    now, y = observe(NOW, initial_values(m), m.prepare()), initial_values(m)
    faster = float(slope(NOW, y, m.prepare())[1])
    assert faster == pytest.approx(0.7 / (1e-5 + 8e-5 * (2 / 7) ** 2), rel=1e-12)
    on_carrier = float(now["torque"][0])
    assert on_carrier == pytest.approx(8e-5 * 2 / 7 * faster, rel=1e-12)
    # The ring is held against what the train exerts on it: R of the sun's share.
    assert float(now["drive_force"][0]) == pytest.approx(on_carrier * 2.5 / 3.5, rel=1e-12)
    # Its balance of power: what the sun's torque does becomes kinetic energy.
    s = cj.simulate(m, 0.01, rtol=1e-10)
    assert float(s["at_carrier"]) == pytest.approx(2 / 7 * float(s["at_sun"]), rel=1e-13)
    assert float(s.energy_residual) < 1e-12


def coupled_arm(driven=()):
    """Six axes in space, of which two follow: one its ancestor, one an axis of another limb and one before it."""
    robot = cj.load("experiments/scenes/six_axes.urdf").without_drives([f"axis_{i}" for i in range(1, 7)])
    for i in range(1, 7):
        joint = robot.joint(f"axis_{i}")
        motion = cj.Motion(position=0.2 * i - 0.5, velocity=1.0 - 0.3 * i, rotor_inertia=0.1 * i)
        robot = robot.with_joint(dataclasses.replace(joint, motion=motion))
    drive = cj.drives.Quintic([0.0, 0.5], [0.1, 0.7])
    robot = robot.with_drives(dict.fromkeys(driven, drive))
    chain = (
        cj.Coupling("elbow_gear", "axis_3", "axis_2", -0.7, offset=0.2),
        cj.Coupling("wrist_gear", "axis_5", "axis_3", 1.3, second="axis_1", second_ratio=0.4),
        cj.Coupling("finger_gear", "finger_right", "finger_left", 1.0),
    )
    return dataclasses.replace(robot, couplings=chain)


@pytest.mark.parametrize("driven", [(), ("axis_1",), ("axis_1", "axis_2", "finger_left")])
@pytest.mark.parametrize("form", ["prepare", "table"])
def test_accelerations_are_those_with_followers_eliminated(driven, form):
    """Lagrange's equations of the arm whose followers are free, with v = G v_free put in."""
    m = coupled_arm(driven)
    ready = m.prepare()
    ready = ready.as_table() if form == "table" else ready
    y, t, plan = initial_values(m), jnp.asarray(0.2), layout(m)
    found = slope(t, y, ready)[plan.v]
    apart = dataclasses.replace(m, couplings=())
    names = layout(apart).velocities
    # Written down by hand: what follows what, and each follower's offset.
    rows = {name: {name: 1.0} for name in names}
    rows["axis_3"], rows["finger_right"] = {"axis_2": -0.7}, {"finger_left": 1.0}
    rows["axis_5"] = {"axis_2": -0.7 * 1.3, "axis_1": 0.4}
    offsets = {"axis_3": 0.2, "axis_5": 1.3 * 0.2}
    leaders = {name: [float(x) for x in cj.drives.Quintic([0.0, 0.5], [0.1, 0.7])(t)] for name in driven}
    for i, name in enumerate(plan.velocities):
        leaders[name] = [float(y[i]), float(y[plan.free + i]), 0.0]
    motion = [[sum(x * leaders[n][k] for n, x in rows[name].items()) for name in names] for k in range(3)]
    places = np.array(motion[0]) + [offsets.get(name, 0.0) for name in names]
    state = jnp.concatenate([places, jnp.array(motion[1])])
    inertia = mass_matrix(apart, t, state)
    load = inertia @ accelerations(apart, t, state)
    rotors = [c.motion.rotor_inertia for c in apart.free_coordinates()]
    inertia = inertia + jnp.diag(jnp.array([0.0 if r is None else r for r in rotors]))
    g = np.array([[rows[name].get(column, 0.0) for column in plan.velocities] for name in names])
    bias = np.array(motion[2])
    wanted = np.linalg.solve(g.T @ inertia @ g, g.T @ (load - inertia @ bias))
    np.testing.assert_allclose(found, wanted, rtol=2e-11, atol=1e-11)
    # Places and rates of followers.
    now = observe(t, y, ready)
    values = dict(zip([name for c in m.coordinates() for name in c.velocities], np.asarray(now["q"]), strict=True))
    assert values["axis_3"] == pytest.approx(-0.7 * values["axis_2"] + 0.2, rel=1e-14)
    assert values["axis_5"] == pytest.approx(1.3 * values["axis_3"] + 0.4 * values["axis_1"], rel=1e-14)
    # The balance of power: drives and actuators against the rate of all energies.
    after = jax.jvp(lambda y: energies(t, y, ready).total, (y,), (slope(t, y, ready)[: y.shape[0]],))[1]
    explicit = jax.jvp(lambda t: energies(t, y, ready).total, (t,), (jnp.ones(()),))[1]
    spent = now["drive_force"] if driven else jnp.zeros(0)
    rates = dict(zip([name for c in m.coordinates() for name in c.velocities], np.asarray(now["v"]), strict=True))
    names = [c.name for c in m.coordinates() if c.name in driven]
    work = sum(float(effort) * rates[name] for effort, name in zip(spent, names, strict=False))
    # The right finger follows, with the damper of its file: where the left one is driven, that drive feels it.
    lost = 20.0 * rates["finger_right"] ** 2 if "finger_left" in driven else 0.0
    assert float(after + explicit) == pytest.approx(work - lost, rel=1e-9, abs=1e-9)


def test_friction_and_actuators_of_a_follower_act_on_its_leader():
    spring, damper = cj.actuators.JointSpring(4.0, 0.02, 0.3), cj.actuators.ConstantEffort(0.5)
    m = pendulum_and_wheel(actuators=(spring, damper))
    y = jnp.array([0.2, 0.7])
    (effort,) = exert(m.prepare(), NOW, layout(m).split(y))
    angle, rate = -6.0 * 0.2, -6.0 * 0.7
    assert float(effort) == pytest.approx(-6.0 * (0.5 - 4.0 * (angle - 0.3) - 0.02 * rate), rel=1e-13)
    s = cj.simulate(m, 0.3, rtol=1e-10)
    assert float(s.energy_residual) < 1e-8
    assert float(s["damping_loss"]) > 1e-3
    own = observe(NOW, y, m.prepare())["actuator_effort"]
    assert float(own[0]) == pytest.approx(0.5 - 4.0 * (angle - 0.3) - 0.02 * rate, rel=1e-13)


def test_a_stiff_spring_between_free_wheels_tends_to_the_coupling():
    """Two free wheels joined by a spring of stiffness k: the difference to the coupling falls like 1 / k."""
    m = pendulum_and_wheel()
    free, ratio = dataclasses.replace(m, couplings=()).prepare(), jnp.array([6.0, 1.0])

    @jax.jit
    def rate(t, y, stiffness):
        effort = -stiffness * (ratio @ y[:2]) * ratio
        return jnp.concatenate([y[2:], accelerations(free, 0.0, y, effort)])

    begin, apart = 1.0 - np.pi / 2, []
    ideal = float(cj.simulate(m, 0.1, rtol=1e-11)["hip"])
    for stiffness in (1e2, 1e3, 1e4):
        # The spring bears the torque of the start, so that the wheel does not swing on it.
        start, how = (
            [begin, -6.0 * begin - 0.0465303590 / stiffness, 0.0, 0.0],
            {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853"},
        )
        end = solve_ivp(rate, (0, 0.1), start, args=(stiffness,), **how)
        apart.append(abs(end.y[0, -1] - ideal))
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.1)
    assert apart[1] / apart[2] == pytest.approx(10.0, rel=0.1)


def geared_arms(**changes):
    """Two arms of one length on the ground, with play in the pin between the first and its forearm."""
    play = cj.joints.pin_clearance(1e-4, pin_radius=0.01)
    bodies = tuple(cj.Body(name, 0.8, 2e-3, cj.Position(0.1)) for name in ("first", "second", "fore"))
    joints = (
        cj.Revolute("left", "ground", "first", motion=cj.Motion(cj.drives.ConstantSpeed(20.0, 0.3))),
        cj.Revolute("right", "ground", "second", at_parent=cj.Position(0.3), **changes),
        cj.Revolute(
            "knee", "second", "fore", at_parent=cj.Position(0.2), clearance=play, motion=cj.Motion(position=0.4)
        ),
    )
    points = (cj.Point("tip", "fore", cj.Position(0.2)),)
    return cj.Mechanism(bodies, joints, points=points, gravity=cj.Gravity(0.0, -9.81))


def test_a_follower_of_a_drive_moves_as_if_it_had_one():
    """Play beyond the follower, settled start, batch and pose: all digits of the mechanism whose follower is driven."""
    driven = geared_arms(motion=cj.Motion(cj.drives.ConstantSpeed(-50.0, -2.5 * 0.3 + 0.1)))
    following = dataclasses.replace(geared_arms(), couplings=(cj.Coupling("mesh", "right", "left", -2.5, offset=0.1),))
    for start in ("centre", "settled"):
        a, b = (cj.simulate(m, 0.02, rtol=1e-8, start=start) for m in (driven, following))
        # The last one is the energy exchanged: of two drives each by itself.
        np.testing.assert_allclose(b.final[:-1], a.final[:-1], rtol=1e-9, atol=1e-12)
        assert 0 < float(b.final[-1]) <= (1 + 1e-9) * float(a.final[-1])
    one, other = (cj.to_dataset(m, s) for m, s in ((driven, a), (following, b)))
    # The one motor bears what the other would have: 2.5 times, and the other way.
    left, right = (float(one["drive_force"].sel(drive=name)[-1]) for name in ("left", "right"))
    assert [*other["drive"].values] == ["left"]
    assert float(other["drive_force"][-1, 0]) == pytest.approx(left - 2.5 * right, rel=1e-8)
    assert float(other["torque"][-1, 0]) == pytest.approx(right, rel=1e-8)
    assert float(b.energy_residual) < 1e-6


def test_inverse_kinematics_moves_what_a_follower_follows():
    following = dataclasses.replace(geared_arms(), couplings=(cj.Coupling("mesh", "right", "left", -2.5, offset=0.1),))
    chain = chain_of(following, "tip", None)
    assert chain.joints == ("left", "knee")
    assert layout(chain.mechanism).positions == ("left", "knee")
    with refused("right"):
        chain_of(following, "tip", ["right"])


def geared_five_bar():
    """Cranks at both ends, geared to each other, and a loop of two rods: one way to move."""
    names = {"first": 0.1, "rod": 0.25, "second": 0.1, "tie": 0.25}
    bodies = tuple(cj.Body(n, 10 * x, 10 * x**3 / 12, cj.Position(x / 2)) for n, x in names.items())
    joints = (
        cj.Revolute("left", "ground", "first", motion=cj.Motion(position=1.2, velocity=8.0)),
        cj.Revolute("a", "first", "rod", at_parent=cj.Position(0.1), motion=cj.Motion(position=-0.6)),
        cj.Revolute("right", "ground", "second", at_parent=cj.Position(0.3)),
        cj.Revolute("b", "second", "tie", at_parent=cj.Position(0.1), motion=cj.Motion(position=0.8)),
    )
    close = (cj.Revolute("top", "rod", "tie", at_parent=cj.Position(0.25), at_child=cj.Position(0.25)),)
    gears = (cj.Gear("gears", "right", "left", (30, 30), offset=np.pi),)
    return cj.Mechanism(bodies, joints, close, gravity=cj.Gravity(0.0, -9.81), couplings=gears)


def test_a_follower_in_a_closed_loop():
    """A geared five-bar has one freedom, so that its energy alone says how fast it is at each place."""
    m = geared_five_bar()
    assert cj.mobility(m).freedom == 1
    early, late = (cj.simulate(m, t, rtol=1e-10) for t in (0.01, 0.06))
    d = cj.to_dataset(m, late)
    assert float(d["q"].sel(coordinate="right")[-1]) == pytest.approx(np.pi - float(late["left"]), rel=1e-14)
    assert float(late.energy_residual) < 1e-9
    first, last = (energies(NOW, s.final, m.prepare()) for s in (early, late))
    assert float(last.total) == pytest.approx(float(first.total), rel=1e-9)
    assert abs(float(last.kinetic / first.kinetic) - 1) > 0.05


def test_presets_have_the_ratios_of_the_textbook():
    def ratio(coupling):
        return float(coupling.ratio)

    assert ratio(cj.Gear("g", "b", "a", (20, 40))) == -0.5
    assert ratio(cj.Gear("g", "b", "a", (20, 40), internal=True)) == 0.5
    assert ratio(cj.Rack("g", "b", "a", 0.03)) == 0.03
    assert ratio(cj.Screw("g", "b", "a", 5e-3)) == pytest.approx(5e-3 / (2 * np.pi), rel=1e-15)
    assert ratio(cj.Belt("g", "b", "a", (1, 4))) == 0.25
    assert ratio(cj.Belt("g", "b", "a", (1, 4), crossed=True)) == -0.25
    for train, wanted in (
        (cj.Planetary("p", "sun", "ring", "carrier", (24, 60)), {"sun": 2 / 7, "ring": 5 / 7}),
        (cj.Planetary("p", "sun", "ring", "carrier", (24, 60), follower="ring"), {"sun": -0.4, "carrier": 1.4}),
        (cj.Differential("d", "cage", "left", "right"), {"left": 0.5, "right": 0.5}),
        (cj.Differential("d", "cage", "left", "right", follower="right"), {"cage": 2.0, "left": -1.0}),
    ):
        assert {name: float(factor) for name, factor in train.terms} == pytest.approx(wanted, rel=1e-15)


def test_a_ratio_is_a_parameter_with_a_derivative():
    m = pendulum_and_wheel()
    assert cj.parameters(m)["mesh.ratio"].unit == ""

    def end(ratio):
        return cj.simulate(cj.replace(m, {"mesh.ratio": ratio}), 0.4, rtol=1e-11)["hip"]

    slope_, h = float(jax.jacfwd(end)(jnp.asarray(-6.0))), 1e-4
    assert slope_ == pytest.approx(float(end(-6.0 + h) - end(-6.0 - h)) / (2 * h), rel=1e-6)


def test_what_does_not_fit_is_refused():
    m = pendulum_and_wheel()

    def given(*couplings):
        return dataclasses.replace(m, couplings=couplings)

    mesh, back = cj.Coupling("a", "spin", "hip", 2.0), cj.Coupling("b", "hip", "spin", 2.0)
    with refused("hop", allowed="hip"):
        given(cj.Coupling("mesh", "spin", "hop", 2.0))
    with refused("spin"):
        given(cj.Coupling("mesh", "spin", "spin", 2.0))
    with refused("spin") as caught:
        given(mesh, back)
    assert "`spin` follows `hip` follows `spin`" in str(caught.value)
    with refused("spin") as caught:
        given(mesh, dataclasses.replace(mesh, name="c"))
    assert "`a` and `c`" in str(caught.value)
    with refused("spin"):
        m.with_drives({"spin": cj.drives.Constant(1.0)})
    with refused("spin"):
        m.without_drives(["spin"])
    with refused("teeth", 4):
        cj.Gear("g", "b", "a", (4, 40))
    with refused("teeth"):
        cj.Planetary("g", "s", "r", "c", (40, 24))
    with refused("radii", 0.0):
        cj.Belt("g", "b", "a", (0.0, 1.0))
    with refused("up", allowed="left"):
        cj.Differential("d", "cage", "left", "right", follower="up")
    with refused("d.second_ratio"):
        cj.Coupling("d", "a", "b", 1.0, second="c")
    with refused("d.second"):
        cj.Coupling("d", "a", "b", 1.0, second="b", second_ratio=2.0)
    with refused("d"):
        cj.Differential("d", "cage", "left", "left")
    with refused("teeth"):
        cj.Gear("g", "b", "a", (20, float("nan")))
    still = given(cj.Coupling("mesh", "spin", "hip", 0.0))
    with pytest.raises(ClearanceError) as caught:
        cj.simulate(still, 0.01)
    assert "`mesh.ratio` must not be 0" in str(caught.value)


def test_friction_of_a_follower_of_an_elastic_drive_is_refused():
    """The motor's `drive_force` would lack it."""
    driven = geared_arms().with_joint(cj.Revolute("left", "ground", "first", motion=cj.Motion(cj.drives.Constant(0.3))))
    elastic = cj.with_compliance(driven, "left", cj.Compliance(800.0))
    friction = cj.Motion(actuators=(cj.actuators.JointFriction(0.1),))
    right = dataclasses.replace(elastic.joint("right"), motion=friction)
    with refused("right"):
        dataclasses.replace(elastic.with_joint(right), couplings=(cj.Coupling("mesh", "right", "left", -2.0),))
    following = dataclasses.replace(elastic, couplings=(cj.Coupling("mesh", "right", "left", -2.0),))
    assert chain_of(following, "tip", None).joints == ("left_motor", "knee")


@pytest.mark.parametrize("motion", [
    cj.Motion(cj.drives.Constant(0.9)),
    cj.Motion(position=0.9, actuators=(cj.actuators.Servo(cj.drives.Constant(0.9), 1e4, 100.0),)),
])  # fmt: skip
def test_a_follower_of_an_elastic_drive_starts_and_errs_beside_the_rigid_one(motion):
    """A stiff drive turns a crank by gears: the loop starts where the rigid drive has it, and errors are small."""
    P, gears = cj.Position, cj.Gear("gears", "main", "axis", (20, 40))
    crank = float(gears.terms[0][1]) * 0.9
    rod, rotor = -np.arcsin(np.sin(crank) / 3), None if motion.drive else 0.2
    bodies = tuple(cj.Body(name, 0.5, 1e-3) for name in ("wheel", "crank", "rod", "slider"))
    joints = (
        cj.Revolute("axis", "ground", "wheel", motion=motion),
        cj.Revolute("main", "ground", "crank"),
        cj.Revolute("crankpin", "crank", "rod", at_parent=P(0.05), motion=cj.Motion(position=rod - crank)),
        cj.Revolute("wrist", "rod", "slider", at_parent=P(0.15), motion=cj.Motion(position=-rod)),
    )
    guide = (cj.Prismatic("guide", "ground", "slider"),)
    firm = cj.Mechanism(bodies, joints, guide, points=(cj.Point("end", "slider"),), couplings=(gears,))
    stiff = cj.with_compliance(firm, "axis", cj.Compliance(1e8, 1e3, rotor_inertia=rotor))
    begun = cj.simulate(stiff, 1e-3, energy_balance=False).initial
    for name, place in (("crankpin", rod - crank), ("wrist", -rod)):
        assert float(begun[layout(stiff).positions.index(name)]) == pytest.approx(place, abs=1e-12)
    error = cj.measure(stiff, {"error": cj.metrics.Peak(cj.metrics.PositionError("end"))}, 1e-3)["error"]
    assert 0 <= float(error) < 1e-8


def test_a_two_link_arm_whose_elbow_follows():
    """G^T M G of its mass matrix, and the frequency at which it hangs."""
    bodies = cj.Body("upper", 1.0, 0.02, cj.Position(0.2)), cj.Body("fore", 0.8, 0.01, cj.Position(0.15))
    push = cj.Motion(position=0.3, actuators=(cj.actuators.ConstantEffort(1.0),))
    joints = (
        cj.Revolute("hip", "ground", "upper", motion=push),
        cj.Revolute("elbow", "upper", "fore", at_parent=cj.Position(0.4)),
    )
    arm = cj.Mechanism(bodies, joints, couplings=(cj.Coupling("gear", "elbow", "hip", -2.0),))
    rates = slope(NOW, initial_values(arm), arm.prepare())
    assert float(rates[1]) == pytest.approx(1 / 0.136767780969, rel=1e-11)
    free = cj.Revolute("hip", "ground", "upper", angle=-np.pi / 2)
    hanging = dataclasses.replace(arm, gravity=cj.Gravity(0.0, -9.81)).with_joint(free).prepare()
    stiff = jax.jacfwd(lambda y: slope(NOW, y, hanging))(jnp.zeros(2))
    assert np.sqrt(-float(stiff[1, 0])) == pytest.approx(7.233256528, rel=1e-9)


def test_a_rotor_on_a_moving_link():
    """As a body of its own that is geared to its joint it has the exact inertia: (Jr, N Jr, N^2 Jr)."""
    ratio, rotor = 100.0, 1e-5
    push = cj.Motion(actuators=(cj.actuators.ConstantEffort(1.0),))
    bodies = cj.Body("parent", 1.0, 0.2), cj.Body("link", 1.0, 0.05)
    joints = cj.Revolute("p", "ground", "parent", motion=push), cj.Revolute("q", "parent", "link")
    spun = cj.Mechanism(
        (*bodies, cj.Body("rotor", 1.0, rotor)),
        (*joints, cj.Revolute("spin", "parent", "rotor")),
        couplings=(cj.Coupling("reducer", "spin", "q", ratio),),
    )
    both = 0.05 + ratio * rotor
    exact = np.linalg.solve([[0.25 + rotor, both], [both, 0.05 + ratio**2 * rotor]], [1, 0])
    assert exact == pytest.approx([4.29793, -1.46130], abs=5e-6)
    np.testing.assert_allclose(slope(NOW, initial_values(spun), spun.prepare())[2:], exact, rtol=1e-12)
    # The reflected inertia alone leaves out the coupling with the parent.
    heavy = cj.Revolute("q", "parent", "link", motion=cj.Motion(rotor_inertia=ratio**2 * rotor))
    bodies = cj.Body("parent", 1.0, 0.2 + rotor), bodies[1]  # which turns with the rotor's housing
    seen = cj.Mechanism(bodies, (joints[0], heavy))
    reflected = slope(NOW, initial_values(seen), seen.prepare())[2:]
    assert np.asarray(reflected) == pytest.approx([4.28553, -1.42851], abs=1.5e-5)
