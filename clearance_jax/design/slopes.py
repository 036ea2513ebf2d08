"""Detection of useless slopes: those of a chaotic motion are exact, but a search cannot follow them."""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# The steepest slope, in logarithms: the limit changes by its own size if a variable changes by 1 %.
STEEPEST = 100.0
# The same for a lower peak, which can use the slopes of the highest one instead.
LOWER_STEEPEST = 5.0
# Limits below this share of their bounds do not decide.
NEAR = 0.5


class UselessSlopes(Exception):
    """Raised if the slopes of a point do not predict its neighbours; the message says why."""


def followed(program: Program, point: Evaluation) -> Evaluation:
    """A point with the slopes that a search can follow.

    A lower peak of a motion with useless slopes takes those of the highest one, as it never decides before that. A
    limit far below its bound takes slopes of zero.

    **Raises:** `UselessSlopes` if a limit that may decide has useless slopes.
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
