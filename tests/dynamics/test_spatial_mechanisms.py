"""Mechanisms in space: against an independent Lagrangian, closed forms, and linkages that close in space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lagrangian import accelerations, inertia_tensor, random_state
from places import refused
from scipy.special import ellipj, ellipk
from spatial import arm, bennett, body, delta, four_bar, platform, zoo

import clearance_jax as cj
from clearance_jax.dynamics.conditions import conditions
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.state import layout
from clearance_jax.spatial import as_array


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: arm(3), lambda: arm(7), zoo], ids=["arm3", "arm7", "zoo"])
def test_field_agrees_with_lagrange(make):
    mechanism = make()
    plan, rng = layout(mechanism), np.random.default_rng(2)
    states = jnp.asarray([random_state(mechanism, rng) for _ in range(1000)])
    ours = jax.jit(jax.vmap(slope, (None, 0, None)))(jnp.asarray(0.3), states, mechanism.prepare())
    theirs = jax.jit(jax.vmap(lambda y: accelerations(mechanism, 0.3, y)))(states)
    size = np.max(np.abs(theirs), axis=1, keepdims=True)
    assert np.max(np.abs(ours[:, plan.v] - theirs) / size) < 1e-10


# Closed forms ---------------------------------------------------------------------------------------------------------


def axes_of(y, plan):
    """The rotation matrices (n, 3, 3) of a state's only quaternion."""
    w, x, y_, z = np.asarray(y)[
        :, [plan.positions.index(n) for n in plan.positions if n[-2:] in (".w", ".x", ".y", ".z")]
    ].T
    return np.moveaxis(
        np.array(
            [
                [1 - 2 * (y_**2 + z**2), 2 * (x * y_ - w * z), 2 * (x * z + w * y_)],
                [2 * (x * y_ + w * z), 1 - 2 * (x**2 + z**2), 2 * (y_ * z - w * x)],
                [2 * (x * z - w * y_), 2 * (y_ * z + w * x), 1 - 2 * (x**2 + y_**2)],
            ]
        ),
        -1,
        0,
    )


def test_free_body_turns_as_euler_says():
    """Spin by Jacobi's elliptic functions (Landau and Lifshitz, Mechanics, section 37); momenta, energy and the
    quaternion's length kept.
    """
    i1, i2, i3 = 1.0, 2.0, 3.0
    start = np.array([1.1, 0.0, 0.9])
    box = cj.Body("box", 2.0, (i1, i2, i3))
    spin = cj.Spin(*start)
    fly = cj.Free(
        "fly", "ground", "box", slide_x=cj.Motion(velocity=0.3), motion=cj.Ball(cj.Orientation(0.1, 0.2, 0.3), spin)
    )
    mechanism = cj.Mechanism((box,), (fly,))
    plan, times = layout(mechanism), np.linspace(0, 40, 201)
    solution = cj.simulate(mechanism, 40.0, save_at=times, rtol=1e-12, solver="dopri8")
    energy = (start**2 @ [i1, i2, i3]) / 2
    momentum2 = start**2 @ [i1**2, i2**2, i3**2]
    assert momentum2 > 2 * energy * i2  # it turns about the axis of its largest moment
    low, high = 2 * energy * i3 - momentum2, momentum2 - 2 * energy * i1
    rate, m = np.sqrt((i3 - i2) * high / (i1 * i2 * i3)), (i2 - i1) * low / ((i3 - i2) * high)
    sn, cn, dn, _ = ellipj(rate * times, m)
    sizes = np.sqrt([low / (i1 * (i3 - i1)), low / (i2 * (i3 - i2)), high / (i3 * (i3 - i1))])
    closed = sizes * np.stack([cn, sn, dn], 1)
    found = np.asarray(solution.y)[:, plan.v][:, 3:]
    np.testing.assert_allclose(found, closed, atol=1e-10)
    turned = axes_of(solution.y, plan)
    whole = np.einsum("nij,nj->ni", turned, found * [i1, i2, i3])
    np.testing.assert_allclose(whole, np.broadcast_to(whole[0], whole.shape), atol=1e-10)
    quaternion = np.asarray(solution.y)[:, 3:7]
    np.testing.assert_allclose(np.sum(quaternion**2, 1), 1.0, atol=1e-15)
    np.testing.assert_allclose(np.asarray(solution.y)[:, 0], 0.3 * times, atol=1e-12)


def cubic_motion(roots, rate, times):
    """U(t) from the middle root of u'^2 = rate (u - u1)(u - u2)(u - u3), where it starts at rest."""
    u1, u2, u3 = np.sort(roots.real)
    m, w = (u2 - u1) / (u3 - u1), np.sqrt(rate * (u3 - u1)) / 2
    return u1 + (u2 - u1) * ellipj(ellipk(m) + w * times, m)[0] ** 2


