"""Optimisers for a `Program`: SLSQP, trust-constr, stochastic approximation; COBYQA without gradients.

They return only why they stopped early: the program keeps every point, and its best feasible point is the answer, also
after an interruption.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import scipy.optimize

from clearance_jax.design.search.program import Program
from clearance_jax.design.search.scaling import ScaledProgram, feasible_neighbour
from clearance_jax.errors import unknown_name

# The weight of a violated limit over the objective: if half of the batches violate it, both balance.
PULL = 2.0


def stochastic_approximation(
    program: Program, start: np.ndarray, steps: int = 200, samples: int = 100, rate: float = 0.05, seed: int = 0
) -> None:
    """Adam (Kingma and Ba 2015, optax's) on the objective and the conditional values at risk of fresh samples
    (stochastic approximation: Robbins and Monro 1951).

    Other methods use a fixed set of samples, for which their design is slightly too good. Here each step draws a few
    new samples, whose noise averages out over the steps. A penalty on the most violated limit holds the limits. The
    rate of the steps falls to zero. The answer is the mean over the second half of the steps (Polyak and Juditsky
    1992). If this mean violates a limit on the problem's own samples, all variables are made smaller until it does not.

    **Arguments:** `samples` of each step; fewer than 1 / (1 - target) have too little of the tail, and are optimistic;
    `rate` of the first step, in logarithms of the variables.
    """
    scaled = ScaledProgram(program, start)
    optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
    z = mean = scaled.start
    state, improve = optimiser.init(jnp.asarray(z)), jax.jit(optimiser.update)
    try:
        for step in range(steps):
            _, limits, gradient, jacobian = scaled.slopes_of(program.fresh(np.exp(z), samples, seed + step))
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


class Method(NamedTuple):
    """An optimiser.

    - `name`; `solve`: `solve(program, start, **options)` returns why it stopped early, or nothing.
    - `gradients`: whether it uses them.
    - `slack`: the share of their bounds to which it meets limits; `is_mean`: whether its answer is a mean of many
      points, which is not to be improved on the program's own samples.
    """

    name: str
    solve: Callable[..., str | None]
    gradients: bool = True
    slack: float = 1e-3
    is_mean: bool = False


def slsqp(program: Program, start: np.ndarray, tolerance: float = 1e-10) -> str:
    """Sequential quadratic programming (Kraft 1988), scipy's."""
    return _scipy(program, start, "SLSQP", {"ftol": tolerance, "maxiter": 200})


def trust_constr(program: Program, start: np.ndarray, tolerance: float = 1e-10) -> str:
    """Trust-region interior point, scipy's: slower than SLSQP, and more robust."""
    return _scipy(program, start, "trust-constr", {"gtol": tolerance, "xtol": 1e-12, "maxiter": 500})


def cobyqa(program: Program, start: np.ndarray, tolerance: float = 1e-6, radius: float = 1.0, most: int = 5000) -> str:
    """Quadratic models without gradients (Ragonneau 2022), scipy's; `radius`: of the first model, in logarithms."""
    return _scipy(program, start, "COBYQA", {"final_tr_radius": tolerance, "initial_tr_radius": radius, "maxfev": most})


def _scipy(program: Program, start, method: str, options: dict) -> str:
    exact = method != "COBYQA"
    scaled = ScaledProgram(program, start, exact)
    limits = {"fun": lambda z: -scaled.value(z)[1]}
    limits |= {"jac": lambda z: -scaled.slopes(z)[3]} if exact else {}

    def objective(z):
        if not exact:
            return scaled.value(z)[0]
        # Value and slopes in one solve: SLSQP asks for both almost everywhere.
        value, _, gradient, _ = scaled.slopes(z)
        return value, gradient

    if method == "SLSQP":
        constraints = [{"type": "ineq", **limits}]
    else:
        constraints = [scipy.optimize.NonlinearConstraint(**limits, lb=0.0, ub=np.inf)]
    solution = scipy.optimize.minimize(
        objective,
        scaled.start,
        jac=exact or None,
        method=method,
        bounds=scipy.optimize.Bounds(*scaled.bounds, keep_feasible=method != "COBYQA"),
        constraints=constraints if program.limit_names else [],
        options=options,
    )
    return "" if solution.success else f"{method} ended with: {solution.message}"


METHODS = {
    method.name: method
    for method in (
        Method("slsqp", slsqp),
        Method("trust-constr", trust_constr),
        Method("stochastic-approximation", stochastic_approximation, is_mean=True),
        Method("cobyqa", cobyqa, gradients=False),
    )
}
"""The optimisers by their names."""
AUTO = "auto"
METHOD_CHOICES = (AUTO, *METHODS)
"""The names of methods, and `AUTO`, which chooses between gradients and none."""


def method_of(method: str | Method) -> Method:
    """The method of a name. **Raises** `ClearanceError` if there is none."""
    if isinstance(method, Method):
        return method
    if method not in METHODS:
        raise unknown_name(f"There is no design method {method!r}.", method, METHOD_CHOICES, "method")
    return METHODS[method]
