"""What a contact law is. Written for ONE contact point: no pose, no body, no time; `vmap` lives above it.

Sign convention, stated here once for the whole library:

- penetration > 0 means overlap; its rate > 0 means approach;
- the normal force is >= 0 and pushes the two surfaces apart (a law that may pull says so);
- slip velocity > 0 is motion of the pin's surface along +t relative to the sleeve's; the traction is the force on the
  pin along +t, so a dissipative law returns a traction of the opposite sign to the slip.

A law owns its memory: `remembers` names its memory variables, `memory_rate` is their time derivative, and `latch`
rewrites them at the instants at which contact begins or ends (which are always ends of integration steps).
"""

import abc
from typing import ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from clearance_jax._types import Scalar

Smoothness = Literal["C-1", "C0", "C1", "C2"]
Memory = Float[Array, " memory"]
Regime = Int[Array, "..."]
Value = Float[Array, "..."]
"""One contact point's scalar, or samples of it."""

# Regimes of a normal law: what the force is made of; CONTACT and above: it presses, on this or a further smooth piece.
# The solver ends a step wherever a regime changes.
APART, CLIPPED, CONTACT = 0, 1, 2


class AbstractStiffness(eqx.Module):
    """A stiffness that is computed from the joint's geometry instead of being given as a number."""

    @abc.abstractmethod
    def value(self, pin_radius: Scalar, radial_clearance: Scalar) -> Scalar:
        """The stiffness in N/m^n."""


class Touch(NamedTuple):
    """An instant at which contact `began` or `ended` (flags): approach speed then, slip velocity, and the time elapsed
    since, a round-off in value that carries how the instant depends on parameters.
    """

    began: Array
    ended: Array
    penetration_rate: Scalar
    slip_velocity: Scalar
    elapsed: Scalar


class AbstractLaw(eqx.Module):
    """What normal and friction laws have in common: a smoothness class and an owned memory."""

    smoothness: eqx.AbstractClassVar[Smoothness]
    remembers: ClassVar[tuple[str, ...]] = ()
    smooth_alternative: ClassVar[str] = ""
    """What to use where derivatives are wanted, for a law of class C-1."""

    def prepared(self, pin_radius: Scalar, radial_clearance: Scalar) -> "AbstractLaw":
        """The law with everything that depends only on geometry computed (once a solve, not once a step)."""
        stiffness = getattr(self, "stiffness", None)
        if isinstance(stiffness, AbstractStiffness):
            value = stiffness.value(pin_radius, radial_clearance)
            return eqx.tree_at(lambda law: law.stiffness, self, value, is_leaf=lambda x: x is stiffness)
        return self

    def latch(self, memory: Memory, touch: Touch) -> Memory:
        """The memory after an instant at which contact began or ended; unchanged by default."""
        return memory

    def memory_scale(self) -> Memory:
        """Magnitude of each memory variable for error control; infinite (the default) where it only latches."""
        return jnp.full(len(self.remembers), jnp.inf)


class AbstractNormalLaw(AbstractLaw):
    """Normal force of one contact point."""

    @abc.abstractmethod
    def __call__(self, penetration: Value, penetration_rate: Value, memory: Memory) -> Value:
        """The normal force [N] for a penetration [m], its rate [m/s] and the law's memory."""

    @abc.abstractmethod
    def energy(self, penetration: Value) -> Value:
        """The elastic energy [J] stored at a penetration [m]; what the force does beyond it is counted as loss."""

    def unclipped(self, penetration: Value, penetration_rate: Value, memory: Memory) -> Value:
        """The force before any `max(0, .)`; its sign tells the clipped regime. The force itself by default."""
        return self(penetration, penetration_rate, memory)

    def piece(self, penetration: Value) -> Regime | int:
        """Which smooth piece of the pressing law a penetration lies on, from 0; a law of one piece by default."""
        return 0

    def regime(self, penetration: Value, penetration_rate: Value, memory: Memory) -> Regime:
        """`APART`, `CLIPPED`, or `CONTACT` plus the piece, for arrays of penetrations and rates of any one shape."""
        pulls = self.unclipped(penetration, penetration_rate, memory) < 0
        return jnp.where(penetration > 0, jnp.where(pulls, CLIPPED, CONTACT + self.piece(penetration)), APART)


class AbstractFrictionLaw(AbstractLaw):
    """Friction of one contact point."""

    @abc.abstractmethod
    def __call__(self, slip_velocity: Value, normal_force: Value, memory: Memory) -> Value:
        """The traction on the pin [N] for a slip velocity [m/s], a normal force [N] and the law's memory."""

    def memory_rate(self, slip_velocity: Value, normal_force: Value, memory: Memory) -> Memory:
        """Time derivative of the memory while the surfaces touch (it is frozen while they do not); zero by default."""
        return jnp.zeros_like(memory)

    def regime(self, slip_velocity: Value) -> Regime | None:
        """Which smooth piece of the law or side of its steep layer a slip velocity lies on; `None` (the default) for a
        law without either.
        """
        return None
