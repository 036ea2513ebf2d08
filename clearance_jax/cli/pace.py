"""How far a command has come, and how long things will take, from how long they have taken."""

import threading
import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

# Where there is no terminal a line is written at least so often [s].
EVERY = 30.0


class ProgressDisplay:
    """How far a command has come: on a terminal one line that changes, elsewhere (a file, a pipe) plain lines: one for
    each phase, and while it lasts one every half a minute, also where nothing is heard of the work itself.

    **Arguments:** `console` to write to; `parts`: whether the work says which part of it is done; `every` [s]: how
    often.
    """

    def __init__(self, console: Console, parts: bool = False, every: float = EVERY):
        self._console, self._parts, self._every, self._done = console, parts, every, threading.Event()
        self._text, self._part, self._began = "", None, time.monotonic()
        self._bar = self._beat = None
        if console.is_terminal:
            known = (BarColumn(), TextColumn("{task.percentage:>3.0f} %")) if parts else (SpinnerColumn(),)
            columns = *known, TextColumn("{task.description}"), TimeElapsedColumn()
            self._bar = Progress(*columns, console=console, transient=parts)
            self._task = self._bar.add_task("", total=1.0)

    def __enter__(self) -> "ProgressDisplay":
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
        self.update(text, 0.0 if self._parts else None)
        if self._bar is None:
            self._print(text)

    def update(self, text: str | None = None, part: float | None = None) -> None:
        """It has come so far: in words, and which part of it is done."""
        self._text = self._text if text is None else text
        self._part = self._part if part is None else part
        if self._bar is not None:
            self._bar.update(self._task, description=self._text, completed=self._part or 0.0)

    def _tell(self) -> None:
        while not self._done.wait(self._every):
            if self._text:
                part = f"{self._part:.0%}, " if self._part else ""
                self._print(f"{self._text} ({part}{time.monotonic() - self._began:.0f} s)")

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
