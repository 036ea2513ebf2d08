"""How long things will take, from how long they have taken."""

import time
from collections.abc import Callable


class Pace:
    """The instants at which evaluations came in, from its making on: the first waits for the compiler.

    **Arguments:** `check`: called with each, and may raise.
    """

    def __init__(self, check: Callable[[], None] = lambda: None):
        self._times, self.check = [time.monotonic()], check

    def tick(self) -> None:
        """Another evaluation has come in."""
        self._times.append(time.monotonic())
        self.check()

    @property
    def count(self) -> int:
        """How many have come in."""
        return len(self._times) - 1

    def estimate(self, evaluations: int) -> float | None:
        """The seconds that so many evaluations of a new program will take; `None` where nothing is known of them."""
        if self.count < 1:
            return None
        steps = [after - before for before, after in zip(self._times, self._times[1:], strict=False)]
        usual = sorted(steps[1:] or steps)[len(steps[1:] or steps) // 2]
        return steps[0] + evaluations * usual


def shown_duration(seconds: float | None) -> str:
    """A duration in words, to one digit more than it is known."""
    if seconds is None:
        return "a time that is not known"
    return f"about {max(seconds, 1.0):.0f} s" if seconds < 100 else f"about {seconds / 60:.0f} min"
