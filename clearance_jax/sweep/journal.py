"""A journal: what has been done, line by line, of which nothing is lost when the process or the machine dies.

One record a line, JSON, with a checksum in front; a line counts once it ends, and as long as it is as it was written.
What a death has torn is the last line only, and it is as if it had never been: so whoever resumes does that work again.
"""

import errno
import json
import os
import zlib
from pathlib import Path
from typing import Any

BEGIN = b'{"check":"'
# A checksum has eight digits, after which the record goes on.
CHECKED = len(BEGIN) + 8 + len(b'",')


class Journal:
    """Records in the order in which they were added, in a file that only grows. One process writes it at a time."""

    def __init__(self, path: str | Path):
        self.path, self._end = Path(path), -1

    def read(self) -> list[dict[str, Any]]:
        """Every whole record; none where there is no file. A line that cannot be read is none."""
        return [record for line in self._whole().splitlines() if (record := record_of(line)) is not None]

    def read_unbroken(self) -> tuple[list[dict[str, Any]], int]:
        """The records before the first line that cannot be read, for journals whose records follow from each other; and
        how many lines come after these, which the next `add` writes over.
        """
        found, end, lines = [], 0, self._whole().splitlines(keepends=True)
        for line in lines:
            record = record_of(line)
            if record is None:
                break
            found.append(record)
            end += len(line)
        self._end = end
        return found, len(lines) - len(found)

    def begun(self, **record: Any) -> bool:
        """Whether the file is empty, not there, or holds the torn begin of such a record: it may be begun anew."""
        try:
            return line_of(record).startswith(self.path.read_bytes())
        except FileNotFoundError:
            return True

    def add(self, **record: Any) -> None:
        """Write a record, and see it on the disk before returning. **Raises** `OSError` where the disk refuses it; the
        journal is then as before.
        """
        line = line_of(record)
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


def line_of(record: dict[str, Any]) -> bytes:
    """A record as it stands in a file."""
    text = json.dumps(record, separators=(",", ":"), allow_nan=False).encode()
    return BEGIN + f"{zlib.crc32(text):08x}".encode() + b'",' + text[1:] + b"\n"


def record_of(line: bytes) -> dict[str, Any] | None:
    """The record of a line; None where it is not as it was written."""
    line = line.rstrip(b"\n")
    text = b"{" + line[CHECKED:]
    if not line.startswith(BEGIN) or line[len(BEGIN) : len(BEGIN) + 8] != f"{zlib.crc32(text):08x}".encode():
        return None
    return json.loads(text)
