"""What a disk refuses, in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from errno import EDQUOT, EFBIG, ENOSPC

from clearance_jax.errors import ClearanceError


@contextmanager
def refuse_in_words(what: str, *, begun: bool = False) -> Iterator[None]:
    """Raise an `OSError` of writing as a `ClearanceError`: what cannot be written, why, and what to do. `begun`: there
    is something already.
    """
    try:
        yield
    except OSError as error:
        mend = "make room" if error.errno in (ENOSPC, EDQUOT, EFBIG) else "see to that"
        fix = f"What was written before is kept: {mend}, and go on" if begun else "Choose another path"
        raise ClearanceError(f"Cannot write {what}: {error.strerror or error}. {fix}.") from error
