"""The base of friction laws, for one contact point; sign convention as in `_base`."""

import abc
import functools
import itertools
import operator
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import corner, safe_sqrt
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax._compile.barriers import share
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.laws._base import AbstractLaw, Bristles, Memory, OfLaw, Slip, Smoothness, Touch
from clearance_jax.laws.geometry import Geometry, Local
from clearance_jax.parameters import Demand, flatten, physical


class Kink(NamedTuple):
    """A corner of the coefficient of friction over the slip: at the `speed` [m/s] its slope jumps by `slope` [s/m] and
    its curvature by `curvature` [s^2/m^2]. At the speed 0 give half of the jumps: the mirror image at negative slip
    adds the other half. `coefficient`: the largest one of the law, by which the size of a change is judged.
    """

    speed: Scalar | float
    coefficient: Scalar
    slope: Scalar | float
    curvature: Scalar


class AbstractFrictionLaw(AbstractLaw):
    """A friction law: the traction along the surface at one contact point."""

    bristles: ClassVar[tuple[str, ...]] = ()
    """Names of its memory, of each of which there is one for every component of the slip."""

    @property
    def has_static_force(self):  # type: ignore[override]
        return not self.bristles

    def smoothed(self, width: Any = None, *, rtol: Any = 1e-6) -> "AbstractFrictionLaw":
        """The law with two continuous derivatives: every corner of its curve is rounded over the `width` [m/s] on
        either side of it, and nothing changes elsewhere. A law of class C2 has no corner and is returned as it is.

        **Arguments:** `width`; by default so that no coefficient changes by more than `rtol` > 0 of the largest.

        **Raises:** `ClearanceError` for a law that does not tell its corners, and for a width so large that corners
        meet.
        """
        if self.smoothness == "C2":
            return self
        if width is None and isinstance(rtol, (int, float)) and not rtol > 0:
            raise ClearanceError(f"`rtol` must be above 0, but it is {rtol:g}: a corner is rounded over some width.")
        kinks = self.kinks()
        if not kinks:
            name = type(self).__name__
            raise ClearanceError(f"`{name}` does not tell where its corners are: give the class a method `kinks`.")
        return SmoothedFriction(self, smooth_speed(kinks, rtol) if width is None else width)

    def kinks(self) -> tuple[Kink, ...]:
        """The corners of the coefficient of friction over the slip, at speeds from 0 on; none by default."""
        return ()

    def prepare(self, geometry: Geometry) -> "PreparedFriction":
        """The law with its constants."""
        return PreparedFriction(self, self.constants(geometry))

    @abc.abstractmethod
    def traction(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> Slip:
        """The traction on the pin [N] for a slip [m/s], a normal force [N] and the law's memory."""

    def event_functions(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> tuple[Scalar, ...]:
        """Smooth functions whose signs tell the piece of the law, or the side of its steep layer, on which a slip lies:
        inside (negative) or outside (positive), as |slip|^2 - v^2; none by default.
        """
        return ()

    def memory_rate(self, constants: Any, slip: Slip, normal_force: Scalar, memory: Bristles) -> Bristles:
        """Time derivative of the memory; zero by default."""
        return tuple(tuple(jnp.zeros_like(m) for m in vector) for vector in memory)

    def memory_scale(self, constants: Any) -> Memory:
        """Magnitude of each kind of memory for error control; infinite (the default) where it only latches."""
        return tuple(jnp.asarray(jnp.inf) for _ in self.bristles)


class PreparedFriction(Module):
    """A friction law with a joint's constants, as a step evaluates it: the law's methods, for memory by component."""

    law: AbstractFrictionLaw
    constants: Any

    def at(self, local: Local) -> "PreparedFriction":
        """The law at one contact point with its own constants."""
        return self if local is None else PreparedFriction(self.law, self.law.localise(self.constants, local))

    def traction(self, slip: Slip, normal_force: Scalar, memory: Memory) -> Slip:
        traction = self.law.traction(self.constants, slip, normal_force, self._split(memory, slip))
        is_several = hasattr(traction, "__len__") and getattr(traction, "ndim", 1)
        if not is_several or len(traction) != len(slip):
            allowed = f"a tuple as long as the slip ({len(slip)})"
            raise wrong_value(f"`traction` of `{type(self.law).__name__}`", allowed, traction, name="traction")
        return tuple(traction)

    def event_functions(
        self, slip: Slip, normal_force: Scalar, memory: Memory, presses: Flag, before: Slip
    ) -> tuple[Scalar, ...]:
        """Functions whose signs define the zone; 1 where nothing presses.

        If the slip jumps from one side of a layer to the other between two samples, no sign of |slip|^2 - v^2 changes.
        So outside a layer a further function tells whether the slip still has the direction that it had `before`.
        """
        zones = self.law.event_functions(self.constants, slip, normal_force, self._split(memory, slip))
        ahead = sum(s * b for s, b in zip(slip, before, strict=True))
        sides = [jnp.where(zone > 0, ahead, 1.0) for zone in zones]
        return tuple(jnp.where(presses, function, 1.0) for function in (*zones, *sides))

    def memory_rate(self, slip: Slip, normal_force: Scalar, memory: Memory) -> Memory:
        rates = self.law.memory_rate(self.constants, slip, normal_force, self._split(memory, slip))
        return tuple(rate for vector in rates for rate in vector)

    def latch(self, memory: Memory, touch: Touch) -> Memory:
        new = self.law.latch(self.constants, self._split(memory, touch.slip), touch)
        return tuple(m for vector in new for m in vector)

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
    speed = speed_of(slip)
    moving = speed > 0
    ratio = jnp.where(moving, profile(speed) / jnp.where(moving, speed, 1.0), jax.grad(profile)(jnp.zeros(())))
    ratio = share(ratio)
    return tuple(ratio * s for s in slip)


def speed_of(slip: Slip) -> Scalar:
    """The magnitude of a slip, or of a deflection with as many components."""
    if len(slip) == 1:
        return jnp.abs(slip[0])
    return safe_sqrt(functools.reduce(operator.add, (s * s for s in slip)))


def outside(slip: Slip, speed: Scalar) -> Scalar:
    """|slip|^2 - speed^2: positive outside a layer, negative inside."""
    return sum(s * s for s in slip) - speed * speed


# Without corners -----------------------------------------------------------------------------------------------------


class AbstractModifiedFriction(AbstractFrictionLaw):
    """A friction law that changes the traction of another one, its `law`; everything else is that law's."""

    law: eqx.AbstractVar[AbstractFrictionLaw]
    bristles: ClassVar = OfLaw()
    acts_apart: ClassVar = OfLaw()
    units: ClassVar = OfLaw()
    constants: ClassVar = OfLaw()
    localise: ClassVar = OfLaw()
    event_functions: ClassVar = OfLaw()
    memory_rate: ClassVar = OfLaw()
    latch: ClassVar = OfLaw()
    memory_scale: ClassVar = OfLaw()


class SmoothedFriction(AbstractModifiedFriction):
    """T = T_law - N sum_i C_i(|v| - v_i), C_i(x) = (j_i + x k_i / 2) (w - |x|)^3 (3 w + |x|) / (16 w^3) for |x| < w: at
    every corner v_i of the `law` a polynomial takes away the jumps j_i of its slope and k_i of its curvature.

    Further than w from every corner the traction is that of the law.

    **Arguments:** `law`; `width` w [m/s] > 0. `law.smoothed()` chooses one.
    """

    law: AbstractFrictionLaw = flatten()
    width: Scalar = physical("m/s", above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def demands(self):
        most = functools.reduce(jnp.minimum, _widths_without_overlap(self.law.kinks()))
        words = "must be at most {:g} m/s: the next corner of the law is as near as that".format
        yield Demand("width", self.width <= most, lambda: words(most))

    def traction(self, constants, slip, normal_force, memory):
        whole = self.law.traction(constants, slip, normal_force, memory)
        rounded = along_slip(lambda v: -normal_force * (self._round(v) - self._round(-v)), slip)
        return tuple(t + r for t, r in zip(whole, rounded, strict=True))

    def _round(self, v: Scalar) -> Scalar:
        """The change of the coefficient by the corners on one side."""
        total = jnp.zeros_like(v)
        for kink in self.law.kinks():
            x = v - kink.speed
            # |x| as x sign(x): its derivative at 0 is 0, the mean of both sides, as that of the law at its corner.
            added = self.width * corner(x * jnp.sign(x) / self.width)
            total += added * (0.5 * kink.slope + 0.25 * kink.curvature * x)
        return total

    def event_functions(self, constants, slip, normal_force, memory):
        ends = tuple(outside(slip, kink.speed + self.width) for kink in self.law.kinks())
        return (*super().event_functions(constants, slip, normal_force, memory), *ends)


def _widths_without_overlap(kinks: tuple[Kink, ...]) -> list[Scalar]:
    """By corner, half the distance to the one before it [m/s]; before the first comes its image at negative slip."""
    speeds = [jnp.asarray(kink.speed) for kink in kinks]
    first = jnp.where(speeds[0] > 0, speeds[0], jnp.inf)
    return [first, *(0.5 * (high - low) for low, high in itertools.pairwise(speeds))]


def smooth_speed(kinks: tuple[Kink, ...], rtol: Any) -> Any:
    """The width w [m/s] over which rounded corners change no coefficient by more than `rtol` of the largest: a jump j
    of the slope changes it by 3/16 j w, one of the curvature k by less than 0.011 k w^2.
    """
    widths = []
    for kink in kinks:
        # A corner at zero is given as one half, and the negative slip adds the other: each may make half the change.
        room = rtol * kink.coefficient * jnp.where(jnp.asarray(kink.speed) > 0, 1.0, 0.5)
        slope, curvature = 3 / 16 * jnp.abs(kink.slope), 0.011 * jnp.abs(kink.curvature)
        # The root w of slope w + curvature w^2 = room. Where nothing jumps, any width will do.
        divisor = slope + safe_sqrt(slope**2 + 4 * curvature * room)
        widths.append(jnp.where(slope + curvature > 0, 2 * room / jnp.where(divisor > 0, divisor, 1.0), jnp.inf))
    return functools.reduce(jnp.minimum, widths + _widths_without_overlap(kinks))
