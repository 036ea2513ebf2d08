"""Normal laws by the formulas of `docs/laws.md`, for the contact points of one joint (an array of each quantity).

A law has its force before it is cut off at zero, its elastic energy, and the rate of its memory. `speed` is the impact
speed, which a restitution law keeps from the last touch. The penetration may be a little below zero, where a step of
the integrator overshoots the end of a contact.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from . import kernels
from .quantities import Vector, number


class Geometry(NamedTuple):
    """What a law may know of its joint: clearance, radii of pin and sleeve, length [m]."""

    clearance: float
    pin_radius: float = np.nan
    sleeve_radius: float = np.nan
    length: float = np.nan


def _none(depth, memory, presses):
    return np.zeros_like(memory)


def _at_the_point(depth):
    return np.zeros_like(depth)


class Normal(NamedTuple):
    """A normal law.

    - `force`: of penetration, its rate, memory and impact speed, before it is cut off.
    - `energy`: elastic energy of a penetration. `clipped`: whether the force never pulls.
    - `least_speed`: the least impact speed. `memories`: 1 if it has memory, with the rate `flows`, also while apart, of
      penetration, memory and whether it presses.
    - `lever`: of a penetration, by how much further from the pin's axis than the contact point friction acts.
    """

    force: Callable[[Vector, Vector, Vector, Vector], Vector]
    energy: Callable[[Vector], Vector]
    clipped: bool = True
    least_speed: float = 1.0
    memories: int = 0
    flows: Callable[[Vector, Vector, Vector], Vector] = _none
    lever: Callable[[Vector], Vector] = _at_the_point


def power(depth, exponent):
    """d^n, and what is smooth below zero."""
    return depth * np.abs(depth) ** (exponent - 1)


def _elastic(stiffness, exponent):
    return lambda d: stiffness * np.abs(d) ** (exponent + 1) / (exponent + 1)


def _stiffness(table, geometry) -> float:
    given = table["stiffness"]
    if not isinstance(given, dict):
        return number(given)
    pin, sleeve = geometry.pin_radius, geometry.sleeve_radius
    if "reference_clearance" in given:
        sleeve = pin + number(given["reference_clearance"])
    return 4 / 3 * contact_modulus(given) * np.sqrt(sleeve * pin / (sleeve - pin))


def contact_modulus(table) -> float:
    """E* of pin and sleeve."""
    soft = [
        (1 - float(table.get(f"{part}_poisson", 0.3)) ** 2) / number(table[f"{part}_modulus"])
        for part in ("pin", "sleeve")
    ]
    return 1 / sum(soft)


def normal_law(table: dict, geometry: Geometry) -> Normal:
    """The law of a scene's table."""
    name = table["law"]
    if name in RATIOS:
        return _restitution(table, geometry, RATIOS[name](float(table["restitution"])))
    return (LINES.get(name) or OTHERS[name])(table, geometry)


# Laws of a power of the penetration ---------------------------------------------------------------------------------


def _exact(e: float) -> float:
    """The root of a (1 + e) = ln((1 + a) / (1 - a e)) beside a = 0."""

    def miss(a):
        return a * (1 + e) - np.log1p(a) + np.log1p(-a * e)

    return root_scalar(miss, bracket=(1e-9, (1 - 1e-15) / e), xtol=1e-15).root


RATIOS: dict[str, Callable[[float], float]] = {
    "exact-restitution": _exact,
    "lankarani-nikravesh": lambda e: 3 * (1 - e * e) / 4,
    "flores": lambda e: 8 * (1 - e) / (5 * e),
    "hunt-crossley-1975": lambda e: 3 * (1 - e) / 2,
    "herbert-mcwhannell": lambda e: 6 * (1 - e) / ((2 * e - 1) ** 2 + 3),
    "lee-wang": lambda e: 3 * (1 - e) / 4,
    "gonthier": lambda e: (1 - e * e) / e,
    "zhiying-qishao": lambda e: 3 * (1 - e * e) * np.exp(2 * (1 - e)) / 4,
    "hu-guo": lambda e: 3 * (1 - e) / (2 * e),
    "gharib-hurmuzlu": lambda e: 1 / e,
}


