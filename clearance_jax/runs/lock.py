"""One writer at a time: a lock that the system takes away from a process that dies."""

import os
import platform
from pathlib import Path

from clearance_jax.errors import ClearanceError

try:
    import fcntl
except ImportError:  # no such locks on Windows: there two writers are not told apart
    fcntl = None


class Lock:
    """Held from its making until `release`, by a file of its own in the folder that it is for, which says who holds it;
    or, with `itself`, by the very file that is for one writer. `wait`: until it is free.

    **Raises:** `ClearanceError` where another process holds it; `OSError` where the file cannot be written.
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
        """Another may write."""
        os.close(self.place)
