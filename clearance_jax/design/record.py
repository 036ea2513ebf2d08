"""The record of a search: every design that was evaluated, line by line, from which a run that was stopped goes on.

Each line has a checksum. Lines do not depend on each other: what is damaged costs that line, and two runs may add to
one record at a time.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.errors import ClearanceError
from clearance_jax.identity import differences, fingerprint, kept, refusal
from clearance_jax.sweep.journal import BEGIN, line_of, record_of

# What the first line of a record has beside names: the problem, by names.
PROBLEM = "problem"
# What is put behind a line that was cut off, once that has been said.
CUT = b" (cut off)"


class RecordWarning(UserWarning):
    """Something in a record was not as it was written."""


class Record:
    """A file with designs of one problem, each with its limits.

    **Arguments:** `names` of the variables; `problem`: by names, numbers and short texts; `limits`: how many.

    **Raises:** `ClearanceError` where there is no folder for it.
    """

    def __init__(self, path: str | Path, names: Sequence[str], problem: Mapping[str, Any], limits: int):
        self.path, self.names, self.limits = Path(path), list(names), limits
        self._problem, self._headed = kept(problem), False
        if not self.path.parent.is_dir():
            raise ClearanceError(f"There is no folder `{self.path.parent}` for the record.")

    def read(self) -> list[Evaluation]:
        """The designs that are there; none where there is no file. What is damaged is warned of.

        **Raises:** `ClearanceError` where the file cannot be read, is no record, or is that of another problem.
        """
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            said = f"Cannot read the record `{self.path}`: {_words(error)}."
            raise ClearanceError(f"{said} See to that, or choose another file.") from error
        lines = [line for line in text.splitlines() if not line.endswith(CUT)]
        entries = [entry for line in lines if (entry := record_of(line)) is not None]
        # What a run that was killed has left of its first line is a record that has not begun.
        begins = not entries and len(lines) < 2 and (text.startswith(BEGIN) or BEGIN.startswith(text))
        if not begins and not any({"names"} < set(entry) for entry in entries):
            raise ClearanceError(
                f"`{self.path}` is no record of designs, or is damaged throughout. Choose another file, or delete it."
            )
        found, lost = self._designs(entries), len(lines) - len(entries)
        if lost:
            said = "1 line is damaged; its design is" if lost == 1 else f"{lost} lines are damaged; their designs are"
            warnings.warn(f"`{self.path}`: {said} evaluated again if needed.", RecordWarning, stacklevel=2)
        if text and not text.endswith(b"\n"):  # what comes next is a line of its own
            self._write(b"\n" if record_of(lines[-1]) is not None else CUT + b"\n")
        return found

    def _designs(self, entries: list[dict[str, Any]]) -> list[Evaluation]:
        """The designs of entries, all of this problem."""
        heads, points = ([e for e in entries if (PROBLEM in e) == is_head] for is_head in (True, False))
        found = {k: v for head in heads for k, v in differences(head[PROBLEM], self._problem, "there").items()}
        if found:
            raise ClearanceError(refusal(self.path, found, "records another problem", "Choose another file"))
        own = self.names, fingerprint(self._problem), self.limits
        if any((e["names"], e.get("identity"), len(e.get("limits", ()))) != own for e in points):
            raise ClearanceError(f"`{self.path}` records another problem. Choose another file.")
        self._headed = bool(heads)
        return [_evaluation(entry) for entry in points]

    def add(self, point: Evaluation) -> None:
        """Add a design, below the problem. **Raises** `ClearanceError` where the disk refuses it."""
        lines = [] if self._headed else [{"names": self.names, PROBLEM: self._problem}]
        lines.append({"names": self.names, "identity": fingerprint(self._problem), **_entry(point)})
        self._write(b"".join(line_of(line) for line in lines))
        self._headed = True

    def _write(self, text: bytes) -> None:
        try:
            with self.path.open("ab") as file:
                file.write(text)
        except OSError as error:
            raise ClearanceError(
                f"Cannot write the record `{self.path}`: {_words(error)}. See to that, and go on with it."
            ) from error


def _entry(point: Evaluation) -> dict[str, Any]:
    return {k: _plain(v.tolist() if isinstance(v, np.ndarray) else v) for k, v in point._asdict().items()}


def _plain(value: Any) -> Any:
    """Numbers as JSON has them: one that is not finite as its name."""
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _evaluation(entry: dict[str, Any]) -> Evaluation:
    values = {k: None if entry[k] is None else np.asarray(entry[k], float) for k in Evaluation._fields}
    return Evaluation(**{**values, "objective": float(entry["objective"])})


def _words(error: OSError) -> str:
    return error.strerror or str(error)
