"""Blocks in guides and balls in sockets, against closed forms and the plane joints."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sleeves import act, checked, random_states, relative

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.solve.codes import Result

SIDE, LENGTH, HEIGHT = 1e-3, 0.1, 0.1
LAW: Any = laws.HuntCrossley(1e9, 0.5)
RUBBING: Any = laws.TanhCoulomb(0.1, 0.01)
BRISTLES: Any = laws.LuGre(0.2, 0.15, 0.01, 2e4, 1e-2)
FLAT = cj.GuideClearance(SIDE, LENGTH, HEIGHT, LAW, RUBBING)
BOX = cj.GuideClearance(SIDE, LENGTH, HEIGHT, LAW, RUBBING, width=0.06)
BALL = cj.SphericalClearance(1e-4, 0.01, LAW, RUBBING)


@pytest.mark.parametrize("joint", [BOX, BALL], ids=["box", "ball"])
def test_rates_are_those_of_the_penetrations_and_power_is_that_of_the_wrench(joint):
    touched = 0
    for at in random_states(20):
        at = at._replace(place=tuple(10 * x for x in at.place))
        touched += float(checked(joint, at).normal_force) > 0
    assert touched > 5


def test_corners_touch_where_a_straight_and_a_tilted_block_have_them():
    """Corners at (+-l/2, +-h/2) of a block that is turned by theta, as Siconos checks them (Flores 2008)."""
    theta, shift = 0.03, 2e-4
    tilted = FLAT.points(relative((shift, 0.0, 0.7), (0.0, theta, 0.0)))
    half, h = LENGTH / 2, HEIGHT / 2
    for i, (side, end) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        # About y a turn takes z to x: the corner's place across.
        across = shift + side * h * np.cos(theta) + end * half * np.sin(theta)
        assert float(tilted.penetration[i]) == pytest.approx(side * across - h - SIDE, rel=1e-12)
    # Both corners of a side that lies flat bear alike, and a block in the middle of its guide bears nothing.
    flat = act(FLAT, relative((1.1 * SIDE, 0.0, -0.2)))
    np.testing.assert_allclose(flat.force, [-2e9 * (0.1 * SIDE) ** 1.5, 0, 0], rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(flat.torque, 0.0, atol=1e-9)
    assert float(act(FLAT, relative((0.0, 0.0, 5.0))).normal_force) == 0.0


def slider(joints=(), loops=(), **body):
    return cj.Mechanism((cj.Body("block", 0.5, 2e-3, **body),), joints, loops, gravity=cj.Gravity(0.2, -9.81))


@pytest.mark.slow
def test_a_block_bounces_and_rubs_in_its_guide():
    """Dropped on its wall with a push along it: what the walls give across, a tenth of it friction takes along."""
    guide = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.5), clearance=FLAT)
    m = slider((guide,))
    assert m.is_plane
    s = cj.simulate(m, 0.2, rtol=1e-9)
    assert float(s.energy_residual) < 1e-8
    across, along = float(s["guide.play_x.velocity"]), float(s["guide.velocity"])
    # (Friction is Coulomb's to exp(-2 v / 0.01), and the block never slides slower than 0.3 m/s.)
    assert along == pytest.approx(0.5 + 0.2 * 0.2 - 0.1 * (9.81 * 0.2 + across), rel=1e-7)
    assert along < 0.4


@pytest.mark.slow
@pytest.mark.parametrize("solve", [cj.simulate, cj.trace])
def test_a_block_that_slides_out_of_its_guide_ends_the_solve(solve):
    """20 mm in a guide of 30 mm, at 0.5 m/s: it is out after 5 mm, at 0.01 s, and went on for 100 mm."""
    short = cj.GuideClearance(1e-4, 0.02, 0.02, LAW, guide_length=0.03)
    guide = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.5), clearance=short)
    m = slider((guide,))
    if solve is cj.trace:
        found = cj.trace(m, 0.2)
        assert "slid out of its guide" in found.message
        assert 0.01 < float(found.solution.end_time) < 0.02
        return
    with pytest.raises(RuntimeError, match="slid out of its guide"):
        cj.simulate(m, 0.2)

    def ending(velocity):
        s = cj.simulate(cj.replace(m, {"guide.velocity": velocity}), 0.02, rtol=1e-7)
        return s["guide"], s.code

    places, codes = jax.jit(jax.vmap(ending))(jnp.array([0.2, 0.5, -0.5]))
    assert codes.tolist() == [0, *[int(Result.LEFT)] * 2]
    assert np.isnan(places).tolist() == [False, True, True]
    # Pushed at 0.2 m/s^2 along the guide.
    assert float(places[0]) < 0.005


@pytest.mark.slow
def test_a_guide_closes_a_loop_as_it_does_in_a_tree():
    """A block that floats in the plane, with a guide as a loop, moves as one on the guide's own coordinates."""
    tree = slider((cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.5), clearance=FLAT),))
    start = cj.Planar("float", "ground", "block", slide_x=cj.Motion(velocity=0.5))
    loop = slider((start,), (cj.Prismatic("guide", "ground", "block", clearance=FLAT),))
    ends = [cj.simulate(m, 0.05, rtol=1e-11, energy_balance=False).final for m in (tree, loop)]
    # Slide, play, tilt; and x, y, turn: the same three.
    np.testing.assert_allclose(ends[0][:6], ends[1][:6], rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [None, BRISTLES], ids=["smooth", "bristles"])
