"""Criteria that end a life: a number of the worn joint reaches its bound."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.analysis.rubbing import pin_of
from clearance_jax.ask.question import Question, answer
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, as_metric
from clearance_jax.parameters import physical
from clearance_jax.results.dataset import to_dataset
from clearance_jax.solve.drivers.trace import trace
from clearance_jax.solve.settings import settings_of
from clearance_jax.wear.model import WearModel


class AbstractCriterion(Module):
    """A criterion that ends the life of a joint: a number of the worn joint, and its bound."""

    bound: eqx.AbstractVar[Scalar]

    @property
    @abc.abstractmethod
    def unit(self) -> str:
        """The unit of the number and its bound."""

    @property
    def label(self) -> str:
        """The name of the number in a dataset."""
        return type(self).__name__

    has_derivatives: ClassVar[bool] = True
    """Whether the number has derivatives, so that life has."""

    @abc.abstractmethod
    def value(self, mechanism: Mechanism, joint: str) -> Any:
        """The number, for the mechanism with its joint worn."""

    def beyond(self, mechanism: Mechanism, joint: str) -> Any:
        """The number minus its bound; below 0 until life ends."""
        return self.value(mechanism, joint) - self.bound


class Deepest(AbstractCriterion):
    """The life ends when the largest depth of wear reaches a bound.

    **Arguments:** `bound` [m].
    """

    bound: Scalar = physical("m", above=0.0)

    unit: ClassVar[str] = "m"

    def value(self, mechanism, joint):
        return jnp.max(pin_of(mechanism, joint).profile)


class Exceeds(AbstractCriterion):
    """The life ends when a metric of the motion on the worn sleeve reaches a bound: an error of a point, a force.

    **Arguments:** `metric`, or a function as one; `bound`, in its unit; `t1`: end of the motion [s]; `options`: of the
    motion, as `simulate`'s.
    """

    metric: AbstractMetric = eqx.field(converter=as_metric)
    bound: Scalar = physical("")
    t1: Scalar = physical("s")
    options: dict[str, Any] = eqx.field(default_factory=dict)

    @property
    def unit(self):
        return self.metric.unit

    def value(self, mechanism, joint):
        settings = settings_of(mechanism, self.t1, self.options)
        return jnp.max(answer(Question(mechanism, {"": self.metric}, self.t1, settings)).values[""])


class ImpactSpeed(AbstractCriterion):
    """The life ends when the largest speed at which the joint's surfaces meet, in a motion on the worn sleeve, reaches
    a bound. The speed is 0 if they never part.

    **Arguments:** `bound` [m/s]; `t1`: end of the motion [s]; `options`: of the motion, as `trace`'s.
    """

    bound: Scalar = physical("m/s", above=0.0)
    t1: Scalar = physical("s")
    options: dict[str, Any] = eqx.field(default_factory=dict)

    unit: ClassVar[str] = "m/s"
    has_derivatives: ClassVar[bool] = False

    def value(self, mechanism, joint):
        motion = trace(mechanism, float(self.t1), **{**self.options, "save_at": None})
        if motion.message:
            raise ClearanceError(f"The motion stopped: {motion.message}")
        dataset = to_dataset(mechanism, motion)
        in_joint = dataset["episode_joint"].values == [*dataset["joint"].values].index(joint)
        return float(np.nanmax(dataset["impact_speed"].values[in_joint], initial=0.0))


class Of(AbstractCriterion):
    """The life ends when a function of the profile reaches 0. Write it with `jax.numpy` if life needs derivatives."""

    function: Any = eqx.field(static=True)
    bound: Scalar = physical("", default=0.0)

    unit: ClassVar[str] = ""
    label: ClassVar[str] = "function of the profile"

    def value(self, mechanism, joint):
        return jnp.asarray(self.function(pin_of(mechanism, joint).profile), float)


def criterion_of(until: Any) -> AbstractCriterion | None:
    """What ends a life (a criterion, a function of the profile, or `None`) as a criterion."""
    return until if until is None or isinstance(until, AbstractCriterion) else Of(function=until)


def end_slopes(criterion: AbstractCriterion, model: WearModel, names: tuple[str, ...], stack: Array) -> Array:
    """Derivatives of the cycle n at which a criterion is reached by the named numbers a, shape (names,). The profile h
    meets the criterion, g(h(n, a), a) = 0, for every a; so dn/da = -(dg/da) / (dg/dn).

    `stack`: the profile at that cycle, its derivatives by each of the numbers, and that by n.
    """
    *slopes, grows = _slopes(criterion, model, names, stack)
    return -jnp.asarray(slopes) / model.sizes(names) / grows


@eqx.filter_jit
def _slopes(criterion: AbstractCriterion, model: WearModel, names: tuple[str, ...], stack: Array) -> Array:
    def of(shares):
        return criterion.beyond(model.shift(names, stack, shares).mechanism, model.joint)

    return jax.jacfwd(of)(jnp.zeros(len(names) + 1))
