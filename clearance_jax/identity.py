"""What makes one question another: a description by names that can be kept, compared, and told apart in words.

A sweep's store, a life's journal and a record of designs keep the description of their question and refuse others.
A description has every number of the models by its name, the settings, the versions with a digest of this library's
source, and a digest of every function and class of the user's that takes part. The code of other packages counts by its
name only.
"""

import dataclasses
import dis
import enum
import functools
import hashlib
import json
import pickle
import re
import sys
import types
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from clearance_jax.parameters import parameters

SOURCE, STRUCTURE = "source of clearance_jax", "structure of the model"
# What computes an answer, beside the question itself.
VERSIONS = ("clearance_jax", SOURCE, "jax")
PACKAGE = Path(__file__).parent
_ADDRESS = re.compile(r"0x[0-9a-f]+")
# What a class has of its maker, not of whoever wrote it.
_MADE = {
    *("__module__", "__qualname__", "__doc__", "__dict__", "__weakref__", "__annotations__", "__annotate__"),
    *("__annotate_func__", "__annotations_cache__", "__firstlineno__", "__static_attributes__", "__parameters__"),
    *("__dataclass_fields__", "__dataclass_params__", "__match_args__", "__orig_bases__"),
    *("__abstractmethods__", "__abstractvars__", "__abstractclassvars__", "_abc_impl"),
}
_BY_DATACLASS = {"__init__", "__repr__", "__eq__", "__hash__", "__replace__", "__setattr__", "__delattr__"}


@functools.cache
def source_digest() -> str:
    """All Python sources of this library as one short text, read once a process: the version's number alone does not
    tell two states of a working copy apart.
    """
    found = hashlib.blake2b(digest_size=8)
    for path in sorted(PACKAGE.rglob("*.py")):
        found.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


def versions() -> dict[str, str]:
    """What computes: this library, its source, and JAX."""
    return dict(zip(VERSIONS, (version("clearance-jax"), source_digest(), jax.__version__), strict=True))


def numbers(model: Any, label: str = "") -> dict[str, Any]:
    """Every number of a model by its name, what else it is made of as one short text, and a digest of each function and
    class of the user's in it, by its name too. The label stands behind every name.
    """
    known = parameters(model) if isinstance(model, eqx.Module) else {}
    reader = _Reader({id(leaf.value) for leaf in known.values()})
    structure = f"{type(model).__qualname__} {reader.of(model)}"
    found = {f"{name}{label}": np.asarray(leaf.value).tolist() for name, leaf in known.items()}
    found |= {f"code of {name}{label}": code for name, code in reader.code.items()}
    return found | {f"{STRUCTURE}{label}": structure}


def settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name as numbers and short texts; those that are `None` are left out."""
    return {name: shown(value) for name, value in given.items() if value is not None}


def shown(value: Any) -> Any:
    """A value as a number or a short text."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        array = np.asarray(value)
        return array.tolist() if array.size <= 8 else f"{array.shape} {digest(array)}"
    if isinstance(value, list | tuple) and all(isinstance(one, str | int | float) for one in value):
        return list(value) if len(value) <= 8 else f"{len(value)} of them, {digest(list(value))}"
    return value if isinstance(value, str | int | float | bool) else f"{type(value).__qualname__} {digest(value)}"


def kept(described: Mapping[str, Any]) -> dict[str, Any]:
    """A description as it comes back from a file."""
    return json.loads(json.dumps(described), parse_constant=str)


def fingerprint(described: Mapping[str, Any]) -> str:
    """A description as one short text."""
    return hashlib.blake2b(json.dumps(described, sort_keys=True).encode(), digest_size=16).hexdigest()


def differences(old: Mapping[str, Any], new: Mapping[str, Any], where: str) -> dict[str, str]:
    """What the `new` question has otherwise than the `old`, which is kept somewhere (`where`: "in the store"): by name,
    in words; what computes it comes last.
    """
    names = sorted({**old, **new}, key=lambda name: name in VERSIONS)
    return {
        name: f"`{name}` is {_put(new.get(name))} here and {_put(old.get(name))} {where}"
        for name in names
        if old.get(name) != new.get(name)
    }