def test_a_ball_in_a_plane_motion_is_a_pin(friction):
    """A pendulum on a ball that starts at the wall below, in the plane of x and z, against a pin about y."""
    inertia = cj.Inertia(0.03, 0.03, 0.03)
    bodies = (cj.Body("arm", 2.0, inertia, cj.Position(x=0.2)),)
    low = cj.Position(0.0, None, -0.5e-4)
    play = cj.SphericalClearance(1e-4, 0.01, LAW, friction)
    pin = cj.RevoluteClearance(1e-4, 0.01, LAW, friction)
    # The sleeve's axes about y: z and x.
    across = cj.Position(-0.5e-4, 0.0)
    turning = cj.Revolute("hip", "ground", "arm", axis="y", clearance=pin, eccentricity=across)
    ball = cj.Spherical("hip", "ground", "arm", clearance=play, eccentricity=low)
    pinned, balled = (
        cj.Mechanism(bodies, (j,), points=(cj.Point("end", "arm", cj.Position(x=0.4)),), gravity=cj.Gravity(z=-9.81))
        for j in (turning, ball)
    )
    motions = [cj.simulate(m, 0.15, rtol=1e-10, save_at=4) for m in (pinned, balled)]
    ends = [motion["end.position"] for motion in motions]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)
    assert abs(float(ends[0][-1, 2])) > 0.05
    assert max(float(motion.energy_residual) for motion in motions) < 1e-9
    # A ball has no axis that could lean, however it turned.
    assert np.all(np.asarray(motions[1]["hip.pin_tilt"]) == 0)


@pytest.mark.slow
def test_a_cylindrical_joint_takes_a_sleeve():
    """A shaft that slides and turns in a sleeve that it passes through: free of its play, and an energy balance that
    closes.
    """
    sleeve = cj.SleeveClearance(1e-4, 0.01, 0.04, LAW, RUBBING, stations=4)
    slide, turn = cj.Motion(velocity=0.3), cj.Motion(velocity=20.0)
    joint = cj.Cylindrical("bush", "ground", "shaft", slide=slide, turn=turn, axis="x", clearance=sleeve)
    m = cj.Mechanism((cj.Body("shaft", 1.0, cj.Inertia(1e-4, 2e-3, 2e-3)),), (joint,), gravity=cj.Gravity(z=-9.81))
    assert [c.name for c in m.coordinates()] == [
        "bush.play_x", "bush.play_y", "bush.tilt_x", "bush.tilt_y", "bush.slide", "bush.turn",
    ]  # fmt: skip
    s = cj.simulate(m, 0.1, rtol=1e-7)
    assert float(s.energy_residual) < 1e-6
    assert 0 < float(s["bush.slide.velocity"]) < 0.3
    assert 0 < float(s["bush.turn.velocity"]) < 20.0


