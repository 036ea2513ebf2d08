"""`simulate`: the motion of a mechanism from t0 to t1, with error control, result code and energy balance."""

import dataclasses
import warnings
from collections.abc import Mapping
from typing import Any, Unpack

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._basis.module import is_foreign
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.dynamics.field import BALANCE_TERMS
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.parameters import as_leaf
from clearance_jax.solve.adjoint import adjoint_flow
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers import effort
from clearance_jax.solve.first_state import closed_start
from clearance_jax.solve.flow import Inputs, flow, plain_flow
from clearance_jax.solve.law_validity import warn_of_validity
from clearance_jax.solve.quasi_static import quasi_static
from clearance_jax.solve.settings import CONTROLLED, DYNAMICS, SCREENING, STATIC, Settings, SolveOptions, settings_of
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
      (samples,), in any order; `None`: only the end.
    - `rtol`: the relative accuracy, at least 1e-14. Absolute tolerances follow from it and from the lengths and speeds
      of the scene.
    - `solver`: "auto" (one of the next two, by `rtol`), "tsit5", "dopri8" (for rtol of 1e-6 or less), or an
      explicit Runge-Kutta solver of diffrax.
    - `throw`: raise an error if the solve fails; if false, return what was computed. Inside jit, vmap or a derivative
      nothing is raised: every number of a solve that fails, and its derivative, is NaN, and `Solution.code` says why.
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
        ).about("fidelity", "static")
    solution = run(mechanism, t1, settings_of(mechanism, t1, options, energy_balance=books), throw=throw)
    warn_of_energy(solution)
    warn_of_validity(solution)
    return solution


def run(
    mechanism: Mechanism,
    t1: Any,
    settings: Settings,
    *,
    throw: bool = True,
    observers: tuple = (),
    integrands: tuple = (),
) -> Solution:
    """`simulate` for metrics: with `observers` and `integrands`, and settings that have been read."""
    settings, places = _in_order(settings)
    solve = _moved if settings.fidelity == DYNAMICS else _posed
    solution = solve(mechanism, as_leaf(t1), settings, throw, observers, integrands)
    if places is not None:
        solution = dataclasses.replace(solution, time=solution.time[places], y=solution.y[places])
    if isinstance(solution.final, Tracer):
        solution = dataclasses.replace(only_reached(solution, solution), end_time=solution.end_time)
    return solution.of(mechanism)


def _in_order(settings: Settings) -> tuple[Settings, Array | np.ndarray | None]:
    """The settings with increasing sample times, and the index of each given time (`None`: they were in order)."""
    times = settings.save_at
    if times is None:
        return settings, None
    if isinstance(times, Tracer):
        order = jnp.argsort(jax.lax.stop_gradient(times))
        return settings._replace(save_at=times[order]), jnp.argsort(order)
    known = np.asarray(times)
    if np.all(np.diff(known) >= 0):
        return settings, None
    order = np.argsort(known, kind="stable")
    return settings._replace(save_at=jnp.asarray(known[order])), np.argsort(order)


def only_reached(solution: Solution, tree: Any) -> Any:
    """A tree whose numbers, and their derivatives, are NaN where the motion did not reach its end."""
    # A factor, not a selection: a selection's derivative in reverse would be a silent zero.
    factor = jnp.where(solution.succeeded, 1.0, jnp.nan)
    return jax.tree.map(lambda x: factor * x if jnp.issubdtype(jnp.result_type(x), jnp.inexact) else x, tree)


def _moved(mechanism, t1, settings: Settings, throw: bool, observers: tuple, integrands: tuple) -> Solution:
    options = settings.compiled_in(observers)
    if layout(mechanism).size == 0:
        # Without states, the energy balance is the only thing to integrate.
        options = options._replace(energy_balance=True)
    inputs = Inputs(mechanism, settings.t0, t1, settings.save_at, settings.rtol, settings.atol, settings.y0, integrands)
    if options.derivatives == CONTROLLED:
        solution = flow(inputs, options=options)
    else:
        solution = (plain_flow if options.derivatives == SCREENING else adjoint_flow)(inputs, options)
    effort.count(solution.steps, solution.rejected)
    if throw and not isinstance(solution.final, Tracer) and int(solution.code) != int(Result.REACHED_END):
        if settings.y0 is None:
            check_start(mechanism, settings.t0, _start_errors(mechanism, settings.t0, options.start))
        raise RuntimeError(
            f"The solve stopped before t1: {solution.message}{_progress(solution, options.max_steps)}. "
            "Pass `throw=False` to keep what was computed."
        )
    return solution


