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
    """Held from its making until `release`, by a file of its own in the folder that it is for; or, with `of` given, by
    that file itself, which is left as it is. **Raises** `ClearanceError` where another process holds it.
    """

    def __init__(self, path: Path, of: Path | None = None):
        named = path.parent if of is None else of
        try:
            self._place = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise ClearanceError(f"Cannot write `{named}`: {error.strerror}. Choose another path.") from None
        if fcntl is None:
            return
        try:
            fcntl.flock(self._place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            said = b"" if of is not None else os.read(self._place, 200)
            holder = said.decode(errors="replace") or "another process"
            os.close(self._place)
            raise ClearanceError(
                f"`{named}` is being written by {holder}. Wait until that has ended, or stop it."
            ) from None
        if of is None:
            os.ftruncate(self._place, 0)
            os.write(self._place, f"process {os.getpid()} on {platform.node()}".encode())

    def release(self) -> None:
        """Another may write."""
        os.close(self._place)
