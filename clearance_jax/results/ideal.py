"""Where the ideal mechanism has its marks while the actual one moves: what errors in a dataset refer to."""

from typing import Any

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


def against_ideal(
    mechanism: Mechanism, time: np.ndarray, y: np.ndarray, seen: dict[str, Any], ideal: Solution | None
) -> tuple[dict[str, np.ndarray], str]:
    """The variables of a dataset that refer to the ideal mechanism, at the times [s] of states `y`; if there are none,
    why.

    **Arguments:** `seen`: the other variables; `ideal`: the motion of `mechanism.ideal()` at these times, where it
    moves freely.

    **Raises:** `ClearanceError` for an `ideal` at other times.
    """
    at, reason = _places(mechanism, time, y, ideal)
    if at is None:
        return {}, reason
    names = [mark.name for mark in marks(mechanism)]
    out = {"ideal_mark_position": at}
    if mechanism.points:
        apart = seen["position"] - at[:, [names.index(point.name) for point in mechanism.points]]
        out["position_error"] = np.linalg.norm(apart, axis=-1)
    return out, ""


def _places(mechanism: Mechanism, time: np.ndarray, y: np.ndarray, ideal: Solution | None) -> tuple[Any, str]:
    """The places of all marks on the ideal mechanism [m], (times, marks, axes); or `None`, and why."""
    if not mechanism.clearance_joints():
        return None, "the mechanism is ideal itself"
    if ideal is not None:
        if np.shape(ideal.time) != time.shape or not np.array_equal(np.asarray(ideal.time), time):
            text = "`ideal` has other times than the solution. Solve it with the same `save_at`."
            raise ClearanceError(text).about("ideal")
        return blocks.in_blocks(blocks.mark_places, mechanism.ideal(), time, np.asarray(ideal.y)), ""
    try:
        if freedom(mechanism.ideal()) > 0:
            return None, FREE
    except ClearanceError as error:
        return None, str(error)
    return blocks.in_blocks(blocks.ideal_mark_places, mechanism, time, y), ""
