"""Stochastic approximation (Robbins and Monro 1951): a search for a yield with new samples in each step.

Other methods use a fixed set of samples, for which their design is slightly too good. Here each step draws a few new
samples, whose noise averages out over the steps.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optax

from clearance_jax.design.program import Program
from clearance_jax.design.repair import feasible_neighbour
from clearance_jax.design.scaling import ScaledProgram

# The weight of a violated limit over the objective: if half of the batches violate it, both balance.
PULL = 2.0


def stochastic_approximation(
    program: Program, start: np.ndarray, steps: int = 200, samples: int = 100, rate: float = 0.05, seed: int = 0
) -> None:
    """Adam (Kingma and Ba 2015, optax's) on the objective and the conditional values at risk of fresh samples.

    An exact penalty holds the limits; the answer is the mean over the second half of the steps (Polyak and Juditsky
    1992), whose rate falls to nothing, smaller if the problem's own samples say so.

    **Arguments:** `samples` of each step; fewer than 1 / (1 - target) have too little of the tail, and are optimistic;
    `rate` of the first step, in logarithms of the variables.
    """
    scaled = ScaledProgram(program, start)
    optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
    z = mean = scaled.start
    state, improve = optimiser.init(jnp.asarray(z)), jax.jit(optimiser.update)
    try:
        for step in range(steps):
            _, limits, gradient, jacobian = scaled.fresh_slopes(z, samples, seed + step)
            k = int(np.argmax(limits))
            if limits[k] > 0:
                steepness = np.linalg.norm(gradient) / max(np.linalg.norm(jacobian[k]), 1e-12)
                gradient = gradient + PULL * steepness * jacobian[k]
            update, state = improve(jnp.asarray(gradient), state, jnp.asarray(z))
            z = np.clip(z + np.asarray(update), *scaled.bounds)
            mean = mean + (z - mean) / max(step - steps // 2, 1)
    except KeyboardInterrupt:
        feasible_neighbour(program, np.exp(mean), gradient=True)
        raise
    # No other point is kept: the best of many on fixed samples would be biased towards these samples.
    feasible_neighbour(program, np.exp(mean), gradient=True)
