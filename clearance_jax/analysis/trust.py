"""Tests of whether an optimiser can trust a derivative: an exact derivative of a chaotic motion is useless to it.

`gradient_report` checks at a design that the derivative does not change with the tolerance; that the metric follows it
over the intended step and within it; that it is the same over the scatter of made parts; and that it agrees with the
slope of the metric over that scatter, which shows jumps and kinks. It also measures how fast neighbouring motions
diverge. It compiles two programs, of the metric and of the motion; numbers and `t1` are their arguments.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax.analysis.periodic import periodic_motion
from clearance_jax.analysis.scatter import MetricSamples, SamplingPlan, Statistics, divergence, sample, statistics
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import as_metric
from clearance_jax.metrics.reductions import AbstractMetric
from clearance_jax.parameters import values_of
from clearance_jax.solve.settings import ALL, SolveOptions, settings_of


class TrustThresholds(Module):
    """The thresholds of the tests of a derivative. Their defaults were chosen on cases for which the right verdict is
    known (`experiments/trust`).
    """

    digits: float = 1e-3
    """Largest relative difference between tolerances rtol and rtol/10."""
    linearity: float = 0.5
    """Largest |change - predicted| / |predicted| over the intended step."""
    departure: float = 0.5
    """Largest |change - predicted| within the step, over the change that is predicted for the whole step."""
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
# Options of `gradient_report`: its derivatives are always error-controlled.
KNOWN = tuple(name for name in ALL if name != "derivatives")


# Fields of a report that are as in `Statistics`, and as in `Divergence`.
TESTED = ("digits", "linearity", "departure", "signal_to_noise", "slope_ratio", "slope_z", "heavy_tail")
PARTING = ("lyapunov", "horizon", "precision_horizon", "slowest_impact", "nearest_miss")


class UntrustedGradient(UserWarning):
    """A warning that a derivative cannot be trusted. The message says why."""


class GradientReport(Module):
    """A gradient, with the results of the tests of whether it can be trusted.

    - `value`: the metric; `gradient` (parameters,), in the order of `names`; `gradient_error` (parameters,): an
      estimate of its error. With `on_untrusted="smooth"` an untrusted gradient is replaced by the slope of the metric
      over the scatter, and `smoothed` is true.
    - `trusted`: the verdict; `reasons`: a sentence for every test that failed.
    - `digits`: relative difference of the gradients at rtol and rtol/10.
    - `linearity` (parameters,): difference between the change of the metric over a step and the change that the
      gradient predicts, relative to the latter.
    - `departure`: the largest such difference at any of the `probes` within the step, where all parameters change
      together, relative to the change that the gradient predicts for a step by all of them.
    - `signal_to_noise`, `slope_ratio` (slope of the metric over the scatter, over the mean derivative), `slope_z`
      (their difference in standard errors), all (parameters,); `heavy_tail`: the largest derivative over the median
      one.
    - `lyapunov`: finite-time exponent [1/s]; `horizon`: the time after which neighbours within the scatter are no
      longer alike [s] (infinite: not in sight); `precision_horizon`: the time after which an error of rtol has grown to
      the size of the motion [s].
    - `impacts`: fewest and most impacts over the scatter; `slowest_impact` [m/s]; `nearest_miss` [m].
    - `multipliers`: of the periodic motion, if a `period` was given.
    """

    value: Array
    gradient: Float[Array, " parameters"]
    gradient_error: Float[Array, " parameters"]
    digits: Array
    linearity: Float[Array, " parameters"]
    departure: Array
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


def _check(mechanism, wrt, samples, probes, on_untrusted) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and values of the parameters. **Raises** `ClearanceError` for arguments that are not allowed."""
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    given = values_of(mechanism, names)
    if any(number.ndim for number in given.values()):
        raise ClearanceError("`gradient_report` wants scalars: name the entries of an array, `name.0`.")
    if samples < (fewest := len(names) + 3):
        raise ClearanceError(f"{len(names)} parameters need `samples` of at least {fewest}, not {samples}.")
    if probes < 0:
        raise wrong_value("`probes`", "0 or more", probes, str(probes))
    if on_untrusted not in ("ignore", "warn", "raise", "smooth"):
        raise ClearanceError(f"There is no on_untrusted={on_untrusted!r}. Allowed: ignore, warn, raise, smooth.")
    return names, np.array([float(v) for v in given.values()])


def _doubts(
    plan: SamplingPlan, thresholds: TrustThresholds, seen: MetricSamples, stats: Statistics, k: int
) -> Iterator[str]:
    """The tests that the derivative by the k-th parameter fails, as sentences."""
    name, mean = plan.names[k], stats.mean[k]
    if not stats.linearity[k] <= thresholds.linearity:
        yield (
            f"A step of {plan.step:.0%} in `{name}` changes the metric by {seen.up[k]:.3g} and {seen.down[k]:.3g}, "
            f"where the gradient predicts +-{abs(stats.predicted[k]):.3g}."
        )
    if stats.signal_to_noise[k] < thresholds.signal_to_noise:
        yield (
            f"Over a scatter of {plan.scatter:.0%} the derivative by `{name}` is {mean:.3g} +- "
            f"{stats.deviation[k]:.3g}: its signal-to-noise ratio is {stats.signal_to_noise[k]:.2g}."
        )
    if stats.slope_z[k] > thresholds.significance and abs(stats.slope_ratio[k] - 1) > thresholds.slope:
        yield (
            f"Over the scatter the metric follows `{name}` with slope {stats.slope[k]:.3g}, not with the mean "
            f"derivative {mean:.3g}: it jumps or has kinks."
        )
    if stats.heavy_tail[k] > thresholds.tail:
        yield (
            f"A few motions within the scatter have derivatives by `{name}` {stats.heavy_tail[k]:.0f} times the "
            "median: their mean means little."
        )


