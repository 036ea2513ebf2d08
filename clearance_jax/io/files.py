"""Reads text, TOML and CSV files of limited size. Messages name the file, the line and the column."""

import csv
import math
import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError, quote, wrong_value
from clearance_jax.io.keys.kinds import check_text

LARGEST_TOML, LARGEST_TABLE = 2_000_000, 50_000_000
TIME = "time"
# Every time of a trajectory ends a step of the solve, and each step looks at all of them.
MOST_ROWS = 100_000
LONGEST_LINE = 100_000
# Contents of cells without a measurement.
GAPS = ("", "nan", "na")
_HEAD = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")


def read_toml(path: Path, what: str) -> tuple[str, dict[str, Any]]:
    """Text and values of a TOML file; `what`: its name in messages."""
    text = read_text(path, what, LARGEST_TOML)
    try:
        return text, tomllib.loads(text)
    except RecursionError:
        raise ClearanceError(f"`{path}` is not valid TOML: it is nested too deep. Nest a few levels only.") from None
    except ValueError as error:
        raise ClearanceError(f"`{path}` is not valid TOML: {error}.") from None


def read_table(path: Path, where: str, columns: str = "time [s] and value") -> tuple[np.ndarray, np.ndarray]:
    """The two `columns` of a CSV file, shape (rows,) each; `where`: the key that names the file, for messages."""
    text = read_text(path, f"table of {where}", LARGEST_TABLE)
    try:
        rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
        try:
            float(rows[0][0])
        except ValueError:
            rows = rows[1:]
        table = np.array([[float(cell) for cell in row[:2]] for row in rows])
        if not np.all(np.isfinite(table)):
            raise ValueError("not every number is finite")
        return table[:, 0], table[:, 1]
    except (ValueError, IndexError, csv.Error) as error:
        raise ClearanceError(f"{where}: `{path}` must be a CSV table of {columns} ({error}).") from None


