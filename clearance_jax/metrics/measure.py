"""Many metrics of one motion, from one solve.

A metric says what it needs of a solve (`Request`): observers, integrals, samples, the energy balance. `measure` asks
for all of it at once and hands each metric its own part (`Reply`).
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any, ClassVar, NamedTuple, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.farthest import Farthest
from clearance_jax.metrics.functions import arguments, function_name, in_words
from clearance_jax.solve.settings import STATIC, Settings, SolveOptions, settings_of
from clearance_jax.solve.simulate import doubts_contacts, only_reached, run, warn_of_energy
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.steps.observers import AbstractObserver, Picked
from clearance_jax.solve.steps.problem import Problem, widths


class Request(NamedTuple):
    """What a metric needs of a solve: `observers` of every step; `integrands`, which are integrated along with the
    motion; samples at `times` [s]; the energy balance (`energy_balance`). It counts `since` a time [s]; `None`: from
    the start.
    """

    observers: tuple[AbstractObserver, ...] = ()
    integrands: tuple[Any, ...] = ()
    times: Float[Array, " times"] | None = None
    energy_balance: bool = False
    since: Any = None


class Reply(NamedTuple):
    """What a metric receives of a solve: the motion that was asked for (`mechanism`, `t1` [s], `options`), its own part
    of the `solution` (what its observers recorded and picked, its samples `solution.time` and `solution.y`), its
    `integrals`, and the time `begin` [s] from which the motion counts, with the state then (`first`). All are in the
    order of its request.
    """

    mechanism: Mechanism
    t1: Any
    options: Settings
    solution: Solution
    integrals: tuple[Array, ...]
    begin: Any
    first: Array

    @property
    def t0(self) -> Any:
        """Where the motion starts [s]."""
        return self.options.t0

    @property
    def picked(self) -> tuple[Picked | None, ...]:
        """What its observers picked."""
        return self.solution.picked

    @property
    def span(self) -> Any:
        """How long the motion counts [s]."""
        return self.t1 - self.begin


class MetricForm(NamedTuple):
    """The `unit` and the `axes` of a metric's values: name and labels of each axis (no labels: a counter)."""

    unit: str
    axes: tuple[tuple[str, tuple[str, ...]], ...] = ()


class AbstractMeasure(Module):
    """What a limit may bound: a metric of one motion (`AbstractMetric`), or one at several ages of the parts."""

    @property
    @abc.abstractmethod
    def base_metric(self) -> "AbstractMetric":
        """The metric of one motion."""

    @abc.abstractmethod
    def with_metric(self, metric: "AbstractMetric") -> "AbstractMeasure":
        """The same measure of another metric of one motion."""

    @property
    @abc.abstractmethod
    def unit(self) -> str:
        """The unit of its values."""

    def model(self, mechanism: Mechanism) -> Any:
        """The model that has all numbers it depends on; by default the mechanism."""
        return mechanism


