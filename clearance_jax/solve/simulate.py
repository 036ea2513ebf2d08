"""`simulate`: a mechanism from t0 to t1, with error control that contact cannot fool, result code and energy books."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax.dynamics.energy import BOOKS
from clearance_jax.errors import ClearanceError, require_float64, suggest
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.parameters import check_values
from clearance_jax.solve.attempt import CENTRE, STARTS, Options
from clearance_jax.solve.flow import CLOSED, Inputs, Solution, closed_start, flow, plain_flow, states_of, with_states
from clearance_jax.solve.tolerances import largest_length

MAX_STEPS = 10_000_000
DERIVATIVES = ("controlled", "screening")
OPTIONS = ("t0", "save_at", "rtol", "solver", "books", "y0", "derivatives", "start")
"""What metrics pass on to a solve."""
SOLVERS = {"tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}


def simulate(
    mechanism: Mechanism,
    t1: Any,
    *,
    t0: Any = 0.0,
    save_at: Any = None,
    rtol: Any = 1e-8,
    atol: Any = None,
    solver: str | Any = "tsit5",
    watch: bool = True,
    books: bool = True,
    derivatives: str = "controlled",
    max_steps: int = MAX_STEPS,
    y0: Any = None,
    start: str = CENTRE,
    throw: bool = True,
) -> Solution:
    """Simulate a mechanism from `t0` to `t1`. Works under jit, vmap, jvp and grad.

    **Arguments:**

    - `t1`, `t0`: end and start [s].
    - `save_at`: number of equally spaced samples (both ends included), or an array of times; `None`: only the end.
    - `rtol`: the one accuracy knob; absolute tolerances follow from it and the scene's own scales.
    - `atol`: overrides them, one number per state component `[q, v, memory]`.
    - `solver`: "tsit5", "dopri8" (for rtol below 1e-8) or an explicit diffrax Runge-Kutta solver.
    - `watch`: end steps at every switch of the contact laws. Off: the plain PID controller, whose error has a floor.
    - `books`: integrate work and losses, for `energy_residual`.
    - `derivatives`: "controlled": a differentiated solve carries the derivatives in its state and in its error control;
      first derivatives only, forward or reverse. "screening": the program is differentiated as it stands (forward
      only): cheaper, for a first look; wrong by 1e-3 and more at any tolerance where contacts begin and end.
    - `y0`: start from this state instead of the mechanism's initial one.
    - `start`: "centre": every pin starts in the middle of its sleeve (or at its `eccentricity`) and falls; "settled":
      pressed at the wall where the ideal joint's reaction puts it, and riding along with the motion. A pin that nothing
      presses starts in the middle all the same. Without effect where `y0` is given.
    - `throw`: raise where the solve fails (never inside jit or vmap: there a failed lane is data).

    **Raises:** `ClearanceError` for float64 off, t1 <= t0, numbers that are not finite or out of bounds, and a loop
    that cannot be closed; `RuntimeError` for a solve that fails on its way.
    """
    chosen = check_arguments(mechanism, t0, t1, rtol, solver)
    t0, t1 = jnp.asarray(t0, float), jnp.asarray(t1, float)
    if isinstance(save_at, int | np.integer):
        save_at = t0 + (t1 - t0) * jnp.asarray(np.linspace(0.0, 1.0, int(save_at)))
    elif save_at is not None:
        save_at = jnp.asarray(save_at, float)
        known = not any(isinstance(t, Tracer) for t in (t0, t1, save_at))
        if known and not (np.all(np.diff(save_at) > 0) and save_at[0] >= t0 and save_at[-1] <= t1):
            raise ClearanceError("The times in `save_at` must increase and lie between `t0` and `t1`.")
    options = Options(chosen, watch, books, max_steps, derivatives, start=check_start(start))
    return _run(mechanism, t0, t1, save_at, rtol, atol, y0, options, throw)


def run(
    mechanism: Mechanism,
    t1: Any,
    *,
    t0: Any = 0.0,
    save_at: Any = None,
    rtol: Any = 1e-8,
    solver: str | Any = "tsit5",
    books: bool = False,
    y0: Any = None,
    derivatives: str = "controlled",
    start: str = CENTRE,
    observers: tuple = (),
    integrands: tuple = (),
    **unknown: Any,
) -> Solution:
    """`simulate` for metrics: without books, with `observers` and `integrands`, `save_at` increasing but not strictly;
    states of a failed lane are NaN, so that no metric is made of a motion that stopped early.
    """
    chosen = check_arguments(mechanism, t0, t1, rtol, solver)
    if unknown:
        raise ClearanceError(f"There is no option `{min(unknown)}`. " + suggest(min(unknown), OPTIONS))
    options = Options(chosen, True, books, MAX_STEPS, derivatives, observers, check_start(start))
    out = _run(mechanism, t0, t1, save_at, rtol, None, y0, options, True, integrands)
    # A factor, not a selection: a selection's derivative in reverse would be a silent zero.
    factor = jnp.where(out.succeeded, 1.0, jnp.nan)

    return with_states(out, [out.initial, *(factor * y for y in states_of(out)[1:])])


def _run(mechanism, t0, t1, save_at, rtol, atol, y0, options: Options, throw, integrands=()) -> Solution:
    t0, t1, rtol = (jnp.asarray(x, float) for x in (t0, t1, rtol))
    size = layout(mechanism).size
    if size == 0:
        options = options._replace(books=True)  # without states the books are what there is to integrate
    if options.derivatives not in DERIVATIVES:
        raise ClearanceError(f"There are no derivatives {options.derivatives!r}. Allowed: {', '.join(DERIVATIVES)}.")
    if y0 is not None:
        y0 = jnp.asarray(y0, float)
        if y0.shape not in ((size,), (size + len(BOOKS),)):
            raise ClearanceError(f"`y0` must have shape ({size},), [q, v, memory], but it has {y0.shape}.")
    save_at = None if save_at is None else jnp.asarray(save_at, float)
    atol = None if atol is None else jnp.asarray(atol, float)
    inputs = Inputs(mechanism, t0, t1, save_at, rtol, atol, y0, integrands)
    solution = flow(inputs, options=options) if options.derivatives == "controlled" else plain_flow(inputs, options)
    if throw and not isinstance(solution.final, Tracer) and not bool(solution.succeeded):
        if y0 is None:
            check_assembled(mechanism, t0, _open_loops(mechanism, t0, options.start))
        raise RuntimeError(
            f"The solve stopped before t1: {solution.message}. Pass `throw=False` to keep what was computed."
        )
    return solution


@eqx.filter_jit
def _open_loops(mechanism: Mechanism, t0: Array, start: str) -> Array:
    return closed_start(mechanism.prepared(), t0, start)[1]


def check_start(start: Any) -> str:
    """Where pins are to start, if that is one of the words for it."""
    if start not in STARTS:
        raise ClearanceError(f"`start` must be {' or '.join(STARTS)}, but it is {start!r}.")
    return start


def check_assembled(mechanism: Mechanism, t0: Any, open_loops: Array) -> None:
    """Raise where a loop stays open at the start (by so much each [m]), naming it."""
    gaps = np.nan_to_num(np.asarray(open_loops), nan=np.inf)
    if np.all(gaps <= CLOSED * float(largest_length(mechanism))):
        return
    worst = int(np.argmax(gaps))
    raise ClearanceError(
        f"The mechanism cannot be assembled: at t = {float(t0):g} s its loop `{mechanism.loops[worst].name}` stays "
        f"open by {float(gaps[worst]) * 1e3:.4g} mm. Change lengths, or the joints' `position`, to start nearer to a "
        "closed one."
    )


def check_arguments(mechanism: Mechanism, t0: Any, t1: Any, rtol: Any, solver: Any) -> Any:
    """Raise for what a solve cannot start from (tracers pass: in a batch it is a result code). Returns the solver."""
    require_float64()
    check_values(mechanism)
    if not any(isinstance(t, Tracer) for t in (t0, t1)) and not -np.inf < float(t0) < float(t1) < np.inf:
        raise ClearanceError(f"`t1` must be finite and greater than `t0`, but t0 = {float(t0)} and t1 = {float(t1)}.")
    if not isinstance(rtol, Tracer) and not 0 < float(rtol) < 1:
        raise ClearanceError(f"`rtol` must be between 0 and 1, for instance 1e-8, but it is {float(rtol)}.")
    if isinstance(solver, str) and solver not in SOLVERS:
        raise ClearanceError(f"There is no solver {solver!r}. " + suggest(solver, SOLVERS))
    return SOLVERS[solver]() if isinstance(solver, str) else solver
