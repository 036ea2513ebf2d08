"""Errors of writing to disk, as messages that say what to do."""

from collections.abc import Iterator
from contextlib import contextmanager
from errno import EDQUOT, EFBIG, ENOSPC

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
