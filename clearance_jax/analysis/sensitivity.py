"""`sensitivities`: value and Jacobian of a metric by parameter names; `hessian`: its second derivatives.

In reverse mode one number is differentiated by many parameters, over steps that a first solve has chosen. The first
solve carries the derivative along one random direction in its error norm: it almost always needs the steps that any
other direction needs. On these fixed steps the solve is a composition of Runge-Kutta steps, which JAX differentiates in
reverse. Two levels of checkpoints recompute steps on the way back, so memory grows with the square root of their
number. The error is not controlled for each parameter by itself.
"""

from collections.abc import Callable, Sequence
from typing import Any, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._compile.solo import solo_jit
from clearance_jax.ask.question import Question, answer
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import drive_breaks, sampling_periods
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.measure import AbstractMetric, Function, as_metric
from clearance_jax.parameters import check_values, replace, values_of
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers.driver import step_ends
from clearance_jax.solve.first_state import initial
from clearance_jax.solve.flow import Inputs, refuse_jumps, task_of
from clearance_jax.solve.settings import Settings, SolveOptions, settings_of
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.steps.problem import Problem, depends, push
from clearance_jax.solve.steps.step import try_step

# Options that a reverse sweep knows.
REVERSIBLE = ("t0", "rtol", "solver", "energy_balance")
# Number of parameters from which on a reverse sweep costs less than forward derivatives.
MANY = 40


class Sensitivities(Module):
    """A metric's `value`, shape (...), and its derivatives: `jacobian[name]`, shape (..., *shape of the parameter), for
    each of the `names`.
    """

    value: Array
    jacobian: dict[str, Array]
    names: tuple[str, ...] = eqx.field(static=True)
    trusted: bool | None = eqx.field(static=True, default=None)
    """Whether the error of the derivatives was controlled (`None`: see `gradient_report`); false for a screening."""

    def __str__(self) -> str:
        def as_text(number: Array) -> str:
            return np.array2string(np.asarray(number), precision=6, threshold=20)

        lines = [f"  d/d {name} = {as_text(self.jacobian[name])}" for name in self.names]
        return "\n".join([f"value {as_text(self.value)}", *lines])

    def matrix(self) -> Float[Array, "... parameters"]:
        """The Jacobian with the parameters' entries along the last axis, in the order of `names`."""
        n = np.ndim(self.value)
        return jnp.concatenate([jnp.reshape(self.jacobian[k], (*np.shape(self.value), -1)) for k in self.names], n)


def sensitivities(
    mechanism: Mechanism,
    metric: AbstractMetric | Callable,
    wrt: Sequence[str],
    t1: Any,
    *,
    mode: str = "auto",
    **options: Unpack[SolveOptions],
) -> Sensitivities:
    """The value of a metric of the motion and its derivatives by named parameters, from one solve.

    **Arguments:**

    - `mechanism`: what moves; `t1`: end of the motion [s].
    - `metric`: one of `clearance_jax.metrics`, or a function `f(solution)` or `f(mechanism, solution)`. If the function
      needs samples, give `save_at`.
    - `wrt`: dotted names, as in `cj.parameters(mechanism)`; `name.i` for one entry of an array.
    - `mode`: "forward": derivatives with controlled error. "reverse": one solve chooses the steps, then one pass
      backwards over them gives all derivatives; for a scalar metric that is a function of the final state, and many
      parameters. "auto": "reverse" from 40 parameters on if it is possible, otherwise "forward". "screening": JAX
      differentiates the program as it stands, for a first look.
    - `options`: as `simulate`'s.

    **Raises:** `ClearanceError` for an unknown name, mode or option, a law of class C-1, and a metric without
    derivative; `RuntimeError` if the solve fails.
    """
    wrt = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if mode not in ("auto", "forward", "reverse", "screening"):
        text = f"There is no mode {mode!r}. Allowed: auto, forward, reverse, screening."
        raise ClearanceError(text).about("mode", mode)
    metric, settings = as_metric(metric), settings_of(mechanism, t1, options)
    values = values_of(mechanism, wrt)
    many = sum(number.size for number in values.values()) >= MANY
    wanted = mode == "reverse" or (mode == "auto" and many)
    obstacle = _not_in_reverse(mechanism, metric, values, options) if wanted else ""
    if mode == "reverse" and obstacle:
        raise ClearanceError(f"Reverse mode is for functions of the final state: {obstacle}. Use mode='forward'.")
    if wanted and not obstacle:
        assert isinstance(metric, Function)
        value, jacobian = reverse(mechanism, metric, values, t1, settings)
        return Sensitivities(value, jacobian, wrt)
    if mode == "screening":
        settings = settings._replace(derivatives="screening")
    solved = answer(Question(mechanism, {"": metric}, t1, settings, wrt))
    value, slopes = solved.values[""], solved.slopes[""]
    if not bool(jnp.all(jnp.isfinite(value))):
        raise RuntimeError("The solve stopped before t1, so there is no value to differentiate. Simulate to see why.")
    # The last axis is over the entries of all parameters.
    ends = np.cumsum([number.size for number in values.values()])
    parts = zip(jnp.split(slopes, ends[:-1], axis=-1), values.items(), strict=True)
    jacobian = {name: part.reshape(*slopes.shape[:-1], *number.shape) for part, (name, number) in parts}
    return Sensitivities(value, jacobian, wrt, False if mode == "screening" else None)


