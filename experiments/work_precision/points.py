"""What is measured of a tool: its runs, their times, and the least time with which it reaches an error."""

import contextlib
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

BOUNDS = (1e-4, 1e-6, 1e-9)
"""Errors of positions at which tools are compared."""
SLOPE_BOUND = 1e-4
LONG = 3.0
"""Seconds of a solve after which no tighter tolerance of the tool is tried."""


class GaveUp(Exception):
    """A tool stopped before the end, or took too long."""


class Run(NamedTuple):
    """What a tool gives at one tolerance: states at the samples (samples, n), evaluations of the right-hand side (-1:
    it does not say), the shortest of several wall times [s]; where it gives a derivative of the last states by the
    clearance, that (n,), and the time of the solve that has it.
    """

    y: np.ndarray
    evaluations: int
    seconds: float
    slope: np.ndarray | None = None
    slope_seconds: float = np.nan


class Point(NamedTuple):
    """A run of a tool on a scene: relative errors of the worst position, the worst state, the peak force and the
    derivative (NaN: not given, or the tool gave up), evaluations and times [s].
    """

    scene: str
    tool: str
    rtol: float
    position: float
    state: float
    force: float
    slope: float
    evaluations: int
    seconds: float
    slope_seconds: float


def best(solve: Callable[[], Any], repeats: int = 5) -> tuple[Any, float]:
    """The result of a solve, and the shortest wall time of several [s]; of a long one, of one."""
    times: list[float] = []
    found = None
    while not times or (len(times) <= repeats and sum(times) < 0.3 * LONG):
        clock = time.perf_counter()
        found = solve()
        times.append(time.perf_counter() - clock)
    return found, min(times)


def judged(case: Any, tool: str, rtol: float, run: Run | None) -> Point:
    """A run as a point; `None`: the tool gave up."""
    if run is None or not np.all(np.isfinite(run.y)):
        return Point(case.scene.name, tool, rtol, *[np.nan] * 4, -1, np.nan, np.nan)
    errors = case.state_errors(run.y)
    force = abs(case.force(run.y) / case.peak - 1)
    slope = np.nan if run.slope is None else case.slope_error(run.slope)
    worst = float(errors[case.positions].max()), float(errors.max())
    return Point(case.scene.name, tool, rtol, *worst, force, slope, run.evaluations, run.seconds, run.slope_seconds)


def ladder(case: Any, tool: str, solve: Callable[[float], Run], rtols: Iterable[float]) -> list[Point]:
    """A tool at one tolerance after the other, from loose to tight, until it takes long or gives up."""
    points, rtols = [], tuple(rtols)
    with contextlib.suppress(GaveUp):
        solve(rtols[0])  # a first call compiles, or imports
    for rtol in rtols:
        clock = time.perf_counter()
        try:
            run = solve(rtol)
        except GaveUp:
            run = None
        points.append(judged(case, tool, rtol, run))
        if (time.perf_counter() - clock if run is None else run.seconds) > LONG:
            break
    return points


def cheapest(points: Iterable[Point], bound: float, error: str = "position", spent: str = "seconds") -> Point | None:
    """Of one tool's runs on one scene the fastest whose error is within `bound`, at that and every tighter tolerance
    measured; `None`: there is none.
    """
    good = []
    for point in sorted(points, key=lambda p: p.rtol):
        if not getattr(point, error) <= bound:
            if np.isfinite(point.seconds):
                break
            continue
        good.append(point)
    return min(good, key=lambda p: getattr(p, spent), default=None)


def of(points: Iterable[Point], scene: str, tool: str) -> list[Point]:
    """The runs of one tool on one scene."""
    return [p for p in points if p.scene == scene and p.tool == tool]
