"""`simulate`: a mechanism from t0 to t1, with error control that contact cannot fool, result code and energy
balance.
"""

import warnings
from typing import Any, Unpack

import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._solo import solo_jit
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.parameters import as_leaf
from clearance_jax.solve import effort
from clearance_jax.solve.codes import Result
from clearance_jax.solve.first_state import closed_start
from clearance_jax.solve.flow import Inputs, flow, plain_flow, states_of, with_states
from clearance_jax.solve.law_validity import warn_of_validity
from clearance_jax.solve.quasi_static import quasi_static
from clearance_jax.solve.settings import DYNAMICS, STATIC, Settings, SolveOptions, settings_of
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.start import check_start

# An energy residual above this is a motion that nobody should build on; a good one is of the size of rtol.
DOUBTFUL = 1e-3


def simulate(mechanism: Mechanism, t1: Any, *, throw: bool = True, **options: Unpack[SolveOptions]) -> Solution:
    """Simulate the motion of a mechanism from `t0` to `t1`. It works under jit, vmap, jvp and grad.

    **Arguments:**

    - `mechanism`: what moves.
    - `t1`, `t0`: end and start [s].
    - `save_at`: number of samples at equal distances in time (both ends included), or an array of times [s] of shape
      (samples,); `None`: only the end.
    - `rtol`: the relative accuracy. Absolute tolerances follow from it and from the lengths and speeds of the scene.
    - `solver`: "tsit5", "dopri8" (for rtol of 1e-6 or less), "auto" (one of the two, by `rtol`), or an
      explicit Runge-Kutta solver of diffrax.
    - `throw`: raise an error if the solve fails. Inside jit or vmap nothing is raised: see `Solution.code`.
    - `atol`, `y0`, `start`, `locate_events`, `energy_balance` (true here), `derivatives`, `max_steps`, `fidelity`: see
      `SolveOptions`.

    **Raises:** `ClearanceError` for an unknown option, without 64-bit floats, for t1 <= t0, for numbers that are not
    finite or out of bounds, for a loop that cannot be closed, and for a pin that finds no place of rest in a settled
    start; `RuntimeError` for a solve that fails before it reaches `t1`.

    **Warns:** `EnergyWarning` if the energy residual is large; `ValidityWarning` if a contact law is used where it does
    not hold (of a batch see `cj.analysis.within_validity`).
    """
    books = options.get("fidelity", DYNAMICS) == DYNAMICS
    if options.get("fidelity") == STATIC:
        raise ClearanceError(
            "A static bound is of metrics, each by places of the pins of its own: it is no motion. Ask `measure`."
        )
    solution = _run(mechanism, t1, settings_of(mechanism, t1, options, energy_balance=books), throw)
    warn_of_energy(solution)
    warn_of_validity(solution)
    return solution


def run(
    mechanism: Mechanism, t1: Any, settings: Settings, *, observers: tuple = (), integrands: tuple = ()
) -> Solution:
    """`simulate` for metrics: with `observers` and `integrands`, sample times increasing but not strictly; states of a
    failed lane are NaN, so that no metric is made of a motion that stopped early.
    """
    out = _run(mechanism, t1, settings, True, observers, integrands)
    # A factor, not a selection: a selection's derivative in reverse would be a silent zero.
    factor = jnp.where(out.succeeded, 1.0, jnp.nan)
    return with_states(out, [out.initial, *(factor * y for y in states_of(out)[1:])])


def _run(mechanism, t1, settings: Settings, throw: bool, observers=(), integrands=()) -> Solution:
    if settings.fidelity != DYNAMICS:
        return _posed(mechanism, as_leaf(t1), settings, throw, observers, integrands)
    options = settings.as_options(observers)
    if layout(mechanism).size == 0:
        # Without states the energy balance is what there is to integrate.
        options = options._replace(energy_balance=True)
    t1, given = as_leaf(t1), settings
    inputs = Inputs(mechanism, given.t0, t1, given.save_at, given.rtol, given.atol, given.y0, integrands)
    solution = flow(inputs, options=options) if options.derivatives == "controlled" else plain_flow(inputs, options)
    effort.count(solution.steps, solution.rejected)
    if throw and not isinstance(solution.final, Tracer) and int(solution.code) != int(Result.REACHED_END):
        if given.y0 is None:
            check_start(mechanism, given.t0, _start_errors(mechanism, given.t0, options.start))
        raise RuntimeError(
            f"The solve stopped before t1: {solution.message}. Pass `throw=False` to keep what was computed."
        )
    return solution.of(mechanism)


def _posed(mechanism, t1, settings: Settings, throw: bool, observers: tuple, integrands: tuple) -> Solution:
    solution = quasi_static(mechanism, t1, settings, observers, integrands)
    if throw and not isinstance(solution.final, Tracer) and int(solution.code) != int(Result.REACHED_END):
        raise RuntimeError(f'There is no quasi-static motion: {solution.message}. Use `fidelity = "dynamics"`.')
    return solution.of(mechanism)


@solo_jit
def _start_errors(mechanism: Mechanism, t0: Array, start: str) -> StartErrors:
    return closed_start(mechanism.prepare(), t0, start)[1]


class EnergyWarning(UserWarning):
    """The energy balance of a solve does not close: its motion is not to be trusted."""


def doubt(solution: Solution) -> str:
    """Why a single solve that reached its end is not to be trusted, in words; empty where its energy balance closes."""
    residual = float(solution.energy_residual)
    if int(solution.code) != int(Result.REACHED_END) or not residual > DOUBTFUL:
        return ""
    return (
        "The energy balance does not close: "
        f"{residual:.1e} of the energy exchanged is missing (more than {DOUBTFUL:g}). "
        "Do not trust this motion: lower `rtol`."
    )


def warn_of_energy(solution: Solution) -> None:
    """Warn of a single solve that is not to be trusted (under a transformation there is nobody to be warned)."""
    said = "" if isinstance(solution.energy_residual, Tracer) else doubt(solution)
    if said:
        warnings.warn(said, EnergyWarning, stacklevel=3)
