"""Many metrics of one motion, from one solve.

A metric says what it needs of a solve (`Request`): observers, integrals, samples, books. `measure` asks for all of it
at once and hands each metric its own part (`Reply`).
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.flow import Solution
from clearance_jax.solve.observers import AbstractObserver, Picked
from clearance_jax.solve.problem import Problem, widths
from clearance_jax.solve.simulate import run


class Request(NamedTuple):
    """What a metric needs of a solve."""

    observers: tuple[AbstractObserver, ...] = ()
    integrands: tuple[Any, ...] = ()
    times: Float[Array, " times"] | None = None
    books: bool = False


class Reply(NamedTuple):
    """What a metric gets of a solve: the motion asked for, and its own part of the solution, in the order of its
    request: what its observers recorded and picked, its integrals, and its samples (`solution.time`, `solution.y`).
    """

    mechanism: Mechanism
    t1: Any
    options: dict[str, Any]
    solution: Solution
    integrals: tuple[Array, ...]

    @property
    def t0(self) -> Any:
        """Where the motion starts [s]."""
        return self.options.get("t0", 0.0)

    @property
    def picked(self) -> tuple[Picked | None, ...]:
        """What its observers picked."""
        return self.solution.picked

    @property
    def span(self) -> Any:
        """How long the motion lasts [s]."""
        return self.t1 - self.t0


class AbstractMetric(eqx.Module):
    """A number, or a few, of a motion."""

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return getattr(getattr(self, "signal", None), "unit", "")

    @abc.abstractmethod
    def request(self, mechanism: Mechanism, t1: Any, options: dict[str, Any]) -> Request:
        """What it needs of the solve of the motion from `t0` to `t1`."""

    @abc.abstractmethod
    def value(self, reply: Reply) -> Any:
        """The metric, from what it asked for: an array, or a record of arrays."""

    def __call__(self, mechanism: Mechanism, t1: Any, **options: Any) -> Any:
        """The metric of the motion from `t0` to `t1`, by a solve of its own; `options` are `simulate`'s `t0`, `rtol`,
        `solver`, `y0`.
        """
        return measure(mechanism, {"metric": self}, t1, **options)["metric"]


class Function(AbstractMetric):
    """Any function `(mechanism, solution) -> array`; `times`: where it wants samples [s] (`None`: at the end)."""

    function: Callable
    times: Any = None

    def request(self, mechanism, t1, options):
        return Request(times=None if self.times is None else jnp.asarray(self.times, float))

    def value(self, reply):
        return jnp.asarray(self.function(reply.mechanism, reply.solution))


def measure(
    mechanism: Mechanism, metrics: Mapping[str, AbstractMetric | Callable], t1: Any, **options: Any
) -> dict[str, Any]:
    """Several metrics of one motion, from one solve. Works under jit, vmap, jvp and grad.

    **Arguments:**

    - `metrics`: name -> one of `clearance_jax.metrics`, or a function `(mechanism, solution) -> array`.
    - `options`: `simulate`'s `t0`, `rtol`, `solver`, `y0`, `books`, and `save_at` for the samples that functions get.

    **Returns:** the values by name: arrays, or the records of arrays that a metric makes.
    """
    times = options.pop("save_at", None)
    wanted = {
        name: metric if isinstance(metric, AbstractMetric) else Function(metric, times)
        for name, metric in metrics.items()
    }
    requests = {name: metric.request(mechanism, t1, options) for name, metric in wanted.items()}
    order, together = _together([request.times for request in requests.values()])
    books = options.pop("books", False) or any(request.books for request in requests.values())
    solution = run(
        mechanism,
        t1,
        save_at=together,
        books=books,
        observers=tuple(o for request in requests.values() for o in request.observers),
        integrands=tuple(f for request in requests.values() for f in request.integrands),
        **options,
    )
    out, seen, integrals, samples = {}, 0, _integrals(mechanism, requests, solution, books), 0
    for name, request in requests.items():
        count = len(request.observers)
        part = slice(seen, seen + count)
        own = dataclasses.replace(solution, records=solution.records[part], picked=solution.picked[part])
        seen += count
        if request.times is not None:
            size = request.times.shape[0]
            place = slice(samples, samples + size) if order is None else order[samples : samples + size]
            own = dataclasses.replace(own, time=request.times, y=solution.y[place])
            samples += size
        sums = tuple(next(integrals) for _ in request.integrands)
        out[name] = wanted[name].value(Reply(mechanism, t1, options, own, sums))
    return out


def _together(times: list[Array | None]) -> tuple[Array | None, Array | None]:
    """All times in increasing order, and where each of them, one list after the other, is among these (`None`: as they
    come).
    """
    asked = [t for t in times if t is not None]
    if not asked:
        return None, None
    whole = jnp.concatenate(asked)
    if len(asked) == 1:
        return None, whole
    order = jnp.argsort(whole)
    return jnp.argsort(order), whole[order]


def _integrals(mechanism: Mechanism, requests: dict[str, Request], solution: Solution, books: bool):
    """The integrals, one after the other, in the shapes of their integrands."""
    functions = tuple(f for request in requests.values() for f in request.integrands)
    sizes = widths(Problem(mechanism.prepared(), functions, None, books)) if functions else []
    start = solution.final.shape[-1] - sum(sizes)
    for size in sizes:
        value = solution.final[start : start + size]
        yield value[0] if size == 1 else value
        start += size
