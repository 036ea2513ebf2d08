"""The base of laws that remember the speed of the last impact: F = F_e (1 + a(e) d'/v0)."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw
from clearance_jax.laws.normal import ratios

RESTITUTION = "coefficient of restitution e"
SLOWEST = "the least impact speed that it reckons with"


class AbstractImpactLaw(AbstractNormalLaw):
    """A law with an elastic force F_e, and a damping that remembers the speed v0 of the last impact; without
    `restitution` it is elastic. Its constants have a `damping_ratio`.
    """

    restitution: eqx.AbstractVar[Scalar | None]
    ratio: eqx.AbstractVar[Callable]
    minimum_impact_speed: eqx.AbstractVar[Scalar]

    @property
    def remembers(self):  # type: ignore[override]
        return () if self.restitution is None else ("impact_speed",)

    @property
    def clips(self):
        return self.restitution is not None

    @property
    def damping_ratio(self) -> Scalar | None:
        """a(e); `None`: elastic."""
        return None if self.restitution is None else self.ratio(self.restitution)

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        """The restitution that a free impact really has: without `speed`, of one faster than `minimum_impact_speed`."""
        ratio = self.damping_ratio
        if ratio is None:
            return jnp.ones(())
        slow = 1.0 if speed is None else jnp.minimum(1.0, speed / self.minimum_impact_speed)
        return ratios.delivered_restitution(ratio * slow)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        """The law with the `restitution` as its own, and the ratio a(e) that delivers it."""
        numbers = {"restitution": jnp.asarray(restitution, float), "ratio": ratios.exact_ratio}
        return dataclasses.replace(self, **numbers)

    @abc.abstractmethod
    def elastic(self, constants: Any, penetration: Scalar) -> Scalar:
        """The elastic force F_e [N]."""

    def formula(self, constants, penetration, penetration_rate, memory):
        elastic = self.elastic(constants, penetration)
        if constants.damping_ratio is None:
            return elastic
        speed = jnp.maximum(memory[0], self.minimum_impact_speed)
        return elastic * (1 + constants.damping_ratio * penetration_rate / speed)

    def latch(self, constants, memory, touch):
        if not memory:
            return memory
        speed = jnp.where(touch.began, jnp.maximum(touch.penetration_rate, self.minimum_impact_speed), memory[0])
        return (jnp.where(touch.ended, 0.0, speed),)