def test_heavy_top_nods_as_lagrange_says():
    """The cosine of the tilt by an elliptic function (Goldstein, Classical Mechanics, section 5.7)."""
    mass, arm_, i1, i3, tilt, spin, g = 1.5, 0.2, 0.08, 0.02, 0.5, 60.0, 9.81
    centre = i1 - mass * arm_**2  # about the centre of mass; i1 is about the tip
    top = cj.Body("top", mass, (centre, centre, i3), cj.Position(z=arm_))
    ball = cj.Spherical("tip", "ground", "top", motion=cj.Ball(cj.Orientation(roll=tilt), cj.Spin(z=spin)))
    mechanism = cj.Mechanism((top,), (ball,), gravity=cj.Gravity(z=-g))
    times = np.linspace(0, 2, 101)
    solution = cj.simulate(mechanism, 2.0, save_at=times, rtol=1e-12, solver="dopri8")
    a = i3 * spin / i1
    b, beta = a * np.cos(tilt), 2 * mass * g * arm_ / i1
    alpha = beta * np.cos(tilt)
    # (alpha - beta u)(1 - u^2) - (b - a u)^2
    roots = np.roots([beta, -alpha - a * a, -beta + 2 * a * b, alpha - b * b])
    u = axes_of(solution.y, layout(mechanism))[:, 2, 2]
    np.testing.assert_allclose(u, cubic_motion(roots, beta, times), atol=1e-10)
    # An orientation is printed by its rotation vector.
    said = " ".join(repr(solution).split())
    assert all(f"tip.{k} {float(solution[f'tip.{k}'][-1]):.5g} rad" in said for k in "xyz")


def test_spherical_pendulum_swings_as_its_cubic_says():
    """The height by an elliptic function (Landau and Lifshitz, Mechanics, section 14, problem 1)."""
    length, g, tilt, speed = 0.7, 9.81, 0.9, 2.0
    bob = cj.Body("bob", 0.3, center_of_mass=cj.Position(z=-length))
    # Starts level: at an end of its heights, with all its speed along the horizontal x axis of the second turn.
    cardan = cj.Universal(
        "pivot", "ground", "bob", turn_1=cj.Motion(position=tilt), turn_2=cj.Motion(velocity=-speed / length)
    )
    point = cj.Point("bob_centre", "bob", cj.Position(z=-length))
    mechanism = cj.Mechanism((bob,), (cardan,), points=(point,), gravity=cj.Gravity(z=-g))
    times = np.linspace(0, 5, 101)
    solution = cj.simulate(mechanism, 5.0, save_at=times, rtol=1e-12, solver="dopri8")
    height = np.asarray(solution["bob_centre.position.z"])
    start = -length * np.cos(tilt)
    energy, turning = speed**2 / 2 + g * start, (speed * length * np.sin(tilt)) ** 2
    roots = np.roots([2 * g, -2 * energy, -2 * g * length**2, 2 * energy * length**2 - turning])
    u1, u2, u3 = np.sort(roots.real)
    m, w = (u2 - u1) / (u3 - u1), np.sqrt(2 * g / length**2 * (u3 - u1)) / 2
    begin = ellipk(m) if abs(u2 - start) < abs(u1 - start) else 0.0
    closed = u1 + (u2 - u1) * ellipj(begin + w * times, m)[0] ** 2
    np.testing.assert_allclose(height, closed, atol=1e-10)
    assert float(solution.energy_residual) < 1e-11


# Loops ----------------------------------------------------------------------------------------------------------------


def gaps(mechanism, solution):
    """The conditions of every closure at every sample."""
    ready, plan = mechanism.prepare(), layout(mechanism)

    def at(t, y):
        motion = frames(ready, t, plan.split(y))
        held = [c for loop in ready.closures() for c in conditions(loop, motion)]
        return jnp.stack([jnp.asarray(c.gap, float) for c in held])

    return np.abs(jax.vmap(at)(solution.time, solution.y))


@pytest.mark.slow
def test_bennett_linkage_moves():
    """Over-constrained, through its fold, where its bars lie in a plane: by Bennett's relation between its angles."""
    mechanism, (alpha, beta) = bennett()
    solution = cj.simulate(mechanism, 2.0, save_at=101, rtol=1e-9)
    assert np.max(gaps(mechanism, solution)) < 1e-12
    assert float(solution.energy_residual) < 1e-8
    first, second = np.asarray(solution.y)[:, :2].T
    # tan(first / 2) tan(second / 2) is constant.
    left = np.sin(first / 2) * np.sin(second / 2) * np.sin((beta - alpha) / 2)
    right = np.cos(first / 2) * np.cos(second / 2) * np.sin((beta + alpha) / 2)
    np.testing.assert_allclose(left, right, atol=1e-10)
    assert np.ptp(first) > 2.0


