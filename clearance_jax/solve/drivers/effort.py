"""Counts of the step attempts of all solves in a function, for a caller who cannot see them in its result.

While a function is traced, its solves append their counts to the open list. A count in an inner jit, vmap or derivative
cannot leave it, so a function with such solves has no known effort.
"""

import contextlib
import dataclasses
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

from jaxtyping import Array, Int

try:
    from jax.extend.core import get_opaque_trace_state
except ImportError:  # where it was before JAX 0.8
    from jax.core import get_opaque_trace_state  # pyright: ignore[reportAttributeAccessIssue]


@dataclasses.dataclass
class AttemptCounts:
    """The attempts of the solves seen so far, and whether one could not be counted."""

    place: Any
    attempts: list[Int[Array, ""]]
    hidden: bool = False

    @property
    def known(self) -> list[Int[Array, ""]] | None:
        """The attempts of every solve; `None` where not all are known, or there was none."""
        return None if self.hidden else self.attempts or None


_open: ContextVar[AttemptCounts | None] = ContextVar("effort", default=None)


@contextlib.contextmanager
def effort() -> Iterator[AttemptCounts]:
    """Counts every solve in its context."""
    counts = AttemptCounts(get_opaque_trace_state(convention="clearance_jax"), [])
    token = _open.set(counts)
    try:
        yield counts
    finally:
        _open.reset(token)


def count(accepted: Int[Array, ""], rejected: Int[Array, ""]) -> None:
    """Report the steps and rejections of a solve to the open count, if any."""
    counts = _open.get()
    if counts is None:
        return
    if counts.place == get_opaque_trace_state(convention="clearance_jax"):
        counts.attempts.append(accepted + rejected)
    else:
        counts.hidden = True