class AbstractMetric(AbstractMeasure):
    """A metric: a number of a motion, or a few numbers."""

    word: ClassVar[str] = ""
    """What study files call it; empty: they do not know it."""
    each: ClassVar[str] = "value"
    """What reports call each of several values."""
    ranked: ClassVar[bool] = False
    """Whether its values are peaks, the highest first, at the instants that the observer of its request picks."""

    @property
    def base_metric(self) -> "AbstractMetric":
        return self

    def with_metric(self, metric: "AbstractMetric") -> "AbstractMetric":
        return metric

    @property
    def unit(self) -> str:
        return getattr(getattr(self, "signal", None), "unit", "")

    @property
    def reduction(self) -> str:
        """What it does with its signal, in words; empty if it bounds every value."""
        return in_words(type(self).__name__)

    @property
    def label(self) -> str:
        """What it measures, in words: "RMS contact force"; by default after its class and its signal's."""
        signal = getattr(self, "signal", None)
        return in_words(type(self).__name__) if signal is None else f"{self.reduction} {signal.label}".lstrip()

    @property
    def part(self) -> str:
        """The point, joint or body that it is about; empty: the mechanism."""
        holder = getattr(self, "signal", self)
        return next((str(getattr(holder, n)) for n in ("point", "joint", "body") if hasattr(holder, n)), "")

    @property
    def title(self) -> str:
        """What tells it from other metrics: "Peak PositionError of piston"."""
        signal, of = getattr(self, "signal", None), f" of {self.part}" if self.part else ""
        return type(self).__name__ + ("" if signal is None else f" {type(signal).__name__}{of}")

    def components(self, count: int) -> tuple[str, ...]:
        """The label of each of its `count` values; empty for a single one."""
        return ("",) if count == 1 else tuple(f"{self.each} {k + 1}" for k in range(count))

    def several(self, count: int) -> "AbstractMetric":
        """The metric that a search solves for in its place: the `count` highest peaks for one peak; else the same."""
        del count
        return self

    def form(self, mechanism: Mechanism) -> MetricForm:
        """Unit and axes of its values for a mechanism's motion; by default axes have no names."""
        return MetricForm(self.known(mechanism).unit)

    def known(self, mechanism: Mechanism) -> "AbstractMetric":
        """The metric with the unit that its signal has in a mechanism."""
        signal: Any = getattr(self, "signal", None)
        known = signal.known(mechanism) if hasattr(signal, "known") else signal
        return self if known is signal else dataclasses.replace(self, signal=known)  # pyright: ignore[reportCallIssue]

    def static_bound(self) -> "AbstractMetric":
        """The metric of the largest errors that play alone allows. **Raises** `ClearanceError` if it has no error."""
        signal = getattr(self, "signal", None)
        if not getattr(signal, "needs_ideal", False):
            raise ClearanceError(
                f"A static bound is of errors of position, path or orientation, and {type(self).__name__} is of "
                'something else here: use `fidelity = "quasi-static"` or "dynamics".'
            ).about("fidelity", "static")
        return eqx.tree_at(lambda metric: metric.signal, self, Farthest(signal))

    @abc.abstractmethod
    def request(self, mechanism: Mechanism, t1: Any, options: Settings) -> Request:
        """What it needs of the solve of the motion from `options.t0` to `t1` [s]."""

    @abc.abstractmethod
    def value(self, reply: Reply) -> Any:
        """The metric, from what it asked for: an array, or a record of arrays."""

    def __call__(self, mechanism: Mechanism, t1: Any, **options: Unpack[SolveOptions]) -> Any:
        """The metric of the motion from `t0` to `t1`, by a solve of its own; `options` as `simulate`'s."""
        return measure(mechanism, {"metric": self}, t1, **options)["metric"]


class Function(AbstractMetric):
    """A metric that is a function `f(solution)` or `f(mechanism, solution)`, and returns a number or an array.

    **Arguments:** `function`; `times`: where it needs samples [s], shape (samples,); `None`: where `save_at` says, or
    else the end alone. **Raises:** `ClearanceError` for a function with other arguments.
    """

    function: Callable
    times: Any = None

    def __check_init__(self):
        arguments(self.function)

    def request(self, mechanism, t1, options):
        times = options.save_at if self.times is None else self.times
        return Request(times=None if times is None else jnp.asarray(times, float))

    def value(self, reply):
        return self.of(reply.mechanism, reply.solution)

    @property
    def label(self) -> str:
        return in_words(getattr(self.function, "__name__", "function"))

    @property
    def title(self) -> str:
        return function_name(self.function)

    def of(self, mechanism: Mechanism, solution: Solution) -> Array:
        """The function's value."""
        given = (solution,) if arguments(self.function) == 1 else (mechanism, solution)
        answer = self.function(*given)
        try:
            return jnp.asarray(answer)
        except (TypeError, ValueError):
            raise ClearanceError(
                f"The metric `{self.title}` must return a number or an array, but it returned {type(answer).__name__}."
            ).about(self.title, type(answer).__name__) from None


def as_measure(given: Any) -> AbstractMeasure:
    """A measure as it is; a function as a metric. **Raises** `ClearanceError` for anything else."""
    return given if isinstance(given, AbstractMeasure) else as_metric(given)


def as_metric(given: Any) -> AbstractMetric:
    """A metric as it is; a function as a metric. **Raises** `ClearanceError` for anything else."""
    if isinstance(given, AbstractMetric):
        return given
    if not callable(given):
        hint = f" Ask for its peak, `Peak({type(given).__name__}(...))`." if hasattr(given, "needs_ideal") else ""
        raise ClearanceError(
            "A metric is one of `clearance_jax.metrics`, or a function `f(solution)` or `f(mechanism, solution)`, but "
            f"this is a {type(given).__name__}.{hint}"
        )
    return Function(given)


def measure(
    mechanism: Mechanism, metrics: Mapping[str, AbstractMetric | Callable], t1: Any, **options: Unpack[SolveOptions]
) -> dict[str, Any]:
    """Several metrics of one motion, from one solve. It works under jit, vmap, jvp and grad.

    **Arguments:**

    - `mechanism`: what moves; `t1`: end of the motion [s].
    - `metrics`: name -> one of `clearance_jax.metrics`, or a function `f(solution)` or `f(mechanism, solution)`.
    - `options`: as `simulate`'s; `save_at` says where functions get samples.

    **Returns:** the values by name: arrays, or the records of arrays that a metric makes. **Raises:** `ClearanceError`
    for what is not a metric, and the errors of `simulate`. **Warns:** `EnergyWarning` (your own laws, losses).
    """
    books = doubts_contacts(mechanism, t1, options)
    return measure_settings(mechanism, metrics, t1, settings_of(mechanism, t1, options, energy_balance=books))


