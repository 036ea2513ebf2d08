"""A start at the wall in space: equilibria by hand, the reactions of the ideal joints, motions, derivatives."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.quantities import evaluate
from clearance_jax.dynamics.reactions import joint_reactions
from clearance_jax.dynamics.seated import play_mobility, play_moves
from clearance_jax.dynamics.settled import settle_start
from clearance_jax.joints.seating import SeatLoad, pose_at, relative_at, seat
from clearance_jax.joints.sleeve import lobatto
from clearance_jax.mechanism.state import layout, move
from clearance_jax.solve.first_state import initial_state

RADIAL, AXIAL, RADIUS, LENGTH, STIFFNESS = 1e-4, 5e-5, 0.01, 0.04, 1e12
SCALES = [RADIAL, RADIAL, AXIAL, 2 * RADIAL / LENGTH, 2 * RADIAL / LENGTH]


def sleeve(pin="through", normal=None, friction=None, axial=AXIAL):
    normal = laws.Hertz(STIFFNESS) if normal is None else normal
    return cj.SleeveClearance(RADIAL, RADIUS, LENGTH, normal, friction, axial_clearance=axial, pin=pin)


def triple(vector):
    return tuple(jnp.asarray(x, float) for x in vector)


@jax.jit
def seated(clearance, force, moment):
    start = jnp.zeros(len(clearance.joint.play()))
    return seat(clearance, SeatLoad(triple(force), triple(moment)), start)


def pressed(joint, force, moment=(0.0, 0.0, 0.0)) -> np.ndarray:
    """The play at rest under what the sleeve exerts on the pin, which the contact does exert there."""
    clearance = joint.prepare()
    play = joint.play()
    found, presses, left, _ = seated(clearance, jnp.asarray(force), jnp.asarray(moment))
    assert bool(presses)
    assert float(left) < 1e-6
    action, axes = clearance.act(relative_at(play, found), ()), pose_at(play, found).axes
    asked = SeatLoad(triple(force), triple(moment)).along(play, axes)
    size = np.array([float(one.scale) for one in play])
    error = size * (SeatLoad(action.force, action.torque).along(play, axes) - asked)
    # But for a pin's edges, which press along a tilted pin: what that gives axially nothing bears.
    assert np.abs(error).max() < 1e-3 * np.abs(size * asked).max()
    return np.asarray(found)


def depth(force):
    """Of the whole law."""
    return (force / STIFFNESS) ** (2 / 3)


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_a_force_through_the_middle_presses_all_stations_alike(pin):
    found = pressed(sleeve(pin), (-30.0, 40.0, 0.0))
    expected = (RADIAL + depth(50.0)) * np.array([0.6, -0.8])
    np.testing.assert_allclose(found[:2], expected, rtol=1e-12)
    # No load along the axis: in the middle, as it was.
    np.testing.assert_allclose(found[2:] / SCALES[2:], 0.0, atol=1e-9)


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_a_force_at_a_lever_beyond_the_sleeve_bears_on_both_edges(pin):
    """N1 - N2 = F and (N1 + N2) L / 2 = F a; the tilt is 2 c / L, and what the edges give way."""
    force, lever = 20.0, 0.1
    x, y, tilt_x, tilt_y = pressed(sleeve(pin, axial=None), (-force, 0.0, 0.0), (0.0, -force * lever, 0.0))
    share = lobatto(8)[1][0]
    near, far = (depth(force * (lever / LENGTH + side) / share) for side in (0.5, -0.5))
    assert tilt_y > 2 * RADIAL / LENGTH
    assert np.tan(tilt_y) * LENGTH - 2 * RADIAL == pytest.approx(near + far, rel=1e-3)
    # Nearer to the load the pin lies on the one side, beyond the middle on the other.
    assert x == pytest.approx((near - far) / 2, rel=1e-3)
    np.testing.assert_allclose([y / RADIAL, tilt_x / SCALES[3]], 0.0, atol=1e-9)


@pytest.mark.slow
def test_faces_balls_and_blocks_are_pressed_as_deep_as_they_bear():
    along = pressed(sleeve(), (0.0, 0.0, 7.0))
    np.testing.assert_allclose(along / SCALES, [0, 0, -1 - depth(7.0) / AXIAL, 0, 0], rtol=1e-12, atol=1e-9)
    ball = cj.SphericalClearance(RADIAL, RADIUS, laws.Hertz(STIFFNESS))
    np.testing.assert_allclose(
        pressed(ball, (2.0, -1.0, 2.0)), (RADIAL + depth(3.0)) * np.array([-2, 1, -2]) / 3, rtol=1e-12
    )
    # Two corners of a block bear where its side lies flat (four of one in space); a moment turns it from wall to wall.
    flat = cj.GuideClearance(1e-3, 0.1, 0.05, laws.Hertz(STIFFNESS))
    np.testing.assert_allclose(pressed(flat, (8.0, 0.0, 0.0)), [-1e-3 - depth(4.0), 0.0], rtol=1e-9, atol=1e-9)
    turned = pressed(flat, (0.0, 0.0, 0.0), (0.0, 0.4, 0.0))
    # At the corner: half the length times the sine, half the height times the cosine.
    sine, cosine = np.sin(turned[1]), np.cos(turned[1])
    reach = 0.05 * abs(sine) + 0.025 * cosine - 0.025
    assert turned[1] < 0
    assert reach == pytest.approx(1e-3 + depth(0.4 / (0.1 * cosine - 0.05 * abs(sine))), rel=1e-9)
    box = cj.GuideClearance(1e-3, 0.1, 0.05, laws.Hertz(STIFFNESS), width=0.06)
    aside = pressed(box, (8.0, 0.0, 0.0))
    np.testing.assert_allclose(aside / [1e-3, 1e-3, 0.02, 0.02, 0.03], [-1 - depth(2.0) / 1e-3, 0, 0, 0, 0], atol=1e-9)


@pytest.mark.slow
def test_loads_of_all_sizes_and_directions_find_their_place():
    """From grams to tons, through the middle or far from it: `pressed` checks each against the contact's own wrench."""
    rng = np.random.default_rng(2)
    for joint in (sleeve("through"), sleeve("inside", laws.AdamsImpact(1e11, 1.0, 1e-5))):
        for _ in range(40):
            size, lever = 10 ** rng.uniform(-2, 4), 10 ** rng.uniform(-4, -1)
            force = size * rng.normal(size=3)
            pressed(joint, force, size * lever * rng.normal(size=3))


