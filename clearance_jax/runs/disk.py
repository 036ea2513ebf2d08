"""Writing to disk: one writer at a time, and errors as messages that say what to do."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EDQUOT, EFBIG, ENOSPC
from pathlib import Path

from clearance_jax.errors import ClearanceError


@contextmanager
def refuse_in_words(what: str, *, begun: bool = False) -> Iterator[None]:
    """Turn an `OSError` of writing `what` into a `ClearanceError` that says why and what to do. `begun`: a part of it
    has been written before.
    """
    try:
        yield
    except OSError as error:
        mend = "make room" if error.errno in (ENOSPC, EDQUOT, EFBIG) else "see to that"
        fix = f"What was written before is kept: {mend}, and go on" if begun else "Choose another path"
        raise ClearanceError(f"Cannot write {what}: {error.strerror or error}. {fix}.") from error


try:
    import fcntl
except ImportError:  # Windows has no such locks: two writers are not noticed there
    fcntl = None


class Lock:
    """A lock, held from its creation until `release`.

    **Arguments:** `path`: a lock file in the folder that is locked, which says who holds it; or, with `itself`, the
    file to be locked. `wait`: wait until it is free.

    **Raises:** `ClearanceError` if another process holds it; `OSError` if the file cannot be written.
    """

    def __init__(self, path: Path, *, itself: bool = False, wait: bool = False):
        named = path if itself else path.parent
        self.place = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        if fcntl is None:
            return
        try:
            fcntl.flock(self.place, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            content = b"" if itself else os.read(self.place, 200)
            holder = content.decode(errors="replace") or "another process"
            os.close(self.place)
            raise ClearanceError(
                f"`{named}` is being written by {holder}. Wait until that has ended, or stop it."
            ) from None
        if not itself:
            os.ftruncate(self.place, 0)
            os.write(self.place, f"process {os.getpid()} on {platform.node()}".encode())

    def release(self) -> None:
        """Another process may write."""
        os.close(self.place)
