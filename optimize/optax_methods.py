"""Two more ways to solve a program, by optimisers of optax, to compare the library's with: an augmented Lagrangian with
L-BFGS, and Adam on objective and penalty. Both hold limits as tightly as asked, or coarsely, at many times the solves.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optax

from clearance_jax.design import Method, Program, ScaledProgram

LBFGS = optax.scale_by_lbfgs(memory_size=20)


def augmented_lagrangian(program: Program, start: np.ndarray, tolerance: float = 1e-9, most: int = 250) -> None:
    """Augmented Lagrangian (Rockafellar 1974): optax's L-BFGS, backtracking; at most so many evaluations."""
    scaled = ScaledProgram(program, start)
    multipliers, weight, z, spent = np.zeros(len(program.limit_names)), 10.0, scaled.start, 0
    violation, wanted = np.inf, 1e-2
    while spent < most:

        def merit(z, multipliers=multipliers, weight=weight):
            value, limits, gradient, jacobian = scaled.slopes(z)
            pressed = np.maximum(0.0, multipliers + weight * limits)
            return value + float(pressed @ pressed - multipliers @ multipliers) / (2 * weight), (
                gradient + pressed @ jacobian
            )

        z, used = _descend(merit, z, scaled.bounds, most - spent, wanted)
        spent += used
        _, limits = scaled.value(z)
        # Of a violated limit the violation; of one with slack, how far its multiplier is from zero.
        now = float(np.max(np.abs(np.maximum(limits, -multipliers / weight)), initial=0.0))
        multipliers = np.maximum(0.0, multipliers + weight * limits)
        if now <= tolerance and wanted <= 1e2 * tolerance:
            return
        # Early multipliers are rough, and so may their minimum be.
        wanted = max(0.1 * wanted, tolerance)
        if now > 0.25 * violation:
            weight *= 4
        violation = now


def _descend(merit: Callable, z: np.ndarray, bounds, most: int, tolerance: float) -> tuple[np.ndarray, int]:
    """Projected L-BFGS; returns the last point and the number of evaluations."""
    method = LBFGS
    state, improve = method.init(jnp.asarray(z)), _jitted(method)
    value, gradient = merit(z)
    spent = 1
    while spent < most:
        fixed = ((z <= bounds[0]) & (gradient > 0)) | ((z >= bounds[1]) & (gradient < 0))
        free = np.where(fixed, 0.0, gradient)
        if np.linalg.norm(free) <= tolerance:
            break
        update, state = improve(jnp.asarray(free), state, jnp.asarray(z))
        direction = np.where(fixed, 0.0, -np.asarray(update))
        if direction @ free >= 0:
            direction = -free
        length = 1.0 if spent > 1 else min(1.0, 0.3 / np.linalg.norm(direction))
        better = None
        while spent < most and better is None:
            moved = np.clip(z + length * direction, *bounds)
            there, slope = merit(moved)
            spent += 1
            length *= 0.3
            if there <= value + 1e-4 * gradient @ (moved - z):
                better = moved, there, slope
        if better is None or np.all(better[0] == z):
            break
        z, value, gradient = better
    return z, spent


@functools.cache
def _jitted(method: optax.GradientTransformation) -> Callable:
    return jax.jit(method.update)


def projected_adam(program: Program, start: np.ndarray, rate: float = 0.05, most: int = 250) -> None:
    """Adam (optax's) on objective and exact penalty, clipped to the bounds, with a rate that falls to nothing: robust,
    and coarse.
    """
    scaled = ScaledProgram(program, start)
    method = optax.adam(optax.cosine_decay_schedule(rate, most))
    z = scaled.start
    state, improve = method.init(jnp.asarray(z)), _jitted(method)
    for _ in range(most):
        _, limits, gradient, jacobian = scaled.slopes(z)
        if limits.size and limits.max() > 0:
            # A violated limit outweighs whatever the objective could gain by violating it.
            k = int(np.argmax(limits))
            steep = np.linalg.norm(gradient) / max(np.linalg.norm(jacobian[k]), 1e-12)
            gradient = gradient + 3 * steep * jacobian[k]
        update, state = improve(jnp.asarray(gradient), state, jnp.asarray(z))
        z = np.clip(z + np.asarray(update), *scaled.bounds)


AUGMENTED_LAGRANGIAN = Method("augmented-lagrangian", augmented_lagrangian)
PROJECTED_ADAM = Method("projected-adam", projected_adam)
