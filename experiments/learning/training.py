"""A network in the friction of the slider-crank, trained by adam: by the library's adjoint, and by plain diffrax."""

import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

import clearance_jax as cj
from experiments.common import slider_crank
from experiments.learning.models import END, LARGEST, SOLVERS, Solve, coefficient, factor, network, ours, plain

WIDTH, STEPS, RATE, RTOL = 30, 800, 2e-2, 1e-6
"""Of the network's hidden layers, of the training, and of its solves."""
TIMES = np.linspace(0.0, END, 101)[1:]
"""The instants of the data [s]."""
GOAL = 2e-4
"""Loss to reach, relative to the first one."""
TRUE = 0.02, 0.06, 1.0
"""The true coefficient a + b exp(-(slip/v)^2): a, b, v [m/s]."""


class Trained(NamedTuple):
    """By step: the loss over the first one, and the time since the first step [s], without compilation; and the largest
    relative error of the coefficient over the slips in contact.
    """

    losses: np.ndarray
    seconds: np.ndarray
    error: float

    def reached(self) -> float | None:
        """When the loss was at `GOAL` [s]."""
        there = np.flatnonzero(self.losses <= GOAL)
        return float(self.seconds[there[0]]) if there.size else None


class TrueNetwork:
    """What stands for a network, so that both models have the true coefficient."""

    def __call__(self, seen):
        low, high, speed = TRUE
        share = (low + high * jnp.exp(-4.0 * seen[1] / speed**2)) / LARGEST
        return jnp.log(share / (1.0 - share))


def slips() -> np.ndarray:
    """The speeds of slip in contact, in the middle nine tenths of them [m/s]."""
    motion = cj.simulate(slider_crank(), END, save_at=np.linspace(0.0, END, 601), rtol=1e-7)
    touching = np.asarray(motion["wrist.contact_force"]) > 1.0
    speeds = np.abs(np.asarray(motion["wrist.slip_velocity"]))[touching]
    low, high = np.quantile(speeds, (0.05, 0.95))
    return np.sort(speeds[(speeds >= low) & (speeds <= high)])


def trained(solve: Solve, steps: int) -> Trained:
    """The training from the same start."""
    (weights, made), damping = network(WIDTH), factor()
    # One model's data for both, which differ by 1e-9.
    target = jax.jit(lambda: plain("dopri8", TIMES)(TrueNetwork(), 1e-10, damping)[1])()
    optimiser = optax.adam(optax.cosine_decay_schedule(RATE, steps))

    def loss(weights):
        return jnp.mean((solve(made(weights), RTOL, damping)[1] - target) ** 2)

    @jax.jit
    def step(weights, state):
        value, slope = jax.value_and_grad(loss)(weights)
        update, state = optimiser.update(slope, state)
        return optax.apply_updates(weights, update), state, value

    state = optimiser.init(weights)
    jax.block_until_ready(step(weights, state))
    losses, seconds, began = [], [], time.perf_counter()
    for _ in range(steps):
        weights, state, value = step(weights, state)
        losses.append(float(value))
        seconds.append(time.perf_counter() - began)
    speeds, (low, high, speed) = slips(), TRUE
    found = jax.vmap(lambda slip: coefficient(made(weights), slip))(speeds)
    error = np.max(np.abs(np.asarray(found) / (low + high * np.exp(-((speeds / speed) ** 2))) - 1))
    return Trained(np.array(losses) / losses[0], np.array(seconds), float(error))


def all_trained(quick: bool) -> dict[str, Trained]:
    """By method."""
    solves = {"adjoint": ours("adjoint", TIMES), **{f"plain, {name}": plain(name, TIMES) for name in SOLVERS}}
    return {name: trained(solve, 5 if quick else STEPS) for name, solve in solves.items()}
