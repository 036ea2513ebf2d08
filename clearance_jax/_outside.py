"""What a program is made of beside code and numbers: files, the environment, the clock, chance.

A key cannot have these. So code that names them is not read (`Untold`), and a trace that opens a file is noticed.
"""

import sys
import threading
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax

from clearance_jax._code import PACKAGE, PYTHON, Untold, imported, names_in, versioned

# Modules of Python's whose answers differ between processes.
_CHANGING = frozenset(
    (
        *("os", "posix", "nt", "sys", "io", "_io", "time", "datetime", "_datetime", "random", "_random", "secrets"),
        *("uuid", "platform", "socket", "locale", "getpass", "tempfile", "subprocess", "threading", "multiprocessing"),
        *("builtins", "importlib", "ctypes", "gc", "inspect"),
    )
)
# Python's own functions that reach what no name says, or that differ between processes.
_REACHING = frozenset(("eval", "exec", "__import__", "globals", "locals", "input", "id", "hash"))
_EVENTS = frozenset(("open", "socket.connect", "subprocess.Popen", "os.system"))
_jax: Any = jax.config  # whose settings have no types
_here = threading.local()
_hooked: list[bool] = []


def is_changing(module: str | None) -> bool:
    """Whether what a module of Python's answers differs between processes."""
    return (module or "").partition(".")[0] in _CHANGING


def check_names(code: types.CodeType, known: dict[str, Any]) -> None:
    """**Raises:** `Untold` for code that reaches what its text does not say, or chance, or imports a user's module."""
    for module in imported(code):
        if is_changing(module) or not versioned(module):
            raise Untold(f"a module that a function imports: {module}")
    names = set(names_in(code))
    reached = sorted(name for name in names & _REACHING if name not in known)
    if reached:
        raise Untold(f"a function that calls {reached[0]}")
    modules = (known.get(name) for name in names)
    if "random" in names and any(getattr(one, "__name__", "") == "numpy" for one in modules):
        raise Untold("a function that calls numpy.random")


@contextmanager
def outside_asked() -> Iterator[list[str]]:
    """Within, files that this thread opens, and whatever else it asks outside of this process, get into the list; not
    code, which keys have.
    """
    if not _hooked:
        _hooked.append(True)
        sys.addaudithook(_notice)
    _here.asked = asked = []
    try:
        yield asked
    finally:
        _here.asked = None


def _notice(event: str, arguments: tuple) -> None:
    if event in _EVENTS:
        asked = getattr(_here, "asked", None)
        if asked is not None and not _is_known(arguments[0] if arguments else None):
            asked.append(event)


def _is_known(path: Any) -> bool:
    """Whether a file is Python's, of an installed package or this library's, or where Python looks for them
    when something is imported; or of JAX's own cache.
    """
    if not isinstance(path, str):
        return False
    found = Path(path)
    installed = bool({"site-packages", "dist-packages"} & set(found.parts))
    cache = _jax.jax_compilation_cache_dir
    if cache and found.is_relative_to(cache):
        return True
    return path in sys.path or installed or found.is_relative_to(PACKAGE) or found.is_relative_to(PYTHON)
