"""Programs that are kept between processes as loadable executables: a second process neither traces nor compiles them.

`configure(cache=...)` switches it on. Any uncertainty (a structure that cannot be read completely, a damaged file, an
executable that cannot be kept) leads to a usual compilation, never to an error. So does code of the user's in a
program, because no key can cover what it reads and remembers. The key of a file covers everything on which its program
depends: the traced functions, with the library as it is in memory (`library`), the structure of the arguments
(`structure`), and the surroundings (`library`).
"""

import contextlib
import functools
import os
import pickle
import re
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from clearance_jax._compile import files
from clearance_jax._compile.library import is_plain, library_text, surroundings
from clearance_jax._compile.private import find_lapack, jax_cache_off, settings
from clearance_jax._compile.runtime import RUNTIME
from clearance_jax._compile.solo import SOLO, is_traced, solo_jit
from clearance_jax._compile.structure import Reader, Untold, hash_texts

# Largest number of calls that are recognised without reading their arguments again.
_MOST = 1024
# By key: a program is made by one thread, several programs side by side.
_making: dict[str, Any] = {}
# A function outside of the program that it calls.
_CALL = re.compile(r'custom_call_target="([^"]*)"')


def keep_in(folder: Path | None) -> None:
    """Keep programs in this folder from now on; `None`: nowhere. They are not kept either if the variable
    CLEARANCE_KEPT is 0, or, with a warning, if others can write to the folder.
    """
    files.remember_in(None)
    if folder is None or os.environ.get("CLEARANCE_KEPT") == "0":
        return
    why = files.unsafe(folder)
    if why:
        warnings.warn(
            f"The folder of kept programs must be writable by its owner alone, but {why}: `{folder}` is not used. "
            "Change its permissions, choose another folder, or set the environment variable CLEARANCE_KEPT=0.",
            stacklevel=3,
        )
        return
    files.remember_in(folder)


class kept_jit:
    """A function as `eqx.filter_jit` makes it, whose programs are kept where possible.

    The function must depend on nothing but its arguments and this library. Its name identifies it, together with those
    of the functions in `made_of` that it is made of. Positional arguments only.
    """

    def __init__(self, function: Callable, made_of: tuple[Callable, ...] = ()):
        self.function, self.plain = function, solo_jit(function)
        self._made_of = function, *made_of
        self._programs: dict[str, tuple[Any, Any]] = {}
        self._calls: dict[Any, tuple[Any, Any]] = {}
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        if RUNTIME.folder is None:
            return self.plain(*arguments)
        leaves, tree = jax.tree.flatten(arguments)
        if any(isinstance(x, Tracer) for x in leaves) or is_traced() or not is_plain():
            if is_plain():  # JAX remembers what it traces now: it is read, so that one sees whether it is altered later
                with contextlib.suppress(Untold, RecursionError):
                    self._key(leaves, tree)
            return self.plain(*arguments)
        call = tree, *map(_view, leaves), *settings()
        try:
            known = self._calls.get(call)
        except TypeError:  # what has no hash, and so is no argument of a program
            return self.plain(*arguments)
        if known is None:
            known = self._program(arguments, leaves, tree)
            if len(self._calls) >= _MOST:
                self._calls.clear()
            self._calls[call] = known
        program, out = known
        if program is None:
            return self.plain(*arguments)
        return _fill(out, program(*(x for x in leaves if eqx.is_array(x))))

    def _program(self, arguments: tuple, leaves: list, tree: Any) -> tuple[Any, Any]:
        """The program of a call, and the structure of its answer; `None`: use `jit`."""
        try:
            key = self._key(leaves, tree)
        except (Untold, RecursionError):
            return None, None
        if files.unsafe(RUNTIME.folder):
            return None, None
        with _making.setdefault(key, threading.RLock()):
            if key not in self._programs:
                self._programs[key] = _read(key) or self._compile(key, arguments)
            return self._programs[key]

    def _key(self, leaves: list, tree: Any) -> str:
        reader = Reader(strict=True)
        question = reader.whole(hash_texts(reader.tree(tree), reader.of([x for x in leaves if not eqx.is_array(x)])))
        names = [f"{function.__module__}.{function.__qualname__}" for function in self._made_of]
        shapes = [str(_view(x)) if eqx.is_array(x) else "" for x in leaves]
        modules = {*reader.homes, *(function.__module__ for function in self._made_of)}
        return hash_texts(*names, repr(SOLO), question, *shapes, library_text(modules), surroundings())

    def _compile(self, key: str, arguments: tuple) -> tuple[Any, Any]:
        """The program compiled here, and kept; (None, None) if it cannot be."""
        arrays, rest = eqx.partition(arguments, eqx.is_array)
        numbers, tree = jax.tree.flatten(arrays)
        outside: list[Any] = []

        def flat(*numbers):
            out = self.function(*eqx.combine(jax.tree.unflatten(tree, numbers), rest))
            answer, left = eqx.partition(out, eqx.is_array)
            leaves, shape = jax.tree.flatten(answer)
            places = jax.tree.unflatten(shape, [_Place(i) for i in range(len(leaves))])
            outside[:] = [eqx.combine(places, left, is_leaf=lambda x: isinstance(x, _Place))]
            return leaves

        lowered = jax.jit(flat).lower(*numbers)
        if "callback" in lowered.as_text():  # it would point into this process
            return None, None
        if RUNTIME.altered or not files.make_writable(RUNTIME.folder):
            return lowered.compile(SOLO), outside[0]
        # A program from JAX's own cache cannot be kept: it would lack functions.
        with jax_cache_off():
            program = lowered.compile(SOLO)
        try:
            frame = pickle.dumps(outside[0])
            pickle.loads(frame)
            calls = set(_CALL.findall(program.as_text() or ""))
            content = pickle.dumps((_needs_lapack(calls), frame, serialize_executable.serialize(program)))
        except Exception:  # what a tree holds may refuse in its own words: the program is good in this process
            return program, outside[0]
        files.write(RUNTIME.folder, key, content)
        return program, outside[0]


def _needs_lapack(calls: set[str]) -> bool:
    """Whether a program calls LAPACK. **Raises** `ValueError` for calls that another process may not have."""
    if not all(name.startswith(("lapack_", "__", "TopK")) for name in calls):
        raise ValueError(calls)
    return any(name.startswith("lapack_") for name in calls)


class _Place:
    """The place of an array in a program's answer."""

    def __init__(self, number: int):
        self.number = number


def _fill(out: Any, numbers: list) -> Any:
    return jax.tree.map(lambda x: numbers[x.number] if isinstance(x, _Place) else x, out)


def _view(leaf: Any) -> Any:
    """The part of an argument's leaf on which a program depends: for an array, all but its numbers."""
    if eqx.is_array(leaf):
        return leaf.dtype, np.shape(leaf), bool(getattr(leaf, "weak_type", False))
    return type(leaf), repr(leaf) if isinstance(leaf, float | complex) else leaf


def _read(key: str) -> tuple[Any, Any] | None:
    content = files.read(RUNTIME.folder, key)
    if content is None:
        return None
    try:
        lapack, frame, program = pickle.loads(content)
        if lapack:
            find_lapack()
        return serialize_executable.deserialize_and_load(*program), pickle.loads(frame)
    except Exception:  # of another version, in whatever way: compiled anew
        return None
