"""The state of this library in a process, where a method or a constant may have been replaced in memory.

The digest of its sources does not show that. So everything of which a program may be made is read as it is: the
functions, classes and constants of every module that can be reached from the program's own. With them it depends on its
surroundings: sources, versions, JAX's settings, the processor.
"""

import functools
import hashlib
import platform
import sys
import threading
import types
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
from jax.extend.backend import get_compile_options  # with XLA's flags in force: the variable may have been set too late

from clearance_jax._compile.code import MADE, PACKAGE, VERSIONED, functions_of, name_of
from clearance_jax._compile.private import settings
from clearance_jax._compile.runtime import RUNTIME
from clearance_jax._compile.structure import Reader, hash_texts

_HEAD = PACKAGE.name + "."
# The state of these changes in a process, and no program depends on it.
_STATEFUL = "kept", "library", "runtime", "files", "structure", "code", "private"
_ASIDE = {f"{_HEAD}_compile.{name}" for name in _STATEFUL} | {f"{_HEAD}configure"}
_reading = threading.Lock()


def library_text(modules: Iterable[str]) -> str:
    """The state of this library, as seen from some of its modules.

    **Raises:** `Untold` if code of the user's is part of it.
    """
    waiting, texts = set(modules), {}
    while waiting:
        name = waiting.pop()
        module = sys.modules.get(name)
        if name in texts or not name.startswith(_HEAD) or name in _ASIDE or module is None:
            continue
        with _reading:  # one thread at a time
            texts[name], more = _module_text(name, module)
        waiting |= more
    return hash_texts(*(part for pair in sorted(texts.items()) for part in pair))


def _module_text(name: str, module: types.ModuleType) -> tuple[str, set[str]]:
    now = list(_contents(module))
    known = RUNTIME.modules.get(name)
    if known is None or len(known[0]) != len(now) or any(a is not b for a, b in zip(known[0], now, strict=True)):
        reader = Reader(strict=True, state=True)
        text = hash_texts(*(hash_texts(key, _tell(value, name, reader)) for key, value in sorted(_named(module))))
        if known is not None and known[1] != text:
            RUNTIME.altered.add(name)
        known = RUNTIME.modules[name] = now, text, reader.homes
    return known[1], known[2]


def _named(module: types.ModuleType) -> Iterator[tuple[str, Any]]:
    """What a module has by name: not Python's own entries, nor submodules, which appear when imported."""
    for key, value in list(vars(module).items()):  # copied: another thread may add something
        if not key.startswith("__") and not (isinstance(value, types.ModuleType) and hasattr(module, "__path__")):
            yield key, value


def _contents(module: types.ModuleType) -> Iterator[Any]:
    """Everything in a module and its classes, and the functions' code; if it is the same, nothing has changed."""
    for _, value in _named(module):
        yield value
        yield from _replaceable(value)
        if isinstance(value, dict):
            yield from (*value, *value.values())
        elif isinstance(value, list | tuple | set | frozenset):
            yield from value
        elif isinstance(value, type) and value.__module__ == module.__name__:
            for name, member in list(vars(value).items()):
                if name not in MADE:
                    yield member
                    yield from _replaceable(member)


def _replaceable(value: Any) -> Iterator[Any]:
    """The parts of functions that a reloading editor replaces in place, through all wrappers."""
    for function in functions_of(value):
        yield from (function.__code__, function.__defaults__, function.__kwdefaults__)


def _tell(value: Any, home: str, reader: Reader) -> str:
    """The text of what a module has by name: a class of its own by its members, all else as it is."""
    if not isinstance(value, type) or value.__module__ != home:
        return reader.of(value)
    members = [(name, member) for name, member in sorted(vars(value).items()) if name not in MADE]
    return hash_texts(name_of(value), *(hash_texts(name, _tell(member, "", reader)) for name, member in members))


_jax: Any = jax.config  # whose settings have no types


def surroundings() -> str:
    """All surroundings as one text; what cannot change within a process is read once."""
    return hash_texts(source_digest(), processor(), _versions(), _flags(), repr(settings()))


def is_plain() -> bool:
    """Whether programs run as in any process like this one: on one CPU, without checks for errors."""
    return (
        jax.default_backend() == "cpu"
        and jax.local_device_count() == 1
        and _jax.jax_default_device is None
        and not (_jax.jax_debug_nans or _jax.jax_debug_infs or _jax.jax_disable_jit)
        and processor() != ""
    )


@functools.cache
def source_digest() -> str:
    """A digest of all Python sources of this library, read once a process. The version's number alone does not
    distinguish two states of a working copy.
    """
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


@functools.cache
def processor() -> str:
    """The abilities of this processor; empty if they are not known."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    words = "flags", "Features", "model", "CPU part", "cpu family", "vendor"
    told = sorted({x for x in lines if x.startswith(words)})
    return hash_texts(platform.machine(), *told) if any(x.startswith(("flags", "Features")) for x in told) else ""


@functools.cache
def _versions() -> str:
    return hash_texts(sys.version, *(f"{name} {_version(name)}" for name in VERSIONED))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"


def _flags() -> bytes:
    """XLA's flags with which programs are compiled."""
    return get_compile_options(num_replicas=1, num_partitions=1).SerializeAsString()
