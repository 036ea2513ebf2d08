"""A journal: what has been done, line by line, of which nothing is lost when the process or the machine dies.

One record a line, JSON; a line counts once it ends. What a death has torn is the last line only, and it is as if it had
never been: so whoever resumes does that work again.
"""

import errno
import json
import os
from pathlib import Path
from typing import Any


class Journal:
    """Records in the order in which they were added, in a file that only grows. One process writes it at a time."""

    def __init__(self, path: str | Path):
        self.path, self._end = Path(path), -1

    def read(self) -> list[dict[str, Any]]:
        """Every whole record; none where there is no file. A line that cannot be read is none."""
        return [record for line in self._whole().splitlines() if (record := _record(line)) is not None]

    def add(self, **record: Any) -> None:
        """Write a record, and see it on the disk before returning. **Raises** `OSError` where the disk refuses it; the
        journal is then as before.
        """
        line = json.dumps(record, separators=(",", ":"), allow_nan=False).encode() + b"\n"
        if self._end < 0:
            self._end = len(self._whole())
        place = os.open(self.path, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            os.ftruncate(place, self._end)  # what was torn would swallow this line
            try:
                os.lseek(place, self._end, os.SEEK_SET)
                if os.write(place, line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                os.fsync(place)
            except OSError:
                os.ftruncate(place, self._end)
                raise
            self._end += len(line)
        finally:
            os.close(place)

    def _whole(self) -> bytes:
        """All lines that have ended."""
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return b""
        return text[: text.rfind(b"\n") + 1]


def _record(line: bytes) -> dict[str, Any] | None:
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
