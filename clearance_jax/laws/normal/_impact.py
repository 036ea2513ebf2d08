"""What laws share that remember the speed of the last impact: F = F_e (1 + a(e) d'/v0)."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._types import Scalar
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

    @property
    def delivered_restitution(self) -> Scalar:
        """The restitution that a free impact faster than `minimum_impact_speed` really has."""
        ratio = self.damping_ratio
        return jnp.ones(()) if ratio is None else ratios.delivered_restitution(ratio)

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