def read_text(path: Path, what: str, largest: int) -> str:
    """The text of a file in UTF-8. **Raises** `ClearanceError` as `read_bytes`, and for another text."""
    try:
        text = read_bytes(path, what, largest).decode("utf-8")
    except UnicodeDecodeError:
        raise ClearanceError(f"Cannot read the {what} `{path}`: it is not a text in UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_bytes(path: Path, what: str, largest: int) -> bytes:
    """The content of a file. **Raises** `ClearanceError` if it is too large or no file (a device may never end)."""
    if "\0" in str(path):
        raise ClearanceError(f"Cannot read the {what}: {quote(str(path))} is no path.")
    try:
        if path.exists() and not path.is_file():
            raise ClearanceError(f"Cannot read the {what} `{path}`: it is no file. Give the path of one.")
        if path.stat().st_size > largest:
            raise ClearanceError(f"Cannot read the {what} `{path}`: it is larger than {largest // 1_000_000} MB.")
        return path.read_bytes()
    except OSError as error:
        raise ClearanceError(f"Cannot read the {what} `{path}`: {error.strerror}.") from None


class Meant(NamedTuple):
    """Words for messages about a table: `what` it is, what a `column` holds (times apart), an `example` of a header."""

    what: str
    column: str
    example: str


class CsvLine(NamedTuple):
    """A line with content: its text, and its name in messages."""

    text: str
    where: str


class Head(NamedTuple):
    """A header cell: column name, unit (`None`: SI), and its name in messages."""

    name: str
    unit: str | None
    where: str


class CsvTable(NamedTuple):
    """A CSV table: header, rows as text, and `values`, shape (rows, columns)."""

    heads: list[Head]
    rows: list[CsvLine]
    values: np.ndarray


def read_columns(path: Path, meant: Meant, gaps: bool = False) -> CsvTable:
    """A CSV file in UTF-8 with a header; empty lines and `#` lines are ignored, `gaps` (empty, `nan`) become NaN."""
    head, *rows = _lines(path, meant)
    heads = _header(head, meant)
    values = np.array([_row(line, heads, meant, gaps) for line in rows]).reshape(-1, len(heads))
    return CsvTable(heads, rows, values)


def _lines(path: Path, meant: Meant) -> list[CsvLine]:
    """The lines with content: the header, then the rows."""
    text = read_text(path, meant.what, LARGEST_TABLE).removeprefix("\ufeff")
    fix = f"Give a CSV file with a header such as {meant.example}."
    if "\0" in text:
        raise ClearanceError(f"`{path}` is no text, but binary data. {fix}")
    numbered = enumerate(re.split(r"\r\n|\r|\n", text), start=1)
    lines = [CsvLine(x, f"`{path}`, line {n}") for n, x in numbered if x.strip() and not x.lstrip().startswith("#")]
    if not lines:
        raise ClearanceError(f"`{path}` is empty. {fix}")
    head, count = lines[0], len(lines) - 1
    if count > MOST_ROWS:
        raise ClearanceError(f"`{path}` has {count} rows, but at most {MOST_ROWS} are read. Thin it out.")
    if "," not in head.text and (mark := next((m for m in ";\t" if m in head.text), "")):
        fix = "Separate them by commas, and write decimals with a point."
        raise ClearanceError(f"{head.where}: columns are separated by {quote(mark)}. {fix}")
    return lines


def _cells(line: CsvLine, meant: Meant) -> list[str]:
    if len(line.text) > LONGEST_LINE:
        raise ClearanceError(f"{line.where} is longer than {LONGEST_LINE} characters. Is it a {meant.what}?")
    try:
        return [cell.strip() for cell in next(csv.reader([line.text], skipinitialspace=True, strict=True))]
    except csv.Error as error:
        raise ClearanceError(f"{line.where}: its cells cannot be told apart ({error}).") from None


def _header(line: CsvLine, meant: Meant) -> list[Head]:
    cells, where = _cells(line, meant), line.where
    if all(_is_number(cell) for cell in cells):
        form = f"a header such as {meant.example}"
        raise ClearanceError(f"{where} must be {form}, but it has numbers only. Add one above it.")
    columns: dict[str, Head] = {}
    for i, cell in enumerate(cells, start=1):
        match, here = _HEAD.fullmatch(cell), f"{where}, column {i}"
        if match is None:
            raise wrong_value(here, "a name with a unit in brackets, `hip [deg]`", cell)
        name, unit = match[1].strip(), match[2]
        if not name:
            raise ClearanceError(f"{here} has no name. Name it, or take the comma beside it away.")
        name = TIME if check_text(name, f"{here}, a name,").lower() == TIME else name
        if name in columns:
            raise ClearanceError(f"{here}: `{name}` has a column already. Take one of them away.")
        columns[name] = Head(name, None if unit is None else unit.strip(), here)
    if TIME not in columns:
        raise ClearanceError(f"{where}: no column is called `{TIME}`. Call one so, as in {meant.example}.")
    if len(columns) < 2:
        what = meant.column
        raise ClearanceError(f"{where}: the header has no {what} beside `{TIME}`. Add a column for each {what}.")
    return list(columns.values())


def _row(line: CsvLine, columns: list[Head], meant: Meant, gaps: bool) -> list[float]:
    cells = _cells(line, meant)
    if len(cells) != len(columns):
        hint = " Are there decimal commas?" if len(cells) > len(columns) else ""
        raise ClearanceError(f"{line.where} has {len(cells)} cells, but the header has {len(columns)} columns.{hint}")
    return [_number(cell, f"{line.where}, column `{c.name}`", gaps) for cell, c in zip(cells, columns, strict=True)]


def _number(cell: str, where: str, gaps: bool) -> float:
    if gaps and cell.lower() in GAPS:
        return math.nan
    if not _is_number(cell):
        content = f"it is {quote(cell)}" if cell else "nothing is there"
        raise ClearanceError(f"{where} must be a number, but {content}.")
    value = float(cell)
    if not math.isfinite(value):
        raise wrong_value(where, "finite", cell)
    return value


def _is_number(cell: str) -> bool:
    """Whether a cell is a number. `1_000`, which Python accepts, is not."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell
