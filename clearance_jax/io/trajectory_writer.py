"""Writes drives as a trajectory file, for `read_trajectory` and `clearance simulate --trajectory`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.io.columns import MOST_ROWS, TIME
from clearance_jax.io.trajectory import LEAST_ROWS
from clearance_jax.mechanism.motion_laws import AbstractMotionLaw


def write_trajectory(
    path: str | Path, drives: Mapping[str, AbstractMotionLaw], t1: Any, *, t0: Any = 0.0, samples: int = 201
) -> None:
    """Write drives as a CSV file: `samples` rows of times [s] and values [rad or m], with a column for each drive.

    A program that reads the file makes cubic splines of it. Their error falls with the fourth power of the number of
    samples.

    **Arguments:** `path`: of the file; `drives`: by the names of their coordinates, as those of `cj.follow`; `t0`,
    `t1`: the first and the last time [s].

    **Raises:** `ClearanceError` for no drives, for times that do not increase, and for too few or too many samples.
    """
    if not drives:
        raise ClearanceError("There are no drives to write.")
    if not float(t1) > float(t0):
        raise ClearanceError(f"`t1` must be later than `t0`, but they are {t1!r} and {t0!r}.")
    if not LEAST_ROWS <= samples <= MOST_ROWS:
        raise ClearanceError(f"`samples` must be between {LEAST_ROWS} and {MOST_ROWS}, but it is {samples}.")
    times = jnp.linspace(float(t0), float(t1), samples)
    columns = [times]
    for drive in drives.values():
        ready = drive.prepare()
        columns.append(jax.vmap(lambda time, ready=ready: jnp.asarray(ready(time)[0], float))(times))
    lines = [",".join((TIME, *drives)), *(",".join(map(repr, row)) for row in np.stack(columns, 1).tolist())]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