def _damped(force, energy, ratio, table) -> Normal:
    """F (1 + a d'/v0)."""

    def damped(d, rate, memory, speed):
        return force(d) * (1 + ratio * rate / speed)

    return Normal(damped, energy, least_speed=number(table.get("minimum_impact_speed", 1e-3)))


def _restitution(table, geometry, ratio) -> Normal:
    k, n = _stiffness(table, geometry), float(table.get("exponent", 1.5))
    return _damped(lambda d: k * power(d, n), _elastic(k, n), ratio, table)


def _hertz(table, geometry) -> Normal:
    k, n = _stiffness(table, geometry), float(table.get("exponent", 1.5))
    return Normal(lambda d, rate, memory, speed: k * power(d, n), _elastic(k, n), clipped=False)


def _hunt_crossley(table, geometry) -> Normal:
    k, n = _stiffness(table, geometry), float(table.get("exponent", 1.5))
    factor = number(table["damping_factor"])
    return Normal(lambda d, rate, memory, speed: k * power(d, n) * (1 + factor * rate), _elastic(k, n))


def _adams(table, geometry) -> Normal:
    k, n = _stiffness(table, geometry), float(table.get("exponent", 1.5))
    most, depth = number(table["damping"]), number(table["full_damping_depth"])

    def force(d, rate, memory, speed):
        s = np.clip(d / depth, 0, 1)
        return k * power(d, n) + most * s * s * (3 - 2 * s) * rate

    return Normal(force, _elastic(k, n))


def _kelvin_voigt(table, geometry) -> Normal:
    k, b = number(table["stiffness"]), number(table["damping"])
    return Normal(lambda d, rate, memory, speed: k * d + b * rate, _elastic(k, 1.0), table.get("clipped", True))


def _beta(e):
    return -np.log(e) / np.sqrt(np.pi**2 + np.log(e) ** 2)


def _tsuji(table, geometry) -> Normal:
    k = _stiffness(table, geometry)
    b = np.sqrt(5) * _beta(float(table["restitution"])) * np.sqrt(number(table["effective_mass"]) * k)

    def force(d, rate, memory, speed):
        return k * power(d, 1.5) + b * np.abs(d) ** 0.25 * rate

    return Normal(force, _elastic(k, 1.5), table.get("clipped", False))


def _anagnostopoulos(table, geometry) -> Normal:
    k = number(table["stiffness"])
    b = 2 * _beta(float(table["restitution"])) * np.sqrt(number(table["effective_mass"]) * k)
    return Normal(lambda d, rate, memory, speed: k * d + b * rate, _elastic(k, 1.0), table.get("clipped", False))


def _standard_linear_solid(table, geometry) -> Normal:
    k, n = _stiffness(table, geometry), float(table.get("exponent", 1.0))
    g, time = float(table["relaxing_share"]), number(table["relaxation_time"])

    def force(d, rate, memory, speed):
        return k * (power(d, n) - g * memory)

    # The wall follows the pin, or recovers free of force where the pin is apart or faster. Which of both it does
    # changes with the regime: a kink within a step that is cut there would spoil what comes before it too.
    def flows(d, memory, presses):
        return (np.where(presses, power(d, n), g * memory) - memory) / time

    return Normal(force, lambda d: (1 - g) * _elastic(k, n)(np.maximum(d, 0.0)), memories=1, flows=flows)


OTHERS: dict[str, Callable[[dict, Geometry], Normal]] = {
    "hertz": _hertz,
    "hunt-crossley": _hunt_crossley,
    "adams-impact": _adams,
    "kelvin-voigt": _kelvin_voigt,
    "tsuji": _tsuji,
    "anagnostopoulos": _anagnostopoulos,
    "standard-linear-solid": _standard_linear_solid,
}


# Contact along a line ------------------------------------------------------------------------------------------------


def _ratio(table) -> float:
    return _exact(float(table["restitution"])) if "restitution" in table else 0.0


