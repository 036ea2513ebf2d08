"""Trajectories: a CSV file of times and joint coordinates to drives. Every message names file, line and column."""

import csv
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.io.files import LARGEST_TABLE, read_text
from clearance_jax.io.kinds import check_text
from clearance_jax.mechanism.driving import drivable
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion_laws import Spline
from clearance_jax.units import to_si

TIME = "time"
# Every time of the table ends a step of the solve, and each step looks at all of them.
MOST_ROWS, LEAST_ROWS = 100_000, 4
LONGEST_LINE = 100_000
MEANT = {"s": "time", "rad": "angle", "m": "length"}
_HEAD = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")
_EXAMPLE = "`time [s], hip [deg], knee [deg]`"


class Trajectory(NamedTuple):
    """A trajectory file, and the drives that it gives, by the coordinates that they are of."""

    path: Path
    drives: dict[str, Spline]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, which all of its drives have in common [s]."""
        times = next(iter(self.drives.values())).times
        return float(times[0]), float(times[-1])


class Line(NamedTuple):
    """A line that says something: its text, and how messages name it."""

    text: str
    where: str


class Head(NamedTuple):
    """A cell of the header: a column's name, its unit (`None`: that of SI), and how messages name it."""

    name: str
    unit: str | None
    where: str


def read_trajectory(
    path: str | Path, mechanism: Mechanism | None = None, ends: str = "not-a-knot"
) -> dict[str, Spline]:
    """Drives from a trajectory file, by the names of their coordinates. Give them to `mechanism.driven`.

    The file is a CSV file in UTF-8. Its header has a column `time` and one for each joint, with units in brackets (`hip
    [deg]`; without them s, rad and m). It has at least four rows. Empty lines, and those that begin with `#`, are
    ignored.

    **Arguments:** `path`: of the file; `mechanism`: whose coordinates the columns must be, with units that fit; `ends`:
    what holds at both ends of the splines, "not-a-knot", "natural" (q'' = 0) or "clamped" (at rest).

    **Raises:** `ClearanceError` naming file, line and column. A file is read completely or not at all.
    """
    path = Path(path)
    head, *rows = _lines(path)
    columns = _header(head)
    units = _units(mechanism)
    scales = np.array([_scale(column, units) for column in columns])
    if len(rows) < LEAST_ROWS:
        raise ClearanceError(f"`{path}` has {len(rows)} rows of numbers, but a spline needs {LEAST_ROWS}. Add some.")
    with np.errstate(over="ignore"):  # what becomes infinite in SI is found below
        table = np.array([_row(line, columns) for line in rows]) * scales
    times = table[:, [column.name for column in columns].index(TIME)]
    _check_times(times, rows)
    with jax.ensure_compile_time_eval():  # numbers stay numbers inside a jitted function
        return {
            column.name: _spline(times, values, ends, f"`{path}`, column `{column.name}`")
            for column, values in zip(columns, table.T, strict=True)
            if column.name != TIME
        }


def _units(mechanism: Mechanism | None) -> dict[str, str] | None:
    """The SI unit of every coordinate that can be driven; `None` where there is no mechanism."""
    if mechanism is None:
        return None
    return {name: "rad" if c.slides is None else "m" for name, c in drivable(mechanism.joints).items()}


# Text to cells -------------------------------------------------------------------------------------------------------


def _lines(path: Path) -> list[Line]:
    """The header, and the rows of numbers as texts."""
    text = read_text(path, "trajectory", LARGEST_TABLE).removeprefix("\ufeff")
    if "\0" in text:
        raise ClearanceError(f"`{path}` is no text, but binary data. Give a CSV file with a header such as {_EXAMPLE}.")
    numbered = enumerate(re.split(r"\r\n|\r|\n", text), start=1)
    lines = [Line(x, f"`{path}`, line {n}") for n, x in numbered if x.strip() and not x.lstrip().startswith("#")]
    if not lines:
        raise ClearanceError(f"`{path}` is empty. Give a CSV file with a header such as {_EXAMPLE}.")
    head, count = lines[0], len(lines) - 1
    if count > MOST_ROWS:
        raise ClearanceError(f"`{path}` has {count} rows, but at most {MOST_ROWS} are read. Thin it out.")
    if "," not in head.text and (mark := next((m for m in ";\t" if m in head.text), "")):
        raise ClearanceError(
            f"{head.where}: columns are separated by {quote(mark)}. Separate them by commas, and write decimals with "
            "a point."
        )
    return lines