def _progress(solution: Solution, most: int) -> str:
    """How far a single solve came that used up its steps, with advice; empty for another."""
    if int(solution.code) != int(Result.MAX_STEPS):
        return ""
    return (
        f", {most} (`max_steps`), at t = {float(solution.end_time):.4g} s. A number may make the motion far too fast "
        "or stiff; if it is as it should be, give more"
    )


def _posed(mechanism, t1, settings: Settings, throw: bool, observers: tuple, integrands: tuple) -> Solution:
    solution = quasi_static(mechanism, t1, settings, observers, integrands)
    if throw and not isinstance(solution.final, Tracer) and int(solution.code) != int(Result.REACHED_END):
        raise RuntimeError(f'There is no quasi-static motion: {solution.message}. Use `fidelity = "dynamics"`.')
    return solution


@solo_jit
def _start_errors(mechanism: Mechanism, t0: Array, start: str) -> StartErrors:
    return closed_start(mechanism.prepare(), t0, start)[1]


class EnergyWarning(UserWarning):
    """The energy balance of a solve does not close: do not trust its motion."""


def doubt(solution: Solution) -> str:
    """Why a single solve that reached its end cannot be trusted, in words; empty if its energy balance closes, and no
    contact has given energy.
    """
    residual = float(solution.energy_residual)
    if int(solution.code) != int(Result.REACHED_END) or not np.isfinite(residual):
        return ""
    if residual > DOUBTFUL:
        return (
            f"The energy balance does not close: {residual:.1e} of the energy exchanged is missing (more than "
            f"{DOUBTFUL:g}). Do not trust this motion: lower `rtol`."
        )
    size = layout(solution.mechanism).size
    _, absorbed, friction, exchanged = map(float, solution.final[size : size + len(BALANCE_TERMS)])
    given = -min(absorbed, friction)
    # At rest what is exchanged is a round-off, beside what contacts hold.
    if not given > DOUBTFUL * (abs(exchanged) + abs(absorbed)):
        return ""
    # Laws of the library take energy: what has given it is another part that may, such as a mesh with an error.
    suspects = [f"`{name}`" for name in foreign_contacts(solution.mechanism)]
    if not suspects:
        return ""
    giving = f"Contact laws of {', '.join(suspects)} have given {given:.3g} J to the motion"
    return f"{giving}: a law must take energy. Look at its signs."


def foreign_contacts(mechanism: Mechanism) -> list[str]:
    """The names of the clearance joints with contact laws that are none of the library's."""
    joints = mechanism.clearance_joints()
    laws = {joint.name: (joint.clearance.normal, joint.clearance.friction) for joint in joints}
    return [name for name, pair in laws.items() if any(map(is_foreign, map(type, filter(None, pair))))]


def doubts_contacts(mechanism: Mechanism, t1: Any, options: Mapping[str, Any]) -> bool:
    """Whether a solve needs an energy balance that nobody asked for: a contact law that is none of the library's may
    give energy, and it can be told (not inside JAX transforms).
    """
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((mechanism, t1)))
    return not traced and options.get("fidelity", DYNAMICS) == DYNAMICS and bool(foreign_contacts(mechanism))


def warn_of_energy(solution: Solution) -> None:
    """Warn if a single solve with an energy balance cannot be trusted (not inside JAX transforms)."""
    if not solution.energy_balance:
        return
    traced = any(isinstance(x, Tracer) for x in (solution.energy_residual, solution.code, solution.final))
    message = "" if traced else doubt(solution)
    if message:
        warnings.warn(message, EnergyWarning, stacklevel=3)
