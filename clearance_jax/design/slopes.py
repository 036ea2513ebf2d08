"""Slopes that say nothing: those of a chaotic motion are exact, and of no use to a search."""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# A limit that would change by its own size where a variable changes by a hundredth is none that slopes describe.
STEEPEST = 100.0
# Limits below this share of their bounds do not decide.
NEAR = 0.5


class UselessSlopes(Exception):
    """The slopes of a point say nothing of its neighbours; the message says why."""


def check_slopes(program: Program, point: Evaluation) -> None:
    """Raise `UselessSlopes` where a limit that may decide is steeper than any that a search can follow."""
    if point.jacobian is None or not np.all(np.isfinite(point.limits)):
        return
    with np.errstate(invalid="ignore"):
        steep = np.abs(np.nan_to_num(point.jacobian * point.x, nan=np.inf)).max(axis=1) / (1 + np.abs(point.limits))
    k = int(np.argmax(np.where(point.limits > NEAR - 1, steep, 0.0)))
    if point.limits[k] > NEAR - 1 and steep[k] > STEEPEST:
        raise UselessSlopes(
            f"slopes are useless here: by its slope, {program.limit_names[k]} would change {0.01 * steep[k]:.1g} times "
            "its own size where a variable changes by 1 %. Neighbouring motions move apart (chaos, ringing)"
        )
