"""Play in space on moving parents and in every joint of a loop, against a simulation that shares nothing but the
mechanism: Lagrange's equations of the energies (`lagrangian`), contacts by virtual work, scipy's DOP853.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lagrangian import accelerations, poses, rpy, three
from scipy.integrate import solve_ivp
from sleeves import AXIAL, RADIAL, sleeve
from spatial import bennett

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.start import check_start

STIFFNESS, DAMPING, STATIONS, RING = 1e9, 0.5, 4, 4
# Gauss-Lobatto of four points, and its weights: all add up to one.
HEIGHTS = np.array([-1.0, -np.sqrt(0.2), np.sqrt(0.2), 1.0])
SHARES = np.array([1.0, 5.0, 5.0, 1.0]) / 12


def play(pin="through", axial=None):
    clearance = sleeve(pin, STATIONS, axial, friction=None, normal=laws.HuntCrossley(STIFFNESS, DAMPING))
    return dataclasses.replace(clearance, ring=RING)


def penetrations(joint, bodies):
    """By how much the pin is in the sleeve's wall at each station, and in a face at each place of the collar's ring."""
    clearance = joint.clearance
    (outer, origin), (inner, there) = bodies[joint.parent], bodies[joint.child]
    axes, middle = outer @ rpy(joint.orientation), origin + outer @ three(joint.at_parent)
    along = axes.T @ inner @ rpy(joint.child_orientation) @ jnp.array([0.0, 0.0, 1.0])
    pin = axes.T @ (there + inner @ three(joint.at_child) - middle)
    heights = HEIGHTS * clearance.length / 2
    if clearance.pin == "inside":
        line = pin[None, :2] + heights[:, None] * along[None, :2]
    else:
        line = pin[None, :2] + (heights - pin[2])[:, None] * along[None, :2] / along[2]
    found = [jnp.sqrt(jnp.sum(line**2, axis=1)) - clearance.radial_clearance]
    if clearance.axial_clearance is not None:
        angles = 2 * np.pi * np.arange(RING) / RING
        ring = 1.5 * clearance.pin_radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        found.append(jnp.abs(pin[2] - (ring - pin[None, :2]) @ along[:2] / along[2]) - clearance.axial_clearance)
    return jnp.concatenate(found)


def simulated(mechanism, y, end):
    """The state at the end, of a start `y`, and the largest penetration on the way there."""
    plan = layout(mechanism)
    joints = [j for j in (*mechanism.joints, *mechanism.loops) if getattr(j, "clearance", None) is not None]
    shares = np.concatenate([SHARES, np.full(RING, 1 / RING)])
    weights = np.concatenate([shares if j.clearance.axial_clearance is not None else SHARES for j in joints])

    def depths(time, y, x):
        bodies = poses(mechanism, time, y[plan.q], x)
        return jnp.concatenate([penetrations(j, bodies) for j in joints])

    @jax.jit
    def slope(time, y):
        x, time = jnp.zeros(plan.free), jnp.asarray(time, float)
        deep, rate = jax.jvp(lambda t, x: depths(t, y, x), (time, x), (jnp.ones(()), y[plan.v]))
        force = weights * STIFFNESS * jnp.maximum(deep, 0.0) ** 1.5 * jnp.maximum(1 + DAMPING * rate, 0.0)
        worked = -jax.vjp(lambda x: depths(time, y, x), x)[1](force)[0]
        return jnp.zeros_like(y).at[plan.q].set(y[plan.v]).at[plan.v].set(accelerations(mechanism, time, y, worked))

    solution = solve_ivp(lambda t, y: np.asarray(slope(t, y)), (0.0, end), y, "DOP853", rtol=1e-12, atol=1e-15)
    deepest = jax.jit(jax.vmap(lambda t, y: jnp.max(depths(t, y, jnp.zeros(plan.free)))))
    return solution.y[:, -1], float(np.max(deepest(solution.t, solution.y.T)))


def arm_on_a_plate():
    """A plate that tumbles carries an upper arm, which carries a forearm: both pins held axially in their sleeves."""

    def harmonic(speed):
        return cj.Motion(cj.drives.Harmonic(0.35, speed))

    bodies = (
        cj.Body("plate"),
        cj.Body("upper", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, None, 0.02)),
        cj.Body("fore", 1.0, cj.Inertia(1e-3, 0.01, 0.01), cj.Position(0.1, 0.01, -0.01)),
    )
    joints = (
        cj.Revolute("motor", "ground", "plate", axis="x", motion=harmonic(30.0)),
        cj.Revolute("shoulder", "plate", "upper", motion=harmonic(20.0), clearance=play()),
        cj.Revolute(
            "elbow",
            "upper",
            "fore",
            cj.Position(0.4),
            orientation=cj.Orientation(roll=np.pi / 2),
            motion=harmonic(40.0),
            clearance=play("inside"),
        ),
    )
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(z=-9.81))


def loose_bennett():
    """Bennett's linkage, which moves only because its measures are exact, with play in all four joints; its crank turns
    evenly.
    """
    exact, _ = bennett()
    loose = [dataclasses.replace(joint, clearance=play(axial=AXIAL)) for joint in (*exact.joints, *exact.loops)]
    loose[0] = dataclasses.replace(loose[0], motion=cj.Motion(cj.drives.ConstantSpeed(2.0, 0.7)))
    return dataclasses.replace(exact, joints=tuple(loose[:3]), loops=tuple(loose[3:]))


@pytest.mark.slow
@pytest.mark.parametrize(("make", "start"), [(arm_on_a_plate, "settled"), (loose_bennett, "centre")])
def test_play_in_space_is_what_lagrange_and_virtual_work_say(make, start):
    mechanism, end = make(), 0.01
    ours = cj.simulate(mechanism, end, rtol=1e-10, start=start, save_at=2)
    assert float(ours.energy_residual) < 1e-9
    plan = layout(mechanism)
    theirs, deepest = simulated(mechanism, np.asarray(ours.y)[0], end)
    assert deepest > 1e-6  # contacts bear
    off = np.abs(np.asarray(ours.y)[1] - theirs)
    assert off[plan.q].max() < 5e-8 * RADIAL


def test_an_over_constrained_loop_with_play_has_no_settled_start():
    """What a solve makes of a loop that stays open with pins at their walls."""
    errors = StartErrors(jnp.array([0.02]), jnp.zeros(4), jnp.zeros(4))
    with pytest.raises(cj.ClearanceError, match=r"cannot be settled: .* over-constrained \(3 of the conditions"):
        check_start(loose_bennett(), 0.0, errors)
