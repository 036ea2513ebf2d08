"""The vector field against Lagrange's equations, its kinematics against derivatives, its reactions against balance."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics import equations
from clearance_jax.dynamics.field import energies, slope
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.solve.first_state import closed_start

GRAVITY = cj.Gravity(0.7, -9.81)


def at(x, y):
    return cj.Position(x, y)


def tree() -> cj.Mechanism:
    """Everything a tree may hold: turn, slide, driven slide, a clearance joint, a weld and springs, no loss."""
    hertz = cj.RevoluteClearance(2e-3, 0.01, laws.Hertz(1e6))
    return cj.Mechanism(
        bodies=(
            cj.Body("arm", 1.3, 0.05, at(0.3, 0.02)),
            cj.Body("carriage", 0.7, 0.02, at(-0.05, 0.1)),
            cj.Body("ram", 0.4, None, at(0.01, 0.02)),
            cj.Body("rod", 0.9, 0.03, at(0.2, -0.04)),
            cj.Body("tip", 0.2, 0.001, at(0.05, 0.0)),
        ),
        joints=(
            cj.Revolute("shoulder", "ground", "arm", at(0.1, 0.2), motion=cj.Motion(cj.drives.Harmonic(0.6, 5.0, 0.3))),
            cj.Prismatic("slide", "arm", "carriage", at(0.5, 0.0), at(0.02, -0.03), jnp.asarray(0.4)),
            cj.Prismatic("press", "carriage", "ram", at(0.0, 0.1), motion=cj.Motion(cj.drives.Harmonic(0.05, 9.0))),
            cj.Revolute("pin", "carriage", "rod", at(0.1, 0.05), at(0.01, 0.02), jnp.asarray(-0.7), clearance=hertz),
            cj.Fixed("weld", "rod", "tip", at(0.4, 0.1), at(0.0, 0.01), jnp.asarray(1.1)),
        ),
        springs=(
            cj.Spring("s", "ground", "tip", 40.0, 0.0, 0.3, at(0.2, -0.5), at(0.03, 0.02)),
            cj.Spring("between", "arm", "rod", 25.0, 0.0, 0.1, at(0.2, 0.1), at(0.1, 0.0)),
        ),
        points=(cj.Point("end", "tip", at(0.1, 0.05)), cj.Point("corner", "carriage", at(0.1, 0.1))),
        gravity=GRAVITY,
    )


def states(mechanism, count, seed=0):
    """Random times and states; the pin of a clearance joint lies anywhere within 1.5 clearances."""
    rng = np.random.default_rng(seed)
    plan = layout(mechanism)
    y = rng.uniform(-1, 1, (count, plan.size))
    for i, name in enumerate(plan.positions):
        if ".play" in name:
            y[:, i] *= 2e-3
    return jnp.asarray(rng.uniform(0, 2, count)), jnp.asarray(y)


def lagrangian_acceleration(mechanism, time, y):
    """Accelerations by Lagrange's equations, from the energies alone."""
    n = layout(mechanism).free

    def lagrangian(t, q, v):
        e = energies(t, jnp.concatenate([q, v]), mechanism)
        return e.kinetic - e.potential - e.elastic

    q, v = y[:n], y[n:]
    momentum = jax.grad(lagrangian, 2)
    mass = jax.jacfwd(momentum, 2)(time, q, v)
    convected = jax.jvp(lambda t, q: momentum(t, q, v), (time, q), (jnp.ones_like(time), v))[1]
    return jnp.linalg.solve(mass, jax.grad(lagrangian, 1)(time, q, v) - convected)


