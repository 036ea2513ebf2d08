"""Where the ideal mechanism has its marks while the actual one moves: what errors in a dataset refer to."""

from typing import NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.ideal import freedom
from clearance_jax.results import blocks
from clearance_jax.results.places import marks
from clearance_jax.solve.solution import Solution

FREE = (
    "the ideal mechanism moves freely, and its motion is not known: give it, "
    "`to_dataset(..., ideal=simulate(mechanism.ideal(), t1, save_at=...))`"
)


class IdealPlaces(NamedTuple):
    """Places `at` [m], (times, marks, axes), of the marks on the ideal mechanism; `None`: not known, and `reason` why."""

    at: np.ndarray | None
    reason: str = ""


def ideal_places(mechanism: Mechanism, time: np.ndarray, y: np.ndarray, ideal: Solution | None) -> IdealPlaces:
    """The places of all marks on the ideal mechanism at the times [s] of states `y`.

    **Arguments:** `ideal`: the motion of `mechanism.ideal()` at these times, where it moves freely.

    **Raises:** `ClearanceError` for an `ideal` at other times.
    """
    if not mechanism.clearance_joints():
        return IdealPlaces(None, "the mechanism is ideal itself")
    if ideal is not None:
        if np.shape(ideal.time) != time.shape or not np.array_equal(np.asarray(ideal.time), time):
            raise ClearanceError("`ideal` has other times than the solution. Solve it with the same `save_at`.").about(
                "ideal"
            )
        return IdealPlaces(blocks.in_blocks(blocks.mark_places, mechanism.ideal(), time, np.asarray(ideal.y)))
    try:
        if freedom(mechanism.ideal()) > 0:
            return IdealPlaces(None, FREE)
    except ClearanceError as error:
        return IdealPlaces(None, str(error))
    return IdealPlaces(blocks.in_blocks(blocks.ideal_mark_places, mechanism, time, y))


def position_errors(mechanism: Mechanism, positions: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The distance [m], (times, points), of each named point from its place among the ideal marks `at`."""
    names = [mark.name for mark in marks(mechanism)]
    return np.linalg.norm(positions - at[:, [names.index(point.name) for point in mechanism.points]], axis=-1)
