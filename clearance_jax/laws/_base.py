"""The base of contact laws, each written for one contact point, without pose, body, time or batch (`vmap` is outside).

Sign convention, stated here once for the whole library:

- penetration > 0 means overlap; its rate > 0 means approach;
- the normal force is >= 0 and pushes the two surfaces apart (a law that may pull says so);
- slip is the velocity of the pin's surface relative to the sleeve's, along one tangent (in the plane) or two (in
  space); the traction is the force on the pin along the same tangents, so a dissipative law returns one of opposite
  sign. Slip, traction and the memory of friction are tuples of as many components: no law is written twice.

A law exists in two forms. The user gives numbers, with units and bounds. Once a solve `prepare(geometry)` adds the
`constants` that follow from them and from the geometry, as a type of its own; a step evaluates that type: it clips and
gates every law alike (`PreparedNormal`, `PreparedFriction`).

Where a formula changes piece, a law has `event_functions`: a fixed tuple of smooth functions whose signs define the
regime. A law owns its memory: it has a rate, or `latch` rewrites it at the instants at which contact begins or ends
(which are always ends of integration steps).
"""

import abc
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import positive_part, step7, step7_slope
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.laws.free_impact import free_impact, needed
from clearance_jax.laws.geometry import Geometry, Local
from clearance_jax.parameters import Parametrised, flatten, physical

Smoothness = Literal["C-1", "C0", "C1", "C2"]
Memory = tuple[Scalar, ...]
Slip = tuple[Scalar, ...]
Bristles = tuple[Slip, ...]
"""Memory of friction: of each name as many components as the slip has."""


class Touch(NamedTuple):
    """An instant at which contact `began` or `ended` (flags): the `penetration_rate` [m/s] and the `slip` [m/s] at that
    instant, and the time `elapsed` since [s]. The value of this time is round-off. Its derivative is not: it says how
    the instant moves with the parameters.
    """

    began: Flag
    ended: Flag
    penetration_rate: Scalar
    slip: Slip
    elapsed: Scalar


class AbstractStiffness(Module):
    """A stiffness computed from the joint's geometry instead of given as a number."""

    exponent: ClassVar[float] = 1.5
    """The exponent n of its unit N/m^n."""

    @abc.abstractmethod
    def value(self, geometry: Geometry) -> Scalar:
        """The stiffness in N/m^n."""


def stiffness_of(given: Any, geometry: Geometry | None, linear: bool = False) -> Scalar:
    """A law's stiffness: its given number, or the value from the geometry. **Raises** `ClearanceError` if that is not
    `linear` in the penetration and the law is.
    """
    if not isinstance(given, AbstractStiffness):
        return given
    if geometry is None:
        raise ClearanceError("The stiffness follows from the joint: give its `geometry` (`laws.Geometry`).")
    if linear and given.exponent != 1.0:
        raise ClearanceError(
            f"A law that is linear in the penetration has a stiffness in N/m, but `{type(given).__name__}` computes "
            f"one in N/m^{given.exponent:g}. Give a number."
        ).about("stiffness", type(given).__name__)
    return given.value(geometry)