@pytest.mark.slow
def test_accelerations_are_lagranges():
    m = tree().prepare()
    t, y = states(m, 200)
    n = layout(m).free
    got = np.asarray(jax.jit(jax.vmap(lambda t, y: slope(t, y, m)[n:]))(t, y))
    expected = np.asarray(jax.jit(jax.vmap(lambda t, y: lagrangian_acceleration(m, t, y)))(t, y))
    touching = np.hypot(*np.asarray(y[:, 1:3]).T) > 2e-3
    assert 20 < touching.sum() < 180
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.slow
def test_velocities_and_accelerations_are_derivatives():
    m = tree().prepare()
    t, y = states(m, 50, seed=1)

    def along(what):
        """A quantity's rate along the motion."""

        def derivative(t, y):
            return jax.jvp(lambda t, y: observe(t, y, m)[what], (t, y), (jnp.ones_like(t), slope(t, y, m)))[1]

        return jax.jit(jax.vmap(derivative))(t, y)

    seen = jax.jit(jax.vmap(lambda t, y: observe(t, y, m)))(t, y)
    for quantity, its_rate in (("position", "velocity"), ("velocity", "acceleration"), ("q", "v")):
        expected = np.asarray(seen[its_rate])
        np.testing.assert_allclose(along(quantity), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def through_the_factors(motion, pairs, efforts):
    own = equations._equations(motion)
    return own.solve(*equations._right_sides(motion, pairs, efforts, own.conditions))


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "second"), [("tool_changer", False), ("squeezer", True), ("bennett", False)])
def test_accelerations_have_the_derivatives_that_go_through_the_factors(scene, second, monkeypatch):
    """A tree in space, ideal closures in the plane, closures that repeat each other: forward and reverse, and twice."""
    mechanism = cj.load(SCENES / f"{scene}.toml").prepare()
    rng = np.random.default_rng(1)
    numbers, rest = eqx.partition(mechanism, eqx.is_inexact_array)
    y = jnp.asarray(initial_values(mechanism) + 1e-5 * rng.standard_normal(layout(mechanism).size))
    ways = jax.tree.map(lambda x: jnp.asarray(x * rng.standard_normal(x.shape)), (numbers, y))
    weights = jnp.asarray(rng.standard_normal(y.shape))

    def all_derivatives():
        def rates(at):
            return slope(jnp.asarray(1e-3), at[1], eqx.combine(at[0], rest))

        def along(at):
            return jax.jvp(rates, (at,), (ways,))[1]

        def twice(at):
            return jax.jvp(along, (at,), (ways,))[1]

        at = numbers, y
        pulled = jax.grad(lambda at: weights @ rates(at))(at)
        # By what each number is moved: so they are of one unit, and of one size as far as they matter.
        moved = [jnp.ravel(g * way) for g, way in zip(*map(jax.tree.leaves, (pulled, ways)), strict=True)]
        return rates(at), along(at), twice(at) if second else 0.0, jnp.concatenate(moved)

    ours = jax.jit(all_derivatives)()
    monkeypatch.setattr(equations, "_solve", through_the_factors)
    theirs = jax.jit(lambda: all_derivatives())()
    np.testing.assert_array_equal(ours[0], theirs[0])
    for a, b in zip(ours[1:], theirs[1:], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.max(np.abs(b)))


def test_power_of_the_drives_is_the_rate_of_energy():
    m = tree().prepare()
    t, y = states(m, 50, seed=2)

    def energy(t, y):
        return energies(t, y, m).total

    gained = jax.jit(jax.vmap(lambda t, y: jax.jvp(energy, (t, y), (jnp.ones_like(t), slope(t, y, m)))[1]))(t, y)
    seen = jax.jit(jax.vmap(lambda t, y: observe(t, y, m)))(t, y)
    names = [c.name for c in m.coordinates()]
    speeds = np.asarray(seen["v"])[:, [names.index("shoulder"), names.index("press")]]
    work = np.sum(np.asarray(seen["drive_force"]) * speeds, 1)
    np.testing.assert_allclose(work, gained, rtol=0, atol=1e-11 * np.abs(work).max())


def test_reactions_balance_every_body():
    """Forces of all joints and springs on a body add up to mass times acceleration minus weight."""
    m = tree().prepare()
    t, y = states(m, 20, seed=3)
    points = tuple(cj.Point(f"centre_{b.name}", b.name, b.center_of_mass) for b in m.bodies)
    watched = dataclasses.replace(m, points=points)
    seen = jax.jit(jax.vmap(lambda t, y: observe(t, y, watched)))(t, y)

    def framed(t, y):
        motion = frames(m, t, layout(m).split(y))
        return [motion[b.name] for b in m.bodies]

    motion = jax.vmap(lambda t, y: {b.name: (f.position, f.angle) for b, f in zip(m.bodies, framed(t, y), strict=True)})
    placed = motion(t, y)

    def place(body, local):
        if body == "ground":
            return np.broadcast_to([local.x, local.y], (t.size, 2))
        (x, y0, _), angle = placed[body]
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([x + c * local.x - s * local.y, y0 + s * local.x + c * local.y], 1)

    forces = {
        b.name: -np.asarray(b.mass) * (np.asarray(seen["acceleration"])[:, i] - [0.7, -9.81])
        for i, b in enumerate(m.bodies)
    }
    scale = max(np.abs(f).max() for f in forces.values())
    for i, joint in enumerate(m.joints):
        reaction = np.asarray(seen["joint_reaction"])[:, i]
        forces[joint.child] = forces[joint.child] + reaction
        if joint.parent != "ground":
            forces[joint.parent] = forces[joint.parent] - reaction
    for spring in m.springs:
        span = place(spring.body_b, spring.at_b) - place(spring.body_a, spring.at_a)
        length = np.linalg.norm(span, axis=1, keepdims=True)
        pull = spring.stiffness * (length - spring.free_length) * span / length
        forces[spring.body_b] = forces[spring.body_b] - pull
        if spring.body_a != "ground":
            forces[spring.body_a] = forces[spring.body_a] + pull
    for left in forces.values():
        assert np.abs(left).max() <= 1e-11 * scale