def test_what_nothing_presses_is_said_to_be_free():
    place, presses, left, _ = seated(sleeve().prepare(), jnp.zeros(3), jnp.asarray([0.0, 0.0, 5.0]))
    assert not bool(presses)
    np.testing.assert_array_equal(place, 0.0)
    assert float(left) == 0


def test_a_search_that_finds_no_rest_says_so():
    """700 kN at a lever of 0.7 m on a block so soft that it turns over: its walls cannot hold that."""
    box = cj.GuideClearance(1e-3, 0.1, 0.05, laws.Hertz(1e9), width=0.06).prepare()
    lost = seated(box, jnp.asarray([7e5, 0.0, 0.0]), jnp.asarray([0.0, 4.9e5, 0.0]))
    assert float(lost.left) > 0.1
    # A hundredth of it is held.
    assert float(seated(box, jnp.asarray([7e3, 0.0, 0.0]), jnp.asarray([0.0, 4.9e3, 0.0])).left) < 1e-9


@pytest.mark.slow
def test_a_start_that_cannot_be_settled_is_refused():
    """A block that hangs 0.7 m beside its soft guide: 1 kg is held, of 2 t nothing is, and under 7 t it turns on from
    round to round.
    """
    box = cj.GuideClearance(1e-3, 0.1, 0.05, laws.HuntCrossley(1e7, 0.0, 1.0), width=0.06)
    body = cj.Body("block", 1.0, cj.Inertia(9.0, 9.0, 9.0), cj.Position(y=0.7))
    slide = cj.Prismatic("guide", "ground", "block", axis="z", motion=cj.Motion(cj.drives.Constant(0.0)), clearance=box)
    light = cj.Mechanism((body,), (slide,), gravity=cj.Gravity(x=-9.81))
    assert bool(cj.simulate(light, 1e-6, start="settled").succeeded)
    for mass in (2e3, 7e3):
        heavy = cj.replace(light, {"block.mass": mass})
        with refused("guide"):
            cj.simulate(heavy, 1e-6, start="settled")
        assert "or settled" in cj.simulate(heavy, 1e-6, start="settled", throw=False).message