def _of_hertz(force, table, geometry):
    """The lever of Hertz's patch: r (kappa - 1), from the elastic force."""
    size = 4 / (np.pi * contact_modulus(table) * geometry.clearance * geometry.length)

    def lever(d):
        x = np.minimum(size * force(np.maximum(d, 0.0)), np.pi**2 / 4)
        return geometry.pin_radius * (1 / (1 - x / 8 + x**2 / 192 - x**3 / 9216 + x**4 / 737280) - 1)

    return lever


def _logarithmic(offset):
    """D = F'/(pi E*) (ln(4 pi E* c / F') + B); F by Newton's method."""

    def of(table, geometry) -> Normal:
        modulus, length, c = np.pi * contact_modulus(table), geometry.length, geometry.clearance
        last = 1.5 * np.exp(-0.5) * 4 * c * np.exp(offset - 1)

        def line(d):
            return kernels.line_force(d, modulus, c, offset)

        def stored(d):
            f = line(d)
            whole = f * f / (2 * modulus) * (np.log(4 * modulus * c / f) + offset) + f * f / (4 * modulus)
            return f * d - whole

        end = line(np.array([last]))[0]
        steep = modulus / (np.log(4 * modulus * c / end) + offset - 1)
        base = stored(np.array([last]))[0]

        def force(d):
            d = np.asarray(d, float)
            beyond = np.maximum(d - last, 0.0)
            inside = np.clip(d, 1e-200, last)
            return length * np.where(d > 0, line(inside) + steep * beyond, 0.0)

        def energy(d):
            beyond = np.maximum(d - last, 0.0)
            inside = np.where(d > last, base, stored(np.clip(d, 1e-200, last)))
            return length * np.where(d > 0, inside + end * beyond + 0.5 * steep * beyond**2, 0.0)

        return _damped(force, energy, _ratio(table), table)._replace(lever=_of_hertz(force, table, geometry))

    return of


def _liu(table, geometry) -> Normal:
    modulus, c = contact_modulus(table) * geometry.length * np.pi / 2, geometry.clearance

    def force(d):
        return modulus * d * np.sqrt(np.abs(d) / (2 * (c + d)))

    def energy(d):
        nodes, weights = np.polynomial.legendre.leggauss(24)
        # In the root of d the integrand is smooth: dd = 2 r dr.
        r = np.sqrt(np.maximum(d, 0.0))[..., None] * 0.5 * (nodes + 1)
        return 0.5 * np.sqrt(np.maximum(d, 0.0)) * (weights * 2 * r * force(r * r)).sum(-1)

    return _damped(force, energy, _ratio(table), table)._replace(lever=_of_hertz(force, table, geometry))


def _winkler(table, geometry) -> Normal:
    k, c = number(table["stiffness"]) * geometry.length * geometry.sleeve_radius, geometry.clearance

    def force(d):
        e = c + np.maximum(d, 0.0)
        angle = np.arccos(np.minimum(c / e, 1.0))
        return k * e * (angle - np.sin(angle) * np.cos(angle))

    def energy(d):
        e = c + np.maximum(d, 0.0)
        angle, root = np.arccos(np.minimum(c / e, 1.0)), np.sqrt(e * e - c * c)
        return k * (0.5 * e * e * angle + c * c * angle - 1.5 * c * root)

    # Each piece of the layer rubs on the pin's surface; the contact point lies on the sleeve's, d deeper.
    def lever(d):
        d = np.maximum(d, 0.0)
        angle = np.arccos(c / (c + d))
        wide = np.maximum(angle, 3e-3)
        kappa = 2 * (np.sin(wide) - wide * np.cos(wide)) / (wide - np.sin(wide) * np.cos(wide))
        return geometry.pin_radius * (np.where(angle < 3e-3, 1 + angle**2 / 10, kappa) - 1) + d

    return _damped(force, energy, _ratio(table), table)._replace(lever=lever)


LINES: dict[str, Callable[[dict, Geometry], Normal]] = {
    "johnson": _logarithmic(-1.0),
    "radzimovsky": _logarithmic(2 / 3 - np.log(4)),
    "esdu-78035": _logarithmic(1.0),
    "liu": _liu,
    "winkler": _winkler,
}