def by_name(given: Any) -> dict[str, AbstractMetric]:
    """Metrics by name, functions among them. **Raises** `ClearanceError` for anything else."""
    if not isinstance(given, Mapping):
        raise ClearanceError('`measure` wants metrics by name, such as `{"peak": Peak(PositionError("piston"))}`.')
    return {name: as_metric(metric) for name, metric in given.items()}


def measure_settings(
    mechanism: Mechanism, metrics: Mapping[str, AbstractMetric | Callable], t1: Any, options: Settings
) -> dict[str, Any]:
    """As `measure`, with settings instead of options."""
    wanted = by_name(metrics)
    if options.fidelity == STATIC:
        wanted = {name: metric.static_bound() for name, metric in wanted.items()}
    requests = {name: metric.request(mechanism, t1, options) for name, metric in wanted.items()}
    begins = {name: begin_of(request.since, t1, options) for name, request in requests.items()}
    times = [_times(request, begins[name]) for name, request in requests.items()]
    together = [samples for samples in times if samples is not None]
    energy_balance = options.energy_balance or any(request.energy_balance for request in requests.values())
    settings = options._replace(save_at=jnp.concatenate(together) if together else None, energy_balance=energy_balance)
    observers = tuple(o for request in requests.values() for o in request.observers)
    integrands = tuple(f for request in requests.values() for f in request.integrands)
    solution = run(mechanism, t1, settings, observers=observers, integrands=integrands)
    warn_of_energy(solution)
    sizes = _sizes(mechanism, requests, energy_balance)
    # Each metric gets its own part of the records, of the samples and of the integrals, one after the other.
    records, picked = iter(solution.records), iter(solution.picked)
    out, summed, samples = {}, solution.final.shape[-1] - sum(map(sum, sizes.values())), 0
    for (name, request), asked in zip(requests.items(), times, strict=True):
        count = len(request.observers)
        view = dataclasses.replace(solution, records=tuple(islice(records, count)), picked=tuple(islice(picked, count)))
        first = solution.initial
        if asked is not None:
            view = dataclasses.replace(view, time=asked, y=solution.y[samples : samples + len(asked)], sampled=True)
            samples += len(asked)
        if request.since is not None:
            first = view.y[-1]
            view = dataclasses.replace(view, time=view.time[:-1], y=view.y[:-1])
        if request.times is None:
            view = dataclasses.replace(view, time=view.end_time[None], y=view.final[None], sampled=False)
        sums = _integrals(solution.final - first, summed, sizes[name])
        summed += sum(sizes[name])
        value = wanted[name].value(Reply(mechanism, t1, options, view, sums, begins[name], first))
        # A lane of a batch in which nothing is left to count has no value.
        if request.since is not None:
            some = jnp.where(begins[name] < t1, 1.0, jnp.nan)
            value = jax.tree.map(lambda v, some=some: some * v, value)
        # Mask the value too: a function of NaN may be finite.
        out[name] = only_reached(solution, value) if isinstance(solution.final, Tracer) else value
    return out


def begin_of(since: Any, t1: Any, options: Settings) -> Any:
    """The time from which a metric counts [s]. **Raises** `ClearanceError` if it is not before the end."""
    if since is None:
        return options.t0
    if not any(isinstance(t, Tracer) for t in (since, t1)) and not float(since) < float(t1):
        raise ClearanceError(
            f"`since` must lie before the end of the motion, but since = {float(since):g} s and t1 = {float(t1):g} s."
        ).about("since", float(since), float(t1))
    return jnp.clip(since, options.t0, t1)


def _times(request: Request, begin: Any) -> Array | None:
    """Sample times of a metric [s], and behind them the time from which it counts, if it has one."""
    if request.since is None:
        return request.times
    return jnp.concatenate([jnp.zeros(0) if request.times is None else request.times, jnp.asarray(begin)[None]])


def _sizes(mechanism: Mechanism, requests: dict[str, Request], energy_balance: bool) -> dict[str, list[int]]:
    """The size of each integrand of each request."""
    if not any(request.integrands for request in requests.values()):
        return {name: [] for name in requests}
    ready = mechanism.prepare()
    return {name: widths(Problem(ready, r.integrands, None, energy_balance)) for name, r in requests.items()}


def _integrals(gained: Array, start: int, sizes: list[int]) -> tuple[Array, ...]:
    """The integrals, one after the other from `start`, in what the quadratures have gained."""
    out = []
    for size in sizes:
        out.append(gained[start] if size == 1 else gained[start : start + size])
        start += size
    return tuple(out)