def arm(clearance, drive=None, **changed) -> cj.Mechanism:
    """An arm on a level pin, its centre of mass beside the sleeve."""
    body = cj.Body("arm", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, 0.02))
    motion = cj.Motion(cj.drives.Harmonic(0.35, 30.0) if drive is None else drive)
    hip = cj.Revolute("hip", "ground", "arm", motion=motion, clearance=clearance, axis="y")
    gravity = cj.Gravity(**({"x": 1.0, "y": 2.0, "z": -9.81} | changed))
    return cj.Mechanism((body,), (hip,), points=(cj.Point("tip", "arm", cj.Position(0.4)),), gravity=gravity)


SOFT = laws.HuntCrossley(1e9, 0.5)


def accelerations(mechanism, time, y):
    prepared = mechanism.prepare()
    return jax.jit(lambda y: slope(jnp.asarray(time), y, prepared)[layout(mechanism).v])(y)


@pytest.mark.slow
def test_an_arm_starts_at_rest_where_its_weight_presses_it():
    """Still, of a law with memory and friction with bristles: all forces balance, and what bears is said to touch."""
    law, friction = laws.exact_restitution(1e9, 0.7), laws.LuGre(0.4, 0.3, 1e-3, 1e5, 1e-2, 0.0)
    m = arm(sleeve(normal=law, friction=friction), cj.drives.Constant(0.0))
    y = initial_state(m.prepare(), jnp.zeros(()), "settled")
    np.testing.assert_allclose(accelerations(m, 0.0, y), 0.0, atol=1e-9)
    np.testing.assert_allclose(y[5:10], 0.0, atol=1e-12)
    plan, (joint,) = layout(m), m.prepare().clearance_joints()
    points = joint.clearance.joint.points(relative_at(joint.joint.play(), y[:5]))
    touching = [float(y[plan.index("hip", f"touching_{i + 1}")]) for i in range(16)]
    np.testing.assert_array_equal(touching, points.penetration > 0)
    assert 0 < sum(touching) < 16