class AbstractLaw(Parametrised):
    """The base of normal and friction laws."""

    smoothness: eqx.AbstractClassVar[Smoothness]
    smooth_alternative: ClassVar[str] = ""
    """What to use where derivatives are wanted, for a law of class C-1."""
    acts_apart: ClassVar[bool] = False
    """Whether it acts, and its memory goes on, where the surfaces are apart."""
    has_static_force: ClassVar[bool] = True
    """Whether its force in a lasting state follows from the place and the slip, so that a pin has a place of rest."""

    def constants(self, geometry: Geometry) -> Any:
        """Constants from the law's numbers and the geometry (once a solve, not once a step); none by default."""
        return None

    def localise(self, constants: Any, local: Local) -> Any:
        """The constants at one contact point that differs from the others; the same by default."""
        return constants

    def latch(self, constants: Any, memory: Any, touch: Touch) -> Any:
        """The memory after an instant at which contact began or ended; unchanged by default."""
        return memory


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

    def smoothed(self, width: Any = None, *, penetration: Any = 1e-6, rtol: Any = 1e-6) -> "AbstractNormalLaw":
        """The law with an onset of two continuous derivatives, over the depth `width` [m]; beyond it
        nothing changes.

        **Arguments:** `width`; by default so that its bias is below `rtol` in impacts as deep as `penetration` [m] or
        deeper.
        """
        return SmoothedOnset(self, smooth_width(self, penetration, rtol) if width is None else width)

    def delivered_restitution(self, speed: Any = None, mass: Any = None, geometry: Geometry | None = None) -> Scalar:
        """The restitution that a free impact really has. Without a closed form, which can be differentiated, the impact
        is simulated; NaN if the mass does not come off.

        **Arguments:** `speed` before the impact [m/s]; `mass` [kg], m1 m2/(m1 + m2) of two free bodies; `geometry` of
        the joint. Arguments without effect on the restitution may be left out; a missing one raises `ClearanceError`.
        """
        unknown = jnp.asarray(jnp.nan)
        ready = self.prepare(Geometry(unknown, unknown, unknown) if geometry is None else geometry)
        speed, mass = needed(speed, "speed", self), needed(mass, "mass", self)
        zero, began = jnp.zeros(()), jnp.asarray(True)
        touch = Touch(began, ~began, jnp.asarray(speed, float), (), zero)
        memory = ready.latch(tuple(zero for _ in self.remembers), touch)
        if not jnp.isfinite(self.formula(ready.constants, jnp.asarray(1e-9), touch.penetration_rate, memory)):
            raise ClearanceError("This law depends on its joint: give the joint's `geometry` (`laws.Geometry`).")
        return free_impact(ready, memory, jnp.asarray(speed, float), jnp.asarray(mass, float))

    def for_restitution(
        self, restitution: Any, speed: Any = None, mass: Any = None, geometry: Geometry | None = None
    ) -> "AbstractNormalLaw":
        """The law with the damping that delivers a `restitution` in (0, 1); the other arguments are those of
        `delivered_restitution`.

        **Raises:** `ClearanceError` for a law without damping, and where none delivers it.
        """
        raise ClearanceError(f"`{type(self).__name__}` has no damping that could be chosen for a restitution.")

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

    def validity(self, constants: Any) -> Scalar | None:
        """Up to which penetration [m] the law holds (infinite: at any); `None` (the default) if nothing is known."""
        return None

    @property
    def validity_reason(self) -> str:
        """Why the law does not hold beyond its limit, in words; empty without a limit."""
        return ""

    def friction_lever(self, constants: Any, penetration: Scalar) -> Scalar | None:
        """How much further from the pin's axis than the contact point friction acts [m]. In a wide contact the sum of
        the pressures, which all rub, is larger than the normal force, so the moment of friction is larger too. `None`
        (the default): friction acts at the point.
        """
        return None

    def event_functions(
        self, constants: Any, penetration: Scalar, penetration_rate: Scalar, memory: Memory
    ) -> tuple[Scalar, ...]:
        """Smooth functions whose signs tell the piece of the pressing formula; none by default."""
        return ()

    def memory_rate(self, constants: Any, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Memory:
        """Time derivative of the memory; zero by default."""
        return tuple(jnp.zeros_like(m) for m in memory)

    def memory_scale(self, constants: Any) -> Memory:
        """Magnitude of each memory variable for error control; infinite (the default) where it only latches."""
        return tuple(jnp.asarray(jnp.inf) for _ in self.remembers)


class PreparedNormal(Module):
    """A normal law with the constants of one joint: the form that a step evaluates. See the law for its methods."""

    law: AbstractNormalLaw
    constants: Any

    def at(self, local: Local) -> "PreparedNormal":
        """The law at one contact point with its own constants."""
        return self if local is None else PreparedNormal(self.law, self.law.localise(self.constants, local))

    def force(self, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Scalar:
        """The normal force [N]: the law's formula, clipped and without contact zero."""
        force = self.law.formula(self.constants, penetration, penetration_rate, memory)
        force = positive_part(force) if self.law.clips else force
        return force if self.law.acts_apart else jnp.where(penetration > 0, force, 0.0)

    def event_functions(
        self, penetration: Scalar, penetration_rate: Scalar, memory: Memory
    ) -> tuple[tuple[Scalar, ...], Flag]:
        """Functions whose signs define the regime, the penetration first, and whether the law presses now. A function
        without meaning in the present regime (a piece of a force that does not act) is 1.
        """
        out, presses = [penetration], penetration > 0
        active = jnp.ones_like(presses) if self.law.acts_apart else presses
        if self.law.clips:
            force = self.law.formula(self.constants, penetration, penetration_rate, memory)
            out.append(jnp.where(active, force, 1.0))
            active, presses = active & (force > 0), presses & (force > 0)
        pieces = self.law.event_functions(self.constants, penetration, penetration_rate, memory)
        return (*out, *(jnp.where(active, piece, 1.0) for piece in pieces)), presses

    def energy(self, penetration: Scalar) -> Scalar:
        return self.law.energy(self.constants, penetration)

    def memory_rate(self, penetration: Scalar, penetration_rate: Scalar, memory: Memory) -> Memory:
        return self.law.memory_rate(self.constants, penetration, penetration_rate, memory)

    def latch(self, memory: Memory, touch: Touch) -> Memory:
        return self.law.latch(self.constants, memory, touch)

    def memory_scale(self) -> Memory:
        return self.law.memory_scale(self.constants)


# Laws made of another ------------------------------------------------------------------------------------------------


class _OfLaw:
    """An attribute of a modified law that is its `law`'s."""

    def __set_name__(self, owner: type, name: str):
        self.name = name

    def __get__(self, modified: Any, owner: Any = None) -> Any:
        return self if modified is None else getattr(modified.law, self.name)


OfLaw: Any = _OfLaw


class AbstractModifiedLaw(AbstractNormalLaw):
    """A normal law that changes the force and the energy of another one, its `law`; everything else is that law's."""

    law: eqx.AbstractVar[AbstractNormalLaw]
    clips: ClassVar = OfLaw()
    acts_apart: ClassVar = OfLaw()
    has_static_force: ClassVar = OfLaw()
    remembers: ClassVar = OfLaw()
    validity_reason: ClassVar = OfLaw()
    constants: ClassVar = OfLaw()
    localise: ClassVar = OfLaw()
    validity: ClassVar = OfLaw()
    friction_lever: ClassVar = OfLaw()
    event_functions: ClassVar = OfLaw()
    memory_rate: ClassVar = OfLaw()
    latch: ClassVar = OfLaw()
    memory_scale: ClassVar = OfLaw()


# A smooth onset ------------------------------------------------------------------------------------------------------

SMOOTHED: dict[Smoothness, Smoothness] = {"C-1": "C0", "C0": "C0", "C1": "C2", "C2": "C2"}
"""The class of a law with a smooth onset, by its own. A force that is cut off where it would pull keeps a corner."""


class SmoothedOnset(AbstractModifiedLaw):
    """F = S F_e + S' U + S (F - F_e), with S = STEP7(d / w): the elastic energy U of the law, and its damping, grow
    over the depth w from nothing at first touch. F_e is the elastic force of the law, that is, its force at rest.

    Beyond the depth w force and elastic energy are those of the law: an impact differs by the damping and by the time
    within w. The energy is S U exactly, so that an elastic law stays elastic.

    **Arguments:** `law`; `width` w [m] > 0: much larger than the round-off of d, and small against the penetration.
    `law.smoothed()` chooses one.
    """

    law: AbstractNormalLaw = flatten()
    width: Scalar = physical("m", above=0.0)

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        return SMOOTHED[self.law.smoothness]

    def units(self):
        return self.law.units()

    def formula(self, constants, penetration, penetration_rate, memory):
        ratio = penetration / self.width
        whole = self.law.formula(constants, penetration, penetration_rate, memory)
        return step7(ratio) * whole + step7_slope(ratio) / self.width * self.law.energy(constants, penetration)

    def event_functions(self, constants, penetration, penetration_rate, memory):
        return (penetration - self.width, *super().event_functions(constants, penetration, penetration_rate, memory))

    def energy(self, constants, penetration):
        return step7(penetration / self.width) * self.law.energy(constants, penetration)


def smooth_width(law: AbstractNormalLaw, penetration: Any, rtol: Any) -> Any:
    """The width w [m] with a bias below `rtol` in impacts as deep as `penetration`.

    Damping that grows as d^p loses the share (w / d)^(p + 1) of its work in an impact of the depth d. At the least p is
    0 for a law of class C-1, 1/4 for one of class C0 (`Tsuji`), and 1 for a smoother one.
    """
    order = {"C-1": 1.0, "C0": 1.25}.get(law.smoothness, 2.0)
    return penetration * rtol ** (1 / order)
