"""A question, metrics of a motion and their derivatives as a function of some numbers, and its answers at points."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.shapes import TreeShape, tree_shape
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Reply, Request, measure_settings
from clearance_jax.parameters import replace, values_of
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers.batch import BatchReport, batch
from clearance_jax.solve.settings import ADJOINT, AUTO, CONTROLLED, DYNAMICS, MANY, Settings

# The name under which it stands beside the metrics; no metric of a user can have it.
ENDING = " ending"


class Ending(AbstractMetric):
    """How the solve ended: code, steps, rejected; the residual of an energy balance; the `Validity.level` of poses."""

    def static_bound(self):
        return self

    def request(self, mechanism, t1, options):
        return Request()

    def value(self, reply: Reply):
        solution = reply.solution
        ending = {"code": solution.code, "steps": solution.steps, "rejected": solution.rejected}
        ending |= {"energy_residual": solution.energy_residual} if solution.energy_balance else {}
        return ending | ({} if solution.validity is None else {"validity": solution.validity.level})


# Numbers that a point may have beside the model's, with their units.
OPTIONS = {"t1": "s", "rtol": ""}


# With more numbers a metric's derivatives are pulled back: their rule then moves the entries of arrays one by one.
PULLED = 30
# The value of `differentiated` that means every metric.
ALL = ("*",)


class Answer(NamedTuple):
    """The answer at a point: `values` by metric; `slopes`, their derivatives with a last axis over the numbers of `by`
    (empty if none were asked for); `ending`: "code", "steps" and so on. Numbers are NaN if the motion did not reach its
    end. At many points all arrays have a first axis (points,).
    """

    values: dict[str, Any]
    slopes: dict[str, Any]
    ending: dict[str, Array]


class Question(Module):
    """What is asked of a model. Call it with numbers by name for the `Answer` at that point; other values of the same
    numbers run the same compiled program.

    - `model`: a mechanism, or a module with a field `mechanism` and numbers of its own.
    - `metrics` by name, of the motion to `t1` [s], solved with `settings` (`fidelity` among them).
    - `by`: names of the numbers by which the metrics in `differentiated` are differentiated.
    """

    model: Any
    metrics: dict[str, AbstractMetric]
    t1: Array = eqx.field(converter=lambda t1: jnp.asarray(t1, float))
    settings: Settings
    by: tuple[str, ...] = eqx.field(static=True, default=(), converter=tuple)
    differentiated: tuple[str, ...] = eqx.field(static=True, default=ALL, converter=tuple)

    def at(self, numbers: Mapping[str, Any]) -> "Question":
        """The question with these numbers of the model, "t1" [s] or "rtol" instead of its own."""
        changes = {name: value for name, value in numbers.items() if name not in OPTIONS}
        t1, rtol = numbers.get("t1", self.t1), numbers.get("rtol", self.settings.rtol)
        settings = self.settings._replace(rtol=rtol)
        return dataclasses.replace(self, model=replace(self.model, changes), t1=t1, settings=settings)

    def __call__(self, numbers: Mapping[str, Any] | None = None) -> Answer:
        question = self.at(numbers) if numbers else self
        if self.by:
            values, slopes, ending = question.chosen()._differentiated()
        else:
            (values, ending), slopes = question._measure(question.model, question.metrics), {}
        reached = ending["code"] == int(Result.REACHED_END)

        def masked(number):  # integers stay as they are
            inexact = jnp.issubdtype(jnp.result_type(number), jnp.inexact)
            return jnp.where(reached, number, jnp.nan) if inexact else number

        values, slopes = jax.tree.map(masked, (values, slopes))
        return Answer(values, slopes, ending)

    def chosen(self) -> "Question":
        """The question with "adjoint" or "controlled" for derivatives that it leaves to the count of numbers."""
        if self.settings.derivatives != AUTO:
            return self
        plain = dataclasses.replace(self, by=())
        values = shapes_of(plain, ()).values
        asked = values if self.differentiated == ALL else [values[name] for name in self.differentiated]
        numbers, results = (sum(x.size for x in jax.tree.leaves(t)) for t in (values_of(self.model, self.by), asked))
        many = numbers >= MANY * results and self.settings.fidelity == DYNAMICS
        settings = self.settings._replace(derivatives=ADJOINT if many else CONTROLLED)
        return dataclasses.replace(self, settings=settings)

    def _differentiated(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Array]]:
        wanted = tuple(self.metrics) if self.differentiated == ALL else self.differentiated
        metrics = {n: metric if n in wanted else Undifferentiated(metric) for n, metric in self.metrics.items()}
        centre, unravel = jax.flatten_util.ravel_pytree(list(values_of(self.model, self.by).values()))

        def at(point):
            return self._measure(replace(self.model, dict(zip(self.by, unravel(point), strict=True))), metrics)

        kind = self.settings.derivatives
        if (kind == ADJOINT or (kind == CONTROLLED and centre.size > PULLED)) and self.settings.fidelity == DYNAMICS:

            def chosen(point):
                values, ending = at(point)
                return {name: values[name] for name in wanted}, (values, ending)

            asked, pull, (values, ending) = jax.vjp(chosen, centre, has_aux=True)
            return values, {name: _rows(pull, asked, name) for name in wanted}, ending

        def along(direction):
            return jax.jvp(at, (centre,), (direction,), has_aux=True)

        # The derivative rule of `flow` makes one solve of all directions.
        values, slopes, ending = jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(centre.size))
        return values, {name: slopes[name] for name in wanted}, ending

    def _measure(self, model: Any, metrics: Mapping[str, AbstractMetric]) -> tuple[dict, dict]:
        mechanism = model if isinstance(model, Mechanism) else model.mechanism
        measured = measure_settings(mechanism, {**metrics, ENDING: Ending()}, self.t1, self.settings)
        return measured, measured.pop(ENDING)


def _rows(pull: Callable, values: dict[str, Any], name: str) -> Any:
    """Derivatives of each number of a value (last axis), one backward pass for each."""
    flat, unravel = jax.flatten_util.ravel_pytree(values[name])
    nothing = jax.tree.map(jnp.zeros_like, values)
    rows = jax.vmap(lambda bar: pull({**nothing, name: unravel(bar)})[0])(jnp.eye(flat.size))
    return jax.vmap(unravel, 1, -1)(rows)


class Undifferentiated(AbstractMetric):
    """A metric whose derivative is not asked for: its inputs are stopped, so that it need not have one."""

    metric: AbstractMetric

    def static_bound(self):
        return Undifferentiated(self.metric.static_bound())

    def request(self, mechanism, t1, options):
        return self.metric.request(mechanism, t1, options)

    def value(self, reply):
        arrays, others = eqx.partition(reply, eqx.is_array)
        return self.metric.value(eqx.combine(jax.tree.map(jax.lax.stop_gradient, arrays), others))


def shapes_of(question: Question, names: Sequence[str]) -> Answer:
    """The answer's shapes with numbers of these names, without a solve; questions of a structure are traced once."""
    return _shapes(tree_shape(question), tuple(names))