@pytest.mark.slow
def test_a_moving_arm_rides_along_the_walls_and_has_derivatives():
    m, now = arm(sleeve(normal=SOFT)), jnp.asarray(0.02)

    def begin(time, radial):
        return initial_state(cj.replace(m, {"hip.radial_clearance": radial}).prepare(), time, "settled")

    start = jax.jit(begin)
    y = start(now, RADIAL)
    # What starts a moment later has gone on from what starts now, with the speed that this has.
    later, before = (start(now + h, RADIAL) for h in (1e-6, -1e-6))
    np.testing.assert_allclose((later - before)[:5] / 2e-6, y[5:10], rtol=1e-6, atol=1e-9)
    # What is left accelerates as riding pins do, and not as ones that fall.
    fallen = accelerations(m, now, initial_state(m.prepare(), now))
    assert np.abs(accelerations(m, now, y)[:3]).max() < 1e-3 * np.abs(fallen[:3]).max()
    found = jax.jit(jax.jacfwd(begin, 1))(now, RADIAL)
    step = 1e-4 * RADIAL
    difference = (start(now, RADIAL + step) - start(now, RADIAL - step)) / (2 * step)
    np.testing.assert_allclose(found, difference, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_a_pin_that_starts_at_its_wall_hits_nothing():
    """It bears from the first instant what it bears a moment later; one that falls hits twice as hard."""
    m = arm(sleeve(normal=SOFT), cj.drives.StepSum([0.0], [0.5], [0.35]))
    prepared, forces = m.prepare(), {}
    for word in ("centre", "settled"):
        y = initial_state(prepared, jnp.zeros(()), word)
        s = cj.simulate(m, 0.03, y0=y, save_at=301, rtol=1e-7)
        forces[word] = np.asarray(s["hip.contact_force"])
        assert float(s.energy_residual) < 1e-6
    settled = forces["settled"]
    np.testing.assert_allclose(settled, settled[0], rtol=1e-2)
    assert forces["centre"][0] == 0
    assert forces["centre"].max() > 2 * settled.max()


@pytest.mark.slow
def test_the_tool_changer_starts_settled():
    m, zero = cj.load("experiments/scenes/tool_changer.toml"), jnp.zeros(())
    y = initial_state(m.prepare(), zero, "settled")
    left, fallen = (accelerations(m, 0.0, state) for state in (y, initial_state(m.prepare(), zero)))
    assert np.abs(left[:3]).max() < 1e-2 * np.abs(fallen[:3]).max()
    reaction = joint_reactions(m.prepare(), zero, jnp.zeros(0))["joint5"]
    # The moment of what hangs 20 mm beside the arm, 300 kg of 400: under weight and the start of the motion.
    at = y[:5] / np.array([1e-4, 1e-4, 1e-4, 2e-4 / 0.06, 2e-4 / 0.06])
    assert float(reaction.on_pin[1]) > 6000
    assert at[1] < -1
    assert float(reaction.turning[0]) * float(at[3]) < 0


@pytest.mark.slow
def test_a_loop_settles_as_the_tree_does():
    """A plate that carries an arm on a sleeve: by the sleeve's own coordinates, or by those of a floating body."""
    tree = arm(sleeve(normal=SOFT))
    motor = cj.Revolute("motor", "ground", "plate", axis="x", motion=cj.Motion(cj.drives.StepSum([0.0], [0.1], [0.35])))
    hip = cj.Revolute("hip", "plate", "arm", clearance=sleeve(normal=SOFT))
    bodies = (cj.Body("plate"), *tree.bodies)
    one = cj.Mechanism(bodies, (motor, hip), points=tree.points, gravity=tree.gravity)
    other = cj.Mechanism(
        bodies, (motor, cj.Free("float", "ground", "arm")), (hip,), points=tree.points, gravity=tree.gravity
    )
    found = []
    for m in (one, other):
        prepared = m.prepare()
        y = initial_state(prepared, jnp.zeros(()), "settled")
        found.append([evaluate(word, jnp.zeros(()), y, prepared)[0] for word in ("position", "velocity")])
    # By how much the arm turns about its pin as it tilts is free: of second order in the tilt, and so the load.
    tilt = abs(float(found[0][0][2])) / 0.4
    assert 1e-3 < tilt < 1e-2
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_allclose(ours[2], theirs[2], rtol=tilt)
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=0, atol=0.4 * tilt**2)


@pytest.mark.slow
def test_a_robot_settles_with_play_in_all_its_joints():
    """Thirty coordinates of play: what is left accelerates a thousand times less than what falls."""
    robot = cj.load_urdf("experiments/scenes/six_axes.urdf", end_effector="tcp")
    moves = {f"axis_{i}": cj.drives.Quintic([0.0, 0.5, 1.0], [0.0, 0.1 * i, 0.0]) for i in range(1, 7)}
    loose = robot.with_drives(
        moves | {"finger_left": cj.drives.Constant(0.02), "finger_right": cj.drives.Constant(0.02)}
    )
    for name in moves:
        loose = loose.with_clearance(
            name, kind="sleeve", radial_clearance=5e-5, axial_clearance=1e-4, length=0.04, pin_radius=0.015
        )
    now = jnp.asarray(0.1)
    left, fallen = (
        np.abs(accelerations(loose, now, initial_state(loose.prepare(), now, word)).reshape(6, 5)[:, :3]).max()
        for word in ("settled", "centre")
    )
    assert left < 1e-3 * fallen