def _not_in_reverse(mechanism, metric, values, options) -> str:
    """Why reverse mode is not possible; empty if it is."""
    if not isinstance(metric, Function) or metric.times is not None:
        return f"`{type(metric).__name__}` looks at the whole motion"
    others = sorted(set(options) - set(REVERSIBLE))
    if others:
        return f"it does not know `{others[0]}`"
    if sampling_periods(mechanism):
        return "something is sampled"
    varied, fixed = eqx.partition(values, eqx.is_inexact_array)
    if depends(lambda v: drive_breaks(replace(mechanism, eqx.combine(v, fixed))), varied):
        return "a time at which a drive switches varies"
    return ""


class Hessian(Module):
    """Second derivatives by the parameters in `names`: `matrix`, shape (..., n, n), and an estimate of its `error`,
    same shape.
    """

    matrix: Array
    error: Array
    names: tuple[str, ...] = eqx.field(static=True)


# Relative step of the differences of gradients; a second difference has twice this step.
HESSIAN_STEP = 1e-4


def hessian(
    mechanism: Mechanism,
    metric: AbstractMetric | Callable,
    wrt: Sequence[str],
    t1: Any,
    **options: Unpack[SolveOptions],
) -> Hessian:
    """Second derivatives of a metric, as central differences of error-controlled gradients.

    The step is 1e-4 of each parameter (1e-4 if the parameter is zero), and then twice that. The result is Richardson's
    extrapolation of the two. Its stated `error` is the difference from the first, plus the asymmetry of the matrix.
    Contacts change with the parameters: if a contact appears or vanishes within the step, the error shows it.

    **Arguments:** `mechanism`, `metric`, `wrt`, `t1` and `options` as `sensitivities`'.
    """
    wrt = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    values = values_of(mechanism, wrt)
    if any(number.ndim for number in values.values()):
        raise ClearanceError("`hessian` wants scalars: name the entries of an array, `name.0`.")
    centre = jnp.stack(list(values.values()))
    step = HESSIAN_STEP * jnp.where(centre == 0, 1.0, jnp.abs(centre))

    def gradient(point):
        moved = replace(mechanism, dict(zip(wrt, point, strict=True)))
        check_values(moved)  # a number at its bound has no neighbour on both sides
        return sensitivities(moved, metric, wrt, t1, mode="forward", **options).matrix()

    def differences(size):
        moves = [jnp.zeros_like(centre).at[k].set(size * step[k]) for k in range(len(wrt))]
        rows = [(gradient(centre + m) - gradient(centre - m)) / (2 * m[k]) for k, m in enumerate(moves)]
        return jnp.stack(rows, -2)

    near, far = differences(1.0), differences(2.0)
    best = near + (near - far) / 3
    symmetric = 0.5 * (best + jnp.swapaxes(best, -1, -2))
    return Hessian(symmetric, jnp.abs(symmetric - near) + 0.5 * jnp.abs(best - jnp.swapaxes(best, -1, -2)), wrt)


