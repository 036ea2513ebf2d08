"""`simulate`: a mechanism from t0 to t1, with error control that contact cannot fool, result code and energy books."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from clearance_jax._checks import BOUNDS, ClearanceError, require_float64, suggest
from clearance_jax._types import Scalar
from clearance_jax.dynamics import rate
from clearance_jax.energy import BOOKS, energies, opened_books, read_books
from clearance_jax.equations import openings, projected
from clearance_jax.mechanism.body import Servo
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout, parameters
from clearance_jax.stepping import ContactController, Stepper
from clearance_jax.tolerances import Tolerances, largest_length, tolerances

# Traced once and called from every stage (a step asks for it a dozen times); XLA inlines the calls.
_rate = jax.jit(rate)
SOLVERS = {"tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}


class Solution(eqx.Module):
    """A solved motion.

    - `time`: sample times [s], shape (samples,); `y`: states `[q, v, memory, books]` there, shape (samples, n).
    - `final`: the state at the end; `initial`: at the start.
    - `result`: diffrax's code; `succeeded` where the solve reached t1, `message` in words; `steps`, `rejected`: counts.
    - `energy_residual`: |energy gained - work of drives + losses| / energy exchanged, a measure of the solve's quality.
    """

    time: Float[Array, " samples"]
    y: Float[Array, "samples n"]
    initial: Float[Array, " n"]
    final: Float[Array, " n"]
    result: Any
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    energy_residual: Float[Array, ""]

    @property
    def succeeded(self) -> Array:
        """Whether the solve reached t1."""
        return self.result == diffrax.RESULTS.successful

    @property
    def message(self) -> str:
        """Why a single solve stopped; empty where it reached t1."""
        return "" if bool(self.succeeded) else meaning(self.result)


def meaning(result: Any) -> str:
    """A failed solve's code in words."""
    if bool(result == diffrax.RESULTS.dt_min_reached):
        return "the step size collapsed: a state that is not finite, or a force that jumps"
    if bool(result == diffrax.RESULTS.nonlinear_divergence):
        return "a number is out of its bounds, or the mechanism cannot be assembled"
    return diffrax.RESULTS[result].rstrip(".")


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
    max_steps: int = 10_000_000,
    y0: Any = None,
    throw: bool = True,
) -> Solution:
    """Simulate a mechanism from `t0` to `t1`. Works under jit, vmap and jvp.

    **Arguments:**

    - `t1`, `t0`: end and start [s].
    - `save_at`: number of equally spaced samples (both ends included), or an array of times; `None`: only the end.
    - `rtol`: the one accuracy knob; absolute tolerances follow from it and the scene's own scales.
    - `atol`: overrides them, one number per state component `[q, v, memory]`.
    - `solver`: "tsit5", "dopri8" (for rtol below 1e-8) or an explicit diffrax Runge-Kutta solver.
    - `watch`: end steps at every switch of the contact laws. Off: the plain PID controller, whose error has a floor.
    - `books`: integrate work and losses, for `energy_residual`.
    - `y0`: start from this state instead of the mechanism's initial one.
    - `throw`: raise where the solve fails (never inside jit or vmap: there a failed lane is data).

    **Raises:** `ClearanceError` for float64 off, t1 <= t0, numbers that are not finite or out of bounds, and a loop
    that cannot be closed; `RuntimeError` for a solve that fails on its way.
    """
    chosen = check_arguments(mechanism, t0, t1, rtol, solver)
    t0, t1, rtol = (jnp.asarray(x, float) for x in (t0, t1, rtol))
    size = layout(mechanism).size
    books = books or size == 0  # without states the books are what there is to integrate
    if isinstance(save_at, int | np.integer):
        save_at = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, int(save_at))
    elif save_at is not None:
        save_at = jnp.asarray(save_at, float)
        known = not any(isinstance(t, Tracer) for t in (t0, t1, save_at))
        if known and not (np.all(np.diff(save_at) > 0) and save_at[0] >= t0 and save_at[-1] <= t1):
            raise ClearanceError("The times in `save_at` must increase and lie between `t0` and `t1`.")
    if y0 is not None:
        y0 = jnp.asarray(y0, float)
        if y0.shape not in ((size,), (size + len(BOOKS),)):
            raise ClearanceError(f"`y0` must have shape ({size},), [q, v, memory], but it has {y0.shape}.")
    solution = _solve(mechanism, t0, t1, save_at, rtol, atol, chosen, watch, books, max_steps, y0)
    if throw and not isinstance(solution.final, Tracer) and not bool(solution.succeeded):
        if y0 is None:
            check_assembled(mechanism, t0, solution.initial)
        raise RuntimeError(
            f"The solve stopped before t1: {solution.message}. Pass `throw=False` to keep what was computed."
        )
    return solution


