"""Drives, courses and targets: functions of time with two derivatives, and the instants at which one jumps."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from .quantities import number

Motion = Callable[[float], tuple[float, float, float]]


class Drive(NamedTuple):
    """Value, rate and second rate over the time, and where a derivative jumps."""

    at: Motion
    breaks: tuple[float, ...] = ()


def drive(table) -> Drive:
    """The drive of a scene's table."""
    return KINDS[table["type"]](table)


def _constant(table) -> Drive:
    value = number(table["value"])
    return Drive(lambda t: (value, 0.0, 0.0))


def _constant_speed(table) -> Drive:
    speed, start = number(table["speed"]), number(table.get("start", 0.0))
    return Drive(lambda t: (start + speed * t, speed, 0.0))


def _harmonic(table) -> Drive:
    a, w = number(table["amplitude"]), number(table["angular_frequency"])
    phase, offset = number(table.get("phase", 0.0)), number(table.get("offset", 0.0))

    def at(t):
        s, c = np.sin(w * t + phase), np.cos(w * t + phase)
        return offset + a * s, a * w * c, -a * w * w * s

    return Drive(at)


def _steps(polynomial: np.polynomial.Polynomial):
    """A sum of steps, each of the shape of a polynomial that goes from 0 to 1."""
    first, second = polynomial.deriv(), polynomial.deriv(2)

    def of(table) -> Drive:
        begins, ends, rises = ([number(x) for x in table[key]] for key in ("begin", "end", "rise"))
        offset = number(table.get("offset", 0.0))

        def at(t):
            out = np.array([offset, 0.0, 0.0])
            for begin, end, rise in zip(begins, ends, rises, strict=True):
                length = end - begin
                s = (t - begin) / length
                if s >= 1:
                    out[0] += rise
                elif s > 0:
                    out += rise * np.array([polynomial(s), first(s) / length, second(s) / length**2])
            return tuple(out)

        return Drive(at, (*begins, *ends))

    return of


def _spline(table) -> Drive:
    times = np.array([number(x) for x in table["times"]])
    spline = CubicSpline(times, [number(x) for x in table["values"]], bc_type=table.get("ends", "not-a-knot"))
    first, second = spline.derivative(), spline.derivative(2)
    return Drive(lambda t: (float(spline(t)), float(first(t)), float(second(t))), tuple(times[1:-1]))


def _trapezoid(table) -> Drive:
    """Of moves by `duration`: the speed grows evenly, stays constant for the share `cruise`, and falls evenly."""
    moves = list(zip(*([number(x) for x in table[key]] for key in ("begin", "duration", "rise")), strict=True))
    cruise, offset = float(table.get("cruise", 1 / 3)), number(table.get("offset", 0.0))
    breaks = []
    for begin, duration, _ in moves:
        ramp = 0.5 * (1 - cruise) * duration
        breaks += [begin, begin + ramp, begin + duration - ramp, begin + duration]

    def at(t):
        value, rate, second = offset, 0.0, 0.0
        for begin, duration, rise in moves:
            ramp = 0.5 * (1 - cruise) * duration
            top = rise / (duration - ramp)
            s = t - begin
            if s >= duration:
                value += rise
            elif s >= 0:  # where a rate jumps, it is the later one
                grown, kept = min(s, ramp), min(max(s - ramp, 0.0), duration - 2 * ramp)
                left = max(s - (duration - ramp), 0.0)
                value += top * (0.5 * grown**2 / ramp + kept + left - 0.5 * left**2 / ramp)
                rate += top * (grown - left) / ramp
                second += top / ramp * (float(s < ramp) - float(s >= duration - ramp))
        return value, rate, second

    return Drive(at, tuple(breaks))


KINDS: dict[str, Callable[[dict], Drive]] = {
    "constant": _constant,
    "constant-speed": _constant_speed,
    "harmonic": _harmonic,
    "step": _steps(np.polynomial.Polynomial([0, 0, 3, -2])),
    "step5": _steps(np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])),
    "spline": _spline,
    "trapezoid": _trapezoid,
}
