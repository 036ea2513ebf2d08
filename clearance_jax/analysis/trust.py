"""Whether a derivative is worth believing: an exact derivative of a chaotic motion is useless to an optimiser.

`gradient_report` measures, at the present design, what an optimiser would rely on: that the derivative does not change
with the tolerance, that the metric follows it over the intended step, that it stays the same over the scatter with
which parts are made, and that the slope of the metric over that scatter is the derivative's (jumps and kinks show
there); how fast neighbouring motions part, and so for how long a derivative can mean anything. It compiles two
programs, the metric's and the motion's, and again only for another structure: numbers and `t1` are arguments.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax.analysis.metrics import AbstractMetric, Peak
from clearance_jax.analysis.periodic import periodic_motion
from clearance_jax.analysis.sensitivity import output, values_of
from clearance_jax.dynamics.field import observe
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism, replace
from clearance_jax.solve.observers import AbstractObserver, TouchCounter, Touches
from clearance_jax.solve.simulate import solve


class TrustThresholds(eqx.Module):
    """What a derivative must meet to be trusted. Calibrated in `experiments/trust.py` on labelled cases."""

    digits: float = 1e-3
    """Largest relative difference between tolerances rtol and rtol/10."""
    linearity: float = 0.5
    """Largest |change - predicted| / |predicted| over the intended step."""
    signal_to_noise: float = 3.0
    """Smallest |mean| / standard deviation of the derivative over the scatter."""
    slope: float = 0.3
    """Largest relative difference between mean derivative and regression slope, where it is significant."""
    significance: float = 3.0
    """Standard errors from which a difference of slopes is significant."""
    spread: float = 0.05
    """Spread of the pins over the scatter, over the clearance, at which neighbouring motions have parted. Chosen by the
    chaotic scenes of the experiment, whose measured horizons 0.03 to 0.1 meet about equally well."""
    minor: float = 0.05
    """Change over the step, relative to the largest parameter's, below which a parameter is not judged."""
    tail: float = 10.0
    """Largest |derivative| over the median one, over the scatter, beyond which a few motions decide the mean."""


THRESHOLDS = TrustThresholds()


class UntrustedGradient(UserWarning):
    """The derivative should not be believed; the message says why."""


class GradientReport(eqx.Module):
    """A gradient with what is known of its worth.

    - `value`, `gradient` (parameters,) in the order of `names`; with `on_untrusted="smooth"` an untrusted gradient is
      replaced by the slope of the metric over the scatter, `smoothed` says so, `gradient_error` its error.
    - `trusted`; `reasons`: a sentence for every test that failed.
    - `digits`: relative difference of the gradients at rtol and rtol/10; `linearity`: per step direction (parameters,);
      `signal_to_noise`, `slope_ratio` (regression slope over mean derivative), `slope_z`, per parameter; `heavy_tail`.
    - `lyapunov`: finite-time exponent [1/s]; `horizon`: when neighbours within the scatter have parted [s] (infinite:
      not foreseeable); `precision_horizon`: when rtol has grown to the size of the motion [s].
    - `impacts`: fewest and most impacts over the scatter; `slowest_impact` [m/s], `nearest_miss` [m].
    - `multipliers`: of the periodic motion, where a `period` was given.
    """

    value: Array
    gradient: Float[Array, " parameters"]
    gradient_error: Float[Array, " parameters"]
    digits: Array
    linearity: Float[Array, " parameters"]
    signal_to_noise: Float[Array, " parameters"]
    slope_ratio: Float[Array, " parameters"]
    slope_z: Float[Array, " parameters"]
    heavy_tail: Array
    lyapunov: Array
    horizon: Array
    precision_horizon: Array
    impacts: tuple[int, int] = eqx.field(static=True)
    slowest_impact: Array
    nearest_miss: Array
    multipliers: Array | None
    names: tuple[str, ...] = eqx.field(static=True)
    reasons: tuple[str, ...] = eqx.field(static=True)
    smoothed: bool = eqx.field(static=True, default=False)

    @property
    def trusted(self) -> bool:
        """The verdict."""
        return not self.reasons

    def __str__(self) -> str:
        lines = [f"value {float(self.value):.6g}; " + ("trusted" if self.trusted else "NOT TRUSTED")]
        lines += [f"  d/d {n} = {float(g):.6g}" for n, g in zip(self.names, self.gradient, strict=True)]
        lines += [f"  - {reason}" for reason in self.reasons]
        if self.smoothed:
            lines.append("  The gradient shown is the slope over the scatter, not the derivative.")
        return "\n".join(lines)


