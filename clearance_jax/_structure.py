"""What a program is traced for, as a text that is the same in another process: all that is no array of its arguments.

A text that leaves out anything on which the program depends would bring a wrong program back from a store. So this
reads only what it can read completely, and raises `Untold` for everything else.
"""

import dataclasses
import dis
import enum
import functools
import types
from collections.abc import Iterator, Mapping
from hashlib import blake2b
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from clearance_jax.identity import elsewhere


class Untold(Exception):
    """A part of a question of which it cannot be told whether it is the same in another process."""


_HEAP_TYPE = 1 << 9  # of a class written in Python
# What Python writes into every class, or a decorator, and nothing depends on.
_MADE = {
    "__module__", "__qualname__", "__doc__", "__dict__", "__weakref__", "__annotations__", "__annotate__",
    "__annotate_func__", "__annotations_cache__", "__firstlineno__", "__static_attributes__", "__dataclass_fields__",
    "__dataclass_params__", "__match_args__", "__abstractmethods__", "__abstractvars__", "__abstractclassvars__",
    "__parameters__", "__orig_bases__", "_abc_impl", "__slots__", "__classcell__", "__init__", "__repr__", "__eq__",
    "__hash__", "__replace__", "__setattr__", "__delattr__", "__signature__", "_flatten", "_unflatten",
}


def hashed(*parts: str | bytes) -> str:
    """Texts as one short text."""
    found = blake2b(digest_size=16)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(len(data).to_bytes(8, "little") + data)
    return found.hexdigest()


def tree_text(tree: Any) -> str:
    """A tree's structure (a `PyTreeDef`): every node's class, and what it holds beside its leaves.

    **Raises:** `Untold`.
    """
    reader = _Reader()

    def of(node: Any) -> str:
        data = node.node_data()
        children = node.children()
        if data is None:
            return "leaf" if not children and node.num_leaves else "nothing"
        kind, held = data
        return hashed("node", reader.of(kind), reader.of(held), *map(of, children))

    return of(tree)


def text(value: Any) -> str:
    """A value, with all that it is made of. **Raises:** `Untold`."""
    return _Reader().of(value)


