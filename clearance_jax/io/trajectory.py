"""Reads trajectories, CSV files of times and joint coordinates, as drives, and writes them."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value
from clearance_jax.io.files import MOST_ROWS, TIME, Head, Meant, read_columns
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw, Spline
from clearance_jax.mechanism.variants import drivable, gives_way, motor_of
from clearance_jax.units import to_si

# Rows that a spline needs.
LEAST_ROWS = 4
MEANT = {"s": "time", "rad": "angle", "m": "length"}
_TABLE = Meant("trajectory", "joint", "`time [s], hip [deg], knee [deg]`")


class Trajectory(NamedTuple):
    """A trajectory file, and the drives that it gives, by the coordinates that they are of."""

    path: Path
    drives: dict[str, Spline]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of its drives [s]."""
        times = next(iter(self.drives.values())).times
        return float(times[0]), float(times[-1])


def read_trajectory(
    path: str | Path, mechanism: Mechanism | None = None, ends: str = "not-a-knot"
) -> dict[str, Spline]:
    """Drives from a trajectory file, by the names of their coordinates. Give them to `mechanism.with_drives`.

    The file is a CSV file in UTF-8. Its header has a column `time` and one for each joint, with units in brackets (`hip
    [deg]`; without them s, rad and m). It has at least four rows. Empty lines, and those that begin with `#`, are
    ignored. A column of a joint whose drive gives way is the motion of its motor.

    **Arguments:** `path`: of the file; `mechanism`: whose coordinates the columns must be, with units that fit; `ends`:
    what holds at both ends of the splines, "not-a-knot", "natural" (q'' = 0) or "clamped" (at rest).

    **Raises:** `ClearanceError` naming file, line and column. A file is read completely or not at all.
    """
    path = Path(path)
    columns, rows, table = read_columns(path, _TABLE)
    known = None if mechanism is None else drivable(mechanism.joints)
    units = None if known is None else {name: "rad" if c.slides is None else "m" for name, c in known.items()}
    scales = np.array([_scale(column, units) for column in columns])
    if len(rows) < LEAST_ROWS:
        raise ClearanceError(f"`{path}` has {len(rows)} rows of numbers, but a spline needs {LEAST_ROWS}. Add some.")
    with np.errstate(over="ignore"):  # what becomes infinite in SI is found below
        table = table * scales
    times = table[:, [column.name for column in columns].index(TIME)]
    with np.errstate(all="ignore"):
        stays = np.flatnonzero(~(np.diff(times) > 0)) + 1
    for i in stays[:1]:
        order = f"{times[i]:.9g} s follows {times[i - 1]:.9g} s"
        raise ClearanceError(f"{rows[i].where}, column `{TIME}`: times must increase, but {order}.")
    with jax.ensure_compile_time_eval():  # numbers stay numbers inside a jitted function
        drives = {
            column.name: _spline(times, values, ends, f"`{path}`, column `{column.name}`")
            for column, values in zip(columns, table.T, strict=True)
            if column.name != TIME
        }
    return drives if mechanism is None else _of_motors(drives, mechanism, path)


def _of_motors(drives: dict[str, Spline], mechanism: Mechanism, path: Path) -> dict[str, Spline]:
    """The drives; those of compliant drives by the names of their motors."""
    known, motors = drivable(mechanism.joints), {}
    for name, drive in drives.items():
        moved = motor_of(name) if gives_way(known[name].motion) else name
        if moved != name and moved in drives:
            why = f"the columns `{name}` and `{moved}` move the same motor"
            raise ClearanceError(f"`{path}`: {why}. Take one of them away.").about(name, moved)
        motors[moved] = drive
    return motors


def _scale(column: Head, units: Mapping[str, str] | None) -> float:
    """The factor from a column's unit to SI; `units`: SI units of the known coordinates."""
    if column.name == TIME:
        allowed = ["s"]
    elif units is None:
        allowed = ["rad", "m"]
    elif column.name in units:
        allowed = [units[column.name]]
    else:
        raise unknown_name(f"{column.where}: there is no coordinate `{column.name}` to drive.", column.name, units)
    if column.unit is None:
        return 1.0
    for si in allowed:
        with contextlib.suppress(ClearanceError):
            return to_si(f"1 {column.unit}", si, column.where)
    meant = " or ".join(MEANT[si] for si in allowed)
    message = f"{column.where}: `{column.name}` must be in a unit of {meant}, not in {quote(column.unit)}."
    raise ClearanceError(message).about(column.name, column.unit)


def _spline(times: np.ndarray, values: np.ndarray, ends: str, where: str) -> Spline:
    with np.errstate(all="ignore"):
        bends = np.diff(np.diff(values) / np.diff(times)) / (times[2:] - times[:-2])
    # The spline's second derivative is at most some times that.
    if not np.all(np.abs(bends) < 1e150):
        raise ClearanceError(f"{where}: its numbers are too large, or its times too close, for a spline.")
    return Spline(times, values, ends)


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
        raise wrong_value("`samples`", f"between {LEAST_ROWS} and {MOST_ROWS}", samples, str(samples))
    times = jnp.linspace(float(t0), float(t1), samples)
    columns = [times]
    for drive in drives.values():
        ready = drive.prepare()
        columns.append(jax.vmap(lambda time, ready=ready: jnp.asarray(ready(time)[0], float))(times))
    lines = [",".join((TIME, *drives)), *(",".join(map(repr, row)) for row in np.stack(columns, 1).tolist())]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