# The slider-crank with play in its guide of Flores, Leine and Glocker (Multibody System Dynamics, 2010), as the Siconos
# examples have it, before its slider first touches: at 1 and 2 ms both angles, their rates, and the slider's place
# across over the clearance.
PUBLISHED = {
    1e-3: (0.0232542798 * 2 * np.pi, -0.0726076318, 139.232668, -68.3446759, 0.0771007342),
    2e-3: (0.0439361465 * 2 * np.pi, -0.1351018529, 120.824209, -56.6802935, 0.487071220),
}
CRANK, ROD, CRANK_MASS, SLIDER_MASS, GRAVITY, ACROSS = 0.153, 0.306, 0.038, 0.076, 9.81, 1e-3


def stepped(h):
    """The same motion by the rule of these examples (theta = 1/2, the masses of each step's end: of first order)."""
    both = (CRANK_MASS / 2 + SLIDER_MASS) * CRANK * ROD

    def mass(q):
        coupled = both * np.cos(q[1] - q[0])
        own = 7.4e-5 + (CRANK_MASS / 4 + CRANK_MASS + SLIDER_MASS) * CRANK**2
        return np.array([[own, coupled], [coupled, 5.9e-4 + (CRANK_MASS / 4 + SLIDER_MASS) * ROD**2]])

    def force(q, v):
        bent = both * np.sin(q[1] - q[0])
        weights = (1.5 * CRANK_MASS + SLIDER_MASS) * CRANK, (CRANK_MASS / 2 + SLIDER_MASS) * ROD
        pulled = [GRAVITY * weight * np.cos(angle) for weight, angle in zip(weights, q, strict=True)]
        return np.array([bent * v[1] ** 2 - pulled[0], -bent * v[0] ** 2 - pulled[1]])

    q, v, out = np.zeros(2), np.array([150.0, -75.0]), []
    for k in range(round(2e-3 / h)):
        old = force(q, v)
        next_v = v
        for _ in range(50):
            there = q + h / 2 * (v + next_v)
            next_v = v + h / 2 * np.linalg.solve(mass(there), old + force(there, next_v))
        q, v = q + h / 2 * (v + next_v), next_v
        if k + 1 in (round(1e-3 / h), round(2e-3 / h)):
            out.append((*q, *v, (CRANK * np.sin(q[0]) + ROD * np.sin(q[1])) / ACROSS))
    return np.array(out)


@pytest.mark.slow
def test_a_slider_crank_with_play_in_its_guide_moves_as_published():
    """The published rows are those of their own scheme at h = 0.1 ms; ours is what this scheme converges to."""
    play = cj.GuideClearance(side_clearance=ACROSS, length=0.1, height=0.05, normal=cj.laws.HuntCrossley(1e9, 0.5))
    bodies = (
        cj.Body("crank", CRANK_MASS, 7.4e-5, cj.Position(CRANK / 2)),
        cj.Body("rod", CRANK_MASS, 5.9e-4, cj.Position(ROD / 2)),
        cj.Body("block", SLIDER_MASS, 2.7e-6),
    )
    joints = (
        cj.Revolute("main", "ground", "crank", motion=cj.Motion(velocity=150.0)),
        cj.Revolute("elbow", "crank", "rod", at_parent=cj.Position(CRANK), motion=cj.Motion(velocity=-225.0)),
        cj.Revolute("pin", "rod", "block", at_parent=cj.Position(ROD), motion=cj.Motion(velocity=75.0)),
    )
    guide = cj.Prismatic("guide", "ground", "block", clearance=play)
    m = cj.Mechanism(bodies, joints, (guide,), gravity=cj.Gravity(y=-GRAVITY))
    y = np.asarray(cj.simulate(m, 2e-3, rtol=1e-10, save_at=np.array([1e-3, 2e-3])).y)
    angles, rates = (np.stack([x[:, 0], x[:, 0] + x[:, 1]], 1) for x in (y[:, :3], y[:, 3:6]))
    across = (CRANK * np.sin(angles[:, :1]) + ROD * np.sin(angles[:, 1:])) / ACROSS
    ours, (coarse, fine, finer) = np.hstack([angles, rates, across]), map(stepped, (1e-4, 5e-5, 2.5e-5))
    np.testing.assert_allclose(coarse, np.array(list(PUBLISHED.values())), rtol=4e-4)
    np.testing.assert_allclose((8 * finer - 6 * fine + coarse) / 3, ours, rtol=1e-5)
    # No corner has touched.
    assert np.all(np.abs(across[:, 0]) < 1.0)