@eqx.filter_jit
def _solve(mechanism, t0, t1, save_at, rtol, atol, solver, watch, books, max_steps, y0) -> Solution:
    mechanism = mechanism.prepared()
    start = _start(mechanism, t0, books, y0)
    # A lane of a batch with impossible numbers, or a mechanism that is not closed, ends at once with a code of its own.
    possible = jnp.isfinite(t1) & (t1 > t0) & (rtol > 0) & (rtol < 1) & bounds_hold(mechanism)
    if y0 is None:
        possible &= is_assembled(mechanism, t0, start)
    end = jnp.where(possible, t1, t0)
    save_at = None if save_at is None else jnp.where(possible, save_at, t0)
    allowed = _tolerances(mechanism, t0, t1, start, rtol, atol)
    out = _integrate(mechanism, t0, end, start, save_at, allowed, solver, watch, max_steps)
    result = diffrax.RESULTS.where(possible, out.result, diffrax.RESULTS.nonlinear_divergence)
    final = out.ys[0][-1]
    time = out.ts[0] if save_at is None else out.ts[1]
    y = out.ys[0] if save_at is None else _samples(mechanism, time, out.ys[1])
    residual = energy_residual(mechanism, t0, t1, start, final) if books else jnp.asarray(jnp.nan)
    return Solution(
        time, y, start, final, result, out.stats["num_accepted_steps"], out.stats["num_rejected_steps"], residual
    )


def _start(mechanism, t0, books, y0):
    if y0 is not None and y0.shape[0] > layout(mechanism).size:
        return jnp.asarray(y0, float)
    start = initial_state(mechanism, t0) if y0 is None else jnp.asarray(y0, float)
    return opened_books(t0, start, mechanism) if books else start


def _samples(mechanism, time, y):
    """Dense output interpolates between projected states: project the samples of a mechanism with closures too."""
    if not mechanism.closures():
        return y
    return jax.vmap(lambda t, y: projected(t, y, mechanism, mechanism.closures(), 1))(time, y)


def _tolerances(mechanism, t0, t1, start, rtol, atol):
    size = layout(mechanism).size
    return tolerances(mechanism, start[:size], t0, t1, rtol, atol, start.shape[0] - size)


def _integrate(mechanism, t0, t1, start, save_at, allowed: Tolerances, solver, watch, max_steps, steps=False):
    controller = ContactController(  # pyright: ignore[reportCallIssue]  # the abstract rtol, atol, norm are properties
        scale=allowed.absolute,
        relative=allowed.relative,
        breaks=drive_breaks(mechanism),
        margin=allowed.margin,
        watch=watch,
    )
    subs = [diffrax.SubSaveAt(t1=True)]
    subs += [] if save_at is None else [diffrax.SubSaveAt(ts=save_at)]
    subs += [diffrax.SubSaveAt(t0=True, steps=True)] if steps else []
    return diffrax.diffeqsolve(
        diffrax.ODETerm(_rate),
        Stepper(solver),
        t0,
        t1,
        None,
        start,
        args=mechanism,
        saveat=diffrax.SaveAt(subs=subs),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=max_steps,
        throw=False,
    )


def energy_residual(mechanism, t0, t1, start, final):
    """|energy gained - work of drives + losses| / energy exchanged between two states with books."""
    before, after = energies(t0, start, mechanism), energies(t1, final, mechanism)
    gained = sum(after.values()) - sum(before.values())
    books = read_books(t1, final, mechanism)
    lost, exchanged = books["damping_loss"] + books["friction_loss"], books["exchanged"]
    return jnp.abs(gained - books["drive_work"] + lost) / jnp.where(exchanged > 0, exchanged, 1.0)


