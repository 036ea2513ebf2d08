"""The expected time and size of a sweep, its progress, and checks of memory and disk."""

import os
import shutil
from pathlib import Path
from typing import NamedTuple

from clearance_jax.errors import ClearanceError


class SweepPlan(NamedTuple):
    """The plan of a sweep. It prints itself.

    - `lanes`: their number, of which `known` are answered already; `regions`, `programs`: the numbers of regions, and
      of programs to compile.
    - `seconds`: the expected time of the other lanes, after compiling (`None`: too few lanes for an estimate).
    - `memory`: bytes of answers in memory at once; `disk`: bytes of the store, uncompressed (0 without one).
    - `place`: what the lanes run on, in words.
    """

    lanes: int
    known: int
    regions: int
    programs: int
    seconds: float | None
    memory: int
    disk: int
    place: str

    def __str__(self) -> str:
        new = f" ({self.known} of them known)" if self.known else ""
        time = "a time not known" if self.seconds is None else shown_time(self.seconds)
        where = f", at most {size(self.disk)} on disk" if self.disk else ""
        return (
            f"{self.lanes} samples{new} in {self.regions} regions, {self.programs} programs, on {self.place}: {time} "
            f"after compiling, {size(self.memory)} of answers in memory{where}"
        )


class SweepProgress(NamedTuple):
    """The progress of a sweep: `done` of its `lanes`; `failed` lanes of finished regions; `new` lanes in the `seconds`
    since the first ones were done.
    """

    lanes: int
    done: int
    failed: int
    new: float
    seconds: float

    @property
    def rate(self) -> float:
        """Lanes per second."""
        return self.new / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Remaining time [s]; `None` if it is not known."""
        return (self.lanes - self.done) / self.rate if self.rate > 0 else None

    def __str__(self) -> str:
        left = "" if self.left is None else f", {shown_time(self.left)} to go"
        return f"{self.done} of {self.lanes} samples, {self.failed} failed, {self.rate:.3g} a second{left}"


def check_room(path: Path, needed: int) -> None:
    """Raise `ClearanceError` if a store does not fit on its disk."""
    folder = next((p for p in path.absolute().parents if p.is_dir()), Path("/"))
    free = shutil.disk_usage(folder).free
    # A disk with no room at all gives its own error.
    if needed > free > 0:
        raise ClearanceError(
            f"`{path}` may take {size(needed)}, but there are {size(free)} free. Ask for fewer samples or outputs, "
            "or choose another disk."
        )


def size(count: int) -> str:
    """Bytes in words."""
    left = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if left < 1000:
            return f"{left:.3g} {unit}"
        left /= 1000
    return f"{left:.3g} TB"


def shown_time(seconds: float) -> str:
    """A duration in words."""
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def check_memory(needed: int) -> None:
    """Raise `ClearanceError` if answers do not fit in this machine's memory."""
    try:
        whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system tells
        return
    if needed > whole:
        raise ClearanceError(
            f"The answers take {size(needed)}, but this machine has {size(whole)} of memory. Give a `store` to write."
        )
