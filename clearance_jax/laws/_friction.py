"""What a friction law is, for one contact point; its sign convention is that of `_base`."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._module import Module
from clearance_jax._numerics import safe_norm
from clearance_jax._sharing import share
from clearance_jax._types import Flag, Scalar
from clearance_jax.laws._base import AbstractLaw, Bristles, Memory, Slip, Touch
from clearance_jax.laws.geometry import Geometry, Local


class AbstractFrictionLaw(AbstractLaw):
    """A friction law: the traction along the surface at one contact point."""

    bristles: ClassVar[tuple[str, ...]] = ()
    """Names of its memory, of each of which there is one for every component of the slip."""

    @property
    def has_static_force(self):  # type: ignore[override]
        return not self.bristles

    def prepare(self, geometry: Geometry) -> "PreparedFriction":
        """The law with its constants."""
        return PreparedFriction(self, self.constants(geometry))

    @abc.abstractmethod
    def traction(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> Slip:
        """The traction on the pin [N] for a slip [m/s], a normal force [N] and the law's memory."""

    def event_functions(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> tuple[Scalar, ...]:
        """Smooth functions whose signs tell on which piece of the law, or side of its steep layer, a slip lies: inside
        (negative) or outside (positive), as |slip|^2 - v^2; none by default.
        """
        return ()

    def memory_rate(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> Bristles:
        """Time derivative of the memory; zero by default."""
        return tuple(tuple(jnp.zeros_like(m) for m in one) for one in memory)

    def latch(self, constants: Any, memory: Bristles, touch: Touch) -> Bristles:
        """The memory after an instant at which contact began or ended; unchanged by default."""
        return memory

    def memory_scale(self, constants: Any) -> Memory:
        """Magnitude of each kind of memory for error control; infinite (the default) where it only latches."""
        return tuple(jnp.asarray(jnp.inf) for _ in self.bristles)


class PreparedFriction(Module):
    """A friction law with the constants of one joint: what a step evaluates. Its memory is flat, component
    by component.
    """

    law: AbstractFrictionLaw
    constants: Any

    def at(self, local: Local) -> "PreparedFriction":
        """The same law at a contact point of its own."""
        return self if local is None else PreparedFriction(self.law, self.law.localise(self.constants, local))

    def traction(self, slip: Slip, normal_force: Scalar, memory: Memory) -> Slip:
        """The traction on the pin [N]."""
        return self.law.traction(self.constants, slip, normal_force, self._split(memory, slip))

    def event_functions(
        self, slip: Slip, normal_force: Scalar, memory: Memory, presses: Flag, before: Slip
    ) -> tuple[Scalar, ...]:
        """Functions whose signs make the zone; 1 where nothing presses.

        From one side of a layer straight to the other no sign of |slip|^2 - v^2 changes between two samples: so what
        lies outside also tells whether it still goes the way it went `before`.
        """
        zones = self.law.event_functions(self.constants, slip, normal_force, self._split(memory, slip))
        ahead = sum(s * b for s, b in zip(slip, before, strict=True))
        sides = [jnp.where(zone > 0, ahead, 1.0) for zone in zones]
        return tuple(jnp.where(presses, function, 1.0) for function in (*zones, *sides))

    def memory_rate(self, penetration: Scalar, slip: Slip, normal_force: Scalar, memory: Memory) -> Memory:
        """Time derivative of the memory; zero while apart, but for a law that acts there."""
        rates = self.law.memory_rate(self.constants, slip, normal_force, self._split(memory, slip))
        flat = tuple(rate for one in rates for rate in one)
        return flat if self.law.acts_apart else tuple(jnp.where(penetration > 0, r, 0.0) for r in flat)

    def latch(self, memory: Memory, touch: Touch) -> Memory:
        """The memory after an instant at which contact began or ended."""
        new = self.law.latch(self.constants, self._split(memory, touch.slip), touch)
        return tuple(m for one in new for m in one)

    def memory_scale(self, components: int) -> Memory:
        """Magnitude of each memory variable."""
        return tuple(scale for scale in self.law.memory_scale(self.constants) for _ in range(components))

    def _split(self, memory: Memory, slip: Slip) -> Bristles:
        n = len(slip)
        return tuple(tuple(memory[i * n : (i + 1) * n]) for i in range(len(self.law.bristles)))


def along_slip(profile: Callable[[Array], Array], slip: Slip) -> Slip:
    """`profile(|slip|)` along the slip, for an odd `profile` of one number."""
    if len(slip) == 1:
        return (profile(slip[0]),)
    speed = safe_norm(*slip)
    moving = speed > 0
    ratio = jnp.where(moving, profile(speed) / jnp.where(moving, speed, 1.0), jax.grad(profile)(jnp.zeros(())))
    ratio = share(ratio)
    return tuple(ratio * s for s in slip)


def outside(slip: Slip, speed: Scalar) -> Scalar:
    """|slip|^2 - speed^2: positive outside a layer, negative inside."""
    return sum(s * s for s in slip) - speed * speed
