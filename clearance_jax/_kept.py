"""Programs that are kept between processes as loadable executables: a second process neither traces nor compiles them.

Off unless `configure(cache=...)` switches it on. Whatever is not certain (a structure that cannot be read completely, a
file that is damaged, an executable that cannot be kept) is a reason to compile as usual, never an error.
"""

import contextlib
import functools
import importlib
import os
import pickle
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax._src import config as jax_config  # all that a trace depends on, and the switch of JAX's own cache
from jax._src import core as jax_core
from jax.core import Tracer
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache

from clearance_jax import _folder
from clearance_jax._structure import Untold, hashed, text, tree_text
from clearance_jax.identity import source_digest

_PACKAGES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")
_where: list[Path] = []
_jax: Any = jax.config  # whose settings have no types


def keep_in(folder: Path | None) -> None:
    """Keep programs in this folder from now on; `None`: nowhere. Only where the variable CLEARANCE_KEPT is 1."""
    _where[:] = [folder] if folder is not None and os.environ.get("CLEARANCE_KEPT") == "1" else []


class kept_jit:
    """A function as `jit` (by default `eqx.filter_jit`) makes it, whose programs are kept where that is possible.

    The function must depend on nothing but its arguments and this library's sources; `name` tells it from all others.
    Positional arguments only.
    """

    def __init__(self, function: Callable, name: str = "", jit: Callable = eqx.filter_jit):
        self.function, self.plain, self.filtered = function, jit(function), jit is eqx.filter_jit
        self.name = name or f"{function.__module__}.{function.__qualname__}"
        self._loaded: dict[str, tuple[Any, Any]] = {}
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        leaves = jax.tree.leaves(arguments)
        if not _where or not _ordinary(leaves) or not (self.filtered or all(map(eqx.is_array, leaves))):
            return self.plain(*arguments)
        arrays, rest = eqx.partition(arguments, eqx.is_array)
        numbers = jax.tree.leaves(arrays)
        try:
            key = self._key(arguments, numbers, rest)
        except (Untold, RecursionError):
            return self.plain(*arguments)
        if key not in self._loaded:
            self._loaded[key] = _read(key) or self._made(key, arrays, rest)
        program, out = self._loaded[key]
        return _filled(out, program(*numbers)) if program is not None else self.plain(*arguments)

    def _key(self, arguments: Any, numbers: list, rest: Any) -> str:
        shapes = [f"{x.dtype} {np.shape(x)} {bool(getattr(x, 'weak_type', False))}" for x in numbers]
        marked = jax.tree.map(eqx.is_array, arguments)
        where = "".join("01"[one] for one in jax.tree.leaves(marked))
        structure = tree_text(jax.tree.structure(arguments)), text(jax.tree.leaves(rest))
        # Named axes, an object without a text, are there only within a transformation: see `_ordinary`.
        settings = [x for x in jax_config.trace_context() if not isinstance(x, jax_core.AxisEnv)]
        context = repr((_jax.jax_enable_x64, settings)), os.environ.get("XLA_FLAGS", "")
        return hashed(self.name, *structure, where, *shapes, *context, _surroundings())

    def _made(self, key: str, arrays: Any, rest: Any) -> tuple[Any, Any]:
        """The program compiled here, and kept; (None, None) where it cannot be."""
        numbers, tree = jax.tree.flatten(arrays)
        outside: list[Any] = []

        def flat(*numbers):
            out = self.function(*eqx.combine(jax.tree.unflatten(tree, numbers), rest))
            found, left = eqx.partition(out, eqx.is_array)
            leaves, shape = jax.tree.flatten(found)
            places = jax.tree.unflatten(shape, [_Place(i) for i in range(len(leaves))])
            outside[:] = [eqx.combine(places, left, is_leaf=lambda x: isinstance(x, _Place))]
            return leaves

        lowered = jax.jit(flat).lower(*numbers)
        if "callback" in lowered.as_text():  # it would point into this process
            return None, None
        try:
            frame = pickle.dumps(outside[0])
        except Exception:  # what a tree holds may refuse in its own words
            return None, None
        # What JAX's own cache brings back cannot be kept once more: it would lack functions.
        with _jax_cache_off():
            program = lowered.compile()
        try:
            content = pickle.dumps((frame, serialize_executable.serialize(program)))
        except Exception:
            content = None
        if content is not None:
            _folder.write(_where[0], key, content)
        return program, outside[0]


class _Place:
    """Where an array of a program's answer goes."""

    def __init__(self, number: int):
        self.number = number


def _filled(out: Any, numbers: list) -> Any:
    return jax.tree.map(lambda x: numbers[x.number] if isinstance(x, _Place) else x, out)


def _read(key: str) -> tuple[Any, Any] | None:
    if _folder.unsafe(_where[0]):
        return None
    content = _folder.read(_where[0], key)
    if content is None:
        return None
    try:
        _ready()
        frame, program = pickle.loads(content)
        return serialize_executable.deserialize_and_load(*program), pickle.loads(frame)
    except Exception:  # of another version, in whatever way: compiled anew
        return None


@functools.cache
def _ready() -> None:
    """LAPACK's functions, which JAX looks up only when it lowers a program: without them a loaded one would crash."""
    lapack: Any = importlib.import_module("jaxlib.lapack")
    lapack._lapack.initialize()


def _ordinary(leaves: list) -> bool:
    """Whether a call is an ordinary one, on the CPU: not inside of another program."""
    return (
        not any(isinstance(x, Tracer) for x in leaves)
        and jax_core.trace_state_clean()
        and jax.default_backend() == "cpu"
        and jax.local_device_count() == 1
        and _jax.jax_default_device is None
        and not (_jax.jax_debug_nans or _jax.jax_debug_infs or _jax.jax_disable_jit)
        and _processor() != ""
    )


@functools.cache
def _processor() -> str:
    """What this processor can do; empty where that is not known."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    words = "flags", "Features", "model", "CPU part", "cpu family", "vendor"
    told = sorted({x for x in lines if x.startswith(words)})
    return hashed(platform.machine(), *told) if any(x.startswith(("flags", "Features")) for x in told) else ""


@functools.cache
def _surroundings() -> str:
    """All outside of the question: sources, versions and the processor."""
    return hashed(source_digest(), _processor(), sys.version, *(f"{name} {version(name)}" for name in _PACKAGES))


@contextlib.contextmanager
def _jax_cache_off() -> Iterator[None]:
    """JAX looks only once whether its cache is used: it is made to look again."""
    compilation_cache.reset_cache()
    try:
        with jax_config.enable_compilation_cache(False):
            yield
    finally:
        compilation_cache.reset_cache()
