"""What a contact law is. Written for ONE contact point: no pose, no body, no time, no batch; `vmap` lives above it.

Sign convention, stated here once for the whole library:

- penetration > 0 means overlap; its rate > 0 means approach;
- the normal force is >= 0 and pushes the two surfaces apart (a law that may pull says so);
- slip is the velocity of the pin's surface relative to the sleeve's, along one tangent (in the plane) or two (in
  space); the traction is the force on the pin along the same tangents, so a dissipative law returns one of opposite
  sign. Slip, traction and the memory of friction are tuples of as many components: no law is written twice.

A law has two lives. What a user gives is the law: numbers, with units and bounds. Once a solve `prepared(geometry)`
puts beside it the `constants` that follow from it and from the geometry, in a type of its own; that is what a step
evaluates, and what clips, gates and counts for every law alike (`PreparedNormal`, `PreparedFriction`).

Where a formula changes piece a law says so by `event_functions`: a fixed tuple of smooth functions, whose signs make
the regime. A law owns its memory: it has a rate, or is rewritten by `latch` at the instants at which contact begins or
ends (which are always ends of integration steps).
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._module import Module
from clearance_jax._numerics import positive_part, safe_norm
from clearance_jax._sharing import share
from clearance_jax._types import Flag, Scalar
from clearance_jax.laws.geometry import Geometry, Local
from clearance_jax.parameters import Parametrised

Smoothness = Literal["C-1", "C0", "C1", "C2"]
Memory = tuple[Scalar, ...]
Slip = tuple[Scalar, ...]
Bristles = tuple[Slip, ...]
"""Memory of friction: of each name as many components as the slip has."""


class Touch(NamedTuple):
    """An instant at which contact `began` or `ended` (flags): the `penetration_rate` [m/s] and the `slip` [m/s] at that
    instant, and the time `elapsed` since [s]. This time is as small as a round-off error. It carries the derivative of
    the instant by the parameters.
    """

    began: Flag
    ended: Flag
    penetration_rate: Scalar
    slip: Slip
    elapsed: Scalar


class AbstractStiffness(Module):
    """A stiffness that is computed from the joint's geometry instead of being given as a number."""

    @abc.abstractmethod
    def value(self, geometry: Geometry) -> Scalar:
        """The stiffness in N/m^n."""


def stiffness_of(given: Any, geometry: Geometry) -> Scalar:
    """A law's stiffness: the number that it was given, or the one that its geometry has."""
    return given.value(geometry) if isinstance(given, AbstractStiffness) else given


class AbstractLaw(Parametrised):
    """What normal and friction laws have in common."""

    smoothness: eqx.AbstractClassVar[Smoothness]
    smooth_alternative: ClassVar[str] = ""
    """What to use where derivatives are wanted, for a law of class C-1."""
    acts_apart: ClassVar[bool] = False
    """Whether it acts, and its memory goes on, where the surfaces are apart."""

    def constants(self, geometry: Geometry) -> Any:
        """What follows from the law's numbers and the geometry (once a solve, not once a step); nothing by default."""
        return None

    def localise(self, constants: Any, local: Local) -> Any:
        """The constants at one contact point that differs from the others; the same by default."""
        return constants


# Normal laws ---------------------------------------------------------------------------------------------------------


class AbstractNormalLaw(AbstractLaw):
    """A normal law: the force that pushes pin and sleeve apart at one contact point.

    A law of your own has a `formula` and an `energy`.
    """

    remembers: ClassVar[tuple[str, ...]] = ()
    """Names of its memory."""

    @property
    def clips(self) -> bool:
        """Whether the force is max(0, formula), because the formula may pull."""
        return True

    def prepare(self, geometry: Geometry) -> "PreparedNormal":
        """The law with its constants."""
        return PreparedNormal(self, self.constants(geometry))

    @abc.abstractmethod
    def formula(self, constants: Any, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Scalar:
        """The normal force [N], before it is clipped, for a penetration [m] (finite with finite gradient also for one
        below zero, where it is not used), its rate [m/s] and the law's memory.
        """

    @abc.abstractmethod
    def energy(self, constants: Any, penetration: Scalar) -> Scalar:
        """The elastic energy [J] stored at a penetration [m]; what the force does beyond it is counted as loss."""

    def event_functions(
        self, constants: Any, penetration: Scalar, penetration_rate: Scalar, memory: Memory
    ) -> tuple[Scalar, ...]:
        """Smooth functions whose signs tell on which piece the pressing formula is; none by default."""
        return ()

    def memory_rate(self, constants: Any, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Memory:
        """Time derivative of the memory; zero by default."""
        return tuple(jnp.zeros_like(m) for m in memory)

    def latch(self, constants: Any, memory: Memory, touch: Touch) -> Memory:
        """The memory after an instant at which contact began or ended; unchanged by default."""
        return memory

    def memory_scale(self, constants: Any) -> Memory:
        """Magnitude of each memory variable for error control; infinite (the default) where it only latches."""
        return tuple(jnp.asarray(jnp.inf) for _ in self.remembers)


class PreparedNormal(Module):
    """A normal law with the constants of one joint: what a step evaluates."""

    law: AbstractNormalLaw
    constants: Any

    def at(self, local: Local) -> "PreparedNormal":
        """The same law at a contact point of its own."""
        return self if local is None else PreparedNormal(self.law, self.law.localise(self.constants, local))

    def force(self, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Scalar:
        """The normal force [N]."""
        force = self.law.formula(self.constants, penetration, penetration_rate, memory)
        force = positive_part(force) if self.law.clips else force
        return force if self.law.acts_apart else jnp.where(penetration > 0, force, 0.0)

    def energy(self, penetration: Scalar) -> Scalar:
        """The elastic energy [J]."""
        return self.law.energy(self.constants, penetration)

    def event_functions(
        self, penetration: Scalar, penetration_rate: Scalar, memory: Memory
    ) -> tuple[tuple[Scalar, ...], Flag]:
        """Functions whose signs make the regime, the penetration first, and whether the law presses now; one that means
        nothing in the present regime (a piece of a force that does not act) is 1.
        """
        out, presses = [penetration], penetration > 0
        active = jnp.ones_like(presses) if self.law.acts_apart else presses
        if self.law.clips:
            force = self.law.formula(self.constants, penetration, penetration_rate, memory)
            out.append(jnp.where(active, force, 1.0))
            active, presses = active & (force > 0), presses & (force > 0)
        pieces = self.law.event_functions(self.constants, penetration, penetration_rate, memory)
        return (*out, *(jnp.where(active, piece, 1.0) for piece in pieces)), presses

    def memory_rate(self, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Memory:
        """Time derivative of the memory; zero while apart, but for a law that acts there."""
        rates = self.law.memory_rate(self.constants, penetration, penetration_rate, memory)
        return rates if self.law.acts_apart else tuple(jnp.where(penetration > 0, r, 0.0) for r in rates)

    def latch(self, memory: Memory, touch: Touch) -> Memory:
        """The memory after an instant at which contact began or ended."""
        return self.law.latch(self.constants, memory, touch)

    def memory_scale(self) -> Memory:
        """Magnitude of each memory variable."""
        return self.law.memory_scale(self.constants)


# Friction ------------------------------------------------------------------------------------------------------------


class AbstractFrictionLaw(AbstractLaw):
    """A friction law: the traction along the surface at one contact point."""

    bristles: ClassVar[tuple[str, ...]] = ()
    """Names of its memory, of each of which there is one for every component of the slip."""

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