def double_pendulum(closed: bool) -> cj.Mechanism:
    """Two links; `closed`: as two loose bodies, each with three coordinates, held by ideal loops."""
    bodies = (cj.Body("a", 1.0, 0.02, at(0.3, 0.0)), cj.Body("b", 0.7, 0.01, at(0.2, 0.05)))
    if not closed:
        joints = (
            cj.Revolute("p", "ground", "a", motion=cj.Motion(position=0.4, velocity=1.0)),
            cj.Revolute("q", "a", "b", at(0.6, 0.0), motion=cj.Motion(position=-0.9, velocity=-2.0)),
        )
        return cj.Mechanism(bodies, joints, gravity=GRAVITY)
    slides = tuple(cj.Body(f"{axis}_{b.name}") for b in bodies for axis in "xy")
    x, y = 0.6 * np.cos(0.4), 0.6 * np.sin(0.4)
    start = {"a": (0.0, 0.0, 0.4), "b": (x, y, -0.5)}
    speed = {"a": (0.0, 0.0, 1.0), "b": (-y, x, -1.0)}
    joints = []
    for name in "ab":
        motions = [cj.Motion(position=q, velocity=v) for q, v in zip(start[name], speed[name], strict=True)]
        joints += [
            cj.Prismatic(f"sx_{name}", "ground", f"x_{name}", motion=motions[0]),
            cj.Prismatic(f"sy_{name}", f"x_{name}", f"y_{name}", angle=np.pi / 2, motion=motions[1]),
            cj.Revolute(f"turn_{name}", f"y_{name}", name, angle=-np.pi / 2, motion=motions[2]),
        ]
    loops = (cj.Revolute("p", "ground", "a"), cj.Revolute("q", "a", "b", at(0.6, 0.0)))
    return cj.Mechanism((*slides, *bodies), tuple(joints), loops, gravity=GRAVITY)


@pytest.mark.slow
def test_ideal_loops_move_as_the_tree_and_do_not_drift():
    t = np.linspace(0, 2.0, 101)
    tree_angles = np.asarray(cj.simulate(double_pendulum(False), 2.0, save_at=t, rtol=1e-11, solver="dopri8").y)
    s = cj.simulate(double_pendulum(True), 2.0, save_at=t, rtol=1e-8)
    y = np.asarray(s.y)
    a, b = y[:, 2], y[:, 5]
    np.testing.assert_allclose(a, tree_angles[:, 0], atol=3e-7)
    np.testing.assert_allclose(b, tree_angles[:, 0] + tree_angles[:, 1], atol=3e-7)
    gap = np.concatenate([y[:, 0:2], y[:, 3:5] - y[:, 0:2] - 0.6 * np.stack([np.cos(a), np.sin(a)], 1)], 1)
    gap_rate = np.concatenate(
        [y[:, 6:8], y[:, 9:11] - y[:, 6:8] - 0.6 * y[:, 8:9] * np.stack([-np.sin(a), np.cos(a)], 1)], 1
    )
    assert np.abs(gap).max() < 1e-10
    assert np.abs(gap_rate).max() < 1e-10
    assert float(s.energy_residual) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("values", [{}, {"pin.radial_clearance": 1e-9}])
def test_two_million_times_smaller_play_has_the_same_mass(values):
    # The play coordinates are measured from the sleeve: their size does not touch the digits of the mass matrix.
    m = cj.replace(tree(), values).prepare()
    t, y = states(m, 5, seed=4)
    y = y.at[:, 1:3].set(0.0)
    n = layout(m).free
    got = jax.vmap(lambda t, y: slope(t, y, m)[n:])(t, y)
    expected = jax.vmap(lambda t, y: lagrangian_acceleration(m, t, y))(t, y)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def two_arms(*order):
    bodies = {"light": cj.Body("light", None, 1.0), "heavy": cj.Body("heavy", None, 100.0)}
    joints = tuple(
        cj.Revolute(f"to_{name}", "ground", name, motion=cj.Motion(cj.drives.Harmonic(1.0, 2.0))) for name in bodies
    )
    return cj.Mechanism(tuple(bodies[name] for name in order), joints)


