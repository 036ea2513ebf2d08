"""Joints with play from a designer's numbers: a clearance, a radius, a length; the rest has usual values."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypedDict

import jax.numpy as jnp

from clearance_jax.errors import ClearanceError, suggest, wrong_value
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.ball import SphericalClearance
from clearance_jax.joints.checks import check_larger, check_sizes
from clearance_jax.joints.fitting import BRONZE, STEEL, Fitting
from clearance_jax.joints.guide import GuideClearance
from clearance_jax.joints.pin import AbstractPin, RevoluteClearance
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, HuntCrossley, InternalHertz, Material

PINS: Mapping[str, type[AbstractPin]] = {pin.kind: pin for pin in (RevoluteClearance, SleeveClearance)}
"""Pins in sleeves, by the word that scenes have for them."""
# Assumed damping factor of Hunt and Crossley's law [s/m]: at 0.1 m/s an impact loses some 2 % of its speed. Give a law
# where damping matters.
DAMPING = 0.3
# Mean approach of a square punch: 0.95 P / (E* sqrt(area)) (Timoshenko and Goodier, Theory of elasticity, article 139).
PUNCH = 0.95


def round_contact(radial_clearance: Any) -> HuntCrossley:
    """Hunt and Crossley's law of steel in bronze, with Hertz's stiffness for a `radial_clearance` [m]."""
    moduli, ratios = (STEEL.modulus, BRONZE.modulus), (STEEL.poisson_ratio, BRONZE.poisson_ratio)
    return HuntCrossley(InternalHertz(*moduli, *ratios, radial_clearance), DAMPING)


def flat_contact(length: Any, breadth: Any, corners: int) -> HuntCrossley:
    """The law of one of the `corners` of a side of a steel block, `length` by `breadth` [m], on a bronze guide.
    Together they have the linear stiffness of a flat punch, E* sqrt(area) / 0.95.
    """
    compliance = sum(Material(solid.modulus, solid.poisson_ratio).compliance for solid in (STEEL, BRONZE))
    stiffness = jnp.sqrt(length * breadth) / (PUNCH * compliance * corners)
    return HuntCrossley(stiffness, DAMPING, 1.0)


def pin_clearance(
    radial_clearance: Any = None,
    *,
    kind: str = "pin",
    pin_radius: Any = None,
    length: Any = None,
    axial_clearance: Any = None,
    fit: str | Fitting | None = None,
    temperature: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> AbstractPin:
    """The play of a pin in a sleeve, from the numbers of a design.

    **Arguments:**

    - `radial_clearance` [m].
    - `kind`: "pin", in the plane; or "sleeve", in space, where the pin can also tilt.
    - `pin_radius` [m]: by default half the length; `length` of the contact [m], for a sleeve its own.
    - `axial_clearance` of a sleeve [m]: to either side, by default none.
    - `fit`: in place of `radial_clearance`, an ISO 286 fit such as "H7/g6" at the nominal diameter, which is twice the
      `pin_radius`. The clearance is that of the mean sizes. A `Fitting` says more. `temperature` at which it runs [K],
      by default 20 degC.
    - `normal`: by default Hunt and Crossley's law for a steel pin in a bronze bush, with Hertz's stiffness for this
      clearance; `friction`: by default none.

    **Raises:** `ClearanceError` if neither length nor pin radius is given, for a sleeve without a length, for axial
    play of a pin in the plane, for a fit that leaves no play, and for numbers that make no joint.
    """
    check_sizes(
        radial_clearance=radial_clearance, axial_clearance=axial_clearance, length=length, pin_radius=pin_radius
    )
    if kind not in PINS:
        raise wrong_value("`kind`", " or ".join(PINS), kind)
    if length is None and "length" in required(PINS[kind]):
        raise ClearanceError(f"A {kind} needs its `length`. Give it.")
    if axial_clearance is not None and "axial_clearance" not in PINS[kind].sizes():
        raise ClearanceError("An `axial_clearance` is that of a sleeve: give `kind` sleeve, and its `length`, too.")
    if pin_radius is None:
        if length is None:
            raise ClearanceError("Play needs the `pin_radius`, or the `length` of the contact. Give one of them.")
        pin_radius = length / 2
    tolerance = None
    if fit is not None or temperature is not None:
        radial_clearance, tolerance = radial_clearance_of(radial_clearance, pin_radius, fit, temperature)
    if radial_clearance is None:
        raise ClearanceError("Play needs its `radial_clearance`, or a `fit`. Give one of them.")
    check_larger("pin_radius", pin_radius, "the radial clearance", radial_clearance, "or there is no pin")
    normal = round_contact(radial_clearance) if normal is None else normal
    make: Any = PINS[kind]
    axial = {} if axial_clearance is None else {"axial_clearance": axial_clearance}
    numbers = {"radial_clearance": radial_clearance, "pin_radius": pin_radius, "length": length, "tolerance": tolerance}
    return make(**numbers, **axial, normal=normal, friction=friction)


def radial_clearance_of(radial_clearance: Any, pin_radius: Any, fit: str | Fitting | None, temperature: Any):
    """Radial clearance [m] of a fit and its tolerance. **Raises** `ClearanceError` for what contradicts it."""
    if fit is None:
        raise ClearanceError("A `temperature` is that of a `fit`: a clearance that is given is as warm as it is meant.")
    if radial_clearance is not None:
        raise ClearanceError("A clearance is given by `radial_clearance` or by a `fit`. Give one of them.")
    check_sizes("K", temperature=temperature)
    if isinstance(fit, Fitting):
        if temperature is not None:
            raise ClearanceError("The `Fitting` has its own temperature: leave the other one out.")
        return fit.radial_clearance(2 * pin_radius)
    warm = {} if temperature is None else {"temperature": temperature}
    return Fitting(fit, **warm).radial_clearance(2 * pin_radius)


def shaft(
    radial_clearance: Any = None,
    *,
    pin_radius: Any = None,
    length: Any = None,
    fit: str | Fitting | None = None,
    temperature: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> SleeveClearance:
    """The play of a pin that slides in its sleeve.

    **Arguments:** `radial_clearance`, `pin_radius`, `length` [m], `fit`, `temperature` [K], `normal` and `friction` as
    of `pin_clearance` for the kind "sleeve".
    """
    numbers: Any = {"length": length, "pin_radius": pin_radius, "fit": fit, "temperature": temperature}
    sleeve: Any = pin_clearance(radial_clearance, kind="sleeve", **numbers, normal=normal, friction=friction)
    return sleeve


def socket(
    radial_clearance: Any = None,
    *,
    ball_radius: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> SphericalClearance:
    """The play of a ball in a socket.

    **Arguments:** `radial_clearance` and `ball_radius` [m]; `normal` and `friction` laws, by default as those of
    `pin_clearance`.

    **Raises:** `ClearanceError` for what is missing, and for numbers that make no joint.
    """
    check_sizes(radial_clearance=radial_clearance, ball_radius=ball_radius)
    if radial_clearance is None or ball_radius is None:
        raise ClearanceError("The play of a ball needs its `radial_clearance` and its `ball_radius`. Give both.")
    check_larger("ball_radius", ball_radius, "the radial clearance", radial_clearance, "or there is no ball")
    normal = round_contact(radial_clearance) if normal is None else normal
    return SphericalClearance(radial_clearance, ball_radius, normal, friction)


def guide_clearance(
    side_clearance: Any = None,
    *,
    length: Any = None,
    height: Any = None,
    width: Any = None,
    guide_length: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> GuideClearance:
    """The play of a block in its guide, from the numbers of a design.

    **Arguments:**

    - `side_clearance` [m], to either side; `length` of the block, and its `height` [m], by default equal to the length.
    - `width` [m]: by default the guide holds the block in this direction; `guide_length` [m]: the block must not be
      longer.
    - `normal`: by default the law of a corner of a steel block on a bronze guide: all corners of one side together have
      the stiffness of a flat punch; `friction`: by default none.

    **Raises:** `ClearanceError` for what is missing, and for numbers that make no joint.
    """
    check_sizes(side_clearance=side_clearance, length=length, height=height, width=width, guide_length=guide_length)
    if side_clearance is None or length is None:
        raise ClearanceError("The play of a block needs its `side_clearance` and its `length`. Give both.")
    height = length if height is None else height
    if normal is None:
        breadth = height if width is None else width
        normal = flat_contact(length, breadth, 2 if width is None else 4)
    return GuideClearance(side_clearance, length, height, normal, friction, width, guide_length=guide_length)


def required(kind: type[AbstractClearance]) -> list[str]:
    """The names of the sizes that a kind of joint does not go without."""
    sizes = kind.sizes()
    return [f.name for f in dataclasses.fields(kind) if f.name in sizes and f.default is dataclasses.MISSING]


def clearance_of_kind(
    *,
    kind: type[AbstractClearance],
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
    **sizes: Any,
) -> AbstractClearance:
    """The play of a joint of a `kind` of one's own, from its `sizes` [m]; `normal` law by default as of `socket`, for
    the first of its sizes that is play; `friction`: by default none.

    **Raises:** `ClearanceError` for what is missing, and for numbers that make no joint.
    """
    check_sizes(**sizes)
    missing = [f"`{name}`" for name in required(kind) if name not in sizes]
    if missing:
        raise ClearanceError(f"The play of a {kind.__name__} needs its {', '.join(missing)}. Give all of them.")
    play = next(sizes[name] for name, is_play in kind.sizes().items() if is_play and name in sizes)
    make: Any = kind
    return make(**sizes, normal=round_contact(play) if normal is None else normal, friction=friction)


class PlayNumbers(TypedDict, total=False):
    """The numbers of a design that make a clearance; each kind of joint takes some of them (see its preset)."""

    kind: str | type[AbstractClearance]
    radial_clearance: Any
    axial_clearance: Any
    pin_radius: Any
    ball_radius: Any
    length: Any
    fit: str | Fitting
    temperature: Any
    side_clearance: Any
    height: Any
    width: Any
    guide_length: Any


class Preset(NamedTuple):
    """How to `make` a clearance from a designer's numbers: `fields`, the numbers that are fields of the clearance too,
    and `words`, the others (a fit, for example).
    """

    make: Callable[..., AbstractClearance]
    fields: tuple[str, ...]
    words: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[str, ...]:
        """The names of the numbers that it takes."""
        return self.fields + self.words

    def with_sizes(self, kind: type[AbstractClearance]) -> "Preset":
        """The same with all sizes of a kind of joint."""
        return self._replace(fields=(*self.fields, *(name for name in kind.sizes() if name not in self.fields)))

    def instead(self, name: str) -> str:
        """Advice for a number that it does not have."""
        new = next((new for old, new in RENAMED if old == name and new in self.fields), None)
        if new is None:
            return suggest(name, self.numbers)
        return f"It is called `{new}` now" + (", half of it." if name == "diameter" else ".")


RENAMED = (
    ("radial", "radial_clearance"),
    ("axial", "axial_clearance"),
    ("side", "side_clearance"),
    ("diameter", "pin_radius"),
    ("diameter", "ball_radius"),
)
"""Former names of numbers."""
FIT = ("fit", "temperature")
_ROUND = ("radial_clearance", "pin_radius", "length")
PIN = Preset(pin_clearance, (*_ROUND, "axial_clearance"), (*FIT, "kind"))
"""The clearance of a pin in a sleeve, for a revolute joint."""
SHAFT = Preset(shaft, _ROUND, FIT)
"""The clearance of a pin that slides in its sleeve, for a cylindrical joint."""
BALL = Preset(socket, tuple(SphericalClearance.sizes()))
"""The clearance of a ball in a socket, for a spherical joint."""
GUIDE = Preset(guide_clearance, tuple(GuideClearance.sizes()))
"""The clearance of a block in a guide, for a prismatic joint."""
OWN = Preset(clearance_of_kind, (), ("kind",))
"""The clearance of a kind of one's own, which adds its sizes, for any joint."""