@functools.lru_cache(maxsize=256)
def _shapes(frame: TreeShape, names: tuple[str, ...]) -> Answer:
    def answer(arrays, numbers):
        return frame.fill(arrays)(numbers)

    return jax.eval_shape(answer, frame.shapes, {name: jax.ShapeDtypeStruct((), float) for name in names})


Columns = Mapping[str, np.ndarray]
"""The numbers of points by name, shape (points,) each."""


def answer(question: Question, numbers: Mapping[str, Any] | None = None) -> Answer:
    """The answer at one point. Other names of `numbers` compile another program; with `Question.at` they share one."""
    return _program(question, {name: jnp.asarray(value, float) for name, value in (numbers or {}).items()})


@kept_jit
def _program(question: Question, numbers: dict[str, Any]) -> Answer:
    return question(numbers)


def lanes(
    question: Question,
    points: Columns,
    *,
    width: int = 1,
    cores: int | None = None,
    progress: Callable[[float], Any] | None = None,
    ready: Callable[[np.ndarray, Answer], Any] | None = None,
    report: Callable[[BatchReport], Any] | None = None,
) -> Answer:
    """The answers at points, as lanes of a batch, on every core. `width`: solve at least so many lanes, by copies of
    the last one (a chunk of another width is another program, with other last digits); the others as `batch`'s.
    """
    count = len(next(iter(points.values())))
    filled = {name: np.pad(column, (0, max(0, width - count)), mode="edge") for name, column in points.items()}

    def chunk(places: np.ndarray, part: Answer) -> None:
        wanted = places < count
        if ready is not None:
            ready(places[wanted], jax.tree.map(lambda x: x[wanted], part))

    whole = batch(question, filled, cores=cores, progress=progress, ready=chunk, report=report)
    return jax.tree.map(lambda x: x[:count], whole)
