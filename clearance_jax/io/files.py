"""Reads text, TOML and CSV files of limited size."""

import csv
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError, quote

LARGEST_TOML, LARGEST_TABLE = 2_000_000, 50_000_000


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
    """The text of a file. **Raises** `ClearanceError` if it is too large or no file (a device may never end)."""
    if "\0" in str(path):
        raise ClearanceError(f"Cannot read the {what}: {quote(str(path))} is no path.")
    try:
        if path.exists() and not path.is_file():
            raise ClearanceError(f"Cannot read the {what} `{path}`: it is no file. Give the path of one.")
        if path.stat().st_size > largest:
            raise ClearanceError(f"Cannot read the {what} `{path}`: it is larger than {largest // 1_000_000} MB.")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ClearanceError(f"Cannot read the {what} `{path}`: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise ClearanceError(f"Cannot read the {what} `{path}`: it is not a text in UTF-8.") from None
