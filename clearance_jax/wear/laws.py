"""Wear laws: the rate at which a surface wears off where another rubs on it, for one place of it.

A coefficient of wear has several units in use, so it is given with its own (`archard`, `reye`): depth by pressure and
distance [1/Pa], which equals volume by force and distance [mm^3/(N m)], or Archard's number with a hardness.
"""

import abc
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.numerics import positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.parameters import Parametrised, as_leaf, physical
from clearance_jax.units import to_si

COEFFICIENT = "1/Pa"


class SlidingState(NamedTuple):
    """What happens at places of a surface: arrays of one shape, or numbers.

    - `pressure` [Pa], at least 0; `speed` of the other surface on it [m/s], at least 0.
    - `traction`: the ratio |T| / N; `time` that the joint has run [s], from 0 when it is new.
    """

    pressure: Array
    speed: Array
    traction: Array
    time: Array


class AbstractWearLaw(Parametrised):
    """A wear law: the rate at which a surface wears off, from pressure and sliding."""

    @abc.abstractmethod
    def rate(self, at: SlidingState) -> Array:
        """The rate at which the surface wears off [m/s], at least 0."""

    is_linear: ClassVar[bool] = False
    """Whether the rate is in proportion to the pressure: then the volume does not depend on how a force spreads."""


class Archard(AbstractWearLaw):
    """Archard's law: dh/ds = k p, with the depth h, the length of sliding s and the pressure p (Archard 1953, doi
    10.1063/1.1721448; Qian et al. 2022, Eqs. 9 to 12).

    **Arguments:** `coefficient` k = K / H [1/Pa]; the function `archard` reads it with its unit.
    """

    coefficient: Scalar = physical(COEFFICIENT, least=0.0, help="coefficient of wear k", example='"6e-5 mm^3/(N*m)"')

    def rate(self, at):
        return self.coefficient * at.pressure * at.speed

    is_linear: ClassVar[bool] = True


class Reye(AbstractWearLaw):
    """Reye's law: the volume worn off is in proportion to the work of friction (Reye 1860): dh/ds = k_r tau, with tau =
    (|T| / N) p.

    **Arguments:** `coefficient` k_r, volume by work [1/Pa]. Without friction nothing wears.
    """

    coefficient: Scalar = physical(COEFFICIENT, least=0.0, help="volume by work of friction", example='"1e-4 mm^3/J"')

    def rate(self, at):
        return self.coefficient * at.traction * at.pressure * at.speed

    is_linear: ClassVar[bool] = True


class Threshold(AbstractWearLaw):
    """A law in which only the pressure beyond a least one counts.

    **Arguments:** `law`; `least` [Pa].
    """

    law: AbstractWearLaw
    least: Scalar = physical("Pa", least=0.0, help="pressure below which nothing wears", example='"1 MPa"')

    def rate(self, at):
        return self.law.rate(at._replace(pressure=positive_part(at.pressure - self.least)))


class RunningIn(AbstractWearLaw):
    """A law whose wear is faster at first: its rate is multiplied by a factor that falls to 1 as exp(-t / `duration`).

    **Arguments:** `law`; `factor` at the start; `duration` [s].
    """

    law: AbstractWearLaw
    factor: Scalar = physical("", least=0.0, help="how many times as fast it wears at first", example="5.0")
    duration: Scalar = physical("s", above=0.0, help="time in which that falls to a third", example='"1 h"')

    def rate(self, at):
        return self.law.rate(at) * (1 + (self.factor - 1) * jnp.exp(-at.time / self.duration))

    @property
    def is_linear(self):
        return self.law.is_linear


class Graded(AbstractWearLaw):
    """A law whose coefficient depends on pressure p and speed v: it is multiplied by (p / `pressure`)^a (v /
    `speed`)^b.

    **Arguments:** `law`; `pressure` [Pa] and `speed` [m/s], at which the coefficient holds; `by_pressure` a; `by_speed`
    b.
    """

    law: AbstractWearLaw
    pressure: Scalar = physical("Pa", above=0.0, help="at which the coefficient holds", example='"10 MPa"')
    speed: Scalar = physical("m/s", above=0.0, help="at which the coefficient holds", example='"0.1 m/s"')
    by_pressure: Scalar = physical("", above=-1.0, default=0.0, help="power of the pressure", example="0.5")
    by_speed: Scalar = physical("", above=-1.0, default=0.0, help="power of the speed", example="-0.25")

    def rate(self, at):
        rubs = (at.pressure > 0) & (at.speed > 0)
        p, v = (jnp.where(rubs, x, 1.0) for x in (at.pressure / self.pressure, at.speed / self.speed))
        return jnp.where(rubs, self.law.rate(at) * p**self.by_pressure * v**self.by_speed, 0.0)


def archard(coefficient: Any, hardness: Any = None) -> Archard:
    """Archard's law from texts with units.

    **Arguments:** `coefficient`: "6e-14 1/Pa" or "6e-5 mm^3/(N*m)"; or Archard's number K, which has no unit, with the
    `hardness` H of the softer surface ("1.3 GPa"). Then k = K / H, from V = K F s / H. If your table defines K by V
    = K F s / (3 H), give a third of it.

    **Raises:** `ClearanceError` for a coefficient without unit and without hardness, and for a wrong dimension.
    """
    if hardness is None:
        return Archard(_coefficient(coefficient, "Write it with its unit, or give `hardness` with Archard's number."))
    number = to_si(coefficient, "", "`coefficient` with a `hardness`")
    return Archard(number / to_si(hardness, "Pa", "`hardness`"))


def reye(coefficient: Any) -> Reye:
    """Reye's law from a text with its unit.

    **Arguments:** `coefficient`: volume by work, such as "1e-4 mm^3/J".
    """
    return Reye(_coefficient(coefficient, "Write it with its unit."))


def _coefficient(given: Any, fix: str) -> Any:
    if isinstance(given, int | float):
        raise ClearanceError(
            f"A coefficient of wear of {given:g} without a unit may mean 1/Pa, mm^2/N, mm^3/(N m) or a number that "
            f"goes with a hardness. {fix}"
        ).about("coefficient", given)
    return to_si(given, COEFFICIENT, "`coefficient`") if isinstance(given, str) else as_leaf(given)