@pytest.mark.slow
def test_blocks_and_balls_settle_too():
    """A block under an eccentric weight in a plane guide, and a ball that swings: the forces are those by hand."""
    guide = cj.GuideClearance(1e-4, 0.1, 0.05, SOFT)
    slide = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.5), clearance=guide)
    block = cj.Mechanism((cj.Body("block", 1.0, 2e-3, cj.Position(0.08)),), (slide,), gravity=cj.Gravity(y=-9.81))
    y = initial_state(block.prepare(), jnp.zeros(()), "settled")
    np.testing.assert_allclose(accelerations(block, 0.0, y), 0.0, atol=1e-6)
    # Closing a loop it settles there too, of a block that floats.
    float_ = cj.Planar("float", "ground", "block", slide_x=cj.Motion(velocity=0.5))
    loop = cj.Mechanism(
        block.bodies, (float_,), (cj.Prismatic("guide", "ground", "block", clearance=guide),), gravity=block.gravity
    )
    np.testing.assert_allclose(initial_state(loop.prepare(), jnp.zeros(()), "settled"), y, atol=1e-9)
    # Two corners on opposite walls: N1 - N2 = m g, and the moment is m g 80 mm over a length of 100 mm.
    joint = block.prepare().clearance_joints()[0]
    points = joint.clearance.joint.points(relative_at(joint.joint.play(), y[1:3]))
    borne = 1e9 * np.maximum(np.asarray(points.penetration), 0) ** 1.5
    np.testing.assert_allclose(np.sort(borne), [0, 0, 9.81 * 0.3, 9.81 * 1.3], rtol=1e-2, atol=1e-6)
    spin = cj.Ball(spin=cj.Spin(y=2.0))
    ball = cj.Spherical("hip", "ground", "arm", motion=spin, clearance=cj.SphericalClearance(RADIAL, RADIUS, SOFT))
    swing = cj.Mechanism(
        (cj.Body("arm", 1.0, cj.Inertia(2e-3, 2e-3, 2e-3), cj.Position(0.3)),), (ball,), gravity=cj.Gravity(z=-9.81)
    )
    y, plan = initial_state(swing.prepare(), jnp.zeros(()), "settled"), layout(swing)
    assert np.abs(accelerations(swing, 0.0, y)[:3]).max() < 1e-3
    # Of a pendulum that lies level: m g I / (I + m l^2) upwards, m l w^2 inwards.
    up, inward = 9.81 * 2e-3 / (2e-3 + 0.09), 0.3 * 4.0
    np.testing.assert_allclose(
        y[:3] / np.linalg.norm(y[:3]), -np.array([-inward, 0, up]) / np.hypot(up, inward), atol=1e-3
    )
    np.testing.assert_allclose(y[plan.v][3:], [0, 2, 0], atol=1e-12)


def seated_frequency(mechanism, time, y):
    """The lowest frequency of a seated pose [Hz]: the root of the least eigenvalue of -A over 2 pi, where A is the
    derivative of the play coordinates' accelerations by the play coordinates. It includes weight, springs and the
    mechanism's own motion. 0 where the pose is not stable, or where nothing holds a coordinate.
    """
    plan = layout(mechanism)
    state = plan.split(y)
    ways, moves = play_moves(mechanism, time, y)

    def accelerations(change):
        q = jnp.stack([jnp.asarray(x, float) for x in move(mechanism, state.q, list(moves @ change))])
        return ways @ slope(time, y.at[plan.q].set(q), mechanism)[plan.v]

    stiff = -jax.jacfwd(accelerations)(jnp.zeros(len(ways)))
    inverse = play_mobility(mechanism, time, y)
    # -A M^-1 = M^-1 K M^-1 is symmetric, and so is what the Cholesky factors of M^-1 make of it.
    lower = jnp.linalg.cholesky(inverse)
    whole = jnp.linalg.solve(lower, jnp.linalg.solve(lower, stiff @ inverse).T)
    return jnp.sqrt(jnp.maximum(jnp.linalg.eigvalsh(0.5 * (whole + whole.T))[0], 0.0)) / (2 * jnp.pi)


