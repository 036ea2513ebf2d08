"""The largest speed and acceleration of the named points over a whole motion: at a step end, or inside a step, where
the motion is integrated anew.

Samples miss them: an acceleration in an impact lasts microseconds.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.results import blocks
from clearance_jax.solve.trace import Trace

# Most steps that are evaluated inside, and places in each.
STEPS, PLACES = 64, 8
# Refinements around the largest value, each 4.5 times closer: a smooth maximum is then missed by 1e-7 of the change in
# its step.
CLOSER = 4

Look = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A function of steps (indices of their starts) and fractions of them (0 to 1): the quantity there."""


class Extreme(NamedTuple):
    """The largest value of a quantity, and when it is reached [s]."""

    value: float
    time: float


def of_points(mechanism: Mechanism, trace: Trace, seen: dict[str, np.ndarray], falls_over: float) -> dict[str, Any]:
    """Dataset variables: the largest speed and acceleration of every point, over the whole motion and, if pins fall at
    the start, after the first falls.

    **Arguments:** `seen`: `velocity` and `acceleration` at the step ends; `falls_over`: when the last first fall ends
    [s], minus infinity where no pin falls.
    """
    time, y = np.asarray(trace.time), np.asarray(trace.y)
    later = int(np.searchsorted(time, falls_over, side="right"))
    begins = [0, later] if 0 < later < time.size - 1 else [0]
    out: dict[str, Any] = {"after": time[begins]}
    for name, called in zip(blocks.OF_POINTS, ("speed", "acceleration"), strict=True):
        sizes, rows = np.linalg.norm(seen[name], axis=-1), []

        def look(step, s, name=name):
            return np.linalg.norm(blocks.inside_steps(mechanism, time, y, step, s)[name], axis=-1)

        for begin in begins:
            for point in range(sizes.shape[1]):
                rows.append(
                    largest(
                        time[begin:],
                        sizes[begin:, point],
                        lambda step, s, begin=begin, point=point, look=look: look(step + begin, s)[:, point],
                    )
                )
        shape = len(begins), sizes.shape[1]
        out[f"largest_{called}"] = np.array([row.value for row in rows]).reshape(shape)
        out[f"largest_{called}_time"] = np.array([row.time for row in rows]).reshape(shape)
    return out


def largest(time: np.ndarray, values: np.ndarray, look: Look) -> Extreme:
    """The largest value of a quantity.

    **Arguments:** `time` [s] and `values` at the step ends; `look`: what looks into steps.
    """
    steps = _candidates(values)
    places = np.arange(1, PLACES + 1) / PLACES
    step, place, value = _best(look, np.repeat(steps, PLACES), np.tile(places, steps.size))
    near = 1.0 / PLACES
    for _ in range(CLOSER):
        closer = np.clip(place + near * np.linspace(-1, 1, PLACES + 2)[1:-1], 0.0, 1.0)
        candidate = _best(look, np.full(PLACES, step), closer)
        near *= 2 / (PLACES + 1)
        if candidate[2] > value:
            step, place, value = candidate
    end = int(np.argmax(values))
    if values[end] >= value:
        return Extreme(float(values[end]), float(time[end]))
    return Extreme(float(value), float(time[step] + place * (time[step + 1] - time[step])))


def _candidates(values: np.ndarray) -> np.ndarray:
    """Steps inside which the quantity may exceed its largest value at a step end. The bound is the change in the step
    and its neighbours.
    """
    change = np.abs(np.diff(values))
    beside = np.maximum(change, np.maximum(np.append(change[1:], 0.0), np.append(0.0, change[:-1])))
    reach = np.maximum(values[:-1], values[1:]) + beside
    highest = np.argsort(-reach, kind="stable")[:STEPS]
    return highest[reach[highest] >= values.max()]


def _best(look: Look, steps: np.ndarray, places: np.ndarray) -> tuple[int, float, float]:
    """The step, the place in it and the value that are largest."""
    values = look(steps, places)
    k = int(np.argmax(values))
    return int(steps[k]), float(places[k]), float(values[k])
