"""Envelopes of curves with more points than a picture has columns, and smooth paths through few points."""

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

# Points drawn per interval of a flight. Places nearer in time than this part of the flight count as one.
FINE, NEAR = 12, 1e-3


def envelope(time: np.ndarray, values: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles of equal columns of time that hold values, with the least and the greatest value in each."""
    edges = np.linspace(time[0], time[-1], columns + 1)
    column = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, columns - 1)
    filled, first = np.unique(column, return_index=True)
    middles = 0.5 * (edges[:-1] + edges[1:])[filled]
    return middles, np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)


def flights(time: np.ndarray, places: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Every free flight as a smooth path from the contact that it leaves to the one that it meets, (points, 2), with a
    row of NaN after each.

    **Arguments:** increasing times (n,), places (n, 2), and whether each is free (n,).
    """
    edge = np.diff(np.concatenate([[0], free.astype(int), [0]]))
    paths = [np.zeros((0, 2))]
    for begin, end in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True):
        # With the last place in contact before it, and the first one after it.
        part = slice(max(begin - 1, 0), min(end + 1, len(time)))
        paths += [smooth(time[part], places[part]), np.full((1, 2), np.nan)]
    return np.concatenate(paths)


def smooth(time: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A smooth path through places (n, 2) of a flight: a spline, for without contact it has no corner."""
    apart = NEAR * (time[-1] - time[0])
    kept = [0]
    for i in range(1, len(time)):
        if time[i] - time[kept[-1]] > apart:
            kept.append(i)
    kept[-1] = len(time) - 1 if len(kept) > 1 else kept[-1]
    if len(kept) < 3:
        return places[kept]
    t = time[kept]
    fine = np.concatenate([np.linspace(a, b, FINE, endpoint=False) for a, b in pairwise(t)])
    return CubicSpline(t, places[kept])(np.append(fine, t[-1]))
