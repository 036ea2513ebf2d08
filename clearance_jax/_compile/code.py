"""Queries of functions, classes and modules: their origin, and the names that they use."""

import dataclasses
import functools
import importlib.util
import os
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class Untold(Exception):
    """Part of a question of which it is not known whether it is the same in another process."""


PACKAGE, PYTHON = Path(__file__).parents[1], Path(os.__file__).parent
# Flags of classes: made at run time, as all classes written in Python; and immutable, as some classes written in C are
# that are made at run time too (locks and patterns from Python 3.13 on).
_MADE_LATER, _UNCHANGEABLE = 1 << 9, 1 << 8
# Entries that Python or a decorator writes into every class, and on which nothing depends.
MADE = {
    *("__module__", "__qualname__", "__doc__", "__dict__", "__weakref__", "__annotations__", "__annotate__"),
    *("__annotate_func__", "__annotations_cache__", "__firstlineno__", "__static_attributes__", "__parameters__"),
    *("__dataclass_fields__", "__dataclass_params__", "__match_args__", "__orig_bases__", "__slots__"),
    *("__abstractmethods__", "__abstractvars__", "__abstractclassvars__", "_abc_impl", "__classcell__"),
    *("__signature__", "__slotnames__"),
}


# Packages whose versions are in a program's key: their code is identified by name.
VERSIONED = (
    *("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "jaxtyping", "typing_extensions"),
    *("scipy", "optax", "beartype"),
)


def elsewhere(name: str | None) -> bool:
    """Whether a module is this library's, Python's or an installed package's: versions and sources identify it."""
    return _home((name or "__main__").partition(".")[0])[0]


def is_versioned(name: str | None) -> bool:
    """As `elsewhere`, but for installed packages only those whose versions are in a key."""
    return _home((name or "__main__").partition(".")[0])[1]


@functools.cache
def _home(head: str) -> tuple[bool, bool]:
    """The answers of `elsewhere` and `is_versioned` for a package."""
    if head == "__main__":
        return False, False
    if head == PACKAGE.name or head in sys.builtin_module_names or head.startswith("namedtuple_"):
        return True, True  # a record's maker, which Python writes
    file = Path(_file(head) or PYTHON)
    if {"site-packages", "dist-packages"} & set(file.parts):
        return True, head in VERSIONED
    # A file of the user's may be named as a module of Python's.
    python = head in sys.stdlib_module_names and file.is_relative_to(PYTHON)
    return python, python


def _file(head: str) -> str | None:
    """The file of a module, imported or not."""
    if head in sys.modules:
        return getattr(sys.modules[head], "__file__", None)
    try:
        spec = importlib.util.find_spec(head)
    except (ImportError, ValueError):
        return None
    return spec.origin if spec is not None and spec.has_location else None


def inner_of(value: Any) -> Any:
    """The function within something that wraps it."""
    if dataclasses.is_dataclass(value) or not callable(value):
        return value.func if isinstance(value, functools.cached_property) else None
    for name in ("__wrapped__", "method", "func"):
        inner = getattr(value, name, None)
        if callable(inner) and (name == "__wrapped__" or isinstance(inner, types.FunctionType)):
            return inner
    return None


def functions_of(value: Any) -> Iterator[types.FunctionType]:
    """The functions of which a function, a property, or a wrapper consists."""
    waiting, seen = [value], set()
    while waiting:
        part = waiting.pop()
        if id(part) in seen or isinstance(part, type | types.ModuleType):
            continue
        seen.add(id(part))
        if isinstance(part, types.FunctionType):
            yield part
            waiting.append(getattr(part, "__wrapped__", None))
        elif isinstance(part, property):
            waiting += part.fget, part.fset, part.fdel
        elif part is not None:
            within = (x for x in variables(part).values() if isinstance(x, types.FunctionType))
            waiting += getattr(part, "__wrapped__", None), inner_of(part), *within


def is_generated(member: Any) -> bool:
    """Whether `dataclass` wrote a method; equinox wraps it."""
    function = member
    for _ in range(4):
        inner = getattr(function, "__wrapped__", getattr(function, "method", None))
        if inner is None:
            break
        function = inner
    return isinstance(function, types.FunctionType) and "__create_fn__" in function.__code__.co_qualname


def in_python(kind: type) -> bool:
    """Whether a class is written in Python."""
    return bool(kind.__flags__ & _MADE_LATER) and not kind.__flags__ & _UNCHANGEABLE


def lookup(kind: type) -> Any:
    """The object at a class's own name; a class that is not written in Python is itself."""
    if not in_python(kind):
        return kind
    target: Any = sys.modules.get(kind.__module__)
    for part in str(kind.__qualname__).split("."):
        target = getattr(target, part, None)
    return target


def name_of(kind: Any) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def variables(value: Any) -> dict[str, Any]:
    return dict(getattr(value, "__dict__", {}))


def content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not known yet, so nothing has used it
        return None


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """A code object and those of functions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def names_in(code: types.CodeType) -> Iterator[str]:
    """The names that a function looks up in its module (and those of attributes)."""
    for inner in _codes(code):
        yield from inner.co_names
