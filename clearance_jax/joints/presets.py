"""Joints with play as a designer first thinks of them: a clearance, a length, a diameter; the rest as is usual."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypedDict

import jax.numpy as jnp

from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.ball import SphericalClearance
from clearance_jax.joints.checks import check_larger, check_sizes
from clearance_jax.joints.fitting import BRONZE, STEEL, Fitting
from clearance_jax.joints.guide import GuideClearance
from clearance_jax.joints.revolute import RevoluteClearance
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, HuntCrossley, InternalHertz, Material

# Assumed damping factor of Hunt and Crossley's law [s/m]: at 0.1 m/s an impact loses some 2 % of its speed. Give a law
# where damping matters.
DAMPING = 0.3
# Mean approach of a square punch: 0.95 P / (E* sqrt(area)) (Timoshenko and Goodier, Theory of elasticity, article 139).
PUNCH = 0.95


def round_contact(radial: Any) -> HuntCrossley:
    """Hunt and Crossley's law of a steel pin in a bronze bush (or ball in a socket), with the stiffness that Hertz has
    for a `radial` clearance [m].
    """
    steel, bronze = STEEL, BRONZE
    stiffness = InternalHertz(
        steel.modulus, bronze.modulus, steel.poisson_ratio, bronze.poisson_ratio, reference_clearance=radial
    )
    return HuntCrossley(stiffness, DAMPING)


def flat_contact(length: Any, breadth: Any, corners: int) -> HuntCrossley:
    """The law of one of so many `corners` of a side of a steel block, `length` by `breadth` [m], on a bronze guide: all
    of them together have the linear stiffness of a flat punch, E* sqrt(area) / 0.95.
    """
    compliance = sum(Material(solid.modulus, solid.poisson_ratio).compliance for solid in (STEEL, BRONZE))
    stiffness = jnp.sqrt(length * breadth) / (PUNCH * compliance * corners)
    return HuntCrossley(stiffness, DAMPING, 1.0)


def fitted(
    radial: Any = None,
    *,
    axial: Any = None,
    length: Any = None,
    diameter: Any = None,
    fit: str | Fitting | None = None,
    temperature: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> RevoluteClearance | SleeveClearance:
    """The play of a pin.

    **Arguments:**

    - `radial` clearance [m]; `axial` [m]: to either side, by default none.
    - `length` of the sleeve [m]: with it the pin may tilt. `diameter` of the pin [m]: as long as the sleeve by default.
    - `fit`: instead of `radial`, an ISO 286 fit such as "H7/g6" at the nominal `diameter`, of which the clearance of
      mean sizes is taken; a `Fitting` says more. `temperature` at which it runs [K], by default 20 degC.
    - `normal`: by default Hunt and Crossley's law for a steel pin in a bronze bush, with the stiffness that Hertz has
      for this clearance; `friction`: by default none.

    **Raises:** `ClearanceError` where neither length nor diameter is given, for axial play without a length, for a fit
    that leaves no play, and for numbers that make no joint.
    """
    check_sizes(radial=radial, axial=axial, length=length, diameter=diameter)
    if diameter is None and length is None:
        raise ClearanceError("Play needs the `diameter` of its pin, or the `length` of its sleeve. Give one of them.")
    if axial is not None and length is None:
        raise ClearanceError("Axial play needs the `length` of its sleeve too. Give it.")
    diameter = length if diameter is None else diameter
    tolerance = None
    if fit is not None or temperature is not None:
        radial, tolerance = made(radial, diameter, fit, temperature)
    if radial is None:
        raise ClearanceError("Play needs its `radial` clearance, or a `fit`. Give one of them.")
    check_larger("diameter", diameter, "twice the radial clearance", 2 * radial, "or there is no pin")
    normal = round_contact(radial) if normal is None else normal
    if length is None:
        return RevoluteClearance(radial, diameter / 2, normal, friction, tolerance=tolerance)
    return SleeveClearance(radial, diameter / 2, length, normal, friction, axial, tolerance=tolerance)


def made(radial: Any, diameter: Any, fit: str | Fitting | None, temperature: Any):
    """Radial clearance [m] of a fit and its tolerance. **Raises** `ClearanceError` for what contradicts it."""
    if fit is None:
        raise ClearanceError("A `temperature` is that of a `fit`: a clearance that is given is as warm as it is meant.")
    if radial is not None:
        raise ClearanceError("A clearance is given by `radial` or by a `fit`. Give one of them.")
    check_sizes("K", temperature=temperature)
    if isinstance(fit, Fitting):
        if temperature is not None:
            raise ClearanceError("The `Fitting` has its own temperature: leave the other one out.")
        return fit.radial_clearance(diameter)
    warm = {} if temperature is None else {"temperature": temperature}
    return Fitting(fit, **warm).radial_clearance(diameter)


def shaft(
    radial: Any = None,
    *,
    length: Any = None,
    diameter: Any = None,
    fit: str | Fitting | None = None,
    temperature: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> SleeveClearance:
    """The play of a pin that slides in its sleeve: as `fitted`, with a `length` and without axial play."""
    if length is None:
        raise ClearanceError("A shaft that slides needs the `length` of its sleeve. Give it.")
    numbers: Any = {"length": length, "diameter": diameter, "fit": fit, "temperature": temperature}
    sleeve = fitted(radial, **numbers, normal=normal, friction=friction)
    assert isinstance(sleeve, SleeveClearance)
    return sleeve


def socket(
    radial: Any = None,
    *,
    diameter: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> SphericalClearance:
    """The play of a ball: its `radial` clearance and `diameter` [m], and laws as `fitted` has them.

    **Raises:** `ClearanceError` for what is missing, and for numbers that make no joint.
    """
    check_sizes(radial=radial, diameter=diameter)
    if radial is None or diameter is None:
        raise ClearanceError("The play of a ball needs its `radial` clearance and its `diameter`. Give both.")
    check_larger("diameter", diameter, "twice the radial clearance", 2 * radial, "or there is no ball")
    return SphericalClearance(radial, diameter / 2, round_contact(radial) if normal is None else normal, friction)


def guided(
    side: Any = None,
    *,
    length: Any = None,
    height: Any = None,
    width: Any = None,
    guide_length: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> GuideClearance:
    """The play of a block in its guide.

    **Arguments:**

    - `side` clearance [m], to either side; `length` of the block, its `height` [m], by default as long; `width` [m]: by
      default the guide holds it there. `guide_length`: what the block must fit in.
    - `normal`: by default the law of a corner of a steel block on a bronze guide, on whose sides all corners together
      have the stiffness of a flat punch; `friction`: by default none.

    **Raises:** `ClearanceError` for what is missing, and for numbers that make no joint.
    """
    check_sizes(side=side, length=length, height=height, width=width, guide_length=guide_length)
    if side is None or length is None:
        raise ClearanceError("The play of a block needs its `side` clearance and its `length`. Give both.")
    height = length if height is None else height
    if normal is None:
        breadth = height if width is None else width
        normal = flat_contact(length, breadth, 2 if width is None else 4)
    return GuideClearance(side, length, height, normal, friction, width, guide_length=guide_length)


class PlayNumbers(TypedDict, total=False):
    """What a designer says of a play; a kind of joint takes some of it (`fitted`, `shaft`, `socket`, `guided`)."""

    radial: Any
    axial: Any
    length: Any
    diameter: Any
    fit: str | Fitting
    temperature: Any
    side: Any
    height: Any
    width: Any
    guide_length: Any


class Preset(NamedTuple):
    """How a kind of play is made of a designer's numbers, and which numbers of the joint these are: its field, and a
    factor.
    """

    make: Callable[..., AbstractClearance]
    fields: Mapping[str, tuple[str, float]]
    fits: bool = False

    @property
    def numbers(self) -> tuple[str, ...]:
        """What it takes."""
        return (*self.fields, "fit", "temperature") if self.fits else tuple(self.fields)


_ROUND = {"radial": ("radial_clearance", 1.0), "diameter": ("pin_radius", 0.5)}
_LONG = _ROUND | {"length": ("length", 1.0)}
PIN = Preset(fitted, _LONG | {"axial": ("axial_clearance", 1.0)}, fits=True)
SHAFT = Preset(shaft, _LONG, fits=True)
BALL = Preset(socket, _ROUND | {"diameter": ("ball_radius", 0.5)})
GUIDE = Preset(
    guided,
    {"side": ("side_clearance", 1.0)} | {name: (name, 1.0) for name in ("length", "height", "width", "guide_length")},
)
