"""The elastic relations of a pin along a line of its sleeve: force per length over penetration.

A `Relation` has three functions of a `ContactLine`; force and work are also functions of the penetration d (and finite
for d < 0, where they are not used). Forces are divided by E* and the length [m], and so is the work, the integral of
the force over d [m^2].
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.numerics import lesser, positive_part, positive_power, power_three_halves, safe_sqrt, within
from clearance_jax._basis.roots import newton
from clearance_jax._basis.types import Scalar

_NODES, _WEIGHTS = (0.5 * np.asarray(x) for x in np.polynomial.legendre.leggauss(20))
_NODES = _NODES + 0.5


class ContactLine(NamedTuple):
    """Radial clearance c, radii of pin and sleeve, length of the contact [m], and the modulus E* [Pa]."""

    clearance: Scalar
    pin_radius: Scalar
    sleeve_radius: Scalar
    length: Scalar
    modulus: Scalar


class Relation(NamedTuple):
    """F'/E* [m] as `force(line, d)`, its integral `work(line, d)` [m^2], the penetration `limit(line)` [m] up to which
    it holds; the `reason` says what ends there; `bends`: whether another formula continues it beyond;
    `comparison`: whether it serves for comparison only, and holds nowhere.
    """

    force: Callable[[ContactLine, Scalar], Scalar]
    work: Callable[[ContactLine, Scalar], Scalar]
    limit: Callable[[ContactLine], Scalar]
    reason: str
    bends: bool = False
    comparison: bool = False


# Relations with a logarithm: d/(4 c) = x (C - ln x), x = F'/(4 pi E* c) ----------------------------------------------

# They turn back where w = C - ln x falls to 1. At w = 1.5, 0.91 of that depth, they continue along their tangent.
STEEPEST = 1.5
NEWTON = 4


def _start(q):
    """The root w of w - ln w = q > 1, to 2 %: by the expansion about w = 1, or by the first iterations from above."""
    near = 1 + jnp.sqrt(2 * (q - 1)) + 2 / 3 * (q - 1)
    return jnp.where(q < 3, near, q + jnp.log(q + jnp.log(q)))


def _logarithmic(constant: Callable[[ContactLine], Scalar]) -> Relation:
    """The relation of a constant C."""

    def limit(line):
        return 4 * line.clearance * STEEPEST * jnp.exp(constant(line) - STEEPEST)

    def split(line, penetration):
        end = limit(line)
        inside = within(penetration, 1e-30, end)
        # w > 1 with w exp(-w) = exp(-q) < 1/e.
        q = -jnp.log(inside / (4 * line.clearance) * jnp.exp(-constant(line)))
        w = newton(lambda w, q: w * (q - 1 + jnp.log(w)) / (w - 1), _start(q), NEWTON, q, unrolled=True)
        return inside, w, positive_part(penetration - end)

    def force(line, penetration):
        inside, w, beyond = split(line, penetration)
        return jnp.pi * (inside / w + beyond / (STEEPEST - 1))

    def work(line, penetration):
        inside, w, beyond = split(line, penetration)
        further = beyond * (limit(line) / STEEPEST + 0.5 * beyond / (STEEPEST - 1))
        return jnp.pi * ((inside / w) ** 2 * (w / 2 - 0.25) + further)

    return Relation(force, work, limit, "its logarithm turns back soon after", True)


JOHNSON = _logarithmic(lambda line: jnp.asarray(-1.0))
RADZIMOVSKY = _logarithmic(lambda line: jnp.asarray(2 / 3 - np.log(4.0)))
ESDU = _logarithmic(lambda line: jnp.asarray(1.0))


def _with_length(power: int) -> Relation:
    """The relation d = F'/(pi E*) (1 + ln(pi E* L^(m-1) c / (F' R_i R_j))) with the `power` m and lengths in mm (which
    has no effect for m = 3).
    """

    def constant(line):
        size = (1e3 * line.length) ** (power - 3) * line.length**2
        return 1 + jnp.log(size / (4 * line.pin_radius * line.sleeve_radius))

    return _logarithmic(constant)


GOLDSMITH = _with_length(1)._replace(
    comparison=True, reason="it is for comparison only, its force depends on the unit of length (mm)"
)
DUBOWSKY_FREUDENSTEIN = _with_length(3)._replace(
    comparison=True, reason="it is for comparison only, its logarithm has the length of the line in it"
)

# Relations in closed form --------------------------------------------------------------------------------------------


def work_of(force: Callable[[ContactLine, Scalar], Scalar]) -> Callable[[ContactLine, Scalar], Scalar]:
    """The integral of a force that is smooth in the penetration's root, by Gauss and Legendre over the root."""

    def work(line, penetration):
        depth = positive_part(penetration)
        each = jax.vmap(lambda s: force(line, s * s * depth) * s)(jnp.asarray(_NODES))
        return 2 * depth * jnp.dot(jnp.asarray(_WEIGHTS), each)

    return work


