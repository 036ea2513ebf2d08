"""Whether a derivative is worth believing: an exact derivative of a chaotic motion is useless to an optimiser.

`gradient_report` measures, at the present design, what an optimiser would rely on: that the derivative does not change
with the tolerance, that the metric follows it over the intended step, that it stays the same over the scatter with
which parts are made, and that the slope of the metric over that scatter is the derivative's (jumps and kinks show
there); how fast neighbouring motions part, and so for how long a derivative can mean anything.
"""

import warnings
from collections.abc import Callable, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._checks import ClearanceError
from clearance_jax.dynamics import observe
from clearance_jax.mechanism.mechanism import Mechanism, replace
from clearance_jax.metrics import AbstractMetric, Peak
from clearance_jax.sensitivity import output, values_of
from clearance_jax.signals import TouchCounter
from clearance_jax.solve import solve


class Limits(eqx.Module):
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
    spread: float = 0.1
    """Spread of the pin over the scatter, over the clearance, at which the motions have parted."""
    tail: float = 10.0
    """Largest |derivative| over the median one, over the scatter, beyond which a few motions decide the mean."""


LIMITS = Limits()


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
    """Values and gradients at points (lanes, parameters), each lane with its own tolerance."""

    def at(point, rtol):
        def of(p):
            changed = replace(mechanism, dict(zip(names, p, strict=True)))
            return output(metric, changed, t1, rtol=rtol, **options)

        value = of(point)
        return value, jax.jacfwd(of)(point)

    return jax.vmap(at)(points, rtols)


@eqx.filter_jit
def _touches(mechanism, points, names, t1, options):
    def at(point):
        changed = replace(mechanism, dict(zip(names, point, strict=True)))
        count = len(mechanism.clearance_joints())
        return [solve(changed, t1, observer=TouchCounter(i), **options).record for i in range(count)]

    return jax.vmap(at)(points)


@eqx.filter_jit
def spreads(mechanism, names, scatter, t1, options, samples):
    """Times, and how far the pins of neighbouring motions are apart there, over the clearances: the largest joint's,
    in linear theory, for independent changes `scatter` of the parameters.
    """
    t0 = options.get("t0", 0.0)
    times = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, samples)
    centre = jnp.stack([jnp.asarray(v, float) for v in values_of(mechanism, names).values()])

    def pins(point):
        changed = replace(mechanism, dict(zip(names, point, strict=True)))
        y = solve(changed, t1, save_at=times, **options).y
        ready = changed.prepared()
        return jax.vmap(lambda t, y: observe(t, y, ready)["eccentricity"])(times, y)

    apart = jax.jacfwd(pins)(centre) * scatter
    sizes = jnp.stack([joint.clearance.radial_clearance for joint in mechanism.clearance_joints() if joint.clearance])
    return times, jnp.max(jnp.sqrt(jnp.sum(apart**2, axis=(2, 3))) / sizes[None], axis=1)


