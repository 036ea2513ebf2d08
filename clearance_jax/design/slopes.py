"""Slopes that say nothing: those of a chaotic motion are exact, and of no use to a search."""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# A limit that would change by its own size where a variable changes by a hundredth is none that slopes describe.
STEEPEST = 100.0
# The same of a lower peak: it loses nothing by the slopes of the highest one, and would hold up a search for nothing.
LOWER_STEEPEST = 5.0
# Limits below this share of their bounds do not decide.
NEAR = 0.5


class UselessSlopes(Exception):
    """The slopes of a point say nothing of its neighbours; the message says why."""


def followed(program: Program, point: Evaluation) -> Evaluation:
    """A point with the slopes that a search can follow.

    A steep limit that does not decide is judged by its values alone. A lower peak of a motion never decides before the
    highest one, so it takes the slopes of that one. A limit far below its bound takes none.

    **Raises:** `UselessSlopes` where a limit that may decide is steeper than any that a search can follow.
    """
    if point.jacobian is None or not np.all(np.isfinite(point.limits)):
        return point
    with np.errstate(invalid="ignore"):
        steep = np.abs(np.nan_to_num(point.jacobian * point.x, nan=np.inf)).max(axis=1) / (1 + np.abs(point.limits))
    leads = program.leaders == np.arange(len(steep))
    useless = steep > np.where(leads, STEEPEST, LOWER_STEEPEST)
    if not np.any(useless):
        return point
    decides = useless & leads & (point.limits > NEAR - 1)
    if np.any(decides):
        k = int(np.argmax(np.where(decides, steep, 0.0)))
        raise UselessSlopes(
            f"slopes are useless here: by its slope, {program.limit_names[k]} would change {0.01 * steep[k]:.1g} times "
            "its own size where a variable changes by 1 %. Neighbouring motions move apart (chaos, ringing)"
        )
    rows = np.where((useless & leads)[:, None], 0.0, point.jacobian)
    return point._replace(jacobian=np.where((useless & ~leads)[:, None], rows[program.leaders], rows))
