"""Blocks in guides and balls in sockets, against closed forms and the plane joints."""

from typing import Any

import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax import laws
from tests.test_sleeve import act, checked, random_states, relative

SIDE, LENGTH, HEIGHT = 1e-3, 0.1, 0.1
LAW: Any = laws.HuntCrossley(1e9, 0.5)
RUBBING: Any = laws.TanhCoulomb(0.1, 0.01)
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


def test_a_guide_closes_a_loop_as_it_does_in_a_tree():
    """A block that floats in the plane, with a guide as a loop, moves as one on the guide's own coordinates."""
    tree = slider((cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.5), clearance=FLAT),))
    start = cj.Planar("float", "ground", "block", slide_x=cj.Motion(velocity=0.5))
    loop = slider((start,), (cj.Prismatic("guide", "ground", "block", clearance=FLAT),))
    ends = [cj.simulate(m, 0.05, rtol=1e-11, books=False).final for m in (tree, loop)]
    # Slide, play, tilt; and x, y, turn: the same three.
    np.testing.assert_allclose(ends[0][:6], ends[1][:6], rtol=0, atol=1e-8)


def test_a_ball_in_a_plane_motion_is_a_pin():
    """A pendulum on a ball that starts at the wall below, in the plane of x and z, against a pin about y."""
    inertia = cj.Inertia(0.03, 0.03, 0.03)
    bodies = (cj.Body("arm", 2.0, inertia, cj.Position(x=0.2)),)
    low = cj.Position(0.0, None, -0.5e-4)
    play = cj.SphericalClearance(1e-4, 0.01, LAW)
    pin = cj.RevoluteClearance(1e-4, 0.01, LAW)
    # The sleeve's axes about y: z and x.
    across = cj.Position(-0.5e-4, 0.0)
    turning = cj.Revolute("hip", "ground", "arm", axis="y", clearance=pin, eccentricity=across)
    ball = cj.Spherical("hip", "ground", "arm", clearance=play, eccentricity=low)
    pinned, balled = (
        cj.Mechanism(bodies, (j,), points=(cj.Point("end", "arm", cj.Position(x=0.4)),), gravity=cj.Gravity(z=-9.81))
        for j in (turning, ball)
    )
    ends = [cj.simulate(m, 0.15, rtol=1e-10, save_at=4)["end.position"] for m in (pinned, balled)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)
    assert abs(float(ends[0][-1, 2])) > 0.05


def test_a_cylindrical_joint_takes_a_sleeve():
    """A shaft that slides and turns in a sleeve that it passes through: free of its play, and books that close."""
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