@pytest.mark.slow
def test_drive_efforts_are_named_by_their_coordinates_whatever_the_order_of_the_bodies():
    for order in (("light", "heavy"), ("heavy", "light")):
        m = two_arms(*order)
        dataset = cj.to_dataset(m, cj.simulate(m, 1.0, save_at=3, rtol=1e-6))
        torque = dataset["drive_force"].sel(drive=["to_light", "to_heavy"]).values[1]
        np.testing.assert_allclose(torque, [-4 * np.sin(1.0), -400 * np.sin(1.0)], rtol=1e-12)


def test_a_coordinate_that_moves_nothing_is_refused():
    m = cj.Mechanism((cj.Body("a"),), (cj.Prismatic("slide", "ground", "a"),))
    with refused("slide"):
        cj.simulate(m, 1.0)


@pytest.mark.slow
def test_ideal_forgets_where_the_pin_started():
    from catalogue import slider_crank

    m = slider_crank()
    wrist = m.loops[0]
    off = cj.Revolute(
        "wrist",
        "conrod",
        "slider",
        wrist.at_parent,
        clearance=m.clearance_joints()[0].clearance,
        eccentricity=at(3e-4, 2e-4),
    )
    m = cj.Mechanism(m.bodies, m.joints, (off,))
    y = np.asarray(cj.simulate(m, 1e-5, save_at=2, rtol=1e-6).y)[0]
    # Axes of the conrod, at angle 0 at the start: the slider is off by the eccentricity, at rest in the sleeve.
    np.testing.assert_allclose(y[1] - 0.05 * np.cos(0) - 0.12 * np.cos(y[0]), 3e-4 * np.cos(y[0]) - 2e-4 * np.sin(y[0]))
    ideal = np.asarray(cj.simulate(m.ideal(), 1e-5, save_at=2, rtol=1e-6).y)[0]
    np.testing.assert_allclose(ideal[1], 0.17, rtol=1e-14)


@pytest.mark.parametrize("too_short", [0.0, 2e-5])
def test_assembly_leaves_pins_in_their_sleeves(too_short):
    """A four-bar with three clearances from a rough guess: its pins stay centred, and meet with the ideal speeds; a
    slider-crank near its toggle, a little out of reach: play alone can close it, and does.
    """
    if too_short:
        scene, values = "slider_crank_loaded.toml", {"guide.position": 0.17 + too_short, "main.position": 0.0}
    else:
        scene, values = "four_bar_loaded.toml", {}
    mechanism = cj.replace(cj.load(SCENES / scene), values)
    (loop,) = mechanism.loops
    if too_short:
        # A slider that is held where it is: only the play can give.
        guide = dataclasses.replace(
            mechanism.joint("guide"), motion=cj.Motion(cj.drives.ConstantSpeed(0.0, 0.17 + too_short))
        )
        joints = tuple(guide if joint.name == "guide" else joint for joint in mechanism.joints)
        mechanism = dataclasses.replace(mechanism, joints=joints)
    y, errors = closed_start(mechanism.prepare(), jnp.asarray(0.0))
    assert float(jnp.max(errors.loops)) <= 1e-12
    names = layout(mechanism).positions
    plays = np.array([y[i] for i, name in enumerate(names) if ".play_" in name])
    assert loop.clearance is not None
    np.testing.assert_allclose(np.abs(plays).max(), too_short, rtol=1e-2, atol=1e-10)


def test_a_pin_in_a_loop_that_another_joint_closes_begins_at_rest(tmp_path):
    """The rates of the loop take it along by less than what a motion is solved to."""
    scene, contact = (SCENES / "four_bar.toml").read_text(), "radial_clearance"
    knuckle = scene[scene.index(contact) : scene.index("[point.tip]")]
    moved = scene.replace(knuckle, "\n").replace('position = "45 deg"\n', f'position = "45 deg"\n{knuckle}')
    file = tmp_path / "scene.toml"
    file.write_text(moved)
    begin = cj.simulate(cj.load(file), 1e-6, save_at=jnp.zeros(1))
    speeds = [abs(float(begin[f"pivot.play_{axis}.velocity"][0])) for axis in "xy"]
    assert max(speeds) <= 1e-11 * abs(float(begin["tip.velocity"][0, 0]))
    assert float(begin["tip.velocity"][0, 0]) != 0.0
