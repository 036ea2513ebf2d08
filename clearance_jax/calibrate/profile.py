"""Intervals of the motion itself, where they are wider than those that the derivatives predict.

The end of such an interval is where the profile likelihood has fallen by as much as at the end of the interval that the
derivatives predict, were the motion linear (Venzon and Moolgavkar 1988, doi 10.2307/2347496).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from clearance_jax.calibrate.confidence import Confidence
from clearance_jax.calibrate.fit import FitResult, FitTask
from clearance_jax.calibrate.readings import FitPoint

# Within this factor between what the derivatives predict at the end of an interval and the motion, they are believed;
# beyond the second one it is said that they are not.
STRAIGHT, BENT = 1.25, 2.0
# How much farther each trial goes, how far at least (where the cost has ripples it may fall again), and how many there
# are at most; how often the last step is halved.
FARTHER, WIDEST, TRIALS, HALVINGS = 1.5, 3.0, 12, 2
# Where another minimum is looked for, over what the derivatives predict, along so many of the numbers known least.
FAR, LOOKED = (3.0, 9.0, 27.0), 2
# At most so many corrections of the others are made at one place. A correction is worth a motion if it promises
# this part of the rise.
WORTH, CORRECTIONS = 0.1, 4
# Singular values below this part of the largest one are of what the data do not tell.
UNTOLD = 1e-6
# A cost that is less than that of the fit by this part of the wanted rise is a better minimum.
BETTER = 0.02


class Profile(NamedTuple):
    """The confidence of the motion itself, and a `better` point than the fit's where one was seen on the way."""

    known: Confidence
    better: FitPoint | None


def profile(task: FitTask, fit: FitResult, known: Confidence) -> Profile:
    """The intervals of the determined numbers, searched for where the motion is not what the derivatives predict."""
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
    """Along a number, the others where the fit is best."""

    def __init__(self, task: FitTask, fit: FitResult, known: Confidence):
        self.task, self.fit, self.known = task, fit, known
        self.cost = task.cost(fit.point, fit.deviations)
        self.here = task.weigh(fit.point, fit.deviations)
        self.lowest, self.lowest_rise, self.better = fit.point, 0.0, False

    def look(self, k: int, sign: float, far: bool) -> tuple[float, bool]:
        """How far to a side the number `k` may be, and whether that is what the derivatives predict. Looked for is the
        end of its interval, or, `far` away, another minimum.
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
        """Per unit of the number `k` where the others are best, were the motion linear: along the column of the
        covariance, but not along what the data do not tell, which would end at a bound.
        """
        sizes, way = self.known.sizes, np.ones(len(self.known.sizes))
        others = np.arange(len(sizes)) != k
        scaled = self.here.jacobian[:, others] * sizes[others]
        way[others] = -sizes[others] * np.linalg.lstsq(scaled, self.here.jacobian[:, k], rcond=UNTOLD)[0]
        return way

    def rise(self, k: int, place: np.ndarray, wanted: float) -> float:
        """By what the cost is larger with the number `k` at its place, the others corrected while that helps."""
        task, variables, others = self.task, self.task.variables, np.arange(len(place)) != k
        rise, point = self.seen(np.clip(place, variables.lower, variables.upper))
        scale = self.known.deviations[others]
        for _ in range(CORRECTIONS if len(place) > 1 and point.reached else 0):
            at = task.weigh(point, self.fit.deviations)
            # Weighted as the loss counts the residuals.
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
        """By what the cost is larger at a place; the lowest of all places is kept."""
        point = self.task.instruments(place)
        rise = self.task.cost(point, self.fit.deviations) - self.cost if point.reached else np.inf
        if rise < self.lowest_rise:
            self.lowest, self.lowest_rise = point, rise
        return rise, point


def _parts(most: float, wanted: float, rises: dict[float, float]) -> Iterator[float]:
    """Where to look, in parts of what the derivatives predict, by the `rises` that were found: outwards, until the cost
    has risen; then between the last place where it had not and the next one.
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
