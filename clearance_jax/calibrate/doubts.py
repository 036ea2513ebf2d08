"""Doubts about a fit, in sentences: residuals unlike noise, misleading derivatives, undetermined numbers."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from clearance_jax.calibrate.confidence import Confidence, Unidentified
from clearance_jax.calibrate.fit import FitResult, FitTask
from clearance_jax.calibrate.residuals import ResidualCheck, residuals_of
from clearance_jax.units import format_quantity

# Share of steps that gained much less than predicted from which on this is told, and the least number of steps.
MISLED, MANY = 0.5, 4
# A number lies at a bound if it is nearer than this part of its size.
AT_BOUND = 1e-6
# The example of a change along an undetermined direction, over the numbers' sizes.
EXAMPLE = 0.1


def doubts(task: FitTask, fit: FitResult, known: Confidence) -> Iterator[str]:
    """The doubts that a user must know before using the numbers."""
    if not fit.converged:
        yield f"The search has not converged: {fit.ending}. The numbers are those of the best motion so far."
    yield from (_undetermined(group, task.variables.units) for group in known.unidentified)
    yield from _at_bounds(task, fit)
    every = residuals_of(task, fit)
    exact = [check.name for check in every if check.exact]
    if exact:
        yield (
            f"The residuals of {listed(exact)} are no larger than the errors of the solves: the intervals are a rough "
            "guess. Choose a smaller `rtol`."
        )
    inexact = [check for check in every if not check.exact]
    yield from _sizes([check for check in every if check.given or not check.exact])
    yield from _correlated(inexact, known)
    if fit.steps >= MANY and fit.doubtful > MISLED * fit.steps:
        yield (
            f"{fit.doubtful} of {fit.steps} steps of the search brought less than a quarter of the improvement that "
            "the derivatives predicted: the derivatives may be misleading, as in chaotic motion. Measure a shorter "
            "time, or try more starts."
        )
    if known.bent:
        yield (
            f"At the ends of the intervals, mainly of {listed(known.bent)}, the motion is not the one that the "
            "derivatives predict. These intervals are those of the motion itself; the deviations and correlations are "
            "a rough guess."
        )


def listed(names: Sequence[str]) -> str:
    """Names as a list in a sentence."""
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
    known = len(group.names) - len(group.directions)
    combinations = "one combination" if known == 1 else f"{known} combinations"
    return (
        f"The data cannot tell {listed(group.names)} apart: only {combinations} of them can be determined{how}. Fix "
        "one of them, or measure something else."
    )


def _at_bounds(task: FitTask, fit: FitResult) -> Iterator[str]:
    variables, x = task.variables, fit.point.x
    near = np.minimum(x - variables.lower, variables.upper - x) <= AT_BOUND * variables.sizes(x)
    names = [name for name, there in zip(variables.names, near, strict=True) if there]
    if names:
        verb, its = ("lies at a bound", "its interval") if len(names) == 1 else ("lie at bounds", "their intervals")
        yield f"{listed(names)} {verb}: a better value may lie beyond, and {its} cannot be trusted. Widen the bounds."


def _sizes(every: Sequence[ResidualCheck]) -> Iterator[str]:
    """Sentences about residuals that are larger or smaller than the noise."""
    for check in every:
        times, square = f"{np.sqrt(check.size):.3g} times as large as", f"(reduced chi-square {check.size:.3g})"
        if check.size > check.high and check.given:
            yield (
                f"The residuals of `{check.name}` are {times} its noise {square}: the model is wrong, there are "
                "outliers, or the noise is larger than the given deviation."
            )
        elif check.size > check.high:
            yield (
                f"The residuals of `{check.name}` are {times} the noise that the readings themselves show, from one "
                "instant to the next: the model is wrong, there are outliers, or the noise is not independent."
            )
        if check.size < check.low:
            yield (
                f"The residuals of `{check.name}` are only {np.sqrt(check.size):.2g} times as large as its noise "
                f"{square}: the noise is smaller than the given deviation. The intervals are too wide."
            )


def _correlated(every: Sequence[ResidualCheck], known: Confidence) -> Iterator[str]:
    """Sentences about series whose residuals are correlated in time."""
    for check in every:
        if check.correlated:
            yield (
                f"The residuals of `{check.name}` follow each other (their correlation from one instant to the next is "
                f"{check.follows:.2f}, that of independent noise is 0 ± {1 / np.sqrt(check.count):.2f}): the model "
                "lacks an effect, or the noise is not independent. The intervals are made wider by the factor "
                f"{np.sqrt(known.memory):.2g}, but if the model is wrong the truth may lie outside of them."
            )
