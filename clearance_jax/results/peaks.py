"""The largest contact force of every episode: at a step end, or inside a step, where the motion is integrated anew.

Force and force rate at the step ends tell which steps may hold the largest one; in these, and only these, the force is
asked for at a few places.
"""

from typing import NamedTuple

import numpy as np

from clearance_jax.results.episodes import Look, Members, Spans, StepEnds, members

# How far the cubic through a step's ends may miss the force's top inside it, over the rise to that top. With the
# longest steps of dopri8 at rtol 1e-6 it misses by a hundredth of the rise.
DOUBT = 0.2
# Places at which such a step is looked into. Each brings the largest force two to three digits closer (kinks of the
# force inside the step: one and a half); from the cubic's two digits four reach the accuracy of the solve.
PLACES = 4


class EpisodePeaks(NamedTuple):
    """Time [s] and height [N] of the largest force of every episode."""

    time: np.ndarray
    force: np.ndarray


class StepPoint(NamedTuple):
    """A place inside a step: how far into it (0 to 1), the force there [N], its slope per step."""

    place: np.ndarray
    force: np.ndarray
    slope: np.ndarray


def cubic_top(value0, slope0, value1, slope1) -> tuple[np.ndarray, np.ndarray]:
    """Place in [0, 1] and height of the top of the cubic through values and slopes; NaN where it does not rise at its
    start and fall at its end.
    """
    turns = (slope0 > 0) & (slope1 < 0)
    a, b, rise = np.where(turns, slope0, 1.0), np.where(turns, slope1, -1.0), np.where(turns, value1 - value0, 0.0)
    # p(x) = f0 + a x + square x^2 + cubic x^3; p' changes sign once, from a > 0 to b < 0.
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    x = a / (np.sqrt(square * square - 3 * cubic * a) - square)
    top = value0 + x * (a + x * (square + x * cubic))
    return np.where(turns, x, np.nan), np.where(turns, top, np.nan)


def peaks(seen: StepEnds, spans: Spans, look: Look) -> EpisodePeaks:
    """The largest force of every episode of one joint."""
    if spans.first.size == 0:
        return EpisodePeaks(np.zeros(0), np.zeros(0))
    row = members(spans)
    highest = _first_largest(seen.force[row.index], row)
    time, height = seen.time[row.index[highest]], seen.force[row.index[highest]]
    steps, span = candidates(seen, row, highest)
    place, top = inside(seen, steps, look)
    # In order of height, so that of several steps of one episode the highest is written last.
    order = np.argsort(top)
    order = order[top[order] > height[span[order]]]
    begin, end = seen.time[steps[order]], seen.time[steps[order] + 1]
    time[span[order]], height[span[order]] = begin + place[order] * (end - begin), top[order]
    return EpisodePeaks(time, height)


def candidates(seen: StepEnds, row: Members, highest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps that may hold an episode's largest force, and their episodes.

    **Arguments:** `highest`: of each episode the step end of largest force, by its place in the `row`.
    """
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
    """Place (0 to 1) and height of the largest force found inside each step.

    Each place asked for is the top of the cubic on what is left of the step around the top (its middle, where there is
    no such cubic), and becomes the left or right end of what is left.
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


def _first_largest(values: np.ndarray, row: Members) -> np.ndarray:
    """Of each span the place in the row of the first of its largest values."""
    largest = np.flatnonzero(values == np.maximum.reduceat(values, row.start)[row.span])
    return largest[np.unique(row.span[largest], return_index=True)[1]]
