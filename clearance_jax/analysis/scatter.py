"""Samples about a design: of a metric and its gradient, with their statistics, and of how fast motions diverge.

The divergence says up to when a derivative is meaningful, and how hard contacts touch.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.ask.question import Question, lanes
from clearance_jax.dynamics.quantities import observe
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import Settings, evenly
from clearance_jax.solve.simulate import run
from clearance_jax.solve.steps.observers import TouchCounter, Touches
from clearance_jax.solve.steps.tolerances import SMALLEST


class SamplingPlan(NamedTuple):
    """Where a metric is sampled: at the values `centre` of the parameters `names`, a relative `step` away, at `probes`
    points within the step, and at `samples` points of the relative standard deviation `scatter`.
    """

    names: tuple[str, ...]
    centre: np.ndarray
    step: float
    probes: int
    scatter: float
    samples: int
    rtol: float
    seed: int

    @property
    def unit(self) -> np.ndarray:
        """What `step` and `scatter` are relative to: the size of each parameter, 1 for a zero."""
        return np.where(self.centre == 0, 1.0, np.abs(self.centre))

    def moves(self) -> np.ndarray:
        """Changes (lanes, parameters): twice none, a step up and down of each, within the step, and the scatter."""
        p, unit = len(self.names), self.unit
        # Antithetic pairs: the mean of a linear metric is then exact.
        half = np.random.default_rng(self.seed).standard_normal((-(-self.samples // 2), p))
        draws = self.scatter * unit * np.concatenate([half, -half])[: self.samples]
        ends = np.diag(self.step * unit)
        # Those within the step change all parameters together, each evenly spaced (a Latin hypercube), so that their
        # distance does not grow with the number of parameters.
        even, rng = (2 * np.arange(self.probes) + 1) / self.probes - 1, np.random.default_rng(self.seed)
        within = np.stack([even, *(rng.permutation(even) for _ in self.names[1:])], 1)
        return np.concatenate([np.zeros((2, p)), ends, -ends, self.step * unit * within, draws])


class MetricSamples(NamedTuple):
    """The metric and its gradient at the design, a step away from it, within the step, and over the scatter.

    `finer`: the gradient at rtol/10 (at 10 rtol if floats resolve no less); `up`, `down`: changes of the metric over a
    step of each parameter; `within` (probes, parameters): changes within the step that could be solved, and `changes`
    of the metric there; `draws` (samples, parameters) of the scatter that could be solved, with the metric `cloud` and
    its `slopes`; `complete`: all could be solved; `second`: value and gradient of the second highest peak, if the
    metric is a peak.
    """

    value: np.floating
    gradient: np.ndarray
    finer: np.ndarray
    up: np.ndarray
    down: np.ndarray
    within: np.ndarray
    changes: np.ndarray
    draws: np.ndarray
    cloud: np.ndarray
    slopes: np.ndarray
    complete: bool
    second: tuple[np.floating, np.ndarray] | None


def sample(plan: SamplingPlan, mechanism, metric, t1, options: Settings) -> MetricSamples:
    """Solve the metric at all points of the plan, by one program."""
    p, rtol, moves = len(plan.names), plan.rtol, plan.moves()
    other = rtol / 10 if rtol >= 10 * SMALLEST else 10 * rtol
    rtols = np.where(np.arange(len(moves)) == 1, other, rtol)
    # The second highest peak is asked for too: where two peaks tie, the metric has a kink.
    asked = metric.several(2)
    peak = asked is not metric
    points = dict(zip(plan.names, (plan.centre + moves).T, strict=True)) | {"rtol": rtols}
    answers = lanes(Question(mechanism, {"": asked}, t1, options, plan.names), points)
    values, slopes = answers.values[""], answers.slopes[""]
    if values.ndim > (2 if peak else 1):
        raise ClearanceError("`gradient_report` wants a metric that is one number.")
    second = (values[0, 1], slopes[0, 1]) if peak else None
    values, slopes = (values[:, 0], slopes[:, 0]) if peak else (values, slopes)
    fine = np.isfinite(values) & np.all(np.isfinite(slopes), axis=1)
    # The rows of `SamplingPlan.moves`.
    step, scatter = slice(2, 2 + 2 * p), slice(-plan.samples, None)
    within = slice(step.stop, len(moves) - plan.samples)
    if not fine[0] or np.sum(fine[scatter]) < p + 3:
        raise RuntimeError("The solve stopped before t1, so there is no value to differentiate. Simulate to see why.")
    up, down = np.split(values[step] - values[0], 2)
    inner, changes = (x[within][fine[within]] for x in (moves, values - values[0]))
    draws, cloud, over = (x[scatter][fine[scatter]] for x in (moves, values, slopes))
    within_step, scattered = (up, down, inner, changes), (draws, cloud, over)
    return MetricSamples(values[0], slopes[0], slopes[1], *within_step, *scattered, bool(np.all(fine)), second)


class Statistics(NamedTuple):
    """Statistics of a gradient, named as in `GradientReport`; per parameter except `digits`, `departed`, `departure`.

    - `error`: of the gradient; `predicted`: the change of the metric over a step, by the gradient;
    - `departed`: how far the metric is at most from what the gradient predicts within the step;
    - `mean`, `deviation` of the derivative over the scatter; `slope`, `slope_error` of the metric's regression there.
    """

    error: np.ndarray
    digits: np.floating
    predicted: np.ndarray
    linearity: np.ndarray
    departed: np.floating
    departure: np.floating
    mean: np.ndarray
    deviation: np.ndarray
    slope: np.ndarray
    slope_error: np.ndarray
    signal_to_noise: np.ndarray
    slope_ratio: np.ndarray
    slope_z: np.ndarray
    heavy_tail: np.ndarray


def statistics(plan: SamplingPlan, seen: MetricSamples) -> Statistics:
    """Statistics of the samples, without a verdict."""
    gradient, slopes, unit = seen.gradient, seen.slopes, plan.unit
    # Zero over zero is NaN, which exceeds no threshold.
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(seen.finer - gradient)
        predicted = plan.step * unit * gradient
        missed = np.maximum(np.abs(seen.up - predicted), np.abs(seen.down + predicted))
        departed = np.max(np.abs(seen.changes - seen.within @ gradient), initial=0.0)
        mean, deviation = slopes.mean(0), slopes.std(0, ddof=1)
        slope, slope_error = regression(seen.draws, seen.cloud)
        return Statistics(
            error=error,
            digits=np.max(error * unit) / np.max(np.abs(gradient) * unit),
            predicted=predicted,
            linearity=missed / np.abs(predicted),
            departed=departed,
            departure=departed / np.sum(np.abs(predicted)),
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
    """Least-squares slopes of `values` (samples,) over `moves` (samples, parameters), and their standard errors."""
    units = moves.std(0)
    columns = np.concatenate([np.ones((len(moves), 1)), moves / units], 1)
    fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ fit
    covariance = np.linalg.pinv(columns.T @ columns) * (left @ left) / (len(values) - columns.shape[1])
    return fit[1:] / units, np.sqrt(np.diag(covariance))[1:] / units


# Times at which the spread of the pins is sampled.
SAMPLES = 400


@eqx.filter_jit
def neighbours(
    mechanism: Mechanism, names: tuple[str, ...], points: Array, scatter: Array, t1: Any, options: Settings
) -> tuple[Array, Array, tuple[Touches, ...]]:
    """How far motions at points (lanes, parameters) are from their neighbours, and their touches.

    Returns times (SAMPLES,); the distance of the pins of neighbouring motions over their clearance, of the joint where
    it is largest (lanes, SAMPLES), to first order for independent changes `scatter` of the parameters; and every
    joint's `Touches`, shape (lanes,).
    """
    times = evenly(options.t0, t1, SAMPLES)
    joints, places = mechanism.contacts(), touching(mechanism)
    observers = tuple(map(TouchCounter, places))

    def at(point):
        def pins(point):
            changed = replace(mechanism, dict(zip(names, point, strict=True)))
            solution = run(changed, t1, options._replace(save_at=times, energy_balance=False), observers=observers)
            ready = changed.prepare()
            return jax.vmap(lambda t, y: _offsets(observe(t, y, ready)))(times, solution.y), solution.records

        slopes, record = jax.jacfwd(pins, has_aux=True)(point)
        return jnp.sqrt(jnp.sum((slopes * scatter[None, None, None]) ** 2, axis=(2, 3))), record

    apart, record = jax.vmap(at)(points)
    sizes = jnp.stack([joints[i].size for i in places])
    return times, jnp.max(apart / sizes[None, None], axis=2), record


def touching(mechanism: Any) -> tuple[int, ...]:
    """The contacts that come off, by number: joints with clearance and gaps, but not friction."""
    open_ones = {gap.name for gap in mechanism.open_gaps()}
    pins = len(mechanism.clearance_joints())
    return (*range(pins), *(pins + i for i, gap in enumerate(mechanism.gaps) if gap.name in open_ones))


def _offsets(seen: dict[str, jax.Array]) -> jax.Array:
    """The places of pins and those in gaps, (contacts, axes)."""
    if "gap_position" not in seen:
        return seen["eccentricity"]
    gaps = seen["gap_position"]
    if "eccentricity" not in seen:
        return gaps[:, None]
    pins = seen["eccentricity"]
    return jnp.concatenate([pins, jnp.pad(gaps[:, None], ((0, 0), (0, pins.shape[1] - 1)))])


class Divergence(NamedTuple):
    """Divergence and touches over the scatter, named as in `GradientReport`; by default as without clearance."""

    lyapunov: float = 0.0
    horizon: float = np.inf
    precision_horizon: float = np.inf
    impacts: tuple[int, int] = (0, 0)
    slowest_impact: float = np.inf
    nearest_miss: float = np.inf


def divergence(plan: SamplingPlan, mechanism, draws: np.ndarray, t1, limit: float, options: Settings) -> Divergence:
    """The divergence of motions at `draws` (samples, parameters), parted where their spread is above `limit`."""
    if not touching(mechanism):
        return Divergence()
    points = jnp.asarray(plan.centre + np.concatenate([np.zeros((1, len(plan.names))), draws]))
    scatter = jnp.asarray(plan.scatter * plan.unit)
    times, apart, touches = neighbours(mechanism, plan.names, points, scatter, t1, options)
    times, spread = np.asarray(times), np.sqrt(np.mean(np.asarray(apart) ** 2, axis=0))
    exponent, horizon = horizon_of(times, spread, limit)
    precision = np.log(1 / plan.rtol) / exponent if exponent * (times[-1] - times[0]) > 1 else np.inf
    count = np.sum([np.asarray(joint.count) for joint in touches], axis=0)
    slowest, miss = (min(float(joint[i][0]) for joint in touches) for i in (1, 2))
    return Divergence(exponent, horizon, precision, (int(count.min()), int(count.max())), slowest, miss)


def horizon_of(times: np.ndarray, spread: np.ndarray, limit: float) -> tuple[float, float]:
    """Growth rate of a spread (samples,) over the second half [1/s], and when it passes `limit` for good [s]:
    extrapolated if that is after the end, infinite if the spread does not grow exponentially.
    """
    half = len(times) // 2
    later = np.log(np.maximum(spread[half:], np.finfo(float).tiny))
    # A straight line averages over the jumps at impacts.
    rate = float(np.polyfit(times[half:], later, 1)[0])
    below = np.flatnonzero(spread <= limit)
    first = below[-1] + 1 if below.size else 0
    if first < len(times):
        return rate, float(times[first])
    # Growth by less than a factor e over the whole motion is drift, not divergence.
    if rate * (times[-1] - times[0]) < 1:
        return rate, float("inf")
    return rate, float(times[-1] + (np.log(limit) - later[-1]) / rate)
