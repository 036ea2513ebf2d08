"""The journal of a life: what was asked, and every block that is done. Another question is refused in words."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from clearance_jax.errors import ClearanceError
from clearance_jax.identity import differences, kept, refusal
from clearance_jax.sweep.journal import Journal
from clearance_jax.sweep.lock import Lock

# What the first record has: the question and the profile at first.
QUESTION, BEGIN = "question", "begin"


class JournalWarning(UserWarning):
    """Something in a journal was not as it was written."""


class LifeJournal:
    """The blocks of one life in a file, as records; held alone until `release`.

    **Arguments:** `question`: by names, numbers and short texts; `begin`: the profile at first (or stack), as lists.

    **Raises:** `ClearanceError` where the file is the journal of another life or none at all, is written by another
    process, and where it cannot be read or written.
    """

    def __init__(self, path: str | Path, question: Mapping[str, Any], begin: list):
        self.path = Path(path)
        self._journal = Journal(self.path)
        self._lock = Lock(self.path, of=self.path)
        try:
            self.records = self._resumed(kept(question), begin)
        except BaseException:
            self.release()
            raise

    def _resumed(self, question: dict[str, Any], begin: list) -> list[dict[str, Any]]:
        """The records after the first one, which is written where there is none."""
        head = {QUESTION: question, BEGIN: begin}
        try:
            records, lost = self._journal.read_unbroken()
            if not records and self._journal.begun(**head):
                self._journal.add(**head)
                return []
        except OSError as error:
            raise ClearanceError(f"Cannot read or write `{self.path}`: {_words(error)}. Name another file.") from error
        if not records or set(records[0]) != set(head):
            raise ClearanceError(
                f"`{self.path}` is no journal of a life, or is damaged at its begin. Name another file, or delete it."
            )
        found = differences(records[0][QUESTION], question, "there")
        if found or records[0][BEGIN] != begin:
            found = found or {BEGIN: "the profile at first is another"}
            fix = "Name another file, or delete it"
            raise ClearanceError(refusal(self.path, found, "is the journal of another life", fix))
        if lost:
            said = f"`{self.path}`: block {len(records)} is damaged; it and what follows are computed again."
            warnings.warn(said, JournalWarning, stacklevel=2)
        return records[1:]

    def add(self, record: Mapping[str, Any]) -> None:
        """Keep a block. **Raises** `ClearanceError` where the disk refuses it."""
        try:
            self._journal.add(**record)
        except OSError as error:
            raise ClearanceError(
                f"Cannot write `{self.path}`: {_words(error)}. The blocks before are kept: see to that, and ask again."
            ) from error

    def release(self) -> None:
        """Another may write."""
        self._lock.release()


def _words(error: OSError) -> str:
    return error.strerror or str(error)
