"""`sensitivities`: value and Jacobian of a metric by parameter names; `hessian`: its second derivatives."""

from collections.abc import Callable, Sequence
from typing import Any, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax.ask.question import Answer, Question, answer
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, as_metric
from clearance_jax.parameters import check_values, replace, values_of
from clearance_jax.solve.settings import (
    ADJOINT,
    AUTO,
    CONTROLLED,
    DERIVATIVES,
    DYNAMICS,
    SCREENING,
    SolveOptions,
    settings_of,
)
from clearance_jax.solve.steps.tolerances import CLOSEST

# An adjoint's error is so many times its difference from one at this part of `rtol` (of a tiny one, at as many times).
FINER, COVERS = 0.1, 2.0


class Sensitivities(Module):
    """A metric's `value`, shape (...), and its derivatives: `jacobian[name]`, shape (..., *shape of the parameter), for
    each of the `names`.
    """

    value: Array
    jacobian: dict[str, Array]
    names: tuple[str, ...] = eqx.field(static=True)
    trusted: bool | None = eqx.field(static=True, default=None)
    """Whether the error of the derivatives was controlled (`None`: see `gradient_report`); false for a screening."""
    error: dict[str, Array] | None = None
    """Of an adjoint, by name, for each number of the metric: an estimate of the largest error of its derivatives."""

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
    mode: str = AUTO,
    **options: Unpack[SolveOptions],
) -> Sensitivities:
    """The value of a metric of the motion and its derivatives by named parameters, from one solve.

    **Arguments:**

    - `mechanism`: what moves; `t1`: end of the motion [s].
    - `metric`: one of `clearance_jax.metrics`, or a function `f(solution)` or `f(mechanism, solution)`. If the function
      needs samples, give `save_at`.
    - `wrt`: dotted names, as in `cj.parameters(mechanism)`; `name.i` for one entry of an array.
    - `mode`: as the option `derivatives` of `simulate`. "auto": "adjoint" if the parameters have 20 entries and more
      for each number of the metric, otherwise "controlled".
    - `options`: as `simulate`'s.

    It works under jit and vmap; a solve that fails is NaN there.

    **Raises:** `ClearanceError` for an unknown name, mode or option, a law of class C-1, and a metric without
    derivative; `RuntimeError` if the solve fails.
    """
    wrt = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if mode not in DERIVATIVES:
        text = f"There is no mode {mode!r}. Allowed: {', '.join(DERIVATIVES)}."
        raise ClearanceError(text).about("mode", mode)
    metric, settings = as_metric(metric), settings_of(mechanism, t1, options)
    values = values_of(mechanism, wrt)
    question = Question(mechanism, {"": metric}, t1, settings._replace(derivatives=mode), wrt).chosen()
    settings, mode = question.settings, question.settings.derivatives
    solved, jacobian = _solved(question)
    reached = jnp.all(jnp.isfinite(solved.values[""]))
    if not isinstance(reached, Tracer) and not reached:
        raise RuntimeError("The solve stopped before t1, so there is no value to differentiate. Simulate to see why.")
    error = None
    if mode == ADJOINT and settings.fidelity == DYNAMICS:
        part = jnp.where(FINER * settings.rtol < CLOSEST, 1 / FINER, FINER)
        _, other = _solved(Question(mechanism, {"": metric}, t1, settings._replace(rtol=part * settings.rtol), wrt))
        off = {name: jnp.abs(other[name] - jacobian[name]) for name in wrt}
        error = {name: COVERS * jnp.max(x, tuple(range(x.ndim - values[name].ndim, x.ndim))) for name, x in off.items()}
    return Sensitivities(solved.values[""], jacobian, wrt, False if mode == SCREENING else None, error)


def _solved(question: Question) -> tuple[Answer, dict[str, Array]]:
    """The answer, and the derivatives of its only value by name."""
    values, solved = values_of(question.model, question.by), answer(question)
    slopes = solved.slopes[""]
    # The last axis is over the entries of all parameters.
    ends = np.cumsum([number.size for number in values.values()])
    parts = zip(jnp.split(slopes, ends[:-1], axis=-1), values.items(), strict=True)
    return solved, {name: part.reshape(*slopes.shape[:-1], *number.shape) for part, (name, number) in parts}


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
        return sensitivities(moved, metric, wrt, t1, mode=CONTROLLED, **options).matrix()

    def differences(size):
        moves = [jnp.zeros_like(centre).at[k].set(size * step[k]) for k in range(len(wrt))]
        rows = [(gradient(centre + m) - gradient(centre - m)) / (2 * m[k]) for k, m in enumerate(moves)]
        return jnp.stack(rows, -2)

    near, far = differences(1.0), differences(2.0)
    best = near + (near - far) / 3
    symmetric = 0.5 * (best + jnp.swapaxes(best, -1, -2))
    return Hessian(symmetric, jnp.abs(symmetric - near) + 0.5 * jnp.abs(best - jnp.swapaxes(best, -1, -2)), wrt)
