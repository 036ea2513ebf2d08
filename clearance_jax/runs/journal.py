"""The journal of a run: a text file with the question in the first line and a record of finished work in each other.

A line is a JSON object with a checksum and the fingerprint of its question. A line counts if it is complete and its
checksum is right. A kill damages at most the last line, so a killed run can be continued. One process writes at a time,
and errors of writing become messages that say what to do.
"""

import errno
import json
import os
import platform
import warnings
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EDQUOT, EFBIG, ENOSPC
from pathlib import Path
from typing import Any

from clearance_jax.errors import ClearanceError
from clearance_jax.runs.identity import as_in_file, differences, fingerprint, refusal


@contextmanager
def refuse_in_words(what: str, *, begun: bool = False) -> Iterator[None]:
    """Turn an `OSError` of writing `what` into a `ClearanceError` in words. `begun`: a part has been written."""
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
            message = f"`{named}` is being written by {holder}. Wait until that has ended, or stop it."
            raise ClearanceError(message).about(named, holder) from None
        if not itself:
            os.ftruncate(self.place, 0)
            os.write(self.place, f"process {os.getpid()} on {platform.node()}".encode())

    def release(self) -> None:
        """Another process may write."""
        os.close(self.place)


BEGIN = b'{"check":"'
# Length of a line up to the end of its checksum of eight digits.
CHECKED = len(BEGIN) + 8 + len(b'",')
# Keys of a line beside its record: the fingerprint of its question, and in the first line the question itself.
OF, QUESTION = "of", "question"


class RunWarning(UserWarning):
    """A file of a run is damaged."""


class Journal:
    """The records of one question in a file to which lines are added.

    Opening reads the file: `question` (`None`: its line is missing), the `records` in order, and the number of
    `damaged` lines. Call `ask` before the first `add`.

    **Arguments:** `ordered`: each record follows from the one before, so a damaged one is overwritten with all after
    it, and the file has one writer until `close`. Otherwise only the damaged record is lost, and several processes may
    add to the file.

    **Raises:** `ClearanceError` if the file cannot be opened, or another process writes it.
    """

    def __init__(self, path: str | Path, *, ordered: bool = False):
        self.path, self._ordered = Path(path), ordered
        self._lock, self._own = None, ""
        try:
            if ordered:
                self._lock = Lock(self.path, itself=True)
            self._read()
        except OSError as error:
            self.close()
            message = f"Cannot open `{self.path}`: {error.strerror or error}. Choose another path."
            raise ClearanceError(message) from error

    def _read(self) -> None:
        text = self.path.read_bytes() if self.path.exists() else b""
        lines = text.split(b"\n")[:-1]
        entries = [record_of(line) for line in lines]
        if self._ordered and None in entries:
            entries = entries[: entries.index(None)]
        whole = [entry for entry in entries if entry is not None]
        self.damaged, self._end = len(lines) - len(whole), _end(text)
        if self._ordered:
            self._end = sum(len(line) + 1 for line in lines[: len(whole)])
        # A file without a whole line, at most with a part of the first one, may be begun anew.
        self._new = not lines and (text.startswith(BEGIN) or BEGIN.startswith(text))
        self.fingerprints = {entry.pop(OF) for entry in whole}
        self.question = next((entry[QUESTION] for entry in whole if QUESTION in entry), None)
        self.records = [entry for entry in whole if QUESTION not in entry]

    def differences(self, question: Mapping[str, Any]) -> dict[str, str]:
        """How a question differs from that of the file, a sentence by name; empty if they are the same."""
        if self.fingerprints == {fingerprint(as_in_file(question))}:
            return {}
        lost = {QUESTION: "its own words are lost"}
        return lost if self.question is None else differences(self.question, as_in_file(question)) or lost

    def ask(self, question: Mapping[str, Any]) -> None:
        """Continue the question of the file, or write it to a new file. **Warns** `RunWarning` of damaged lines.
        **Raises** `ClearanceError` if the file has another question (with the differences), is no journal, or cannot be
        written; it is then unchanged.
        """
        if not self._new:
            if not self.fingerprints or (self._ordered and self.question is None):
                raise ClearanceError(
                    f"`{self.path}` is no journal of a run, one of an earlier form, or damaged at its begin. "
                    "Choose another path, or delete it."
                )
            if changes := self.differences(question):
                raise refusal(self.path, changes)
        if self.damaged:
            damage = f"{self.damaged} lines are damaged; what they held is"
            if self.damaged == 1:
                damage = "1 line is damaged; what it held is"
            if self._ordered:  # below the question, counted from 1
                damage = f"line {len(self.records) + 2} is damaged; it and what follows are"
            warnings.warn(f"`{self.path}`: {damage} computed again.", RunWarning, stacklevel=2)
        self._own = fingerprint(as_in_file(question))
        if self.question is None:
            self.add(**{QUESTION: as_in_file(question)})

    def add(self, **record: Any) -> None:
        """Write a record and flush it. **Raises** `ClearanceError` if that fails; the file is then unchanged."""
        line = line_of({OF: self._own, **record})
        with refuse_in_words(f"`{self.path}`", begun=QUESTION not in record):
            lock = self._lock or Lock(self.path, itself=True, wait=True)
            try:
                self._append(lock.place, line)
            finally:
                if lock is not self._lock:
                    lock.release()

    def _append(self, place: int, line: bytes) -> None:
        if not self._ordered and os.fstat(place).st_size != self._end:  # another process has written
            self._end = _end(self.path.read_bytes())
        os.ftruncate(place, self._end)  # a damaged end would merge with this line
        try:
            os.lseek(place, self._end, os.SEEK_SET)
            if os.write(place, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(place)
        except OSError:
            os.ftruncate(place, self._end)
            raise
        self._end += len(line)

    def close(self) -> None:
        """Release the lock: another process may write."""
        if self._lock is not None:
            self._lock.release()


def _end(text: bytes) -> int:
    """Where the last complete line ends."""
    return text.rfind(b"\n") + 1


def line_of(record: Mapping[str, Any]) -> bytes:
    """The line of a record in a file."""
    text = json.dumps(record, separators=(",", ":"), allow_nan=False).encode()
    return BEGIN + f"{zlib.crc32(text):08x}".encode() + b'",' + text[1:] + b"\n"


def record_of(line: bytes) -> dict[str, Any] | None:
    """The record of a line; `None` if the line is damaged or belongs to no question."""
    text = b"{" + line[CHECKED:]
    if not line.startswith(BEGIN) or line[len(BEGIN) : len(BEGIN) + 8] != f"{zlib.crc32(text):08x}".encode():
        return None
    record = json.loads(text)
    return record if OF in record else None
