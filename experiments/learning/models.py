"""A slider-crank whose friction is a network: by the library, and by equations of its own in plain diffrax."""

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

import clearance_jax as cj
from experiments.common import slider_crank
from experiments.reference.problems import slider_crank_parameters, slider_crank_scale, slider_crank_start

END = 6e-3
TIMES = np.linspace(0.0, END, 11)[1:]
"""The end of the motion and the instants of the loss [s]."""
SPEED, MASS = 1.0, 0.1
"""The impact [m/s, kg] at which the law has the restitution of the scene's own."""
CAP_DEPTH, CAP_RATE = 1e-3, 100.0
"""Penetration [m] and its rate [m/s] that only rejected steps of plain diffrax reach."""
LARGEST, STEEP = 0.1, 0.1
"""The coefficient of friction is below the first, and complete well above the second [m/s]."""
SOLVERS = {"tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
MOST_STEPS = 2**14
NUMBERS = slider_crank_parameters(5e-4)

Solve = Callable[[Any, Any, Any], tuple[Any, Any, Any]]
"""(network, rtol, damping factor) to (final position and velocity of the slider, its velocities at `TIMES`, steps)."""


def network(width: int) -> tuple[Any, Callable]:
    """The weights as one array, and the network of such an array."""
    net = eqx.nn.MLP(2, "scalar", width, 2, activation=jnp.tanh, key=jax.random.key(width))
    arrays, rest = eqx.partition(net, eqx.is_array)
    weights, shaped = ravel_pytree(arrays)
    return weights, lambda weights: eqx.combine(shaped(weights), rest)


def loss_of(solve: Solve, made: Callable) -> Callable:
    def loss(weights, rtol, damping):
        final, speeds, steps = solve(made(weights), rtol, damping)
        return jnp.mean(speeds**2), (final, steps)

    return loss


def coefficient(net, slip):
    """The coefficient of friction by a network of the slip's square."""
    square = slip * slip
    return LARGEST * jax.nn.sigmoid(net(jnp.stack([square / (1.0 + square), square / 4.0])))


def friction(net, slip, normal_force):
    """T = -mu(v^2) N v / sqrt(v^2 + v0^2), with a coefficient mu by a network."""
    return -coefficient(net, slip) * normal_force * slip / jnp.sqrt(slip * slip + STEEP**2)


# By the library ------------------------------------------------------------------------------------------------------


class Learned(cj.laws.AbstractFrictionLaw):
    """`friction` as a law."""

    net: Any
    smoothness: ClassVar = "C2"

    def traction(self, constants, slip, normal_force, memory):
        return (friction(self.net, slip[0], normal_force),)


@cache
def restitution() -> float:
    """Of an impact in the scene, by its own law."""
    (wrist,) = (joint.clearance for joint in slider_crank().clearance_joints())
    assert wrist is not None
    own = eqx.tree_at(lambda law: law.stiffness, wrist.normal, wrist.prepare().normal.constants)
    return float(own.delivered_restitution(speed=SPEED, mass=MASS))


def factor() -> float:
    """The damping factor of Hunt and Crossley's law with the same restitution [s/m]."""
    law = cj.laws.HuntCrossley(NUMBERS[2], 0.0).for_restitution(restitution(), speed=SPEED, mass=MASS)
    return float(law.damping_factor)


def ours(derivatives: str, times: Any = TIMES) -> Solve:
    crank = slider_crank()
    (wrist,) = (joint.clearance for joint in crank.clearance_joints())
    assert wrist is not None

    law: Any = Learned

    def solve(net, rtol, damping):
        normal = cj.laws.HuntCrossley(wrist.prepare().normal.constants, damping)
        play = cj.RevoluteClearance(wrist.radial_clearance, wrist.pin_radius, normal, law(net))
        s = cj.simulate(
            crank.with_clearance("wrist", play),
            END,
            save_at=times,
            rtol=rtol,
            solver="dopri8",
            energy_balance=False,
            throw=False,
            derivatives=derivatives,
        )
        speeds = s["piston.velocity.x"]
        return jnp.stack([s["piston.position.x"][-1], speeds[-1]]), speeds, s.steps

    return solve


# Without the library -------------------------------------------------------------------------------------------------


def field(t, y, given):
    """The rates of y = (phi, x, phi_dot, x_dot), as in `experiments.reference.problems`: Euler's law of the rod about
    the crank pin, and Newton's of the slider. No square root is of zero, so that its slope is finite.
    """
    pin, clearance, stiffness = (float(x) for x in NUMBERS[:3])
    w, r, length, rod_mass, rod_inertia, slider_mass = (float(x) for x in NUMBERS[8:])
    (phi, x, phi_dot, x_dot), (net, damping) = y, given
    crank_x, crank_y, rod_x, rod_y = jnp.cos(w * t), jnp.sin(w * t), jnp.cos(phi), jnp.sin(phi)
    ex, ey = x - (r * crank_x + length * rod_x), -(r * crank_y + length * rod_y)
    vx = x_dot + r * w * crank_y + length * phi_dot * rod_y
    vy = -(r * w * crank_x + length * phi_dot * rod_x)
    square = ex * ex + ey * ey
    eccentricity = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    nx, ny = ex / eccentricity, ey / eccentricity
    penetration = jnp.where(square > 0, eccentricity, 0.0) - clearance
    touches, sleeve = penetration > 0, pin + clearance
    depth = jnp.where(touches, jnp.minimum(penetration, CAP_DEPTH), 1.0)
    damped = jnp.maximum(0.0, 1.0 + damping * jnp.clip(nx * vx + ny * vy, -CAP_RATE, CAP_RATE))
    normal = jnp.where(touches, stiffness * depth * jnp.sqrt(depth) * damped, 0.0)
    traction = friction(net, nx * vy - ny * vx - sleeve * phi_dot, normal)
    fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
    torque = (length * rod_x + sleeve * nx) * fy - (length * rod_y + sleeve * ny) * fx
    inertia = rod_inertia + rod_mass * length * length / 4
    turned = (rod_mass * length / 2 * r * w * w * jnp.sin(w * t - phi) - torque) / inertia
    return jnp.stack([phi_dot, x_dot, turned, fx / slider_mass])


def plain(solver: str, times: Any = TIMES) -> Solve:
    def solve(net, rtol, damping):
        s = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            SOLVERS[solver](),
            0.0,
            END,
            None,
            jnp.asarray(slider_crank_start(NUMBERS)),
            args=(net, damping),
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol * slider_crank_scale(NUMBERS)),
            adjoint=diffrax.RecursiveCheckpointAdjoint(),
            max_steps=MOST_STEPS,
            throw=False,
        )
        assert s.ys is not None
        return s.ys[-1, 1::2], s.ys[:, 3], s.stats["num_accepted_steps"]

    return solve
