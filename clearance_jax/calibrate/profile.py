"""Confidence intervals by profile likelihood, if they are wider than those that the derivatives predict.

The end of such an interval is where the profile likelihood has fallen by as much as it would for a linear motion at the
end of the interval that the derivatives predict (Venzon and Moolgavkar 1988, doi 10.2307/2347496).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from clearance_jax.calibrate.confidence import Confidence
from clearance_jax.calibrate.fit import FitResult, FitTask
from clearance_jax.calibrate.readings import FitPoint

# Ratio of the rise of the cost to its prediction at the end of an interval: within the first factor the prediction is
# used, beyond the second a doubt is reported.
STRAIGHT, BENT = 1.25, 2.0
# The factor of each further trial, how far trials go at least (a rippled cost may fall again), how many there are at
# most, and how often the last step is halved.
FARTHER, WIDEST, TRIALS, HALVINGS = 1.5, 3.0, 12, 2
# Where another minimum is looked for, in predicted half intervals, and along how many of the least known numbers.
FAR, LOOKED = (3.0, 9.0, 27.0), 2
# The other numbers are corrected if that is predicted to gain this part of the rise, at most so often at one place.
WORTH, CORRECTIONS = 0.1, 4
# Singular values below this part of the largest one belong to undetermined directions.
UNTOLD = 1e-6
# A point is a better minimum if its cost is below that of the fit by this part of the wanted rise.
BETTER = 0.02


class Profile(NamedTuple):
    """The confidence with intervals of the motion itself, and a `better` point than the fit if one was met."""

    known: Confidence
    better: FitPoint | None


def profile(task: FitTask, fit: FitResult, known: Confidence) -> Profile:
    """Search for the ends of the intervals of the determined numbers, if the derivatives do not predict the motion."""
    walk, intervals, bent = _Walk(task, fit, known), known.intervals.copy(), []
    undetermined = {name for group in known.unidentified for name in group.names}
    determined = [k for k, name in enumerate(task.variables.names) if name not in undetermined]
    vague = sorted(determined, key=lambda k: known.deviations[k] / known.sizes[k])[-LOOKED:]
    for far, numbers in ((True, vague), (False, determined)):
        for k in numbers:
            for side, sign in enumerate((-1.0, 1.0)):
                end, straight = walk.look(k, sign, far)
                if walk.better:
                    return Profile(known, walk.lowest)
                intervals[k, side] = sign * max(sign * intervals[k, side], sign * end)
                bent += [] if straight else [task.variables.names[k]]
    lower, upper = task.variables.lower[:, None], task.variables.upper[:, None]
    return Profile(known._replace(intervals=np.clip(intervals, lower, upper), bent=tuple(dict.fromkeys(bent))), None)


class _Walk:
    """Evaluations along one number, with the others at their best fit."""

    def __init__(self, task: FitTask, fit: FitResult, known: Confidence):
        self.task, self.fit, self.known = task, fit, known
        self.cost = task.cost(fit.point, fit.deviations)
        self.here = task.weigh(fit.point, fit.deviations)
        self.lowest, self.lowest_rise, self.better = fit.point, 0.0, False

    def look(self, k: int, sign: float, far: bool) -> tuple[float, bool]:
        """The end of the interval of number `k` to one side, and whether the derivatives predict it. With `far` it
        looks for another minimum far away.
        """
        task, known, x = self.task, self.known, self.fit.point.x
        way = sign * known.factor * known.deviations[k] * self.others_follow(k)
        wanted = task.loss.cost(self.here.residuals + self.here.jacobian @ way) - self.cost
        bound = task.variables.upper[k] if sign > 0 else task.variables.lower[k]
        most = (bound - x[k]) / way[k]
        if most <= 0 or not wanted > 0:
            return x[k], True
        rises: dict[float, float] = {}
        for part in (part for part in FAR if part < most) if far else _parts(most, wanted, rises):
            rises[part] = self.rise(k, x + part * way, wanted)
            if rises[part] < -BETTER * wanted:
                self.better = True
                break
            if not far and len(rises) == 1 and 1 / STRAIGHT <= rises[part] / (wanted * part**2) <= STRAIGHT:
                break
        within = [part for part, rise in rises.items() if rise <= wanted]
        end, first = max([min(1.0, most), *within]), next(iter(rises.items()), (1.0, wanted))
        straight = 1 / BENT <= first[1] / (wanted * first[0] ** 2) <= BENT
        return float(x[k] + end * way[k]), bool(not within if far else straight and end <= BENT)

    def others_follow(self, k: int) -> np.ndarray:
        """The change of all numbers per unit of number `k`, with the others at their best fit for a linear motion,
        without changes along undetermined directions, which would end at a bound.
        """
        sizes, way = self.known.sizes, np.ones(len(self.known.sizes))
        others = np.arange(len(sizes)) != k
        scaled = self.here.jacobian[:, others] * sizes[others]
        way[others] = -sizes[others] * np.linalg.lstsq(scaled, self.here.jacobian[:, k], rcond=UNTOLD)[0]
        return way

    def rise(self, k: int, place: np.ndarray, wanted: float) -> float:
        """The rise of the cost over that of the fit with number `k` fixed, the others corrected while that helps."""
        task, variables, others = self.task, self.task.variables, np.arange(len(place)) != k
        rise, point = self.seen(np.clip(place, variables.lower, variables.upper))
        scale = self.known.deviations[others]
        for _ in range(CORRECTIONS if len(place) > 1 and point.reached else 0):
            at = task.weigh(point, self.fit.deviations)
            # Residuals are weighted by the loss.
            psi, slope = task.loss.influence(at.residuals)
            root, step = np.sqrt(np.maximum(slope, 0.1)), np.zeros(len(place))
            step[others] = -scale * np.linalg.lstsq(root[:, None] * at.jacobian[:, others] * scale, psi / root)[0]
            gain = task.loss.cost(at.residuals) - task.loss.cost(at.residuals + at.jacobian @ step)
            if gain < WORTH * max(rise, wanted):
                break
            now, point = self.seen(np.clip(point.x + step, variables.lower, variables.upper))
            if now >= rise:
                break
            rise = now
        return rise

    def seen(self, place: np.ndarray) -> tuple[float, FitPoint]:
        """The rise of the cost at a place, and its point; the lowest of all is kept."""
        point = self.task.instruments(place)
        rise = self.task.cost(point, self.fit.deviations) - self.cost if point.reached else np.inf
        if rise < self.lowest_rise:
            self.lowest, self.lowest_rise = point, rise
        return rise, point


def _parts(most: float, wanted: float, rises: dict[float, float]) -> Iterator[float]:
    """The places to evaluate, in predicted half intervals, by the `rises` so far: outwards until the cost has risen by
    `wanted`, then by bisection.
    """
    part = min(1.0, most)
    yield part
    while part < most and (part < WIDEST or (rises[part] <= wanted and len(rises) < TRIALS)):
        part = min(most, FARTHER * part)
        yield part
    within = [part for part, rise in rises.items() if rise <= wanted]
    beyond = [part for part in rises if within and part > max(within)]
    if beyond:
        low, high = max(within), min(beyond)
        for _ in range(HALVINGS):
            part = (low + high) / 2
            yield part
            low, high = (part, high) if rises[part] <= wanted else (low, part)