def horizon_of(times: np.ndarray, spread: np.ndarray, limit: float) -> tuple[float, float]:
    """Finite-time Lyapunov exponent over the second half [1/s], and the time at which the spread passes `limit` [s]:
    where it does for good, or by extrapolation with the exponent; infinite where neighbours do not part exponentially.
    """
    half = len(times) // 2
    later = np.log(np.maximum(spread[half:], 1e-300))
    # Slope of the logarithm, smoothed over the beats of impacts by a straight line.
    exponent = float(np.polyfit(times[half:], later, 1)[0])
    beyond = np.flatnonzero(spread <= limit)
    last = beyond[-1] if beyond.size else 0
    if last < len(times) - 1:
        return exponent, float(times[min(last + 1, len(times) - 1)])
    # A steady growth by less than a factor e over the whole motion is drift, not divergence.
    if exponent * (times[-1] - times[0]) < 1:
        return exponent, float("inf")
    return exponent, float(times[-1] + (np.log(limit) - later[-1]) / exponent)


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
    limits: Limits = LIMITS,
    on_untrusted: Literal["ignore", "warn", "raise", "smooth"] = "warn",
    **options: Any,
) -> GradientReport:
    """The gradient of a scalar metric by named scalars, and whether to believe it.

    **Arguments:**

    - `step`: the change an optimiser would make, relative to each parameter.
    - `scatter`: the standard deviation with which parts are made, relative to each parameter; `samples` of it are
      drawn, with one `seed` for all designs (common random numbers).
    - `period`: of a periodic drive [s]: adds the Floquet multipliers.
    - `on_untrusted`: "warn" (`UntrustedGradient`), "raise" (`ClearanceError`), "ignore", or "smooth": return the slope
      of the metric over the scatter instead, by least squares.
    - `options`: `simulate`'s `t0`, `solver`.
    """
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    values = values_of(mechanism, names)
    if any(number.ndim for number in values.values()):
        raise ClearanceError("`gradient_report` wants scalars: name the entries of an array, `name.0`.")
    t1 = jnp.asarray(t1, float)
    centre = np.array([float(v) for v in values.values()])
    unit = np.where(centre == 0, 1.0, np.abs(centre))
    p = len(names)
    # Antithetic pairs: the mean of a linear metric is then exact.
    half = np.random.default_rng(seed).standard_normal((-(-samples // 2), p))
    draws = scatter * unit * np.concatenate([half, -half])[:samples]
    steps = np.concatenate([np.diag(step * unit), -np.diag(step * unit)])
    points = np.concatenate([centre[None], centre[None], centre + steps, centre + draws])
    rtols = np.full(len(points), rtol)
    rtols[1] = rtol / 10
    if isinstance(metric, Peak) and metric.count == 1:
        lanes, slopes = _lanes(
            Peak(metric.signal, 2), mechanism, jnp.asarray(points), jnp.asarray(rtols), names, t1, options
        )
        (value, second), lane_values, lane_slopes = (
            np.asarray(lanes[0]),
            np.asarray(lanes)[:, 0],
            np.asarray(slopes)[:, 0],
        )
        other = np.asarray(slopes)[0, 1]
    else:
        lanes, slopes = _lanes(metric, mechanism, jnp.asarray(points), jnp.asarray(rtols), names, t1, options)
        lane_values, lane_slopes, second, other = np.asarray(lanes), np.asarray(slopes), None, None
        value = lane_values[0]
    if np.ndim(value):
        raise ClearanceError("`gradient_report` wants a metric that is one number.")
    gradient, scale = lane_slopes[0], np.maximum(np.abs(lane_slopes[0]) * unit, 1e-300)
    digits = np.max(np.abs(lane_slopes[1] - gradient) * unit) / np.max(scale)
    up, down = lane_values[2 : 2 + p] - value, lane_values[2 + p : 2 + 2 * p] - value
    predicted = step * unit * gradient
    weight = np.abs(predicted) / np.max(np.abs(predicted)) if np.any(predicted) else np.zeros(p)
    with np.errstate(divide="ignore", invalid="ignore"):
        linearity = np.maximum(np.abs(up - predicted), np.abs(down + predicted)) / np.abs(predicted)
    cloud, cloud_slopes = lane_values[2 + 2 * p :], lane_slopes[2 + 2 * p :]
    slope, slope_error = regression(draws, cloud)
    mean, deviation = cloud_slopes.mean(0), cloud_slopes.std(0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        snr = np.abs(mean) / deviation
        z = np.abs(slope - mean) / np.sqrt(slope_error**2 + deviation**2 / len(cloud))
        ratio = slope / mean
        tail = np.max(np.abs(cloud_slopes), 0) / np.median(np.abs(cloud_slopes), 0)
    reasons = []

    def check(bad, text):
        for k in np.flatnonzero(bad & (weight > 0.05)):
            reasons.append(text(k))

    if not np.all(np.isfinite(lane_values)) or not np.all(np.isfinite(lane_slopes)):
        reasons.append("Some motions near this design could not be solved to the end.")
    if not digits <= limits.digits:
        reasons.append(f"The gradient changes by {digits:.1g} of itself when the tolerance is ten times tighter.")
    check(
        ~(linearity <= limits.linearity),
        lambda k: (
            f"A step of {step:.0%} in `{names[k]}` changes the metric by "
            f"{up[k]:.3g} and {down[k]:.3g}, where the gradient predicts +-{abs(predicted[k]):.3g}."
        ),
    )
    check(
        ~(snr >= limits.signal_to_noise),
        lambda k: (
            f"Over a scatter of {scatter:.0%} the derivative by `{names[k]}` is "
            f"{mean[k]:.3g} +- {deviation[k]:.3g}: its signal-to-noise ratio is {snr[k]:.2g}."
        ),
    )
    check(
        (z > limits.significance) & (np.abs(ratio - 1) > limits.slope),
        lambda k: (
            f"Over the scatter the metric follows "
            f"`{names[k]}` with slope {slope[k]:.3g}, not with the mean derivative {mean[k]:.3g}: it jumps or has kinks."
        ),
    )
    check(
        tail > limits.tail,
        lambda k: (
            f"A few motions within the scatter have derivatives by `{names[k]}` "
            f"{tail[k]:.0f} times the median: their mean means little."
        ),
    )
    if second is not None and other is not None:
        gap = step * unit * np.abs(other - gradient)
        if value - second < np.max(gap) and np.any(np.abs(other - gradient) > limits.slope * np.abs(gradient)):
            reasons.append(
                f"Two peaks tie: {value:.6g} and {second:.6g}, with different slopes. Use `Peak(signal, 2)`."
            )
    motion = _motion(mechanism, names, scatter * unit, t1, {**options, "rtol": rtol}, limits)
    exponent, horizon, precision = motion
    if horizon < t1:
        reasons.append(
            f"Neighbouring motions within the scatter have parted by t = {horizon:.3g} s, before the end at "
            f"{float(t1):.3g} s: beyond, a derivative says nothing of them."
        )
    fewest, most, slowest, miss = _impact_counts(
        mechanism, centre + np.concatenate([0 * draws[:1], draws]), names, t1, options
    )
    multipliers = None
    if period is not None:
        from clearance_jax.periodic import periodic_motion

        multipliers = periodic_motion(mechanism, period).multipliers
    smoothed = bool(reasons) and on_untrusted == "smooth"
    report = GradientReport(
        value=jnp.asarray(value),
        gradient=jnp.asarray(slope if smoothed else gradient),
        gradient_error=jnp.asarray(slope_error if smoothed else digits * np.abs(gradient)),
        digits=jnp.asarray(digits),
        linearity=jnp.asarray(linearity),
        signal_to_noise=jnp.asarray(snr),
        slope_ratio=jnp.asarray(ratio),
        slope_z=jnp.asarray(z),
        heavy_tail=jnp.asarray(tail),
        lyapunov=jnp.asarray(exponent),
        horizon=jnp.asarray(horizon),
        precision_horizon=jnp.asarray(precision),
        impacts=(fewest, most),
        slowest_impact=jnp.asarray(slowest),
        nearest_miss=jnp.asarray(miss),
        multipliers=multipliers,
        names=names,
        reasons=tuple(reasons),
        smoothed=smoothed,
    )
    if reasons and on_untrusted == "raise":
        raise ClearanceError("This gradient is not to be trusted. " + " ".join(reasons))
    if reasons and on_untrusted == "warn":
        warnings.warn("This gradient is not to be trusted. " + " ".join(reasons), UntrustedGradient, stacklevel=2)
    return report


def regression(moves: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of `values` (samples,) over `moves` (samples, parameters) by least squares, and their standard errors."""
    columns = np.concatenate([np.ones((len(moves), 1)), moves / moves.std(0)], 1)
    fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ fit
    freedom = max(len(values) - columns.shape[1], 1)
    covariance = np.linalg.pinv(columns.T @ columns) * (left @ left) / freedom
    return fit[1:] / moves.std(0), np.sqrt(np.diag(covariance))[1:] / moves.std(0)


# Samples of the pins' spread over the motion.
_SAMPLES = 200


def _motion(mechanism, names, scatter, t1, options, limits):
    if not mechanism.clearance_joints():
        return 0.0, np.inf, np.inf
    times, spread = spreads(mechanism, names, jnp.asarray(scatter), t1, options, _SAMPLES)
    exponent, horizon = horizon_of(np.asarray(times), np.asarray(spread), limits.spread)
    grows = exponent * float(t1 - options.get("t0", 0.0)) > 1
    return exponent, horizon, np.log(1 / options["rtol"]) / exponent if grows else np.inf


def _impact_counts(mechanism, points, names, t1, options):
    if not mechanism.clearance_joints():
        return 0, 0, np.inf, np.inf
    seen = _touches(mechanism, jnp.asarray(points), names, t1, options)
    counts = np.sum([np.asarray(joint.count) for joint in seen], axis=0)
    slowest = min(float(joint.slowest[0]) for joint in seen)
    return int(counts.min()), int(counts.max()), slowest, min(float(joint.nearest_miss[0]) for joint in seen)