def refusal(path: Any, found: Mapping[str, str], what: str, fix: str) -> str:
    """Why a file of another question is not gone on with, by the `differences` that were found, and what to do.
    `what`: what it is then ("belongs to another question").
    """
    computes = [name for name in found if name in VERSIONS]
    # Another state of the library may be made of other parts.
    asked = [name for name in found if name not in VERSIONS and not (computes and name.startswith(STRUCTURE))]
    names = [*asked, *(name for name in found if name not in asked)] if asked else computes or list(found)
    said = "; ".join(found[name] for name in names[:3]) + (f"; and {len(names) - 3} more" if len(names) > 3 else "")
    if asked or not computes:
        return f"`{path}` {what}: {said}. {fix}."
    return (
        f"`{path}` was begun by another version of the library: {said}. The digits of its answers may differ. {fix}, "
        "or go on with the version that began it."
    )


def _put(value: Any) -> str:
    text = "absent" if value is None else value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def digest(value: Any) -> str:
    """What a value is, with all that it is made of, as one short text; not where in memory it lies."""
    reader = _Reader()
    return _hashed(reader.of(value), *(part for pair in reader.code.items() for part in pair))


def _hashed(*parts: str | bytes) -> str:
    found = hashlib.blake2b(digest_size=6)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(len(data).to_bytes(8, "little") + data)
    return found.hexdigest()


# Reading values ------------------------------------------------------------------------------------------------------


class _Reader:
    """Digests of values. `aside`: arrays, by `id`, that are told elsewhere; `code`: what was met of the user's
    functions and classes, by name, which the digests have by that name only.
    """

    def __init__(self, aside: set[int] = frozenset()):  # pyright: ignore[reportArgumentType]
        self.code: dict[str, str] = {}
        self._aside, self._done, self._within = aside, {}, []

    def of(self, value: Any) -> str:
        if id(value) in self._aside:
            return "named"
        if value is None or (isinstance(value, bool | int | float | complex | str | bytes) and not _enumerated(value)):
            return f"{type(value).__name__} {value!r}"
        if id(value) in self._done:
            return self._done[id(value)][1]
        if any(one is value for one in self._within):
            return "above"
        self._within.append(value)
        try:
            found = self._compound(value)
        finally:
            self._within.pop()
        self._done[id(value)] = value, found  # the value stays, so that no other gets its id
        return found

    def _compound(self, value: Any) -> str:
        if isinstance(value, jax.Array | np.ndarray | np.generic):
            array = np.asarray(value)
            if array.dtype.kind != "O":
                return _hashed("array", str(array.dtype), str(array.shape), np.ascontiguousarray(array).tobytes())
            return _hashed("array", str(array.shape), *map(self.of, array.ravel().tolist()))
        if isinstance(value, types.FunctionType | type):
            name = f"{value.__module__}.{value.__qualname__}"
            if elsewhere(value.__module__):
                return _hashed(name, *self._held(value))
            return self._own(value, name)
        if isinstance(value, types.ModuleType):
            return _module(value)
        if isinstance(value, enum.Enum):
            return _hashed(self.of(type(value)), value.name)
        if isinstance(value, Mapping):
            pairs = sorted((self.of(key), self.of(one)) for key, one in value.items())
            return _hashed("mapping", *(part for pair in pairs for part in pair))
        if isinstance(value, set | frozenset):
            return _hashed("set", *sorted(map(self.of, value)))
        if isinstance(value, list | tuple):
            return _hashed(self.of(type(value)), *map(self.of, value))
        inner = _unwrapped(value)
        if inner is not None:
            return _hashed(type(value).__name__, *map(self.of, inner))
        return self._object(value)

    def _object(self, value: Any) -> str:
        kind = self.of(type(value))
        if dataclasses.is_dataclass(value):
            names = [field.name for field in dataclasses.fields(value)]
            return _hashed(kind, *(self.of((name, getattr(value, name, None))) for name in names))
        held = getattr(value, "__dict__", None)
        if held:
            return _hashed(kind, self.of(dict(held)))
        try:
            return _hashed(kind, pickle.dumps(value, protocol=4))
        except Exception:  # whatever an object raises that cannot be pickled
            return _hashed(kind, _ADDRESS.sub("", repr(value)))

    def _held(self, value: Any) -> Iterator[str]:
        """What a function keeps: of its makers, and as defaults."""
        if isinstance(value, types.FunctionType):
            for cell in value.__closure__ or ():
                yield self.of(_content(cell))
            yield self.of(value.__defaults__)
            yield self.of(value.__kwdefaults__)

    def _own(self, value: Any, name: str) -> str:
        """A function or class of the user's: by its code where another one has it, else by its name, with its code
        among those found.
        """
        nested = any(_is_own(one) for one in self._within[:-1])
        code = self._function(value) if isinstance(value, types.FunctionType) else _hashed(*self._class(value))
        if nested:
            return _hashed(name, code)
        short, count = value.__qualname__, 1
        while short in self.code:
            count += 1
            short = f"{value.__qualname__} ({count})"
        self.code[short] = f"{code} (Python {sys.version_info[0]}.{sys.version_info[1]})"
        return short

    def _function(self, function: types.FunctionType) -> str:
        named = sorted(name for name in set(_globals(function.__code__)) if name in function.__globals__)
        known = (_hashed(name, self.of(function.__globals__[name])) for name in named)
        return _hashed(self._code(function.__code__), *self._held(function), *known)

    def _code(self, code: types.CodeType) -> str:
        constants = (self._code(one) if isinstance(one, types.CodeType) else self.of(one) for one in code.co_consts)
        return _hashed(code.co_code, *code.co_names, *code.co_varnames, *constants)

    def _class(self, kind: type) -> Iterator[str]:
        for base in kind.__mro__:
            if elsewhere(base.__module__):
                yield f"{base.__module__}.{base.__qualname__}"
                continue
            for name, member in sorted(vars(base).items()):
                if name not in _MADE and not (name in _BY_DATACLASS and _made(member)):
                    yield _hashed(name, self.of(member))


