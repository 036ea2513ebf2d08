"""Ctrl-C, and the signal by which a system ends a program (SIGTERM), that are not lost.

Python raises an interruption wherever the program happens to be. When a long call of JAX comes back that is often a
callback of the garbage collector, where an exception is printed and forgotten and the command goes on. So it is
remembered too, and raised once more where the command next looks up.
"""

import signal
import sys
import threading
from typing import Any

# What asks a command to end: Ctrl-C, and what `kill`, `timeout` and batch systems send.
SIGNALS = signal.SIGINT, signal.SIGTERM


class Interruption:
    """Ctrl-C, or SIGTERM, while it is on (`with Interruption() as asked`): raised at once, and by `check` where that
    was in vain.
    """

    def __init__(self):
        self._heard = False

    def __enter__(self) -> "Interruption":
        self._hook, self._usual = sys.unraisablehook, {}
        sys.unraisablehook = self._forgotten
        if threading.current_thread() is threading.main_thread():  # no other may listen
            self._usual = {number: signal.signal(number, self._hear) for number in SIGNALS}
        return self

    def __exit__(self, *_: Any) -> None:
        sys.unraisablehook = self._hook
        for number, usual in self._usual.items():
            signal.signal(number, signal.SIG_DFL if usual is None else usual)

    @property
    def heard(self) -> bool:
        """Whether the command was asked to end."""
        return self._heard

    def check(self) -> None:
        """Raise `KeyboardInterrupt` where the command was asked to end and still goes on."""
        if self._heard:
            raise KeyboardInterrupt

    def _hear(self, *_: Any) -> None:
        self._heard = True
        raise KeyboardInterrupt

    def _forgotten(self, what: Any) -> None:
        # An interruption is not lost, so there is nothing to tell.
        if not issubclass(what.exc_type, KeyboardInterrupt):
            self._hook(what)
