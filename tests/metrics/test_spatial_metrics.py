"""Metrics of mechanisms in space: what joints bear, how freely they move, what an offset in a joint does."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from spatial import arm, bennett, delta, four_bar

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.dynamics.closures import assemble
from clearance_jax.dynamics.quantities import evaluate
from clearance_jax.mechanism.state import initial_values
from clearance_jax.metrics.ideal import freedom

G = 9.81
DRIVES = [cj.drives.Harmonic(0.3, 4.0, phase=phase, offset=0.1) for phase in (0.0, 1.0, 2.5)]


def test_a_pendulums_bearing_bears_most_at_the_bottom():
    """Let go level: m g (1 + 2 m l^2 / (I + m l^2)), and its derivatives by mass and length."""
    inertia = 0.05
    bob = cj.Body("bob", 1.3, (inertia, inertia, 0.01), cj.Position(z=-0.4))
    pin = cj.Revolute("pin", "ground", "bob", axis="x", motion=cj.Motion(position=np.pi / 2))
    pendulum = cj.Mechanism((bob,), (pin,), gravity=cj.Gravity(z=-G))
    peak = metrics.Peak(metrics.JointReaction("pin"))

    def found(mass, height):
        return peak(cj.replace(pendulum, {"bob.mass": mass, "bob.center_of_mass.z": height}), 0.8, rtol=1e-10)

    def bears(mass, height):
        return mass * G * (1 + 2 * mass * height**2 / (inertia + mass * height**2))

    value, slopes = jax.value_and_grad(found, (0, 1))(1.3, -0.4)
    np.testing.assert_allclose(value, bears(1.3, -0.4), rtol=1e-8)
    np.testing.assert_allclose(slopes, jax.grad(bears, (0, 1))(1.3, -0.4), rtol=1e-7)


def test_a_shaft_bears_the_moment_of_what_turns_with_it():
    """A mass at radius a and height h turns evenly: m a (g + h w^2), by weight and by centrifugal force."""
    m, a, h, w = 2.0, 0.3, 0.5, 7.0
    body = cj.Body("rotor", m, (0.02, 0.03, 0.04), cj.Position(a, 0.0, h))
    shaft = cj.Revolute("shaft", "ground", "rotor", motion=cj.Motion(cj.drives.ConstantSpeed(w)))
    rotor = cj.Mechanism((body,), (shaft,), gravity=cj.Gravity(z=-G))
    metric = metrics.At(metrics.JointMoment("shaft"), [0.1, 0.3])
    value, slope = jax.jvp(lambda z: metric(cj.replace(rotor, {"rotor.center_of_mass.z": z}), 0.4), (h,), (1.0,))
    np.testing.assert_allclose(value, m * a * (G + h * w**2), rtol=1e-12)
    np.testing.assert_allclose(slope, m * a * w**2, rtol=1e-10)
    force = metrics.Mean(metrics.JointReaction("shaft"))(rotor, 0.4)
    np.testing.assert_allclose(force, m * np.hypot(G, a * w**2), rtol=1e-10)
    with refused("shift", allowed="shaft"):
        metrics.Mean(metrics.JointReaction("shift"))(rotor, 0.4)


@pytest.mark.slow
def test_freedom_is_counted_in_space():
    """Repeated conditions count once; a mechanism's own error is nothing, however it closes."""
    linkage, _ = bennett()
    assert freedom(linkage) == 1
    assert freedom(linkage.with_drives({"j1": cj.drives.ConstantSpeed(2.0)})) == 0
    assert freedom(delta(DRIVES)) == 0
    assert freedom(arm(3)) == 3
    assert freedom(four_bar(cj.Revolute, False)) == freedom(four_bar(cj.Spherical, True)) == 1

    def traced(mechanism):
        return jax.eval_shape(lambda mass: float(freedom(cj.replace(mechanism, {"l1.mass": mass}))) + mass, 1.0)

    traced(four_bar(cj.Spherical, True))
    with pytest.raises(cj.ClearanceError, match="over-constrained: whether it moves freely"):
        traced(linkage)


@pytest.mark.slow
def test_errors_of_a_closed_linkage_without_play_are_nothing():
    linkage, _ = bennett()
    driven = cj.Mechanism(
        linkage.bodies, linkage.joints, linkage.loops, points=(cj.Point("knee", "l2"),), gravity=linkage.gravity
    ).with_drives({"j1": cj.drives.Harmonic(0.3, 2.0, offset=0.7)})
    asked = {"place": metrics.Rms(metrics.PositionError("knee")), "turn": metrics.Rms(metrics.OrientationError("l2"))}
    found = cj.measure(driven, asked, 0.2)
    assert max(map(float, found.values())) < 1e-9