SHORTEST, LONGEST = 2**10, 2**20
SEED = 20


@solo_jit
def _steps(mechanism, values, inputs: Inputs, options: Settings):
    """Ends of the steps that the motion and its derivative need (infinite beyond the last), and the result code."""
    rng = np.random.default_rng(SEED)
    probe = {
        name: jnp.where(value == 0, 1.0, jnp.abs(value))[None] * rng.choice([-1.0, 1.0], value.shape)
        for name, value in values.items()
    }
    changed, direction, _ = push(lambda v: replace(mechanism, v), values, probe)
    task = task_of(inputs._replace(mechanism=changed, save_at=None), options, (direction, None, ()))
    return step_ends(task, options)


@solo_jit
def _sweep(mechanism, values, function, begins, ends, inputs: Inputs, options: Settings):

    def of(values):
        changed = replace(mechanism, values)
        problem = Problem(changed.prepare(), (), None, options.energy_balance)
        start, _ = initial(problem, inputs.t0, None)

        def step(y, times):
            begin, end = times
            trial = try_step(problem, options.solver, (begin, end), y, jnp.zeros_like(y), True)
            return jnp.where(end > begin, trial.end, y), None

        @jax.checkpoint
        def stretch(y, times):
            return jax.lax.scan(jax.checkpoint(step), y, times)

        final, _ = jax.lax.scan(stretch, start, (begins, ends))
        end, none, reached = ends[-1, -1], jnp.zeros((), int), jnp.asarray(int(Result.REACHED_END))
        unknown, how = jnp.asarray(jnp.nan), {"sampled": False, "energy_balance": options.energy_balance}
        solution = Solution(end[None], final[None], start, final, reached, none, none, unknown, end, **how)
        return function.of(changed, solution.of(changed))

    value, pull = jax.vjp(of, values)
    rows = jax.vmap(pull)(jnp.eye(value.size).reshape(value.size, *value.shape))[0]
    return value, {name: row.reshape(*value.shape, *row.shape[1:]) for name, row in rows.items()}


def reverse(
    mechanism: Mechanism, function: Function, values: dict[str, Array], t1: Any, settings: Settings
) -> tuple[Array, dict[str, Array]]:
    """Value and Jacobian of a function of the final state by named values, which move no time when a drive switches."""
    refuse_jumps(mechanism)
    inputs = Inputs(mechanism, settings.t0, jnp.asarray(t1, float), None, settings.rtol, None, None)
    # Without states only the energy balance is there to be integrated.
    energy_balance = settings.energy_balance or layout(mechanism).size == 0
    size = SHORTEST
    while True:
        options = settings._replace(locate_events=True, energy_balance=energy_balance, max_steps=size).compiled_in()
        times, code = _steps(mechanism, values, inputs, options)
        if int(code) != Result.MAX_STEPS or size >= LONGEST:
            break
        size *= 4
    if int(code) != Result.REACHED_END:
        raise RuntimeError("The solve stopped before t1. Simulate to see why.")
    times = np.asarray(times)
    times = times[np.isfinite(times)]
    begins, ends = times[:-1].copy(), times[1:]
    breaks = np.asarray(drive_breaks(mechanism))
    margin = 4 * np.finfo(float).eps * np.abs(breaks)
    # A step that ends just before a break is followed by one just past it.
    for time, hair in zip(breaks, margin, strict=True):
        begins[(begins < time) & (time - begins <= 2 * hair)] = time + hair
    width = int(np.ceil(np.sqrt(begins.size)))
    padding = width * int(np.ceil(begins.size / width)) - begins.size
    begins, ends = (np.concatenate([x, np.full(padding, ends[-1])]).reshape(-1, width) for x in (begins, ends))
    return _sweep(mechanism, values, function, jnp.asarray(begins), jnp.asarray(ends), inputs, options)
