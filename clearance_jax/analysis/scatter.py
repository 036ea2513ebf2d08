"""A metric and its gradient over the scatter with which parts are made: the solves, and their statistics."""

import dataclasses
from typing import NamedTuple

import numpy as np

from clearance_jax.ask.lanes import lanes
from clearance_jax.ask.question import Question
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.reductions import Peak
from clearance_jax.solve.settings import Settings


class SamplingPlan(NamedTuple):
    """Where a metric is sampled: about the numbers `centre` of `names`, a `step` away and over their `scatter`."""

    names: tuple[str, ...]
    centre: np.ndarray
    step: float
    scatter: float
    samples: int
    rtol: float
    seed: int

    @property
    def unit(self) -> np.ndarray:
        """What `step` and `scatter` are relative to: each parameter's own size, one for a zero."""
        return np.where(self.centre == 0, 1.0, np.abs(self.centre))

    def moves(self) -> np.ndarray:
        """Changes (lanes, parameters): twice none, a step up by each, a step down by each, draws of the scatter."""
        p, unit = len(self.names), self.unit
        # Antithetic pairs: the mean of a linear metric is then exact.
        half = np.random.default_rng(self.seed).standard_normal((-(-self.samples // 2), p))
        draws = self.scatter * unit * np.concatenate([half, -half])[: self.samples]
        return np.concatenate([np.zeros((2, p)), np.diag(self.step * unit), np.diag(-self.step * unit), draws])


class Samples(NamedTuple):
    """The metric and its gradient at the design, a step away from it, and over the scatter.

    `finer`: the gradient at rtol/10; `up`, `down`: changes of the metric over a step by each parameter; `draws`
    (samples, parameters) of the scatter that could be solved, `cloud` and `slopes` there; `complete`: all could be
    solved; `second`: value and gradient of the second highest peak, of a metric that is a peak.
    """

    value: np.floating
    gradient: np.ndarray
    finer: np.ndarray
    up: np.ndarray
    down: np.ndarray
    draws: np.ndarray
    cloud: np.ndarray
    slopes: np.ndarray
    complete: bool
    second: tuple[np.floating, np.ndarray] | None


def sample(plan: SamplingPlan, mechanism, metric, t1, options: Settings) -> Samples:
    """All solves of the metric, by one program."""
    p, samples, rtol, moves = len(plan.names), plan.samples, plan.rtol, plan.moves()
    rtols = np.where(np.arange(len(moves)) == 1, rtol / 10, rtol)
    # Of a peak the second highest is looked at too: where they tie, the metric has a kink.
    peak = isinstance(metric, Peak) and metric.count == 1
    asked = dataclasses.replace(metric, count=2) if peak else metric
    points = dict(zip(plan.names, (plan.centre + moves).T, strict=True)) | {"rtol": rtols}
    found = lanes(Question(mechanism, {"": asked}, t1, options, plan.names), points)
    values, slopes = found.values[""], found.slopes[""]
    if values.ndim > (2 if peak else 1):
        raise ClearanceError("`gradient_report` wants a metric that is one number.")
    second = (values[0, 1], slopes[0, 1]) if peak else None
    values, slopes = (values[:, 0], slopes[:, 0]) if peak else (values, slopes)
    fine = np.isfinite(values) & np.all(np.isfinite(slopes), axis=1)
    if not fine[0] or np.sum(fine[-samples:]) < p + 3:
        raise RuntimeError("The solve stopped before t1, so there is no value to differentiate. Simulate to see why.")
    up, down = values[2 : 2 + p] - values[0], values[2 + p : 2 + 2 * p] - values[0]
    draws, cloud, over = (x[-samples:][fine[-samples:]] for x in (moves, values, slopes))
    return Samples(values[0], slopes[0], slopes[1], up, down, draws, cloud, over, bool(np.all(fine)), second)


class Statistics(NamedTuple):
    """What samples say of a gradient, per parameter but for `digits`; named as in the report, and

    - `error`: of the gradient; `predicted`: the change of the metric over a step, by the gradient;
    - `mean`, `deviation` of the derivative over the scatter; `slope`, `slope_error` of the metric's regression there.
    """

    error: np.ndarray
    digits: np.floating
    predicted: np.ndarray
    linearity: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    slope: np.ndarray
    slope_error: np.ndarray
    signal_to_noise: np.ndarray
    slope_ratio: np.ndarray
    slope_z: np.ndarray
    heavy_tail: np.ndarray


def statistics(plan: SamplingPlan, seen: Samples) -> Statistics:
    """Statistics of the samples, without a verdict."""
    gradient, slopes, unit = seen.gradient, seen.slopes, plan.unit
    # Zeros over zeros are no finding: a ratio of them is not a number, and no threshold is passed by it.
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(seen.finer - gradient)
        predicted = plan.step * unit * gradient
        missed = np.maximum(np.abs(seen.up - predicted), np.abs(seen.down + predicted))
        mean, deviation = slopes.mean(0), slopes.std(0, ddof=1)
        slope, slope_error = regression(seen.draws, seen.cloud)
        return Statistics(
            error=error,
            digits=np.max(error * unit) / np.max(np.abs(gradient) * unit),
            predicted=predicted,
            linearity=missed / np.abs(predicted),
            mean=mean,
            deviation=deviation,
            slope=slope,
            slope_error=slope_error,
            signal_to_noise=np.abs(mean) / deviation,
            slope_ratio=slope / mean,
            slope_z=np.abs(slope - mean) / np.hypot(slope_error, deviation / np.sqrt(len(seen.cloud))),
            heavy_tail=np.max(np.abs(slopes), 0) / np.median(np.abs(slopes), 0),
        )


def regression(moves: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of `values` (samples,) over `moves` (samples, parameters) by least squares, and their standard errors."""
    units = moves.std(0)
    columns = np.concatenate([np.ones((len(moves), 1)), moves / units], 1)
    fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ fit
    covariance = np.linalg.pinv(columns.T @ columns) * (left @ left) / (len(values) - columns.shape[1])
    return fit[1:] / units, np.sqrt(np.diag(covariance))[1:] / units