class _Reader:
    """Reads values; knows which it is within, so that a function that calls itself ends."""

    def __init__(self):
        self._within: list[Any] = []

    def of(self, value: Any) -> str:
        if value is None or (isinstance(value, bool | int | str | bytes) and not isinstance(value, enum.Enum)):
            return f"{_name(type(value))} {value!r}"
        if isinstance(value, float):
            return f"{_name(type(value))} {value.hex()}"
        for depth, one in enumerate(self._within):
            if one is value:
                return f"above {depth}"
        self._within.append(value)
        try:
            return self._compound(value)
        finally:
            self._within.pop()

    def _compound(self, value: Any) -> str:
        if isinstance(value, Tracer):
            raise Untold(f"a traced value: {type(value)}")
        if isinstance(value, jax.Array | np.ndarray | np.generic):
            array = np.asarray(value)
            if array.dtype.kind not in "biufc":
                raise Untold(f"an array of {array.dtype}")
            return hashed("array", str(array.dtype), str(array.shape), np.ascontiguousarray(array).tobytes())
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, types.FunctionType):
            return self._function(value)
        if isinstance(value, types.CodeType):
            return self._code(value)
        if isinstance(value, types.ModuleType):
            if not elsewhere(value.__name__):
                raise Untold(f"a module of the user's: {value.__name__}")
            return f"module {value.__name__}"
        if isinstance(value, enum.Enum):
            return hashed("enum", self.of(type(value)), value.name)
        if isinstance(value, Mapping):
            pairs = [hashed(self.of(key), self.of(one)) for key, one in value.items()]
            return hashed("mapping", self.of(type(value)), *pairs)
        if isinstance(value, set | frozenset):
            return hashed("set", *sorted(map(self.of, value)))
        if isinstance(value, list | tuple):
            return hashed("sequence", self.of(type(value)), *map(self.of, value))
        if isinstance(value, complex | range | np.dtype | types.EllipsisType):
            return hashed(type(value).__name__, repr(value))
        if isinstance(value, slice):
            return hashed("slice", *map(self.of, (value.start, value.stop, value.step)))
        return self._wrapped(value)

    def _wrapped(self, value: Any) -> str:
        """What wraps a function, or an object of a class written in Python."""
        kind = _name(type(value))
        if isinstance(value, functools.partial):
            return hashed(kind, self.of(value.func), self.of(value.args), self.of(value.keywords))
        if isinstance(value, types.MethodType):
            return hashed(kind, self.of(value.__func__), self.of(value.__self__))
        if isinstance(value, property):
            return hashed(kind, *map(self.of, (value.fget, value.fset)))
        if isinstance(value, staticmethod | classmethod):
            return hashed(kind, self.of(value.__func__))
        if isinstance(value, types.BuiltinFunctionType | np.ufunc):
            home = getattr(value, "__module__", "") or ""
            if isinstance(getattr(value, "__self__", None), types.ModuleType | None):
                return f"built in {home}.{getattr(value, '__qualname__', value.__name__)}"
            raise Untold(f"a method of a built-in object: {value}")
        inner = getattr(value, "__wrapped__", None)
        if callable(inner) and elsewhere(type(value).__module__) and not dataclasses.is_dataclass(value):
            return hashed(kind, self.of(inner))
        if not all(base.__flags__ & _HEAP_TYPE for base in type(value).__mro__[:-1]):
            raise Untold(f"an object of {kind}")
        if dataclasses.is_dataclass(value):
            fields = [field.name for field in dataclasses.fields(value)]
            held = {name: getattr(value, name) for name in fields if hasattr(value, name)} | _variables(value)
        else:
            held = _variables(value)
            if any("__slots__" in vars(base) for base in type(value).__mro__[:-1]):
                raise Untold(f"an object with slots, of {kind}")
        return hashed("object", self.of(type(value)), self.of(held))

    def _class(self, kind: type) -> str:
        if elsewhere(kind.__module__):
            if "<locals>" in kind.__qualname__:
                raise Untold(f"a class made by a function: {_name(kind)}")
            return f"class {_name(kind)}"
        return hashed("class", _name(kind), *self._members(kind))

    def _members(self, kind: type) -> Iterator[str]:
        for base in kind.__mro__:
            if elsewhere(base.__module__):
                yield _name(base)
                continue
            yield hashed(base.__name__, *(str(one) for one in sorted(getattr(base, "__abstractmethods__", ()))))
            for name, member in vars(base).items():
                if name not in _MADE or (isinstance(member, types.FunctionType) and not _generated(member)):
                    yield hashed(name, self.of(member))

    def _function(self, function: types.FunctionType) -> str:
        own = not elsewhere(function.__module__)
        cells = [self.of(_content(cell)) for cell in function.__closure__ or ()]
        defaults = self.of(function.__defaults__), self.of(function.__kwdefaults__)
        inner = getattr(function, "__wrapped__", None)
        parts = [f"{function.__module__}.{function.__qualname__}", self._code(function.__code__), *cells, *defaults]
        if inner is not None:
            parts.append(self.of(inner))
        if own:
            parts += [hashed(name, self._looked_up(name, function)) for name in sorted(_names(function.__code__))]
        return hashed("function", *parts)

    def _looked_up(self, name: str, function: types.FunctionType) -> str:
        """What a name of a function's module is now."""
        if name in function.__globals__:
            return self.of(function.__globals__[name])
        builtins = function.__globals__.get("__builtins__", {})
        builtins = vars(builtins) if isinstance(builtins, types.ModuleType) else builtins
        if name in builtins:
            return f"built in {name}"
        raise Untold(f"a name that is not known yet: {name}")

    def _code(self, code: types.CodeType) -> str:
        constants = [self.of(one) for one in code.co_consts]
        names = [*code.co_names, "|", *code.co_varnames, "|", *code.co_freevars]
        return hashed(code.co_code, *names, *constants)


def _name(kind: Any) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _variables(value: Any) -> dict[str, Any]:
    return dict(getattr(value, "__dict__", {}))


def _generated(function: types.FunctionType) -> bool:
    """Whether a decorator wrote it, from the fields."""
    inner = getattr(function, "__wrapped__", function)
    return inner.__code__.co_filename.startswith("<") or elsewhere(inner.__module__)


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:
        raise Untold("a name that is not known yet") from None


def _names(code: types.CodeType) -> set[str]:
    """The names that a function of the user's looks up in its module, those of functions inside it too."""
    found = set()
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            found.add(step.argval)
        if step.opname == "IMPORT_NAME" and not elsewhere(step.argval):
            raise Untold(f"a module of the user's: {step.argval}")
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            found |= _names(constant)
    return found
