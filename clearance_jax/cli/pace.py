"""How far a command has come, and how long things will take, from how long they have taken."""

import threading
import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

# Where there is no terminal a line is written at least so often [s].
EVERY = 30.0


class Shown:
    """How far a command has come: on a terminal one line that changes, elsewhere (a file, a pipe) plain lines: one for
    each phase, and while it lasts one every half a minute, also where nothing is heard of the work itself.

    **Arguments:** `console` to write to; `every` [s]: how often.
    """

    def __init__(self, console: Console, every: float = EVERY):
        self._console, self._every, self._text, self._done = console, every, "", threading.Event()
        self._began = time.monotonic()
        self._bar = self._beat = None
        if console.is_terminal:
            columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
            self._bar = Progress(*columns, console=console)
            self._task = self._bar.add_task("", start=True)

    def __enter__(self) -> "Shown":
        if self._bar is not None:
            self._bar.start()
        else:
            self._beat = threading.Thread(target=self._tell, daemon=True)
            self._beat.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._beat is not None:
            self._beat.join()
        if self._bar is not None:
            self._bar.stop()

    def phase(self, text: str) -> None:
        """Something else begins."""
        self._began = time.monotonic()
        self.update(text)
        if self._bar is None:
            self._print(text)

    def update(self, text: str) -> None:
        """It has come so far."""
        self._text = text
        if self._bar is not None:
            self._bar.update(self._task, description=text)

    def _tell(self) -> None:
        while not self._done.wait(self._every):
            if self._text:
                self._print(f"{self._text} ({time.monotonic() - self._began:.0f} s)")

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False, markup=False, soft_wrap=True)


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