def _enumerated(value: Any) -> bool:
    return isinstance(value, enum.Enum)


def _is_own(value: Any) -> bool:
    return isinstance(value, types.FunctionType | type) and not elsewhere(value.__module__)


def _made(member: Any) -> bool:
    """Whether a method was written by `dataclass`."""
    function = getattr(member, "__wrapped__", getattr(member, "method", member))
    return not isinstance(function, types.FunctionType) or function.__code__.co_filename.startswith("<")


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # empty
        return None


def _unwrapped(value: Any) -> list[Any] | None:
    """What stands within something that only wraps it: a method, a partial or a jitted function."""
    if isinstance(value, functools.partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, types.MethodType):
        return [value.__func__, value.__self__]
    if isinstance(value, property):
        return [value.fget]
    if isinstance(value, staticmethod | classmethod):
        return [value.__func__]
    for name in ("__wrapped__", "method", "func"):
        inner = getattr(value, name, None)
        if isinstance(inner, types.FunctionType) and not dataclasses.is_dataclass(value):
            return [inner]
    name = getattr(value, "__qualname__", getattr(value, "__name__", None))
    return [f"{getattr(value, '__module__', '')}.{name}"] if callable(value) and isinstance(name, str) else None


def _globals(code: types.CodeType) -> Iterator[str]:
    """The names that a function looks up in its module, those of functions inside it too."""
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            yield step.argval
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _globals(constant)


def _module(module: types.ModuleType) -> str:
    """A module of the user's by its text."""
    if elsewhere(module.__name__):
        return f"module {module.__name__}"
    try:
        return _hashed(module.__name__, Path(str(module.__file__)).read_bytes())
    except OSError:
        return f"module {module.__name__}"


@functools.cache
def elsewhere(name: str | None) -> bool:
    """Whether a module is this library's, Python's or of an installed package: what versions and `SOURCE` tell."""
    head = (name or "__main__").partition(".")[0]
    if head == "__main__":
        return False
    if head == PACKAGE.name or head in sys.stdlib_module_names or head in sys.builtin_module_names:
        return True
    file = getattr(sys.modules.get(head), "__file__", None) or ""
    return bool({"site-packages", "dist-packages"} & set(Path(file).parts))
