"""Partial results: answers of parts that are not whole yet, in files of their own. A kill costs what it was at, and a
second.

A part has places, each with a row of variables. A file is blocks of rows, each block with a digest. It only grows, one
process alone writes it, and what is torn at its end is no block. It is removed when the journal has its part: the
journal says what is there, these files only save work. Rows wait for each other a while before they are written.
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

# A row has its place in its part, and the variables by their order: they may be called anything.
PLACE = "place"
# How long rows may wait until they are written [s].
PATIENCE = 1.0
# Of a block: the digest of its rows, and how many they are.
DIGEST, COUNT = 16, 8


class PartialResults:
    """The files of one folder; threads may share it. `kinds`: of every variable its type and shape."""

    def __init__(self, folder: Path, kinds: Mapping[str, tuple[np.dtype, tuple[int, ...]]]):
        self._folder, self._names = folder, list(kinds)
        columns = ((str(i), dtype, shape) for i, (dtype, shape) in enumerate(kinds.values()))
        self._row = np.dtype([(PLACE, "<i8"), *columns])
        # A process that comes later, or does the same part elsewhere, has files of its own.
        self._own = uuid.uuid4().hex
        self._waiting: dict[int, list[np.ndarray]] = {}
        self._turn = threading.Lock()
        self._written = time.monotonic()

    def add(self, part: int, places: Int[np.ndarray, " n"], values: Mapping[str, np.ndarray]) -> None:
        """Keep the values at these places of a part; on the disk by the first call that comes `PATIENCE`
        after the last writing. **Raises** `OSError` where the disk refuses it.
        """
        rows = np.zeros(len(places), self._row)
        rows[PLACE] = places
        for i, name in enumerate(self._names):
            rows[str(i)] = values[name]
        with self._turn:
            self._waiting.setdefault(part, []).append(rows)
        if time.monotonic() - self._written >= PATIENCE:
            self.flush()

    def flush(self) -> None:
        """Write what waits. **Raises** `OSError` where the disk refuses it: then that is solved again."""
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
        """All of the part is where it belongs: what waits of it need not be written."""
        with self._turn:
            self._waiting.pop(part, None)

    def fill(self, part: int, values: Mapping[str, np.ndarray]) -> None:
        """Put what has been kept of a part among its values."""
        for rows in self._blocks(part):
            for i, name in enumerate(self._names):
                values[name][rows[PLACE]] = rows[str(i)]

    def parts(self) -> list[int]:
        """The parts of which something has been kept."""
        self.flush()
        files = self._folder.iterdir() if self._folder.is_dir() else ()
        return sorted({int(name) for file in files if (name := file.name.split(".")[0]).isdigit()})

    def count(self, part: int) -> int:
        """Of how many places of a part something has been kept."""
        return len(np.unique(np.concatenate([np.zeros(0, "<i8"), *(rows[PLACE] for rows in self._blocks(part))])))

    def remove(self, part: int) -> None:
        """The journal has the part."""
        self.forget(part)
        for file in self._folder.glob(f"{part}.*"):
            file.unlink(missing_ok=True)

    def close(self) -> None:
        """Nothing follows: write what waits, where that can be, and leave no empty folder."""
        with suppress(OSError):
            self.flush()
        with suppress(OSError):
            self._folder.rmdir()

    def _blocks(self, part: int) -> Iterator[np.ndarray]:
        self.flush()
        for file in sorted(self._folder.glob(f"{part}.*")):
            yield from self._read(file.read_bytes())

    def _read(self, data: bytes) -> Iterator[np.ndarray]:
        begin = 0
        while begin < len(data):
            first = begin + DIGEST + COUNT
            end = first + self._row.itemsize * int.from_bytes(data[begin + DIGEST : first], "little")
            if _digest(data[first:end]) != data[begin : begin + DIGEST]:
                return
            yield np.frombuffer(data[first:end], self._row)
            begin = end


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=DIGEST).digest()
