"""Metrics of a mechanism after wear of a joint, for limits that hold over its life."""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.ask.question import Question, answer
from clearance_jax.errors import ClearanceError, WearFailure
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMeasure, AbstractMetric, as_metric
from clearance_jax.parameters import check_values, flatten, physical, replace, values_of
from clearance_jax.solve.settings import settings_of
from clearance_jax.wear.criteria import Exceeds
from clearance_jax.wear.history import march
from clearance_jax.wear.laws import AbstractWearLaw
from clearance_jax.wear.model import WearModel
from clearance_jax.wear.pressure import AbstractPressure
from clearance_jax.wear.service import ServiceLives, service_lives


class AbstractAged(AbstractMeasure):
    """A metric of a mechanism at several ages of its parts. It needs several motions in a row, so no other metric
    shares its solve.
    """

    metric: eqx.AbstractVar[AbstractMetric]
    """Of one motion."""
    joint: eqx.AbstractVar[str]
    """The joint that wears."""
    cycles: eqx.AbstractVar[tuple[int, ...]]
    """Its ages: after how many cycles of wear it is computed, ascending."""
    tolerance: eqx.AbstractVar[float]
    """Of the simulation of the wear."""

    @abc.abstractmethod
    def of(
        self, mechanism: Mechanism, values: Mapping[str, Any], t1: float, by: Sequence[str] = (), **options: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """The metric of the motion to `t1` [s] at all ages, shape (values,), and its derivatives by numbers, (values,
        by).

        **Arguments:** `values`: of the numbers of its `model`, by name; `by`: names; `options` as `simulate`'s, without
        `save_at`.

        **Raises:** `WornThrough` for parts that do not reach such an age, `WearFailure` for numbers out of bounds, and
        for wear that cannot be followed.
        """

    @abc.abstractmethod
    def lives(
        self, mechanism: Mechanism, values: Mapping[str, Any], t1: float, bound: float, most: int, **options: Any
    ) -> ServiceLives:
        """The cycles, at most `most`, after which the metric of the motion to `t1` [s] reaches `bound`, for `values` by
        name, (n,) each.
        """


class AfterWear(AbstractAged):
    """A metric, or a function as one, of the motion on a sleeve that has worn for some numbers of cycles.

    A `design.Limit` on it holds for the new and the worn joint: `cycles=(0, 1000, 2000)`. It is not a metric of one
    motion: its method `of` computes its values and derivatives.

    **Arguments:**

    - `metric`: of the motion on the worn sleeve.
    - `joint`, `wear` (the law), `pressure` and `cycle` [s]: as of a `WearModel`.
    - `cycles`: at least 0, ascending.
    - `sectors`: the same for all designs; by default as many as the first cycle of the given mechanism needs. A warning
      says if a design needs more.
    - `tolerance`: of the simulation of the wear.

    **Raises:** `ClearanceError` for cycles in another order.
    """

    metric: AbstractMetric = eqx.field(converter=as_metric)
    joint: str = eqx.field(static=True, kw_only=True)
    wear: AbstractWearLaw = eqx.field(kw_only=True)
    pressure: AbstractPressure = eqx.field(kw_only=True)
    cycle: Scalar = physical("s", above=0.0, kw_only=True)
    cycles: tuple[int, ...] = eqx.field(static=True, converter=tuple, kw_only=True)
    sectors: int | None = eqx.field(static=True, default=None)
    tolerance: float = eqx.field(static=True, default=1e-2)

    def __check_init__(self):
        if not self.cycles or self.cycles[0] < 0 or any(np.diff(self.cycles) <= 0):
            raise ClearanceError(f"`cycles` must be at least 0 and ascending, but they are {self.cycles}.")

    @property
    def base_metric(self) -> AbstractMetric:
        return self.metric

    @property
    def unit(self) -> str:
        return self.metric.unit

    def with_metric(self, metric: AbstractMetric) -> "AfterWear":
        return dataclasses.replace(self, metric=metric)

    def model(self, mechanism: Mechanism) -> WearModel:
        """The wear model, whose numbers have names: "wear.coefficient" of the law, "pressure.stiffness"."""
        return WearModel(mechanism, self.joint, self.wear, self.pressure, self.cycle)

    def _sectors(self, mechanism: Mechanism, options: Mapping[str, Any]) -> int:
        """For all designs, from the mechanism's own numbers."""
        return self.sectors or self.model(mechanism).sectors(dict(options))

    def of(self, mechanism, values, t1, by=(), **options):
        model: WearModel = replace(self.model(mechanism), values)
        try:
            check_values(model)
        except ClearanceError as error:
            raise WearFailure(error).about(error.name, error.value, error.allowed) from None
        names, begin = tuple(by), model.begin(self._sectors(mechanism, options))
        stack = np.concatenate([begin[None], np.zeros((len(names), begin.size))])
        solve, now = settings_of(model.mechanism, t1, options), list(values_of(model, names).values())
        rows, done = [], 0
        for cycles in self.cycles:
            if cycles > done:

                def rate(stack, after, done=done):
                    return model.cycle_wears(stack, names, done + after, dict(options))

                leg = march(rate, stack, cycles - done, tolerance=self.tolerance)
                assert leg.slopes is not None
                stack, done = np.concatenate([leg.depth[-1:], leg.slopes[-1]]), cycles
            worn = Worn(names, jnp.asarray(stack), jnp.asarray(now, float), model)
            outcome = answer(Question(worn, {"": self.metric}, t1, solve, names))
            value = np.ravel(outcome.values[""])
            rows.append((value, np.reshape(outcome.slopes[""] if names else [], (value.size, len(names)))))
        answers, slopes = zip(*rows, strict=True)
        return np.concatenate(answers), np.concatenate(slopes)

    def lives(self, mechanism, values, t1, bound, most, **options):
        until = Exceeds(self.metric, bound, t1, dict(options))
        how = {"sectors": self._sectors(mechanism, options), "tolerance": self.tolerance, **options}
        return service_lives(self.model(mechanism), most, values, until=until, **how)


class Worn(Module):
    """A model whose joint has worn for some cycles. Its numbers are those of `model`, and its profile follows them to
    first order: `stack`, shape (1 + names, sectors), has the profile [m] at the values `at` of the numbers `names`, and
    below it the derivatives by these.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    stack: Array
    at: Array
    model: WearModel = flatten()

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with its joint worn."""
        if not self.names:
            return self.model.at(self.stack[0])
        sizes = jnp.where(self.at == 0, 1.0, jnp.abs(self.at))
        shares = (jnp.stack(list(values_of(self.model, self.names).values())) - self.at) / sizes
        return self.model.wear_by(self.stack[0], self.stack[1:] * sizes[:, None], shares).mechanism