def _liu(line, penetration):
    depth = positive_part(penetration)
    return 0.5 * jnp.pi * power_three_halves(depth) / jnp.sqrt(2 * (line.clearance + depth))


def _bai_zhao(line, penetration):
    c, depth = line.clearance, positive_part(penetration)
    root = safe_sqrt(2 * depth) / jnp.sqrt(c + depth)
    return jnp.pi / 8 * root * (3 * c + 2 * depth) / (c + depth) * depth


def _endless(line):
    return jnp.full_like(line.clearance, jnp.inf)


LIU = Relation(_liu, work_of(_liu), _endless, "")
BAI_ZHAO = Relation(_bai_zhao, work_of(_bai_zhao), _endless, "")


def _pereira_numbers(line):
    """K / (E* L) and n of F = K d^n, with lengths in mm."""
    c = 1e3 * line.clearance
    middle = 0.34954
    small = 1.51 * jnp.log(1e3 * within(c, 0.005, middle)) ** -0.151
    exponent = jnp.where(c < middle, small, 0.0151 * c + 1.151) * c**-0.005
    return (0.965 * c + 0.0965) / c, exponent


def _pereira(line, penetration):
    factor, exponent = _pereira_numbers(line)
    return 1e-3 * factor * positive_power(1e3 * penetration, exponent)


def _pereira_work(line, penetration):
    _, exponent = _pereira_numbers(line)
    return positive_part(penetration) * _pereira(line, penetration) / (exponent + 1)


PEREIRA = Relation(
    _pereira,
    _pereira_work,
    lambda line: jnp.where((line.clearance >= 5e-6) & (line.clearance <= 1e-2), jnp.inf, 0.0),
    "it was fitted to radial clearances from 5 um to 10 mm",
)


WIDEST = np.pi / 2


def ellipse_spread(line: ContactLine, force: Scalar) -> Scalar:
    """How much larger the sum of the pressures is than the force, the sum of their components along it, for a `force`
    F'/E* [m]. Hertz's elliptic pressures over the half angle t, t^2 = 4 F' / (pi E* c), give t / (2 J_1(t)), here by
    its series. From t = 90 deg on the ratio stays constant.
    """
    square = lesser(4 / np.pi * force / line.clearance, WIDEST**2)
    return 1 / (1 - square * (1 / 8 - square * (1 / 192 - square * (1 / 9216 - square * (1 / 737280)))))


# An elastic foundation ---------------------------------------------------------------------------------------------


# A half angle [rad] below which differences are series.
NARROW = 0.2


def _excess(x: Scalar) -> Scalar:
    """`x - sin(x)` for x >= 0, by its series where the difference would lose digits."""
    small = jnp.where(x < 1, x, 1.0)
    square, series = small * small, jnp.ones_like(x)
    for k in range(17, 3, -2):
        series = 1 - square / (k * (k - 1)) * series
    return jnp.where(x < 1, small * square / 6 * series, x - jnp.sin(x))


def _half_angle(line: ContactLine, penetration: Scalar) -> Scalar:
    """The angle t to either side up to which a layer is pressed [rad]: cos t = c / (c + d)."""
    depth = positive_part(penetration)
    return 2 * jnp.arcsin(safe_sqrt(0.5 * depth / (line.clearance + depth)))


def foundation(line: ContactLine, penetration: Scalar) -> Scalar:
    """(c + d) (t - sin t cos t) [m], t of `_half_angle`: the integral of the layer's depth times the angle's cosine."""
    reach = line.clearance + positive_part(penetration)
    return 0.5 * reach * _excess(2 * _half_angle(line, penetration))


def foundation_spread(line: ContactLine, penetration: Scalar) -> Scalar:
    """As `ellipse_spread` for a layer: 2 (sin t - t cos t) / (t - sin t cos t), with t of `_half_angle`."""
    angle = _half_angle(line, penetration)
    narrow = angle < NARROW
    square = jnp.where(narrow, angle * angle, 0.0)
    # The series of numerator and denominator in t^2, each divided by t^3.
    above = 2 / 3 - square * (1 / 15 - square * (1 / 420 - square * (1 / 22680 - square / 1995840)))
    below = 2 / 3 - square * (2 / 15 - square * (4 / 315 - square * (2 / 2835 - square * (4 / 155925))))
    wide = jnp.where(narrow, 1.0, angle)
    whole = 2 * (jnp.sin(wide) - wide * jnp.cos(wide)) / (0.5 * _excess(2 * wide))
    return jnp.where(narrow, above / below, whole)


foundation_work = work_of(foundation)
"""The integral of `foundation` over the penetration [m^2]."""