def _tie(plan: SamplingPlan, thresholds: TrustThresholds, seen: MetricSamples, judged: np.ndarray) -> Iterator[str]:
    """A sentence about two peaks that tie and have different slopes, if one overtakes the other within the step."""
    if seen.second is None:
        return
    value, gradient = seen.second
    apart = np.abs(gradient - seen.gradient)
    near = seen.value - value < np.max(plan.step * plan.unit * apart)
    if near and np.any(judged & (apart > thresholds.slope * np.abs(seen.gradient))):
        yield f"Two peaks tie: {seen.value:.6g} and {value:.6g}, with different slopes: use `Peak(signal, 2)`."


def _reasons(plan: SamplingPlan, thresholds: TrustThresholds, seen: MetricSamples, stats: Statistics) -> list[str]:
    """A sentence for every test that failed; after these, whether a tie of peaks explains it."""
    reasons = [] if seen.complete else ["Some motions near this design could not be solved to the end."]
    # Changes that the solve cannot resolve, or that are small beside another parameter's, are not judged.
    change = np.max(np.abs([stats.predicted, seen.up, seen.down]), axis=0)
    judged = change > max(thresholds.minor * np.max(change), plan.rtol * abs(seen.value))
    if stats.digits > thresholds.digits and np.any(judged):
        reasons.append(f"The gradient changes by {stats.digits:.1g} of itself when the tolerance is ten times tighter.")
    if stats.departure > thresholds.departure and np.any(judged):
        reasons.append(
            f"Within the step of {plan.step:.0%} the metric is up to {stats.departed:.3g} away from what the gradient "
            f"predicts, which is {np.sum(np.abs(stats.predicted)):.3g} for the whole step: it jumps there, or another "
            "motion begins."
        )
    for k in np.flatnonzero(judged).tolist():
        reasons += _doubts(plan, thresholds, seen, stats, k)
    # An explanation, not a test: a tie in which no peak overtakes the other does not disturb an optimiser.
    if reasons:
        reasons += _tie(plan, thresholds, seen, judged)
    return reasons


def gradient_report(
    mechanism: Mechanism,
    metric: AbstractMetric | Callable,
    wrt: Sequence[str],
    t1: Any,
    *,
    step: float = 0.02,
    probes: int = 96,
    scatter: float = 0.01,
    samples: int = 16,
    period: Any = None,
    seed: int = 0,
    thresholds: TrustThresholds = THRESHOLDS,
    on_untrusted: Literal["ignore", "warn", "raise", "smooth"] = "warn",
    **options: Unpack[SolveOptions],
) -> GradientReport:
    """The gradient of a scalar metric by named scalar parameters, and tests of whether an optimiser can trust it.

    **Arguments:**

    - `mechanism`, `metric`, `wrt`, `t1` [s]: as of `sensitivities`.
    - `step`: the change that an optimiser would make, relative to each parameter (absolute for a parameter of zero).
    - `probes`: at so many points within the step the metric is compared with what the gradient predicts. The points of
      each parameter are evenly spaced, 2 `step` / `probes` apart. An island of other motion that is wider is seen; a
      narrower one may lie between two points.
    - `scatter`: the standard deviation of made parts, given in the same way. `samples` of it are drawn with one `seed`,
      the same for all designs (common random numbers).
    - `period`: of a periodic drive [s]: adds the Floquet multipliers.
    - `thresholds`: those of the tests (`TrustThresholds`).
    - `on_untrusted`: "warn" (`UntrustedGradient`), "raise" (`ClearanceError`), "ignore", or "smooth": return the slope
      of the metric over the scatter instead, by least squares.
    - `options`: as `simulate`'s, without `derivatives`.

    **Raises:** `ClearanceError` for unknown names or options, parameters that are arrays, a metric of several numbers,
    too few samples, and a law of class C-1; `RuntimeError` if the motion itself, or too many of the scatter, cannot be
    solved to the end.
    """
    names, centre = _check(mechanism, wrt, samples, probes, on_untrusted)
    settings = settings_of(mechanism, t1, options, KNOWN)
    plan = SamplingPlan(names, centre, step, probes, scatter, samples, float(settings.rtol), seed)
    t1 = jnp.asarray(t1, float)
    seen = sample(plan, mechanism, as_metric(metric), t1, settings)
    stats = statistics(plan, seen)
    reasons = _reasons(plan, thresholds, seen, stats)
    parting = divergence(plan, mechanism, seen.draws, t1, thresholds.spread, settings)
    # An explanation, not a test: a large spread that stays linear does not disturb an optimiser.
    if reasons and parting.horizon < t1:
        reasons.append(
            f"Neighbouring motions within the scatter have parted by t = {parting.horizon:.3g} s, before the end at "
            f"{float(t1):.3g} s: beyond, a derivative says nothing of them."
        )
    cycle_options = {"t0": settings.t0, "solver": settings.solver}
    smoothed = bool(reasons) and on_untrusted == "smooth"
    report = GradientReport(
        value=jnp.asarray(seen.value),
        gradient=jnp.asarray(stats.slope if smoothed else seen.gradient),
        gradient_error=jnp.asarray(stats.slope_error if smoothed else stats.error),
        **{name: jnp.asarray(getattr(stats, name)) for name in TESTED},
        **{name: jnp.asarray(getattr(parting, name)) for name in PARTING},
        impacts=parting.impacts,
        multipliers=None if period is None else periodic_motion(mechanism, period, **cycle_options).multipliers,
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
