"""Options of a solve: one set of keywords for everything that solves, read and checked in one place.

Functions that solve take `**options`, the keywords of `SolveOptions`, and turn them into `Settings` at once. An unknown
keyword, or a value with which no solve can start, is refused there.

`solver="auto"` is the solver for a tolerance and a kind of scene. The rule follows docs/benchmarks/work_precision.md:
the solver of order eight takes longer steps, and is faster below a tolerance that depends on what limits the steps of a
scene.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypedDict

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax.dynamics.field import BALANCE_TERMS
from clearance_jax.errors import ClearanceError, quote, require_float64, unknown_name, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.parameters import as_leaf, check_values
from clearance_jax.solve.steps.tolerances import SMALLEST

AUTO = "auto"
LOW, HIGH = "tsit5", "dopri8"
"""The solvers of order five and eight."""
SMOOTH, PLANE, SPACE = "without play", "plane", "space"
LIMITS = {SMOOTH: 1e-6, PLANE: 1e-6, SPACE: 1e-6}
"""By kind of scene the largest rtol at which the solver of order eight is chosen. Near it the two take about the same
time for the same error. The page found the same limit in the plane and in space; it has no scene without play."""


def kind_of(model: Any) -> str:
    """The kind of a mechanism (or a model's), for the choice of a solver: without play, in the plane, or in space."""
    mechanism = model if isinstance(model, Mechanism) else model.mechanism
    if not mechanism.contacts():
        return SMOOTH
    return PLANE if mechanism.is_plane else SPACE


def choose_solver(model: Any, rtol: Any) -> str:
    """The name of the solver for a mechanism, or a model that has one, at a relative tolerance. **Raises**
    `ClearanceError` for an `rtol` that is traced.
    """
    if isinstance(rtol, Tracer):
        raise ClearanceError(
            f'`solver="{AUTO}"` chooses by `rtol`, but its number is not known here (it is traced by JAX). Name the '
            f'solver: "{LOW}" or "{HIGH}".'
        ).about("solver", AUTO)
    return HIGH if float(rtol) <= LIMITS[kind_of(model)] else LOW


# Largest number of output times: with some hundred numbers each they take about a gigabyte.
MOST_SAMPLES = 1_000_000
# Attempts at a step after which a solve gives up: more than any motion in the benchmarks takes, and few enough that a
# search soon leaves numbers with which a motion does not end.
MAX_STEPS = 1_000_000
DERIVATIVES = CONTROLLED, ADJOINT, AUTO, SCREENING = "controlled", "adjoint", AUTO, "screening"
# Entries of parameters from which on an adjoint costs less than controlled derivatives of one number.
MANY = 20
# Where pins start: in the middle of their sleeves (at their `eccentricity`), or at the wall where a load presses them.
STARTS = CENTRE, SETTLED = "centre", "settled"
# Models of the motion, from the dearest to the cheapest.
FIDELITIES = DYNAMICS, QUASI_STATIC, STATIC = "dynamics", "quasi-static", "static"
# Models that give a motion.
OF_MOTIONS = (DYNAMICS, QUASI_STATIC)
SOLVERS = {"tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
# What a user may write for a solver.
SOLVER_WORDS = (*SOLVERS, AUTO)


class SolveOptions(TypedDict, total=False):
    """The keywords of `simulate`, and of every other function that solves a motion.

    - `t0`: start [s] (0).
    - `save_at`: number of samples at equal distances in time (both ends included), or an array of times [s] of shape
      (samples,), in any order; `None`: only the end.
    - `rtol`: the relative accuracy (1e-8), at least 1e-14: 64-bit numbers resolve no less. Absolute tolerances follow
      from it and from the lengths and speeds of the scene.
    - `atol`: absolute tolerances in their place, one number for each state component `[q, v, memory]`, shape (n,).
    - `solver`: "auto" (one of the next two, by `rtol`; whatever is kept of the solve names the one that was chosen),
      "tsit5", "dopri8" (for rtol of 1e-6 or less), or an explicit Runge-Kutta solver of diffrax.
    - `y0`: start from this state, shape (n,), instead of the mechanism's initial one.
    - `start`: "centre": every pin starts in the middle of its sleeve (or at its `eccentricity`), and falls to the wall;
      "settled": every pin starts at the wall where the reaction of the ideal joint presses it, and moves along with the
      motion. A pin that nothing presses starts in the middle in both cases. If `y0` is given, `start` has no effect.
    - `locate_events`: end steps at every event of the contact laws. If false, an ordinary PID controller chooses the
      steps, and the error stays above a certain size.
    - `energy_balance`: integrate work and losses, for `energy_residual`.
    - `derivatives`: "controlled": a differentiated solve integrates the derivatives as well, and controls their error;
      first derivatives only, in forward or reverse mode. "adjoint": a pass backwards over the steps of one solve gives
      the derivatives by any number of numbers in the time of a few solves, in reverse mode only (`jax.grad`,
      `jax.vjp`); the error along one random direction is controlled, and a motion may have 131 072 steps. "auto", in
      reverse mode only: "adjoint" for 20 numbers and more, otherwise "controlled".
      "screening": JAX differentiates the program as it stands
      (forward mode only). This is cheaper, for a first look; if contacts begin or end, it is wrong by 1e-3 and more at
      any tolerance.
    - `max_steps`: the number of attempted steps after which a solve gives up (1 000 000).
    - `fidelity`: "dynamics": the equations of motion; "quasi-static": at every instant the pose at which pins rest
      under the load of the ideal motion, without swinging or impacts (see `solve.quasi_static`); "static": of an
      error the largest that play alone allows at every instant, whatever the load (only for `measure` and what asks
      through it). Tolerances, `start` and `locate_events` have no effect on the last two.
    """

    t0: Any
    save_at: Any
    rtol: Any
    atol: Any
    solver: Any
    y0: Any
    start: str
    locate_events: bool
    energy_balance: bool
    derivatives: str
    max_steps: int
    fidelity: str


class Settings(NamedTuple):
    """`SolveOptions` as read: every option has a value, numbers are arrays (their values are not compiled in).
    `observers` see every accepted step.
    """

    t0: Any = 0.0
    save_at: Array | None = None
    rtol: Any = 1e-8
    atol: Array | None = None
    solver: Any = AUTO
    y0: Array | None = None
    start: str = CENTRE
    locate_events: bool = True
    energy_balance: bool = False
    derivatives: str = "controlled"
    max_steps: int = MAX_STEPS
    fidelity: str = DYNAMICS
    observers: tuple = ()

    def compiled_in(self, observers: tuple = ()) -> "Settings":
        """The choices for which a solve is compiled, without numbers. **Raises** `ClearanceError` for a `fidelity`
        without steps.
        """
        if self.fidelity != DYNAMICS:
            text = f'This follows the steps of a motion, and `fidelity = "{self.fidelity}"` has none: use "{DYNAMICS}".'
            raise ClearanceError(text).about("fidelity", self.fidelity, DYNAMICS)
        solver = SOLVERS[self.solver]() if isinstance(self.solver, str) else self.solver
        return self._replace(solver=solver, observers=observers, t0=None, save_at=None, rtol=None, atol=None, y0=None)


ALL = tuple(SolveOptions.__annotations__)


def settings_of(
    mechanism: Mechanism, t1: Any, given: Mapping[str, Any], known: Iterable[str] = ALL, **usual: Any
) -> Settings:
    """The options `given` of a solve to `t1`, checked; `usual` where they differ from the common defaults.

    **Arguments:** `known`: the options that make sense here.

    **Raises:** `ClearanceError` for an unknown option or word, float64 off, t1 <= t0, numbers of the mechanism that are
    not finite or out of bounds, an array of the wrong shape.
    """
    check_names(given, known)
    asked = Settings(**{**usual, **given})
    check_arguments(mechanism, asked.t0, t1, asked.rtol, asked.solver)
    if asked.derivatives not in DERIVATIVES:
        text = f"There are no derivatives {asked.derivatives!r}. Allowed: {', '.join(DERIVATIVES)}."
        raise ClearanceError(text).about("derivatives", asked.derivatives, DERIVATIVES)
    for name, word, words in (("start", asked.start, STARTS), ("fidelity", asked.fidelity, FIDELITIES)):
        if word not in words:
            raise wrong_value(f"`{name}`", " or ".join(words), word)
    solver = asked.solver
    if _is_auto(solver):
        # Who named none gets one, also where JAX traces `rtol`.
        unnamed = "solver" not in given and isinstance(asked.rtol, Tracer)
        solver = LOW if unnamed else choose_solver(mechanism, asked.rtol)
    t0, t1, rtol, atol = (as_leaf(x) for x in (asked.t0, t1, asked.rtol, asked.atol))
    y0, save_at = _initial(mechanism, asked.y0), _times(asked.save_at, t0, t1)
    return asked._replace(solver=solver, t0=t0, rtol=rtol, atol=atol, y0=y0, save_at=save_at)


def with_solver(model: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with the solver that "auto", the default, stands for, to tell solves apart by their options."""
    if not _is_auto(options.get("solver", Settings().solver)):
        return dict(options)
    rtol = options.get("rtol", Settings().rtol)
    return {**options, "solver": choose_solver(model, rtol)}


def _is_auto(solver: Any) -> bool:
    return isinstance(solver, str) and solver == AUTO


def check_names(given: Iterable[str], known: Iterable[str]) -> None:
    """Raise for an unknown option, with a suggestion."""
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise unknown_name(f"There is no option `{unknown[0]}` here.", unknown[0], known)


def check_arguments(mechanism: Mechanism, t0: Any, t1: Any, rtol: Any, solver: Any) -> None:
    """Raise for numbers with which no solve can start (tracers pass; in a batch a result code says so)."""
    require_float64()
    check_values(mechanism)
    t0, t1, rtol = (_number(name, x) for name, x in {"t0": t0, "t1": t1, "rtol": rtol}.items())
    if not any(isinstance(t, Tracer) for t in (t0, t1)) and not -np.inf < float(t0) < float(t1) < np.inf:
        text = f"`t1` must be finite and greater than `t0`, but t0 = {float(t0)} and t1 = {float(t1)}."
        raise ClearanceError(text).about("t1", float(t1), "greater than t0")
    if not isinstance(rtol, Tracer) and not SMALLEST <= float(rtol) < 1:
        allowed = f"between {SMALLEST:g} (64-bit numbers resolve no less) and 1, for instance 1e-8"
        raise wrong_value("`rtol`", allowed, float(rtol), f"{float(rtol):g}")
    if isinstance(solver, str) and solver not in SOLVER_WORDS:
        raise unknown_name(f"There is no solver {solver!r}.", solver, SOLVER_WORDS, "solver")
    if not isinstance(solver, str | diffrax.AbstractERK):
        words = " or ".join(map(repr, SOLVER_WORDS))
        allowed = f"{words} or an explicit diffrax Runge-Kutta solver such as `diffrax.Dopri5()`"
        raise wrong_value("`solver`", allowed, solver, repr(solver))


def _number(name: str, value: Any) -> Any:
    """A tracer as it is, anything else as one number."""
    if isinstance(value, Tracer):
        return value
    try:
        return float(value)
    except (TypeError, ValueError):
        raise wrong_value(f"`{name}`", "one number", value) from None


def _initial(mechanism: Mechanism, y0: Any) -> Array | None:
    """The given initial state, checked to have the mechanism's shape; the energy balance may follow it."""
    if y0 is None:
        return None
    y0, size = jnp.asarray(y0, float), layout(mechanism).size
    if y0.shape not in ((size,), (size + len(BALANCE_TERMS),)):
        raise ClearanceError(f"`y0` must have shape ({size},), [q, v, memory], but it has {y0.shape}.")
    return y0


def _times(save_at: Any, t0: Array, t1: Array) -> Array | None:
    """The sample times [s]."""
    if save_at is None:
        return None
    if isinstance(save_at, int | np.integer) and not isinstance(save_at, bool):
        if not 2 <= save_at <= MOST_SAMPLES:
            raise wrong_value("`save_at`", f"between 2 and {MOST_SAMPLES}, the number of samples", save_at)
        return evenly(t0, t1, int(save_at))
    times = jnp.asarray(save_at, float)
    if times.ndim != 1:
        raise ClearanceError(f"`save_at` must be a whole number of samples, or a list of times, not {quote(save_at)}.")
    if not any(isinstance(t, Tracer) for t in (t0, t1, times)):
        given = np.asarray(times)
        outside = given[~((given >= t0) & (given <= t1))]
        if outside.size:
            raise ClearanceError(
                f"The times in `save_at` must lie between t0 = {float(t0):g} s and t1 = {float(t1):g} s, but one is "
                f"{outside[0]:g} s."
            ).about("save_at", float(outside[0]))
    return times


def evenly(t0: Any, t1: Any, count: int) -> Array:
    """Times from t0 to t1, both included exactly: a time a round-off beyond the end would be refused."""
    part = np.linspace(0.0, 1.0, count)
    if not any(isinstance(t, Tracer) for t in (t0, t1)):  # without a program, which JAX would compile
        return jax.device_put(np.asarray(t0) * (1 - part) + np.asarray(t1) * part)
    return t0 * jnp.asarray(1 - part) + t1 * jnp.asarray(part)
