"""What speaks against a fit, in sentences: residuals unlike noise, misleading derivatives, undetermined numbers."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.stats import chi2, norm

from clearance_jax.calibrate.confidence import Confidence, Unidentified
from clearance_jax.calibrate.fit import INTERRUPTED, Fit, Task
from clearance_jax.units import format_quantity

# How improbable residuals must be, were they noise, before that is said.
IMPROBABLE = 1e-3
# Residuals of which it is asked whether they follow each other, at least.
FEWEST = 10
# From this factor on between what the derivatives predict at the end of an interval and what the motion shows there.
BENT = 2.0
# From this share on of steps that brought much less than predicted, of at least so many.
MISLED, MANY = 0.5, 4
# Nearer to a bound than this part of its size a number lies at it.
AT_BOUND = 1e-6
# A change along an undetermined direction that is told for example, over the numbers' sizes.
EXAMPLE = 0.1


def doubts(task: Task, fit: Fit, known: Confidence) -> Iterator[str]:
    """What a user must know before the numbers are believed; the motions at the ends of intervals are solved for it."""
    if not fit.converged:
        yield f"The search has not converged: {fit.ending}. The numbers are those of the best motion so far."
    yield from (_undetermined(group, task.variables.units) for group in known.unidentified)
    yield from _at_bounds(task, fit)
    exact = list(_exact(task, fit))
    if exact:
        yield (
            f"The residuals of {listed(exact)} are no larger than the errors of the solves: the intervals are a rough "
            "guess. Choose a smaller `rtol`."
        )
    yield from _sizes(task, fit)
    yield from (said for name, said in _autocorrelation(task, fit) if name not in exact)
    if fit.steps >= MANY and fit.doubtful > MISLED * fit.steps:
        yield (
            f"{fit.doubtful} of {fit.steps} steps of the search brought less than a quarter of the improvement that "
            "the derivatives predicted: the derivatives may be misleading, as in chaotic motion. Measure a shorter "
            "time, or try more starts."
        )
    try:
        yield from () if exact or fit.ending == INTERRUPTED else _bends(task, fit, known)
    except KeyboardInterrupt:
        yield "Interrupted: the motion at the ends of the intervals was not compared with what the derivatives predict."


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _undetermined(group: Unidentified, units: Mapping[str, str]) -> str:
    if len(group.names) == 1:
        return (
            f"The data do not determine {listed(group.names)}: its interval is larger than the number itself, or than "
            "its bounds. Fix it, or measure something that depends on it."
        )
    if len(group.directions) == len(group.names):
        return (
            f"The data do not determine {listed(group.names)}, nor any combination of them. Fix them, or measure more."
        )
    how = ""
    if len(group.directions) == 1:
        parts = zip(group.names, group.directions[0], strict=True)
        changes = ", ".join(f"{name} by {format_quantity(EXAMPLE * part, units[name], 3)}" for name, part in parts)
        how = f" (change {changes}: the readings stay the same within the noise)"
    return (
        f"The data cannot tell {listed(group.names)} apart: only {_count(len(group.names) - len(group.directions))} of "
        f"them can be determined{how}. Fix one of them, or measure something else."
    )


def _count(combinations: int) -> str:
    return "one combination" if combinations == 1 else f"{combinations} combinations"


def _at_bounds(task: Task, fit: Fit) -> Iterator[str]:
    variables, x = task.variables, fit.point.x
    near = np.minimum(x - variables.lower, variables.upper - x) <= AT_BOUND * variables.sizes(x)
    names = [name for name, there in zip(variables.names, near, strict=True) if there]
    if names:
        verb, its = ("lies at a bound", "its interval") if len(names) == 1 else ("lie at bounds", "their intervals")
        yield f"{listed(names)} {verb}: a better value may lie beyond, and {its} cannot be trusted. Widen the bounds."


def _sizes(task: Task, fit: Fit) -> Iterator[str]:
    """Whether residuals are as large as the deviations that are given say, series by series."""
    share = len(task.variables.names) / np.sum(task.measurement.known)
    square, freedom_each = task.loss.normal_squares()
    for name, psi, given in zip(_names(task), _influences(task, fit), task.given, strict=True):
        if not given:
            continue
        size = np.mean(psi**2) / (square * (1 - share))
        freedom = freedom_each * len(psi) * (1 - share)
        low, high = chi2.ppf([IMPROBABLE / 2, 1 - IMPROBABLE / 2], freedom) / freedom
        if size > high:
            yield (
                f"The residuals of `{name}` are {np.sqrt(size):.3g} times as large as its noise (reduced chi-square "
                f"{size:.3g}): the model is wrong, there are outliers, or the noise is larger than the given deviation."
            )
        if size < low:
            yield (
                f"The residuals of `{name}` are only {np.sqrt(size):.2g} times as large as its noise (reduced "
                f"chi-square {size:.2g}): the noise is smaller than the given deviation. The intervals are too "
                "wide."
            )


def _exact(task: Task, fit: Fit) -> Iterator[str]:
    """The series whose residuals are the solves' own errors."""
    for one, model in zip(task.measurement.series, fit.point.values.T, strict=True):
        there = np.isfinite(one.values)
        off, values = (model - one.values)[there], one.values[there]
        if np.sqrt(np.mean(off**2)) <= task.floor(values):
            yield one.name