@pytest.mark.slow
def test_static_weights_of_an_arm_are_one():
    """An offset in a joint of a driven arm moves its end by itself, whatever the arm's shape."""
    drives = {f"joint{i}": cj.drives.Harmonic(0.5, 2.0 + i) for i in range(3)}
    weights = design.static_weights(arm(3).with_drives(drives), "tip", 1.0, 11, joints=("joint2", "joint0"))
    assert list(weights) == ["joint2", "joint0"]
    np.testing.assert_allclose(list(weights.values()), 1.0, rtol=1e-12)
    with refused("joints"):
        design.static_weights(arm(3).with_drives(drives), "tip", 1.0)
    with refused("joint9"):
        design.static_weights(arm(3).with_drives(drives), "tip", 1.0, joints=["joint9"])


def rssr(drive):
    """A crank about z, a rod between a cardan and a ball, a rocker about x: a closed loop that leaves every plane."""
    bodies = (
        cj.Body("crank", 1.0, (1e-3, 4e-3, 4e-3), cj.Position(0.1)),
        cj.Body("rod", 0.5, (1e-2, 1e-2, 1e-4), cj.Position(z=-0.26)),
        cj.Body("rocker", 1.0, (1e-2, 1e-3, 1e-2), cj.Position(y=-0.2)),
    )
    joints = (
        cj.Revolute("hub", "ground", "crank", motion=cj.Motion(drive)),
        cj.Universal("cardan", "crank", "rod", cj.Position(0.2)),
        cj.Revolute("pivot", "ground", "rocker", cj.Position(0.3, 0.4, -0.5), axis="x"),
    )
    ball = cj.Spherical("ball", "rod", "rocker", cj.Position(z=-0.52), cj.Position(y=-0.4))
    points = (cj.Point("tip", "rocker", cj.Position(y=-0.4)),)
    return cj.Mechanism(bodies, joints, (ball,), points=points, gravity=cj.Gravity(z=-G))


@pytest.mark.slow
def test_static_weights_of_a_closed_loop_are_those_of_its_assembly():
    """Against differences of the rocker's place, each variant assembled from the same guess."""
    linkage, asked = rssr(cj.drives.Harmonic(0.8, 20.0, phase=0.3)), ("hub", "cardan", "pivot", "ball")
    weights = design.static_weights(linkage, "tip", 0.1, 3, joints=asked)

    def moved(name, offset):
        joint = linkage.joint(name)
        at = joint.at_parent.vector
        return linkage.with_joint(
            dataclasses.replace(joint, at_parent=cj.Position(*(a + b for a, b in zip(at, offset, strict=True))))
        )

    @jax.jit
    @jax.vmap
    def places(time, offset):
        out = []
        for name in asked:
            ready = moved(name, offset).prepare()
            y, opened = assemble(time, initial_values(ready), ready)
            out.append((evaluate("position", time, y, ready)[0], jnp.max(opened)))
        return jnp.stack([place for place, _ in out]), jnp.stack([opened for _, opened in out])

    width = 1e-4
    steps = np.concatenate([np.eye(3), -np.eye(3)]) * width
    times = np.repeat([0.0, 0.05, 0.1], 6)
    place, opened = places(jnp.asarray(times), jnp.asarray(np.tile(steps, (3, 1))))
    assert float(np.max(opened)) < 1e-12
    place = np.asarray(place).reshape(3, 2, 3, 4, 3)  # time, sign, offset, joint, axis
    slopes = np.moveaxis((place[:, 0] - place[:, 1]) / (2 * width), 2, 0)
    wanted = np.linalg.norm(slopes, ord=2, axis=(2, 3)).max(1)
    np.testing.assert_allclose(list(weights.values()), wanted, rtol=1e-5)
    assert np.max(np.abs(wanted - 1)) > 0.05


def test_an_over_constrained_mechanism_has_no_static_bound():
    linkage, _ = bennett()
    driven = linkage.with_drives({"j1": cj.drives.ConstantSpeed(2.0)})
    with refused("loops", 3):
        design.static_weights(driven, "any", 1.0, joints=["j2"])
