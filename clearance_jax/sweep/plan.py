"""What a sweep will take, said before it starts; and how far it has come."""

import os
import shutil
from pathlib import Path
from typing import NamedTuple

from clearance_jax.errors import ClearanceError


class SweepPlan(NamedTuple):
    """What a sweep will take. It prints itself.

    - `lanes`: how many there are, of which `known` are answered already; `regions`, `programs`: into how many they are
      cut, and how many programs are compiled.
    - `seconds`: the expected time of those not known, after compiling, by a pilot (`None`: too few for one).
    - `memory`: bytes held at once, the answers in memory or one region of them; `disk`: of the store, uncompressed (0
      without one).
    - `place`: what the lanes run on.
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
    """How far a sweep is: `done` of its `lanes` (those of a region that is under way count as they come), `failed` of
    the regions that are ready; `seconds` since the first lanes were done, in which `new` ones followed.
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
        """Seconds to go; `None` where nothing is known."""
        return (self.lanes - self.done) / self.rate if self.rate > 0 else None

    def __str__(self) -> str:
        left = "" if self.left is None else f", {shown_time(self.left)} to go"
        return f"{self.done} of {self.lanes} samples, {self.failed} failed, {self.rate:.3g} a second{left}"


def check_room(path: Path, needed: int) -> None:
    """Raise where a store will not fit on its disk."""
    folder = next((p for p in path.absolute().parents if p.is_dir()), Path("/"))
    free = shutil.disk_usage(folder).free
    # Where nothing can be written at all the disk says so itself.
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
    """Raise where answers will not fit in this machine's memory."""
    try:
        whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system says
        return
    if needed > whole:
        raise ClearanceError(
            f"The answers take {size(needed)}, but this machine has {size(whole)} of memory. Give a `store` to write."
        )
