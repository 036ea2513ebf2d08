"""The largest contact force of every episode, speed and acceleration of every point, inside steps too.

Samples miss them: an acceleration in an impact lasts microseconds. What is known at the step ends tells which steps may
hold the largest one; in these the motion is integrated anew, and looked at in a few places.
"""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.results import blocks
from clearance_jax.results.episodes import Look, Members, Spans, StepEnds, members
from clearance_jax.solve.drivers.trace import Trace

# Largest error of the cubic through a step's ends at the top of the force, as a part of the rise to that top. With the
# longest steps of dopri8 at rtol 1e-6 the error is a hundredth of the rise.
DOUBT = 0.2
# Evaluations of a force inside a step. Each makes the largest force more accurate by two to three digits (by one and a
# half if the force has kinks in the step). The cubic has two digits, so four evaluations reach the solve's accuracy.
PLACES = 4
# Of speeds and accelerations: most steps that are evaluated inside, and places in each.
STEPS, SPOTS = 64, 8
# Refinements around the largest value, each 4.5 times closer: a smooth maximum is then missed by 1e-7 of the change in
# its step.
CLOSER = 4

LookInto = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A function of steps (indices of their starts) and fractions of them (0 to 1): the quantity there."""


class Extreme(NamedTuple):
    """The largest value of a quantity, and when it is reached [s]; of several episodes arrays of both."""

    value: Any
    time: Any


class StepPoint(NamedTuple):
    """A place inside a step: how far into it (0 to 1), the force there [N], its slope per step."""

    place: np.ndarray
    force: np.ndarray
    slope: np.ndarray


def cubic_top(value0, slope0, value1, slope1) -> tuple[np.ndarray, np.ndarray]:
    """Place in [0, 1] and height of the top of a cubic by values and slopes; NaN without a rise, then a fall."""
    turns = (slope0 > 0) & (slope1 < 0)
    a, b, rise = np.where(turns, slope0, 1.0), np.where(turns, slope1, -1.0), np.where(turns, value1 - value0, 0.0)
    # p(x) = f0 + a x + square x^2 + cubic x^3; p' changes sign once, from a > 0 to b < 0.
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    x = a / (np.sqrt(square * square - 3 * cubic * a) - square)
    top = value0 + x * (a + x * (square + x * cubic))
    return np.where(turns, x, np.nan), np.where(turns, top, np.nan)


def peaks(seen: StepEnds, spans: Spans, look: Look) -> Extreme:
    """The largest force [N] of every episode of one joint."""
    if spans.first.size == 0:
        return Extreme(np.zeros(0), np.zeros(0))
    row = members(spans)
    forces = seen.force[row.index]
    highest = np.flatnonzero(forces == np.maximum.reduceat(forces, row.start)[row.span])
    highest = highest[np.unique(row.span[highest], return_index=True)[1]]  # of each span the first
    time, height = seen.time[row.index[highest]], seen.force[row.index[highest]]
    steps, span = candidates(seen, row, highest)
    place, top = inside(seen, steps, look)
    # In order of height, so that of several steps of one episode the highest is written last.
    order = np.argsort(top)
    order = order[top[order] > height[span[order]]]
    begin, end = seen.time[steps[order]], seen.time[steps[order] + 1]
    time[span[order]], height[span[order]] = begin + place[order] * (end - begin), top[order]
    return Extreme(height, time)


def candidates(seen: StepEnds, row: Members, highest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps that may hold an episode's largest force, and their episodes; `highest`: its largest step end in `row`."""
    index, span = row.index, row.span
    begin, end = index[:-1], index[1:]
    h = seen.time[end] - seen.time[begin]
    low = np.minimum(seen.force[begin], seen.force[end])
    _, top = cubic_top(seen.force[begin], seen.force_rate[begin] * h, seen.force[end], seen.force_rate[end] * h)
    top = np.where((span[1:] == span[:-1]) & ~np.isnan(top), top, -np.inf)
    best = np.maximum(seen.force[index[highest]], np.maximum.reduceat(np.append(top, -np.inf), row.start))
    possible = top + DOUBT * (top - low) >= best[span[:-1]]
    # Also the steps at both sides of the highest step end, whatever the force does at their other ends (and at a break
    # of a drive: there its rate is that after the break).
    beside = np.concatenate([highest - 1, highest])
    beside = beside[(beside >= 0) & (beside < begin.size)]
    possible[beside[span[beside] == span[beside + 1]]] = True
    chosen = np.flatnonzero(possible)
    return begin[chosen], span[chosen]