@pytest.mark.slow
def test_a_plane_linkage_in_space_moves_as_in_the_plane():
    """Whatever closes it: a revolute holds its plane three times over, a spherical joint once."""
    wanted = cj.simulate(four_bar(cj.Revolute, False), 1.0, save_at=21, rtol=1e-10)
    start = np.asarray(wanted.y)[0, :6].reshape(2, 3).T
    for joint in (cj.Revolute, cj.Spherical, cj.Cylindrical):
        mechanism = four_bar(joint, True, start)
        found = cj.simulate(mechanism, 1.0, save_at=21, rtol=1e-10)
        np.testing.assert_allclose(np.asarray(found.y)[:, :3], np.asarray(wanted.y)[:, :3], atol=1e-8)
        assert np.max(gaps(mechanism, found)) < 1e-12


@pytest.mark.slow
def test_delta_robot_is_where_its_spheres_meet():
    drives = [cj.drives.Harmonic(0.3, 4.0, phase=phase, offset=0.1) for phase in (0.0, 1.0, 2.5)]
    mechanism = delta(drives)
    solution = cj.simulate(mechanism, 1.0, save_at=11, rtol=1e-9)
    assert np.max(gaps(mechanism, solution)) < 1e-12
    place = np.asarray(solution["centre.position"])
    angles = 0.1 + 0.3 * np.sin(4.0 * np.asarray(solution.time)[:, None] + np.array([0.0, 1.0, 2.5]))
    np.testing.assert_allclose(place, [platform(a) for a in angles], atol=1e-12)


# Accuracy -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_error_of_an_arm_follows_the_tolerance():
    """A free arm of three: from 1e-5 to 1e-11 the error falls as the tolerance does, and the energy balance closes."""
    mechanism = arm(3, seed=3)
    fine = cj.simulate(mechanism, 0.5, rtol=1e-13, solver="dopri8").y[:, :6]
    for rtol in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11):
        coarse = cj.simulate(mechanism, 0.5, rtol=rtol)
        assert np.max(np.abs(coarse.y[:, :6] - fine)) < 100 * rtol
        assert float(coarse.energy_residual) < 10 * rtol


@pytest.mark.slow
def test_derivatives_of_an_arms_end():
    """By a length, a mass and an inertia: against differences of the sixth order."""
    mechanism = arm(3, seed=3)
    names = ["joint2.at_parent.x", "link1.mass", "link2.inertia.xx"]
    begin = np.array([float(cj.parameters(mechanism)[name].value) for name in names])

    @jax.jit
    def end(values):
        moved = cj.replace(mechanism, dict(zip(names, values, strict=True)))
        return cj.simulate(moved, 0.5, rtol=1e-12, solver="dopri8")["tip.position"]

    found = jax.jacfwd(end)(jnp.asarray(begin))
    for i, (value, width) in enumerate(zip(begin, (1e-3, 1e-2, 3e-5), strict=True)):
        places = [end(jnp.asarray(begin).at[i].set(value + k * width)) for k in (-3, -2, -1, 1, 2, 3)]
        weights = np.array([-1, 9, -45, 45, -9, 1]) / (60 * width)
        wanted = sum(w * p for w, p in zip(weights, places, strict=True))
        np.testing.assert_allclose(found[:, i], wanted, atol=1e-8 * np.max(np.abs(wanted)))


@pytest.mark.slow
def test_momentum_of_what_flies_is_kept():
    """Two bodies joined by a ball, free, without weight: momentum, angular momentum and energy stay."""
    rng = np.random.default_rng(5)
    first, second = body("first", rng, 1.0), body("second", rng, 0.4)
    fly = cj.Free(
        "fly", "ground", "first", slide_y=cj.Motion(velocity=0.5), motion=cj.Ball(spin=cj.Spin(1.0, -2.0, 0.5))
    )
    joint = cj.Spherical("joint", "first", "second", cj.Position(0.3), motion=cj.Ball(spin=cj.Spin(3.0, 1.0, -1.0)))
    mechanism = cj.Mechanism((first, second), (fly, joint))
    solution = cj.simulate(mechanism, 5.0, save_at=21, rtol=1e-11)
    ready, plan = mechanism.prepare(), layout(mechanism)

    def momenta(t, y):
        motion, whole, turning = frames(ready, t, plan.split(y)), jnp.zeros(3), jnp.zeros(3)
        for part in ready.bodies:
            frame = motion[part.name]
            centre = frame.point(part.center_of_mass.vector)
            rows = jnp.asarray([as_array(row) for row in frame.rotation.rows])
            assert part.mass is not None
            momentum = part.mass * as_array(frame.velocity_at(centre))
            spin = rows @ inertia_tensor(part) @ rows.T @ as_array(frame.spin)
            whole, turning = whole + momentum, turning + spin + jnp.cross(as_array(centre), momentum)
        return jnp.concatenate([whole, turning])

    seen = jax.vmap(momenta)(solution.time, solution.y)
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-10)
    energy = solution["kinetic_energy"]
    np.testing.assert_allclose(energy, np.broadcast_to(energy[0], energy.shape), rtol=1e-10)


