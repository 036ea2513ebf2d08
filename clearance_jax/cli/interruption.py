"""Handling of Ctrl-C and SIGTERM, so that neither is lost.

Python raises an interruption wherever the program is. After a long call of JAX that is often a callback of the garbage
collector, where an exception is printed and dropped. So the signal is remembered, and raised again by `check`.
"""

import signal
import sys
import threading
from typing import Any

# Ctrl-C, and the signal of `kill`, `timeout` and batch systems.
SIGNALS = signal.SIGINT, signal.SIGTERM


class Interruption:
    """A context (`with Interruption() as asked`) in which Ctrl-C and SIGTERM raise `KeyboardInterrupt` at once, and
    again in `check` if that exception was lost.
    """

    def __init__(self):
        self._heard = False

    def __enter__(self) -> "Interruption":
        self._hook, self._usual = sys.unraisablehook, {}
        sys.unraisablehook = self._forgotten
        if threading.current_thread() is threading.main_thread():  # other threads may not set handlers
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
        """Raise `KeyboardInterrupt` if the command was asked to end."""
        if self._heard:
            raise KeyboardInterrupt

    def _hear(self, *_: Any) -> None:
        self._heard = True
        raise KeyboardInterrupt

    def _forgotten(self, what: Any) -> None:
        # An interruption is remembered, so it is not printed.
        if not issubclass(what.exc_type, KeyboardInterrupt):
            self._hook(what)
