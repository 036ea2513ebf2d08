"""Numbers of a page: which samples it keeps, how far lines between them are from all samples, and their bytes."""

import base64
import heapq
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from clearance_jax.errors import ClearanceError

# NumPy's types, little-endian, by the names that the page knows.
KINDS = {"f4": "<f4", "f8": "<f8", "i2": "<i2", "u1": "<u1", "u4": "<u4"}
# Steps of a 16-bit number on either side of zero.
STEPS = 32767


def keep(time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n m"], most: int) -> Int[np.ndarray, " kept"]:
    """Indices of at most so many samples. Each next one is that which is farthest from the lines between those before,
    so that an impact is kept however short it is.

    **Arguments:** `time` [s]; `values`: of each sample, scaled such that errors of all columns are alike; `most` >= 2.
    """
    if len(time) <= most:
        return np.arange(len(time))
    kept, spans = {0, len(time) - 1}, []

    def look(begin: int, end: int) -> None:
        inner = slice(begin + 1, end)
        if end - begin > 1:
            share = ((time[inner] - time[begin]) / (time[end] - time[begin]))[:, None]
            line = values[begin] + share * (values[end] - values[begin])
            off = np.abs(values[inner] - line).max(axis=1)
            k = int(np.argmax(off))
            heapq.heappush(spans, (-float(off[k]), begin, begin + 1 + k, end))

    look(0, len(time) - 1)
    while spans and len(kept) < most:
        _, begin, middle, end = heapq.heappop(spans)
        kept.add(middle)
        look(begin, middle)
        look(middle, end)
    return np.array(sorted(kept))


def between(time: np.ndarray, kept: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values of the kept samples (kept, ...) at all times, by linear interpolation, (times, ...)."""
    if len(values) == 1:
        return np.repeat(values, len(time), axis=0)
    at = np.clip(np.searchsorted(time[kept], time, side="right") - 1, 0, len(kept) - 2)
    share = (time - time[kept][at]) / (time[kept][at + 1] - time[kept][at])
    share = share.reshape(-1, *(1,) * (values.ndim - 1))
    return values[at] * (1 - share) + values[at + 1] * share


class Numbers:
    """The arrays of a page, one after another, each at a multiple of eight bytes. An array that is there already is not
    stored again, and of one that does not change over time one row is.
    """

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []
        self._data, self._known = bytearray(), {}

    def add(self, values: Any, kind: str = "f4") -> tuple[int, np.ndarray]:
        """Store an array (times,) or (times, width), "i2" as multiples of a step, a 32767th of its largest value; its
        index, and the values as the page reads them.
        """
        table = np.atleast_2d(np.asarray(values, float).T).T
        if not np.all(np.isfinite(table)):
            raise ClearanceError("A part of this result is not finite, so that it cannot be shown. Simulate again.")
        if len(table) > 1 and np.all(table == table[0]):
            table = table[:1]
        entry: dict[str, Any] = {"kind": kind, "rows": table.shape[0], "width": table.shape[1]}
        if kind == "i2":
            entry["step"] = float(np.abs(table).max(initial=0.0)) / STEPS or 1.0
            table = np.round(table / entry["step"])
        raw = table.astype(KINDS[kind])
        key = (kind, entry.get("step"), raw.shape, raw.tobytes())
        if key not in self._known:
            self._known[key] = len(self.entries)
            self.entries.append(entry | {"at": len(self._data)})
            self._data += raw.tobytes() + bytes(-raw.nbytes % 8)
        return self._known[key], raw.astype(float) * entry.get("step", 1.0)

    def text(self) -> str:
        """All bytes in base64."""
        return base64.b64encode(self._data).decode()