def _autocorrelation(task: Task, fit: Fit) -> Iterator[tuple[str, str]]:
    """Of which series, by name, it must be said that a residual tells the next one: the correlation of N
    independent ones deviates by 1 / sqrt(N) (Anderson 1942, doi 10.1214/aoms/1177731638).
    """
    for name, psi in zip(_names(task), _influences(task, fit), strict=True):
        follows = np.sum(psi[1:] * psi[:-1]) / max(np.sum(psi**2), np.finfo(float).tiny)
        if len(psi) >= FEWEST and follows * np.sqrt(len(psi)) > norm.ppf(1 - IMPROBABLE):
            said = (
                f"The residuals of `{name}` follow each other (their correlation from one instant to the next is "
                f"{follows:.2f}, that of independent noise is 0 ± {1 / np.sqrt(len(psi)):.2f}): the model lacks an "
                "effect, or the noise is not independent. The intervals are then too narrow."
            )
            yield name, said


def _names(task: Task) -> list[str]:
    return [one.name for one in task.measurement.series]


def _influences(task: Task, fit: Fit) -> list[np.ndarray]:
    """Of each series the residuals over their deviations, outliers as the loss counts them."""
    off = (fit.point.values - task.measurement.values) / fit.deviations
    return [task.loss.influence(one[there])[0] for one, there in zip(off.T, task.measurement.known.T, strict=True)]


def _bends(task: Task, fit: Fit, known: Confidence) -> Iterator[str]:
    """Whether the motion differs at the ends of the ellipsoid's axes as the derivatives say."""
    variables, cost = task.variables, task.cost(fit.point, fit.deviations)
    here = task.weigh(fit.point, fit.deviations)
    unsure: set[str] = set()
    undetermined = {name for group in known.unidentified for name in group.names}
    for axis, length in zip(known.axes.T, known.lengths, strict=True):
        main = variables.names[int(np.argmax(np.abs(axis)))]
        step = known.sizes * axis * length
        if main in undetermined or not np.all(np.isfinite(step)):
            continue
        for sign in (-1.0, 1.0):
            x = fit.point.x + sign * step
            if np.any(x <= variables.lower) or np.any(x >= variables.upper):
                continue
            end = task.instruments(x)
            expected = task.loss.cost(here.residuals + sign * here.jacobian @ step) - cost
            found = task.cost(end, fit.deviations) - cost if end.reached else np.inf
            if not expected / BENT <= found <= BENT * expected:
                unsure.add(main)
    if unsure:
        names = [name for name in variables.names if name in unsure]
        yield (
            f"At the ends of the intervals, mainly of {listed(names)}, the motion is not the one that the derivatives "
            "predict: it is too nonlinear there, or the derivatives are misleading. The intervals are a rough guess."
        )