@eqx.filter_jit
def begun(mechanism):
    """How a robot starts: the rest flags, the lowest frequency as the start has it and as the whole field has it, the
    tool's speed by play, and by how much play in units of its size moves the tool.
    """
    ready, now = mechanism.prepare(), jnp.zeros(())
    plan = layout(ready)
    y, errors = settle_start(now, ready)

    def tool(v):
        return evaluate("velocity", now, y.at[plan.v].set(v), ready)[0]

    sizes = jnp.stack([one.scale for joint in ready.clearance_joints() for one in joint.joint.play()])
    moves = jnp.sum(jnp.abs(jax.jacfwd(tool)(y[plan.v])) * sizes[None, :], axis=1)
    exact = seated_frequency(ready, now, y)
    assert errors.seated is not None
    return errors.seated, exact, jnp.linalg.norm(tool(y[plan.v]) - tool(0 * y[plan.v])), jnp.linalg.norm(moves)


@pytest.mark.slow
@pytest.mark.large
def test_lightly_loaded_sleeves_of_a_robot_begin_at_relative_rest():
    """Quintics from rest: where a sleeve's place of rest outruns it, the tool must not start at 0.5 m/s."""
    rng, rested = np.random.default_rng(1), []
    robot = cj.load_urdf("experiments/scenes/six_axes.urdf", end_effector="tcp")
    for _ in range(8):
        at = np.radians(rng.uniform(-1, 1, 6) * [170, 60, 120, 180, 110, 180])
        by = at + np.radians(rng.uniform(-15, 15, 6))
        moves = {f"axis_{i + 1}": cj.drives.Quintic([0.0, 0.25], [at[i], by[i]]) for i in range(6)}
        loose = robot.with_drives(
            moves | {"finger_left": cj.drives.Constant(0.02), "finger_right": cj.drives.Constant(0.02)}
        )
        for name, radial, length, pin in (
            ("axis_2", 3e-5, 0.08, 0.03),
            ("axis_3", 3e-5, 0.06, 0.025),
            ("axis_5", 2e-5, 0.04, 0.015),
        ):
            loose = loose.with_clearance(name, kind="sleeve", radial_clearance=radial, length=length, pin_radius=pin)
        seated, exact, speed, reach = begun(loose)
        assert float(speed) <= min(0.05, 2 * np.pi * float(exact) * float(reach))
        # The start leaves out what weight adds to the stiffness of contacts: a pendulum's g / l, of 0.85 m of reach.
        squares = (2 * np.pi * np.array([float(seated.frequency), float(exact)])) ** 2
        assert abs(squares[0] - squares[1]) <= 9.81 / 0.85
        rested.append(np.asarray(seated.rest))
    # Some ride along, some do not: the rule is no switch for all.
    assert 0 < np.mean(rested) < 1


@pytest.mark.slow
def test_lanes_of_settled_starts_in_space_are_those_alone():
    """The search for tilted pins, over lanes; quintics from rest, of which the faster ones leave the pin at rest."""
    m = arm(dataclasses.replace(sleeve(normal=SOFT), stations=2), cj.drives.Quintic([0.0, 0.1], [0.0, 0.1]))

    def start(rise):
        moved = m.with_drives({"hip": cj.drives.Quintic([0.0, 0.1], jnp.stack([0.0 * rise, rise]))})
        return settle_start(jnp.zeros(()), moved.prepare())

    rises = jnp.asarray([0.0, 1e-3, 1e-2, 0.1, 1.0])
    single = jax.jit(start)
    alone = jax.tree.map(lambda *x: np.stack(x), *[single(rise) for rise in rises])
    together = jax.jit(jax.vmap(start))(rises)
    np.testing.assert_array_equal(together[1].seated.rest, alone[1].seated.rest)
    assert 0 < np.mean(alone[1].seated.rest) < 1
    for ours, theirs in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