def _cells(line: Line) -> list[str]:
    if len(line.text) > LONGEST_LINE:
        raise ClearanceError(f"{line.where} is longer than {LONGEST_LINE} characters. Is it a trajectory?")
    try:
        return [cell.strip() for cell in next(csv.reader([line.text], skipinitialspace=True, strict=True))]
    except csv.Error as error:
        raise ClearanceError(f"{line.where}: its cells cannot be told apart ({error}).") from None


# Header --------------------------------------------------------------------------------------------------------------


def _header(line: Line) -> list[Head]:
    cells, where = _cells(line), line.where
    if all(_is_number(cell) for cell in cells):
        raise ClearanceError(f"{where} must be a header such as {_EXAMPLE}, but it has numbers only. Add one above it.")
    columns: dict[str, Head] = {}
    for i, cell in enumerate(cells, start=1):
        column = _head(cell, f"{where}, column {i}")
        if column.name in columns:
            raise ClearanceError(f"{column.where}: `{column.name}` has a column already. Take one of them away.")
        columns[column.name] = column
    if TIME not in columns:
        raise ClearanceError(f"{where}: no column is called `{TIME}`. Call one so, as in {_EXAMPLE}.")
    if len(columns) < 2:
        raise ClearanceError(f"{where}: the header has no joint beside `{TIME}`. Add a column for each joint.")
    return list(columns.values())


def _head(cell: str, where: str) -> Head:
    match = _HEAD.fullmatch(cell)
    if match is None:
        raise ClearanceError(f"{where} must be a name with a unit in brackets, `hip [deg]`, but it is {quote(cell)}.")
    name, unit = match[1].strip(), match[2]
    if not name:
        raise ClearanceError(f"{where} has no name. Name it, or take the comma beside it away.")
    check_text(name, f"{where}, a name,")
    return Head(TIME if name.lower() == TIME else name, None if unit is None else unit.strip(), where)


def _scale(column: Head, units: Mapping[str, str] | None) -> float:
    """By what the column's numbers are multiplied to be in SI; `units`: those of the coordinates that there are."""
    if column.name == TIME:
        allowed = ["s"]
    elif units is None:
        allowed = ["rad", "m"]
    elif column.name in units:
        allowed = [units[column.name]]
    else:
        raise ClearanceError(
            f"{column.where}: there is no coordinate `{column.name}` to drive. " + suggest(column.name, units)
        )
    if column.unit is None:
        return 1.0
    for si in allowed:
        try:
            return to_si(f"1 {column.unit}", si, column.where)
        except ClearanceError:
            continue
    meant = " or ".join(MEANT[si] for si in allowed)
    raise ClearanceError(f"{column.where}: `{column.name}` must be in a unit of {meant}, not in {quote(column.unit)}.")


# Numbers -------------------------------------------------------------------------------------------------------------


def _row(line: Line, columns: list[Head]) -> list[float]:
    cells = _cells(line)
    if len(cells) != len(columns):
        hint = " Are there decimal commas?" if len(cells) > len(columns) else ""
        raise ClearanceError(f"{line.where} has {len(cells)} cells, but the header has {len(columns)} columns.{hint}")
    return [_number(cell, f"{line.where}, column `{c.name}`") for cell, c in zip(cells, columns, strict=True)]


def _number(cell: str, where: str) -> float:
    if not _is_number(cell):
        said = f"it is {quote(cell)}" if cell else "nothing is there"
        raise ClearanceError(f"{where} must be a number, but {said}.")
    value = float(cell)
    if not math.isfinite(value):
        raise ClearanceError(f"{where} must be finite, but it is {quote(cell)}.")
    return value


def _is_number(cell: str) -> bool:
    """Whether Python reads it as a number; `1_000`, which only a program would write so, is none."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _check_times(times: np.ndarray, lines: list[Line]) -> None:
    with np.errstate(all="ignore"):
        stays = np.flatnonzero(~(np.diff(times) > 0))
    if stays.size:
        i = int(stays[0]) + 1
        raise ClearanceError(
            f"{lines[i].where}, column `{TIME}`: times must increase, but {times[i]:.9g} s follows "
            f"{times[i - 1]:.9g} s."
        )


def _spline(times: np.ndarray, values: np.ndarray, ends: str, where: str) -> Spline:
    with np.errstate(all="ignore"):
        bends = np.diff(np.diff(values) / np.diff(times)) / (times[2:] - times[:-2])
    # A spline bends by no more than some times that.
    if not np.all(np.abs(bends) < 1e150):
        raise ClearanceError(f"{where}: its numbers are too large, or its times too close, for a spline.")
    return Spline(times, values, ends)
