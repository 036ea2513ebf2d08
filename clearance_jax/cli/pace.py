"""Progress display of a command, estimates of remaining time, and its interruption by Ctrl-C."""

import itertools
import os
import signal
import socket
import statistics
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from clearance_jax.cli.answer import errors

# Without a terminal a line is written after every interval of this length [s].
EVERY = 30.0
# Ctrl-C, and the signal of `kill`, `timeout` and batch systems.
SIGNALS = signal.SIGINT, signal.SIGTERM


class Interruption:
    """A context (`with Interruption() as asked`) in which Ctrl-C and SIGTERM raise `KeyboardInterrupt` at once, and
    again in `check` if that exception was lost. `heard`: whether the command was asked to end.

    Python raises an interruption wherever the program is. After a long call of JAX that is often a callback of the
    garbage collector, where an exception is printed and dropped. So the signal is remembered, and raised again.
    While JAX compiles or computes, Python raises nothing. So a thread hears the signal too: it says at once that the
    command ends and what it does `until` then, and a second signal ends the process.
    """

    def __init__(self, until: str = "keeping what is done"):
        self.heard, self.until = False, until

    def __enter__(self) -> "Interruption":
        self._hook, self._usual = sys.unraisablehook, {}
        sys.unraisablehook = self._forgotten
        if threading.current_thread() is threading.main_thread():  # other threads may not set handlers
            self._usual = {number: signal.signal(number, self._hear) for number in SIGNALS}
            ear, self._mouth = socket.socketpair()
            self._mouth.setblocking(False)
            self._woken = signal.set_wakeup_fd(self._mouth.fileno(), warn_on_full_buffer=False)
            threading.Thread(target=self._listen, args=(ear,), daemon=True).start()
        return self

    def __exit__(self, *_: Any) -> None:
        sys.unraisablehook = self._hook
        for number, usual in self._usual.items():
            signal.signal(number, signal.SIG_DFL if usual is None else usual)
        if self._usual:
            signal.set_wakeup_fd(self._woken)
            self._mouth.close()  # which ends the thread

    def check(self) -> None:
        """Raise `KeyboardInterrupt` if the command was asked to end."""
        if self.heard:
            raise KeyboardInterrupt

    def _hear(self, *_: Any) -> None:
        self.heard = True
        raise KeyboardInterrupt

    def _listen(self, ear: socket.socket) -> None:
        told = False
        with ear:
            while number := ear.recv(1):
                if number[0] in SIGNALS and told:
                    errors.show_cursor()
                    os._exit(128 + number[0])
                if number[0] in SIGNALS:
                    told, what = True, f": {self.until}" if self.until else ""
                    errors.print(f"interrupted{what}; Ctrl-C again leaves at once")

    def _forgotten(self, what: Any) -> None:
        # An interruption is remembered, so it is not printed.
        if not issubclass(what.exc_type, KeyboardInterrupt):
            self._hook(what)


class ProgressDisplay:
    """Progress: on a terminal a line that changes; else a line for each phase, and one after `every` interval [s] of
    it. `parts`: whether the work reports which part of it is done.
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
        """Begin a phase with this name."""
        self._began = time.monotonic()
        self.update(text, 0.0 if self._parts else None)
        if self._bar is None:
            self._print(text)

    def update(self, text: str | None = None, part: float | None = None) -> None:
        """Show another text, or another part of the phase that is done (0 to 1)."""
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
    """When evaluations were done, to estimate how long others take; `check`: called after each one, and may raise."""

    def __init__(self, check: Callable[[], None] = lambda: None):
        self._times, self.check = [time.monotonic()], check

    def tick(self) -> None:
        """Record an evaluation."""
        self._times.append(time.monotonic())
        self.check()

    @property
    def count(self) -> int:
        """The number of evaluations."""
        return len(self._times) - 1

    def estimate(self, evaluations: int) -> float | None:
        """The expected time of so many evaluations by a new program [s]; `None` before the first evaluation."""
        if self.count < 1:
            return None
        steps = [after - before for before, after in itertools.pairwise(self._times)]
        return steps[0] + evaluations * statistics.median_high(steps[1:] or steps)


def shown_duration(seconds: float | None) -> str:
    """A duration [s] in words."""
    if seconds is None:
        return "a time that is not known"
    return f"about {max(seconds, 1.0):.0f} s" if seconds < 100 else f"about {seconds / 60:.0f} min"