def leg() -> cj.Mechanism:
    """A leg of a Unitree Go2 by its published masses, its foot part of the calf; play in two joints, held by drives."""
    bodies = (
        cj.Body("hip_link", 0.678, cj.Inertia(4.8e-4, 8.8e-4, 6e-4), cj.Position(-0.0054, 0.00194, -0.000105)),
        cj.Body("thigh_link", 1.152, cj.Inertia(5.84e-3, 5.8e-3, 1.03e-3), cj.Position(-0.00374, -0.0223, -0.0327)),
        cj.Body("calf_link", 0.194, cj.Inertia(1.6e-3, 1.6e-3, 4e-5), cj.Position(0.0044, -0.0008, -0.135)),
    )
    still = cj.Motion(cj.drives.Constant(0.0))
    play = cj.SleeveClearance(RADIAL, RADIUS, 0.02, laws.Hertz(1e11), axial_clearance=AXIAL)
    joints = (
        cj.Revolute("hip", "ground", "hip_link", axis="x", motion=still),
        cj.Revolute(
            "thigh", "hip_link", "thigh_link", axis="y", at_parent=cj.Position(y=0.0955), motion=still, clearance=play
        ),
        cj.Revolute(
            "calf", "thigh_link", "calf_link", axis="y", at_parent=cj.Position(z=-0.213), motion=still, clearance=play
        ),
    )
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(z=-9.81))


@pytest.mark.slow
def test_a_moment_that_passes_through_zero_within_the_play_is_settled():
    """A leg's calf hangs nearly straight: its pin tilts until its weight bears no moment. The whole vector field, with
    the contacts' own forces, does not move it. (With its load taken as given the pin leapt from wall to wall: eight of
    150 such postures were refused.)
    """
    m, rng = leg(), np.random.default_rng(5)

    @jax.jit
    def begin(m):
        y, errors = settle_start(jnp.zeros(()), m)
        return errors, slope(jnp.zeros(()), y, m)[layout(m).v]

    for k in range(40):
        # Every second leg hangs straight down from its hip, every fourth thigh too, every eighth calf.
        angles = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-1.5, 3.5), rng.uniform(-2.7, -0.84)])
        angles[[k % 2 == 0, k % 4 == 0, k % 8 == 0]] = 0.0
        changed = {f"drive.{name}.value": x for name, x in zip(("hip", "thigh", "calf"), angles, strict=True)}
        for name in ("thigh", "calf"):
            play = 10 ** rng.uniform(-5, -2.8)
            length = {f"{name}.length": 10 ** rng.uniform(-2.2, -1.4)}
            changed |= {f"{name}.radial_clearance": play, f"{name}.axial_clearance": play} | length
        errors, left = begin(cj.replace(m, changed).prepare())
        assert float(jnp.max(errors.unborne)) < 1e-4, k
        assert float(jnp.max(errors.moved)) < 1e-6, k
        # Of a gravity of 9.8 m/s^2, and of turns of some hundred rad/s^2.
        np.testing.assert_allclose(left, 0.0, atol=0.2, err_msg=str(k))


@pytest.mark.slow
def test_the_arm_with_play_in_six_joints_settles_under_a_load_that_passes_through_zero():
    """Its last sleeve bears its tool's moment about one axis; about the other the moment changes its sign within the
    play, and so leapt from side to side: 93 % of the play from round to round.
    """
    m = cj.load("experiments/scenes/robot_arm.toml")
    y, errors = jax.jit(settle_start)(jnp.zeros(()), m.prepare())
    assert float(jnp.max(errors.moved)) < 1e-6
    left = accelerations(m, 0.0, y).reshape(6, 5)
    np.testing.assert_allclose(left[:, :3], 0.0, atol=0.02)