@eqx.filter_jit
def _lanes(metric, mechanism, points, rtols, names, t1, options):
    """Values and gradients at points (lanes, parameters), each lane with its own tolerance; one solve a lane."""

    def at(point, rtol):
        def of(p):
            value = output(metric, replace(mechanism, dict(zip(names, p, strict=True))), t1, rtol=rtol, **options)
            return value, value

        slopes, value = jax.jacfwd(of, has_aux=True)(point)
        return value, slopes

    return jax.vmap(at)(points, rtols)


class _Touching(AbstractObserver):
    """Watches all clearance joints at once."""

    joints: tuple[TouchCounter, ...]

    def start(self, t0, y0, problem):
        return tuple(joint.start(t0, y0, problem) for joint in self.joints)

    def __call__(self, record, times, ends, problem):
        return tuple(j(r, times, ends, problem) for j, r in zip(self.joints, record, strict=True))


# Samples of the pins' spread over the motion.
SAMPLES = 400


@eqx.filter_jit
def neighbours(
    mechanism: Mechanism, names: tuple[str, ...], points: Array, scatter: Array, t1: Any, options: dict
) -> tuple[Array, Array, tuple[Touches, ...]]:
    """How motions at points (lanes, parameters) part from their neighbours, and touch.

    Returns times (SAMPLES,); how far the pins of neighbouring motions are apart there (lanes, SAMPLES), over the
    clearances, the largest joint's, in linear theory, for independent changes `scatter` of the parameters; and every
    joint's `Touches`, shape (lanes,).
    """
    t0 = options.get("t0", 0.0)
    times = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, SAMPLES)
    joints = mechanism.clearance_joints()
    observer = _Touching(tuple(TouchCounter(i) for i in range(len(joints))))

    def at(point):
        def pins(point):
            changed = replace(mechanism, dict(zip(names, point, strict=True)))
            solution = solve(changed, t1, save_at=times, observer=observer, **options)
            ready = changed.prepared()
            return jax.vmap(lambda t, y: observe(t, y, ready)["eccentricity"])(times, solution.y), solution.record

        slopes, record = jax.jacfwd(pins, has_aux=True)(point)
        return jnp.sqrt(jnp.sum((slopes * scatter[None, None, None]) ** 2, axis=(2, 3))), record

    apart, record = jax.vmap(at)(points)
    sizes = jnp.stack([joint.clearance.radial_clearance for joint in joints if joint.clearance])
    return times, jnp.max(apart / sizes[None, None], axis=2), record


def horizon_of(times: np.ndarray, spread: np.ndarray, limit: float) -> tuple[float, float]:
    """Growth rate of a spread (samples,) over the second half [1/s], and when it passes `limit` for good [s]: by
    extrapolation where that is after the end, infinite where the spread does not grow exponentially.
    """
    half = len(times) // 2
    later = np.log(np.maximum(spread[half:], np.finfo(float).tiny))
    # A straight line smooths the beats of the impacts.
    rate = float(np.polyfit(times[half:], later, 1)[0])
    below = np.flatnonzero(spread <= limit)
    first = below[-1] + 1 if below.size else 0
    if first < len(times):
        return rate, float(times[first])
    # Growth by less than a factor e over the whole motion is drift, not divergence.
    if rate * (times[-1] - times[0]) < 1:
        return rate, float("inf")
    return rate, float(times[-1] + (np.log(limit) - later[-1]) / rate)