def inside(seen: StepEnds, steps: np.ndarray, look: Look) -> tuple[np.ndarray, np.ndarray]:
    """Place (0 to 1) and height of the largest force inside each step. The force is evaluated at the top of the cubic
    through the ends of an interval (in its middle if there is no top). Then that place is an end of the interval.
    """
    h = seen.time[steps + 1] - seen.time[steps]
    left = StepPoint(np.zeros(steps.size), seen.force[steps], seen.force_rate[steps] * h)
    right = StepPoint(np.ones(steps.size), seen.force[steps + 1], seen.force_rate[steps + 1] * h)
    place, top = left.place, np.full(steps.size, -np.inf)
    for _ in range(PLACES if steps.size else 0):
        width = right.place - left.place
        x, _ = cubic_top(left.force, left.slope * width, right.force, right.slope * width)
        s = left.place + np.where(np.isnan(x), 0.5, x) * width
        now = StepPoint(s, *look(steps, s)[:2])
        place, top = np.where(now.force > top, s, place), np.maximum(now.force, top)
        left, right = _choose(now.slope > 0, now, left), _choose(now.slope > 0, right, now)
    return place, top


def _choose(where: np.ndarray, a: StepPoint, b: StepPoint) -> StepPoint:
    return StepPoint(*(np.where(where, x, y) for x, y in zip(a, b, strict=True)))


def of_points(mechanism: Mechanism, trace: Trace, seen: dict[str, np.ndarray], falls_over: float) -> dict[str, Any]:
    """Variables: the largest speed and acceleration of every point, over the whole motion, and after first falls (the
    last ends at `falls_over` [s]; minus infinity: none); `seen`: `velocity` and `acceleration` at the step ends.
    """
    time, y = np.asarray(trace.time), np.asarray(trace.y)
    later = int(np.searchsorted(time, falls_over, side="right"))
    begins = [0, later] if 0 < later < time.size - 1 else [0]
    out: dict[str, Any] = {"after": time[begins]}
    for name, called in zip(blocks.OF_POINTS, ("speed", "acceleration"), strict=True):
        sizes, rows = np.linalg.norm(seen[name], axis=-1), []

        for begin, point in itertools.product(begins, range(sizes.shape[1])):

            def look(step, s, name=name, begin=begin, point=point):
                vectors = blocks.inside_steps(mechanism, time, y, step + begin, s)[name]
                return np.linalg.norm(vectors[:, point], axis=-1)

            rows.append(largest(time[begin:], sizes[begin:, point], look))
        shape = len(begins), sizes.shape[1]
        out[f"largest_{called}"] = np.array([row.value for row in rows]).reshape(shape)
        out[f"largest_{called}_time"] = np.array([row.time for row in rows]).reshape(shape)
    return out


def largest(time: np.ndarray, values: np.ndarray, look: LookInto) -> Extreme:
    """The largest value of a quantity, by times [s] and `values` at the step ends; `look`: what looks into steps."""
    steps = _candidates(values)
    places = np.arange(1, SPOTS + 1) / SPOTS
    step, place, value = _best(look, np.repeat(steps, SPOTS), np.tile(places, steps.size))
    near = 1.0 / SPOTS
    for _ in range(CLOSER):
        closer = np.clip(place + near * np.linspace(-1, 1, SPOTS + 2)[1:-1], 0.0, 1.0)
        candidate = _best(look, np.full(SPOTS, step), closer)
        near *= 2 / (SPOTS + 1)
        if candidate[2] > value:
            step, place, value = candidate
    end = int(np.argmax(values))
    if values[end] >= value:
        return Extreme(float(values[end]), float(time[end]))
    return Extreme(float(value), float(time[step] + place * (time[step + 1] - time[step])))


def _candidates(values: np.ndarray) -> np.ndarray:
    """Steps inside which the values at step ends may be exceeded, judged by the changes there and in steps beside."""
    change = np.abs(np.diff(values))
    beside = np.maximum(change, np.maximum(np.append(change[1:], 0.0), np.append(0.0, change[:-1])))
    reach = np.maximum(values[:-1], values[1:]) + beside
    highest = np.argsort(-reach, kind="stable")[:STEPS]
    return highest[reach[highest] >= values.max()]


def _best(look: LookInto, steps: np.ndarray, places: np.ndarray) -> tuple[int, float, float]:
    """The step, the place in it and the value that are largest."""
    values = look(steps, places)
    k = int(np.argmax(values))
    return int(steps[k]), float(places[k]), float(values[k])
