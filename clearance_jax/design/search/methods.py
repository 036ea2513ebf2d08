"""Optimisers for a `Program`: SLSQP, trust-constr; COBYQA without gradients.

They return only why they stopped early: the program keeps every point, and its best feasible point is the answer, also
after an interruption.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.optimize

from clearance_jax.design.search.program import Program
from clearance_jax.design.search.scaling import ScaledProgram
from clearance_jax.errors import unknown_name


class Method(NamedTuple):
    """An optimiser.

    - `name`; `solve`: `solve(program, start, **options)` returns why it stopped early, or nothing.
    - `gradients`: whether it uses them.
    - `slack`: the share of their bounds to which it meets limits.
    """

    name: str
    solve: Callable[..., str | None]
    gradients: bool = True
    slack: float = 1e-3


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
