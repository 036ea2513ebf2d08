"""Friction laws by the formulas of `docs/laws.md`: the traction over the normal force, for a slip of shape (points,
directions).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .quantities import Vector, dot, number


def _no_rates(slip, bend):
    return np.zeros_like(bend)


class Friction(NamedTuple):
    """A friction law: traction over normal force, of slip and deflection of the bristles; the rate of these; and
    whether it has any.
    """

    traction: Callable[[Vector, Vector], Vector]
    rates: Callable[[Vector, Vector], Vector] = _no_rates
    remembers: bool = False


def friction_law(table: dict) -> Friction:
    """The law of a scene's table."""
    law = table["law"]
    numbers = {key: number(value) for key, value in table.items() if key != "law"}
    if law in CURVES:
        return _along(CURVES[law](**numbers))
    return BRISTLES[law](**numbers)


def _along(curve) -> Friction:
    """-mu(|v|) v / |v|."""

    def traction(slip, bend):
        speed = np.sqrt(dot(slip, slip))[:, None]
        return np.where(speed > 0, -curve(speed) * slip / np.where(speed > 0, speed, 1.0), 0.0)

    return Friction(traction)


def _rise(x):
    """STEP from 0 to 1."""
    s = np.clip(x, 0, 1)
    return s * s * (3 - 2 * s)


def _cubic(coefficient, transition_speed):
    def curve(v):
        x = np.minimum(v / transition_speed, 1)
        return coefficient * (3 * x - x**3) / 2

    return curve


def _tanh(coefficient, transition_speed):
    return lambda v: coefficient * np.tanh(v / transition_speed)


def _brown_mcphee(static_coefficient, dynamic_coefficient, transition_speed):
    def curve(v):
        x = v / transition_speed
        peak = (static_coefficient - dynamic_coefficient) * x / (x * x / 4 + 3 / 4) ** 2
        return dynamic_coefficient * np.tanh(4 * x) + peak

    return curve


def _adams(static_coefficient, dynamic_coefficient, stiction_speed, transition_speed):
    def curve(v):
        inside = static_coefficient * (2 * _rise((v + stiction_speed) / (2 * stiction_speed)) - 1)
        fallen = _rise((v - stiction_speed) / (transition_speed - stiction_speed))
        return np.where(
            v < stiction_speed, inside, static_coefficient + (dynamic_coefficient - static_coefficient) * fallen
        )

    return curve


def _threlfall(coefficient, transition_speed):
    return lambda v: coefficient * (1 - np.exp(-3 * np.minimum(v / transition_speed, 1)))


def _ambrosio(coefficient, free_speed, transition_speed):
    return lambda v: coefficient * np.clip((v - free_speed) / (transition_speed - free_speed), 0, 1)


def _bengisu_akay(static_coefficient, dynamic_coefficient, transition_speed, decay_speed):
    def curve(v):
        rising = static_coefficient * (1 - (v / transition_speed - 1) ** 2)
        decay = np.exp(-np.maximum(v - transition_speed, 0.0) / decay_speed)
        falling = dynamic_coefficient + (static_coefficient - dynamic_coefficient) * decay
        return np.where(v <= transition_speed, rising, falling)

    return curve


def _stribeck(static_coefficient, dynamic_coefficient, stribeck_speed, transition_speed, shape=2.0, viscous=0.0):
    def curve(v):
        decay = np.exp(-((v / stribeck_speed) ** shape))
        level = dynamic_coefficient + (static_coefficient - dynamic_coefficient) * decay
        return level * np.tanh(v / transition_speed) + viscous * v

    return curve


CURVES = {
    "cubic": _cubic,
    "tanh": _tanh,
    "brown-mcphee": _brown_mcphee,
    "adams": _adams,
    "threlfall": _threlfall,
    "ambrosio": _ambrosio,
    "bengisu-akay": _bengisu_akay,
    "stribeck": _stribeck,
}


# Bristles. They are straight at a touch, and at rest while the surfaces are apart ------------------------------------


def _dahl(coefficient, bristle_stiffness):
    def rates(slip, bend):
        speed = np.sqrt(dot(slip, slip))[:, None]
        return slip - bristle_stiffness * speed * bend / coefficient

    return Friction(lambda slip, bend: -bristle_stiffness * bend, rates, True)


def _lugre(**given):
    def gives(slip, bend, curve):
        return given["bristle_stiffness"] * np.sqrt(dot(slip, slip))[:, None] / curve

    return _bent(gives, **given)


def _elasto_plastic(breakaway_share=0.5, **given):
    def gives(slip, bend, curve):
        size = np.sqrt(dot(bend, bend))[:, None]
        ratio = given["bristle_stiffness"] / curve
        s = np.clip((size * ratio - breakaway_share) / (1 - breakaway_share), 0, 1)
        forward = np.maximum(dot(slip, bend)[:, None] / np.where(size > 0, size, 1.0), 0.0)
        return s**3 * (10 - 15 * s + 6 * s * s) * ratio * forward

    return _bent(gives, **given)


def _bent(
    gives,
    static_coefficient,
    kinetic_coefficient,
    stribeck_speed,
    bristle_stiffness,
    bristle_damping=0.0,
    viscous=0.0,
):
    """LuGre's traction, with z' = v - `gives` z."""

    def rates(slip, bend):
        decay = np.exp(-dot(slip, slip)[:, None] / stribeck_speed**2)
        curve = kinetic_coefficient + (static_coefficient - kinetic_coefficient) * decay
        return slip - gives(slip, bend, curve) * bend

    def traction(slip, bend):
        return -(bristle_stiffness * bend + bristle_damping * rates(slip, bend) + viscous * slip)

    return Friction(traction, rates, True)


BRISTLES: dict[str, Callable[..., Friction]] = {"dahl": _dahl, "lugre": _lugre, "elasto-plastic": _elasto_plastic}