def initial_state(mechanism: Mechanism, t0: Scalar) -> Array:
    """The state at t0: the given initial values, then the nearest ones at which every loop is assembled.

    A loop with clearance starts with its pin at `eccentricity` in the sleeve and at rest relative to it, that is, with
    the positions and velocities of the ideal mechanism.
    """
    plan = layout(mechanism)
    free = mechanism.free_coordinates()
    q = [jnp.asarray(c.motion.position, dtype=float) for c in free]
    v = [jnp.asarray(c.motion.velocity, dtype=float) for c in free]
    y = jnp.concatenate([jnp.stack([*q, *v]) if free else jnp.zeros(0), jnp.zeros(plan.remembered)])
    return projected(t0, y, mechanism, mechanism.loops, 12) if mechanism.loops and mechanism.assemble else y


def is_assembled(mechanism: Mechanism, t0: Scalar, y: Array) -> Array:
    """Whether every loop is closed at the start (true where the mechanism is not to be assembled)."""
    if not mechanism.loops or not mechanism.assemble:
        return jnp.asarray(True)
    gaps = jnp.stack(list(openings(t0, y, mechanism).values()))
    return jnp.all(gaps <= 1e-10 * largest_length(mechanism))


def check_assembled(mechanism: Mechanism, t0: Any, y: Array) -> None:
    """Raise where a loop is open at the start, naming it."""
    t0 = jnp.asarray(t0, float)
    if bool(is_assembled(mechanism, t0, y)):
        return
    name, gap = max(openings(t0, y, mechanism).items(), key=lambda item: np.nan_to_num(float(item[1]), nan=np.inf))
    raise ClearanceError(
        f"The mechanism cannot be assembled: at t = {float(t0):g} s its loop `{name}` stays open by "
        f"{float(gap) * 1e3:.4g} mm. Change lengths, or the joints' `position`, to start nearer to a closed one."
    )


def drive_breaks(mechanism: Mechanism) -> Array:
    """Break times of every drive and servo target."""
    drives = [c.motion.drive for c in mechanism.coordinates() if c.motion.drive is not None]
    servos = [a for c in mechanism.coordinates() for a in c.motion.actuators]
    drives += [a.target for a in servos if isinstance(a, Servo)]
    return jnp.concatenate([jnp.zeros(0), *(drive.breaks() for drive in drives)])


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


def bounds_hold(mechanism: Mechanism) -> Array:
    """Whether every number is finite and inside its bounds (a flag, also for tracers)."""
    flags = []
    for leaf in parameters(mechanism).values():
        flags.append(jnp.all(jnp.isfinite(leaf.value)))
        flags += [jnp.all(f(leaf.value, leaf.metadata[b])) for b, f, _ in BOUNDS if leaf.metadata.get(b) is not None]
    return jnp.all(jnp.stack(flags)) if flags else jnp.asarray(True)


def check_values(mechanism: Mechanism) -> None:
    """Raise for a number that is not finite or not inside its bounds. Tracers pass."""
    for name, leaf in parameters(mechanism).items():
        if isinstance(leaf.value, Tracer):
            continue
        try:
            value = np.asarray(leaf.value, float)
        except (TypeError, ValueError):
            raise ClearanceError(f"`{name}` must be a number in {leaf.metadata['unit']}, not {leaf.value!r}.") from None
        if not np.all(np.isfinite(value)):
            raise ClearanceError(f"`{name}` must be finite, but it is {value.tolist()}.")
        for bound, holds, words in BOUNDS:
            limit = leaf.metadata.get(bound)
            if limit is not None and not np.all(holds(value, limit)):
                raise ClearanceError(
                    f"`{name}` must be {words} {limit:g} {leaf.metadata['unit']}, but it is {value.tolist()}."
                )


__all__ = ["SOLVERS", "Solution", "frames", "initial_state", "simulate"]