def regression(moves: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of `values` (samples,) over `moves` (samples, parameters) by least squares, and their standard errors."""
    units = moves.std(0)
    columns = np.concatenate([np.ones((len(moves), 1)), moves / units], 1)
    fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ fit
    covariance = np.linalg.pinv(columns.T @ columns) * (left @ left) / (len(values) - columns.shape[1])
    return fit[1:] / units, np.sqrt(np.diag(covariance))[1:] / units


class _Question(NamedTuple):
    """The report's arguments: the numbers `centre` of `names`, how far they are moved, and how that is judged."""

    names: tuple[str, ...]
    centre: np.ndarray
    step: float
    scatter: float
    samples: int
    rtol: float
    seed: int
    thresholds: TrustThresholds

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


def _checked(mechanism, wrt, samples, on_untrusted) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and numbers of the parameters, once it is seen that there is something to report on."""
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    given = values_of(mechanism, names)
    if any(number.ndim for number in given.values()):
        raise ClearanceError("`gradient_report` wants scalars: name the entries of an array, `name.0`.")
    p = len(names)
    if samples < p + 3:
        raise ClearanceError(f"{p} parameters need `samples` of at least {p + 3}, not {samples}.")
    if on_untrusted not in ("ignore", "warn", "raise", "smooth"):
        raise ClearanceError(f"There is no on_untrusted={on_untrusted!r}. Allowed: ignore, warn, raise, smooth.")
    return names, np.array([float(v) for v in given.values()])


class _Samples(NamedTuple):
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


def _sampled(question: _Question, mechanism, metric, t1, options) -> _Samples:
    """All solves of the metric, in one program."""
    p, samples, rtol, moves = len(question.names), question.samples, question.rtol, question.moves()
    rtols = np.where(np.arange(len(moves)) == 1, rtol / 10, rtol)
    # Of a peak the second highest is looked at too: where they tie, the metric has a kink.
    peak = isinstance(metric, Peak) and metric.count == 1
    asked = Peak(metric.signal, 2) if isinstance(metric, Peak) and peak else metric
    points = jnp.asarray(question.centre + moves)
    lanes = _lanes(asked, mechanism, points, jnp.asarray(rtols), question.names, t1, options)
    values, slopes = (np.asarray(x) for x in lanes)
    if values.ndim > (2 if peak else 1):
        raise ClearanceError("`gradient_report` wants a metric that is one number.")
    second = (values[0, 1], slopes[0, 1]) if peak else None
    values, slopes = (values[:, 0], slopes[:, 0]) if peak else (values, slopes)
    fine = np.isfinite(values) & np.all(np.isfinite(slopes), axis=1)
    if not fine[0] or np.sum(fine[-samples:]) < p + 3:
        raise RuntimeError("The solve stopped before t1, so there is no value to differentiate. Simulate to see why.")
    up, down = values[2 : 2 + p] - values[0], values[2 + p : 2 + 2 * p] - values[0]
    draws, cloud, over = (x[-samples:][fine[-samples:]] for x in (moves, values, slopes))
    return _Samples(values[0], slopes[0], slopes[1], up, down, draws, cloud, over, bool(np.all(fine)), second)


class _Statistics(NamedTuple):
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


def _statistics(question: _Question, seen: _Samples) -> _Statistics:
    """Statistics of the samples, without a verdict."""
    gradient, slopes, unit = seen.gradient, seen.slopes, question.unit
    # Zeros over zeros are no finding: a ratio of them is not a number, and no threshold is passed by it.
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(seen.finer - gradient)
        predicted = question.step * unit * gradient
        missed = np.maximum(np.abs(seen.up - predicted), np.abs(seen.down + predicted))
        mean, deviation = slopes.mean(0), slopes.std(0, ddof=1)
        slope, slope_error = regression(seen.draws, seen.cloud)
        return _Statistics(
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


def _doubts(question: _Question, seen: _Samples, found: _Statistics, k: int) -> Iterator[str]:
    """Why not to believe the derivative by the k-th parameter."""
    name, mean, thresholds = question.names[k], found.mean[k], question.thresholds
    if not found.linearity[k] <= thresholds.linearity:
        yield (
            f"A step of {question.step:.0%} in `{name}` changes the metric by {seen.up[k]:.3g} and {seen.down[k]:.3g}, "
            f"where the gradient predicts +-{abs(found.predicted[k]):.3g}."
        )
    if found.signal_to_noise[k] < thresholds.signal_to_noise:
        yield (
            f"Over a scatter of {question.scatter:.0%} the derivative by `{name}` is {mean:.3g} +- "
            f"{found.deviation[k]:.3g}: its signal-to-noise ratio is {found.signal_to_noise[k]:.2g}."
        )
    if found.slope_z[k] > thresholds.significance and abs(found.slope_ratio[k] - 1) > thresholds.slope:
        yield (
            f"Over the scatter the metric follows `{name}` with slope {found.slope[k]:.3g}, not with the mean "
            f"derivative {mean:.3g}: it jumps or has kinks."
        )
    if found.heavy_tail[k] > thresholds.tail:
        yield (
            f"A few motions within the scatter have derivatives by `{name}` {found.heavy_tail[k]:.0f} times the "
            "median: their mean means little."
        )


def _tie(question: _Question, seen: _Samples, judged: np.ndarray) -> Iterator[str]:
    """A tie of two peaks with different slopes, unless no peak is turned over within the step."""
    if seen.second is None:
        return
    value, gradient = seen.second
    apart = np.abs(gradient - seen.gradient)
    near = seen.value - value < np.max(question.step * question.unit * apart)
    if near and np.any(judged & (apart > question.thresholds.slope * np.abs(seen.gradient))):
        yield f"Two peaks tie: {seen.value:.6g} and {value:.6g}, with different slopes: use `Peak(signal, 2)`."


def _reasons(question: _Question, seen: _Samples, found: _Statistics) -> list[str]:
    """Every test that failed, as a sentence; and where one did, whether a tie explains it."""
    thresholds = question.thresholds
    reasons = [] if seen.complete else ["Some motions near this design could not be solved to the end."]
    # A change the solve cannot resolve, or one small beside another parameter's, is not judged.
    change = np.max(np.abs([found.predicted, seen.up, seen.down]), axis=0)
    judged = change > max(thresholds.minor * np.max(change), question.rtol * abs(seen.value))
    if found.digits > thresholds.digits and np.any(judged):
        reasons.append(f"The gradient changes by {found.digits:.1g} of itself when the tolerance is ten times tighter.")
    for k in np.flatnonzero(judged).tolist():
        reasons += _doubts(question, seen, found, k)
    # An explanation, not a test: of a tie that turns no peak over within the step an optimiser feels nothing.
    if reasons:
        reasons += _tie(question, seen, judged)
    return reasons


class _Divergence(NamedTuple):
    """How motions over the scatter part and touch, as in the report; the defaults hold where there is no clearance."""

    lyapunov: float = 0.0
    horizon: float = np.inf
    precision_horizon: float = np.inf
    impacts: tuple[int, int] = (0, 0)
    slowest_impact: float = np.inf
    nearest_miss: float = np.inf


def _divergence(question: _Question, mechanism, draws: np.ndarray, t1, options) -> _Divergence:
    """Of the motion and those at `draws` (samples, parameters) of the scatter, in one program."""
    if not mechanism.clearance_joints():
        return _Divergence()
    names, rtol = question.names, question.rtol
    points = jnp.asarray(question.centre + np.concatenate([np.zeros((1, len(names))), draws]))
    scatter = jnp.asarray(question.scatter * question.unit)
    times, apart, touches = neighbours(mechanism, names, points, scatter, t1, {**options, "rtol": rtol})
    times, spread = np.asarray(times), np.sqrt(np.mean(np.asarray(apart) ** 2, axis=0))
    exponent, horizon = horizon_of(times, spread, question.thresholds.spread)
    precision = np.log(1 / rtol) / exponent if exponent * (times[-1] - times[0]) > 1 else np.inf
    count = np.sum([np.asarray(joint.count) for joint in touches], axis=0)
    slowest, miss = (min(float(joint[i][0]) for joint in touches) for i in (1, 2))
    return _Divergence(exponent, horizon, precision, (int(count.min()), int(count.max())), slowest, miss)


def gradient_report(
    mechanism: Mechanism,
    metric: AbstractMetric | Callable,
    wrt: Sequence[str],
    t1: Any,
    *,
    step: float = 0.02,
    scatter: float = 0.01,
    samples: int = 16,
    rtol: float = 1e-8,
    period: Any = None,
    seed: int = 0,
    thresholds: TrustThresholds = THRESHOLDS,
    on_untrusted: Literal["ignore", "warn", "raise", "smooth"] = "warn",
    **options: Any,
) -> GradientReport:
    """The gradient of a scalar metric by named scalars, and whether to believe it.

    **Arguments:**

    - `step`: the change an optimiser would make, relative to each parameter (absolute for a zero).
    - `scatter`: the standard deviation with which parts are made, likewise; `samples` of it are drawn, with one `seed`
      for all designs (common random numbers).
    - `period`: of a periodic drive [s]: adds the Floquet multipliers.
    - `on_untrusted`: "warn" (`UntrustedGradient`), "raise" (`ClearanceError`), "ignore", or "smooth": return the slope
      of the metric over the scatter instead, by least squares.
    - `options`: `simulate`'s `t0`, `solver`.

    **Raises:** `ClearanceError` for unknown names, arrays, a metric of several numbers, too few samples, a law of
    class C-1; `RuntimeError` where the motion itself, or too many of the scatter, cannot be solved to the end.
    """
    names, centre = _checked(mechanism, wrt, samples, on_untrusted)
    question = _Question(names, centre, step, scatter, samples, rtol, seed, thresholds)
    t1 = jnp.asarray(t1, float)
    seen = _sampled(question, mechanism, metric, t1, options)
    found = _statistics(question, seen)
    reasons = _reasons(question, seen, found)
    parting = _divergence(question, mechanism, seen.draws, t1, options)
    # An explanation, not a test: of a large spread that stays linear an optimiser feels nothing.
    if reasons and parting.horizon < t1:
        reasons.append(
            f"Neighbouring motions within the scatter have parted by t = {parting.horizon:.3g} s, before the end at "
            f"{float(t1):.3g} s: beyond, a derivative says nothing of them."
        )
    smoothed = bool(reasons) and on_untrusted == "smooth"
    report = GradientReport(
        value=jnp.asarray(seen.value),
        gradient=jnp.asarray(found.slope if smoothed else seen.gradient),
        gradient_error=jnp.asarray(found.slope_error if smoothed else found.error),
        digits=jnp.asarray(found.digits),
        linearity=jnp.asarray(found.linearity),
        signal_to_noise=jnp.asarray(found.signal_to_noise),
        slope_ratio=jnp.asarray(found.slope_ratio),
        slope_z=jnp.asarray(found.slope_z),
        heavy_tail=jnp.asarray(found.heavy_tail),
        lyapunov=jnp.asarray(parting.lyapunov),
        horizon=jnp.asarray(parting.horizon),
        precision_horizon=jnp.asarray(parting.precision_horizon),
        impacts=parting.impacts,
        slowest_impact=jnp.asarray(parting.slowest_impact),
        nearest_miss=jnp.asarray(parting.nearest_miss),
        multipliers=None if period is None else periodic_motion(mechanism, period).multipliers,
        names=names,
        reasons=tuple(reasons),
        smoothed=smoothed,
    )
    message = "This gradient is not to be trusted. " + " ".join(reasons)
    if reasons and on_untrusted == "raise":
        raise ClearanceError(message)
    if reasons and on_untrusted == "warn":
        warnings.warn(message, UntrustedGradient, stacklevel=2)
    return report
