"""Partial results: the rows of unfinished parts, in files of their own, so that a killed run loses little.

A part has places, each with a row of variables. A file is a sequence of blocks of rows, each with a digest; one process
writes it, and a damaged end is ignored. Rows are collected for about a second before they are written. The files of a
part are removed when the journal has the part.
"""

import hashlib
import threading
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import Int

# Fields of a row: its place in the part, and the variables by their order, as their names may be anything.
PLACE = "place"
# How long rows may wait until they are written [s].
PATIENCE = 1.0
# Bytes of the head of a block: the digest of its rows, and their count.
DIGEST, COUNT = 16, 8


class PartialResults:
    """The partial results in one folder; safe for threads. `kinds`: type and shape of every variable by name."""

    def __init__(self, folder: Path, kinds: Mapping[str, tuple[np.dtype, tuple[int, ...]]]):
        self._folder, self._names = folder, list(kinds)
        columns = ((str(i), dtype, shape) for i, (dtype, shape) in enumerate(kinds.values()))
        self._row = np.dtype([(PLACE, "<i8"), *columns])
        # Another process has files of its own, also for the same part.
        self._own = uuid.uuid4().hex
        self._waiting: dict[int, list[np.ndarray]] = {}
        self._turn = threading.Lock()
        self._written = time.monotonic()

    def add(self, part: int, places: Int[np.ndarray, " n"], values: Mapping[str, np.ndarray]) -> None:
        """Keep values at places of a part; write if the last write is `PATIENCE` ago. **Raises** `OSError`."""
        rows = np.zeros(len(places), self._row)
        rows[PLACE] = places
        for i, name in enumerate(self._names):
            rows[str(i)] = values[name]
        with self._turn:
            self._waiting.setdefault(part, []).append(rows)
        if time.monotonic() - self._written >= PATIENCE:
            self.flush()

    def flush(self) -> None:
        """Write all rows that are not on disk yet. **Raises** `OSError` if that fails: they are then solved again."""
        with self._turn:
            waiting, self._waiting = self._waiting, {}
            for part, blocks in waiting.items():
                rows = np.concatenate(blocks)
                data = rows.tobytes()
                self._folder.mkdir(exist_ok=True)
                with (self._folder / f"{part}.{self._own}").open("ab") as file:
                    file.write(_digest(data) + len(rows).to_bytes(COUNT, "little") + data)
            self._written = time.monotonic()

    def forget(self, part: int) -> None:
        """Drop the unwritten rows of a part that is complete elsewhere."""
        with self._turn:
            self._waiting.pop(part, None)

    def fill(self, part: int, values: Mapping[str, np.ndarray]) -> None:
        """Copy the kept rows of a part into its `values`, in place."""
        for rows in self._blocks(part):
            for i, name in enumerate(self._names):
                values[name][rows[PLACE]] = rows[str(i)]

    def parts(self) -> list[int]:
        """The parts with files."""
        self.flush()
        files = self._folder.iterdir() if self._folder.is_dir() else ()
        return sorted({int(name) for file in files if (name := file.name.split(".")[0]).isdigit()})

    def count(self, part: int) -> int:
        """How many places of a part are kept."""
        return len(np.unique(np.concatenate([np.zeros(0, "<i8"), *(rows[PLACE] for rows in self._blocks(part))])))

    def remove(self, part: int) -> None:
        """Remove the rows and files of a part that the journal has."""
        self.forget(part)
        for file in self._folder.glob(f"{part}.*"):
            file.unlink(missing_ok=True)

    def close(self) -> None:
        """Write the last rows if possible, and remove the folder if it is empty."""
        with suppress(OSError):
            self.flush()
        with suppress(OSError):
            self._folder.rmdir()

    def _blocks(self, part: int) -> Iterator[np.ndarray]:
        self.flush()
        for file in sorted(self._folder.glob(f"{part}.*")):
            data, begin = file.read_bytes(), 0
            while begin < len(data):
                first = begin + DIGEST + COUNT
                end = first + self._row.itemsize * int.from_bytes(data[begin + DIGEST : first], "little")
                if _digest(data[first:end]) != data[begin : begin + DIGEST]:
                    break
                yield np.frombuffer(data[first:end], self._row)
                begin = end


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=DIGEST).digest()
