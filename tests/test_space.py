"""Mechanisms in space: against an independent Lagrangian, closed forms, and linkages that close in space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lagrangian import accelerations, random_state

import clearance_jax as cj
from clearance_jax.dynamics.field import slope
from clearance_jax.mechanism.state import layout


def body(name, rng, mass=1.0):
    """A body with a random inertia of a real one: of points."""
    points = 0.1 * rng.normal(size=(6, 3))
    points -= points.mean(0)
    tensor = mass / 6 * sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)
    six = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    return cj.Body(name, mass, six, cj.Position(*(0.1 * rng.normal(size=3))))


def arm(n, seed=0):
    """A serial arm of n turns about random axes, randomly placed."""
    rng = np.random.default_rng(seed)
    bodies = tuple(body(f"link{i}", rng, 1.0 + i) for i in range(n))
    joints = tuple(
        cj.Revolute(
            f"joint{i}",
            "ground" if i == 0 else f"link{i - 1}",
            f"link{i}",
            cj.Position(*(0.3 * rng.normal(size=3))),
            orientation=cj.Orientation(*rng.normal(size=3)),
            axis="xyz"[i % 3] if i % 2 else rng.normal(size=3),
        )
        for i in range(n)
    )
    tip = cj.Point("tip", f"link{n - 1}", cj.Position(0.1, 0.2, 0.3))
    return cj.Mechanism(bodies, joints, points=(tip,), gravity=cj.Gravity(z=-9.81))


def zoo():
    """Every kind of joint of the tree, driven ones and branches among them."""
    rng = np.random.default_rng(1)
    names = ["lift", "ball", "cardan", "drill", "foot", "drone", "twig", "rod"]
    bodies = tuple(body(name, rng, 1.0 + 0.3 * i) for i, name in enumerate(names))

    def at():
        return cj.Position(*(0.2 * rng.normal(size=3)))

    def turned():
        return cj.Orientation(*rng.normal(size=3))

    joints = (
        cj.Prismatic("slide", "ground", "lift", at(), orientation=turned(), axis=(1.0, 2.0, -1.0)),
        cj.Spherical("socket", "lift", "ball", at(), at(), orientation=turned()),
        cj.Universal("cross", "ball", "cardan", at(), at(), child_orientation=turned()),
        cj.Cylindrical("sleeve", "cardan", "drill", at(), at(), orientation=turned(), axis="-y"),
        cj.Planar("floor", "lift", "foot", at(), at(), orientation=turned(), axis="x"),
        cj.Free("air", "ground", "drone", at(), at(), orientation=turned()),
        cj.Revolute("bent", "ball", "twig", at(), motion=cj.Motion(cj.Harmonic(0.7, 3.0)), axis=(0.3, 0.2, 1.0)),
        cj.Revolute("last", "twig", "rod", at(), at(), orientation=turned(), axis="x"),
    )
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(0.3, -1.0, -9.81))


@pytest.mark.parametrize("make", [lambda: arm(3), lambda: arm(7), zoo], ids=["arm3", "arm7", "zoo"])
def test_field_agrees_with_lagrange(make):
    mechanism = make()
    plan, rng = layout(mechanism), np.random.default_rng(2)
    states = jnp.asarray([random_state(mechanism, rng) for _ in range(1000)])
    ours = jax.jit(jax.vmap(slope, (None, 0, None)))(jnp.asarray(0.3), states, mechanism.prepared())
    theirs = jax.jit(jax.vmap(lambda y: accelerations(mechanism, 0.3, y)))(states)
    size = np.max(np.abs(theirs), axis=1, keepdims=True)
    assert np.max(np.abs(ours[:, plan.v] - theirs) / size) < 1e-10