def test_a_quaternion_stays_unit_for_a_day():
    """A spinning body over 1e5 s at a loose tolerance."""
    box = cj.Body("box", 2.0, (1.0, 2.0, 3.0))
    mechanism = cj.Mechanism(
        (box,), (cj.Spherical("spin", "ground", "box", motion=cj.Ball(spin=cj.Spin(0.01, 0.002, 0.0))),)
    )
    solution = cj.simulate(mechanism, 1e5, rtol=1e-6, energy_balance=False)
    assert abs(float(jnp.sum(solution.y[-1, :4] ** 2)) - 1) < 1e-14


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: cj.Body("b", 1.0, (1.0, 1.0, 3.0)), "more than the other two"),
        (lambda: cj.Body("b", 1.0, (1.0, -1.0, 1.0)), "positive"),
        (lambda: cj.Revolute("j", "ground", "b", axis="w"), "axis"),
        (lambda: cj.Revolute("j", "ground", "b", axis=(0.0, 0.0, 0.0)), "not zero"),
        (lambda: cj.Revolute("j", "ground", "b", angle=1.0, orientation=cj.Orientation(1.0)), "one of them"),
    ],
)
def test_what_is_no_part_of_a_mechanism_is_refused(make, words):
    with pytest.raises(cj.ClearanceError, match=words):
        make()


def test_bodies_that_turn_in_space_need_their_inertia():
    one = cj.Mechanism((cj.Body("b", 1.0, 1.0),), (cj.Revolute("j", "ground", "b", axis="x"),))
    with refused("b"):
        cj.simulate(one, 0.1)


def test_mobility_is_counted():
    """Bennett's linkage moves under five conditions; a plane four-bar in space holds its plane three times."""
    assert cj.mobility(bennett()[0]) == (3, 5, 2)
    assert cj.mobility(bennett()[0]).repeated == 3
    assert "over-constrained" in str(cj.mobility(bennett()[0]))
    assert cj.mobility(four_bar(cj.Revolute, False)) == (3, 2, 2)
    assert cj.mobility(four_bar(cj.Revolute, True)).freedom == 1
    assert cj.mobility(arm(3)) == (3, 0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("digits", [8, 4])
def test_a_rounded_linkage_is_said_to_be_over_constrained(digits):
    """Its angles are irrational: rounded, it does not close, though it still counts as one that moves."""
    exact = bennett()[0]
    angles = {name: leaf.value for name, leaf in cj.parameters(exact).items() if "roll" in name}
    rounded = cj.replace(exact, {name: np.round(np.asarray(angle), digits) for name, angle in angles.items()})
    assert cj.mobility(rounded) == (3, 5, 2)
    with refused("j4") as raised:
        cj.simulate(rounded, 0.1)
    assert "It is over-constrained: 3 of the conditions" in str(raised.value)
    assert "all digits" in str(raised.value)
    assert "a `Spherical` instead" in str(raised.value)


def test_a_loop_that_repeats_nothing_is_not_said_to():
    """Crank, rod and rocker, 1 m together, cannot span 2 m."""
    far = cj.replace(four_bar(cj.Revolute, False), {"rocker.at_parent.x": 2.0})
    with refused("close") as raised:
        cj.simulate(far, 0.1)
    assert "over-constrained" not in str(raised.value)


def test_books_close_where_a_drive_breaks_at_the_end():
    """Its acceleration jumps at t1: what the last step sees is what was before (read past the jump the energy balance
    misses 1e-9 of the energy here, at this tolerance else 5e-11).
    """
    bob, cart = cj.Body("bob", 1.0, (0.1, 0.1, 0.1), cj.Position(0.3)), cj.Body("cart", 1.0, (0.1, 0.1, 0.1))
    ball = cj.Spherical("ball", "cart", "bob")
    for end in (0.3, 0.45):
        slide = cj.Prismatic("slide", "ground", "cart", motion=cj.Motion(cj.drives.StepSum([0.0], [end], [0.2])))
        mechanism = cj.Mechanism((cart, bob), (slide, ball), gravity=cj.Gravity(z=-9.81))
        assert float(cj.simulate(mechanism, end, rtol=1e-9).energy_residual) < 3e-10
