"""A text of everything of which a value consists, the same in another process: numbers, words, and the user's code.

One reader serves everything that is kept between processes. Programs (`kept`) use it strictly: a text without
something on which a program depends would return a wrong program, so it raises `Untold` for everything that it cannot
read completely, and for every function and class of the user's. The modules of this library are read too, because parts
of them may have been replaced (`library`). Questions of sweeps, lives and designs (`identity`) use
the best possible text: the user's functions and classes are read by their code (byte code, constants, closures,
defaults, and the functions and globals that they name). Other packages and this library count by names.
"""

import dataclasses
import enum
import functools
import math
import pickle
import re
import sys
import types
from collections.abc import Iterator, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from clearance_jax._compile.code import (
    MADE,
    Untold,
    content,
    elsewhere,
    functions_of,
    in_python,
    inner_of,
    is_generated,
    is_versioned,
    lookup,
    name_of,
    names_in,
    variables,
)

_ADDRESS = re.compile(r"0x[0-9a-f]+")


_PLAIN = {type(None), bool, int, float, complex, str, bytes}  # of which `repr` has all digits


def hash_texts(*parts: str | bytes) -> str:
    """A short digest of several texts."""
    whole = [part.encode("utf-8", "surrogatepass") if isinstance(part, str) else part for part in parts]
    lengths = b",".join(b"%d" % len(part) for part in whole)
    return blake2b(b"".join((lengths, b"|", *whole)), digest_size=16).hexdigest()


class Reader:
    """Texts of values. `aside`: values, by `id`, that are identified otherwise. `code`: the user's functions and
    classes that were met, by name; texts contain only these names, and `whole` adds the code. `homes`: the modules of
    all functions and classes that were met. `strict`: raise `Untold` for values that cannot be read completely, and for
    code of the user's. `state`: read what a module consists of; of an object with a state of its own, such as a lock or
    a property that remembers its values, its class and its functions count.
    """

    def __init__(self, aside: Any = (), strict: bool = False, state: bool = False):
        self.code: dict[str, str] = {}
        self.homes: set[str] = set()
        self._aside, self._strict, self._state, self._done, self._within = set(aside), strict, state, {}, []
        self._foreign = is_versioned if strict and not state else elsewhere  # modules whose code counts by its name
        self._open = math.inf  # depth of the outermost value that was met again inside itself

    def whole(self, digest: str) -> str:
        """A text with the code that it names."""
        return hash_texts(digest, *(part for pair in self.code.items() for part in pair))

    def tree(self, tree: Any) -> str:
        """The text of a tree's structure (a `PyTreeDef`): every node's class, and its static data."""
        data, children = tree.node_data(), tree.children()
        if data is None:
            return "leaf" if not children and tree.num_leaves else "nothing"
        return hash_texts("node", *map(self.of, data), *map(self.tree, children))

    def of(self, value: Any) -> str:
        if id(value) in self._aside:
            return "named"
        if type(value) in _PLAIN:  # and of no class of the user's
            return f"{type(value).__name__} {value!r}"
        if id(value) in self._done:
            return self._done[id(value)][1]
        here = len(self._within)
        for depth, outer in enumerate(self._within):
            if outer is value:
                self._open = min(self._open, depth)
                return f"above {here - depth}"
        before, self._open = self._open, math.inf
        self._within.append(value)
        try:
            digest = self._compound(value)
        finally:
            self._within.pop()
        if self._open >= here:  # its text does not depend on where it stands
            self._done[id(value)] = value, digest  # the value stays, so that no other gets its id
            self._open = before
        else:
            self._open = min(before, self._open)
        return digest

    def _compound(self, value: Any) -> str:
        if isinstance(value, Tracer) and self._strict:
            return self._unknown(value)
        if isinstance(value, jax.Array | np.ndarray | np.generic):
            return self._array(value)
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, types.FunctionType):
            return self._function(value)
        if isinstance(value, types.CodeType):
            return self._code(value)
        if isinstance(value, types.ModuleType):
            return self._module(value)
        if isinstance(value, enum.Enum):
            return hash_texts("enum", self.of(type(value)), value.name, self.of(value.value))
        if isinstance(value, Mapping) and not dataclasses.is_dataclass(value):
            pairs = [hash_texts(self.of(key), self.of(entry)) for key, entry in value.items()]
            return hash_texts("mapping", self.of(type(value)), *pairs, *self._beside(value))
        if isinstance(value, set | frozenset):
            return hash_texts("set", self.of(type(value)), *sorted(map(self.of, value)), *self._beside(value))
        if isinstance(value, list | tuple):
            return hash_texts("sequence", self.of(type(value)), *map(self.of, value), *self._beside(value))
        if isinstance(value, range | np.dtype | types.EllipsisType | types.NotImplementedType):
            return hash_texts(name_of(type(value)), repr(value))
        if isinstance(value, slice):
            return hash_texts("slice", *map(self.of, (value.start, value.stop, value.step)))
        return self._wrapper(value)

    def _beside(self, value: Any) -> list[str]:
        """The attributes of a container's own class, besides its contents."""
        attributes = self._attributes(value)
        return ["beside", self.of(attributes)] if attributes else []

    def _attributes(self, value: Any) -> dict[str, Any]:
        """The attributes of an object that count."""
        attributes = variables(value)
        if not self._state:
            return attributes
        return {name: x for name, x in attributes.items() if not isinstance(x, dict | list | set)}

    def _array(self, value: Any) -> str:
        try:
            array = np.asarray(value)
        except (TypeError, ValueError):  # random keys
            return self._unknown(value)
        kind = (
            "array",
            name_of(type(value)),
            str(array.dtype),
            str(array.shape),
            str(getattr(value, "weak_type", False)),
        )
        if isinstance(value, np.ndarray) and type(value) is not np.ndarray:  # a mask, or the user's operations
            kind = (*kind, self.of(type(value)), *self._beside(value))
        if array.dtype.kind == "O":
            return hash_texts(*kind, *map(self.of, array.ravel().tolist()))
        return hash_texts(*kind, np.ascontiguousarray(array).tobytes())

    def _module(self, value: types.ModuleType) -> str:
        """A module of the user's by its text."""
        self.homes.add(value.__name__)
        if self._foreign(value.__name__):
            return f"module {value.__name__}"
        if self._strict:
            raise Untold(f"a module of the user's: {value.__name__}")
        try:
            return hash_texts(value.__name__, Path(str(value.__file__)).read_bytes())
        except OSError:
            return f"module {value.__name__}"

    def _wrapper(self, value: Any) -> str:
        """A wrapper of a function, or an object."""
        kind = self.of(type(value))
        if isinstance(value, functools.partial):
            return hash_texts(kind, *map(self.of, (value.func, value.args, value.keywords)))
        if isinstance(value, types.MethodType):
            return hash_texts(kind, self.of(value.__func__), self.of(value.__self__))
        if isinstance(value, property):
            return hash_texts(kind, *map(self.of, (value.fget, value.fset, *([value.fdel] if value.fdel else []))))
        if isinstance(value, staticmethod | classmethod):
            return hash_texts(kind, self.of(value.__func__))
        if isinstance(value, types.BuiltinFunctionType | np.ufunc):
            owner = getattr(value, "__self__", None)
            if self._strict and not _is_installed(value):
                raise Untold(f"a function that a package does not have by its name: {value!r}")
            if isinstance(owner, types.ModuleType | None) or (isinstance(owner, type) and not in_python(owner)):
                home = getattr(value, "__module__", "") or ""
                return f"built in {home}.{getattr(value, '__qualname__', value.__name__)}"
            return self._unknown(value)
        inner = inner_of(value)
        if inner is not None:
            # A rule of differentiation stands beside the function, for instance.
            beside = self._attributes(value) if not type(value).__module__.startswith("jaxlib") else {}
            attributes = {k: a for k, a in beside.items() if not k.startswith("__") and a is not inner}
            return hash_texts(kind, self.of(inner), self.of(attributes))
        return self._object(value)

    def _object(self, value: Any) -> str:
        written = all(map(in_python, type(value).__mro__[:-1]))
        attributes, slots = self._attributes(value), any("__slots__" in vars(base) for base in type(value).__mro__[:-1])
        if dataclasses.is_dataclass(value):
            names = [field.name for field in dataclasses.fields(value)]
            attributes = {name: getattr(value, name) for name in names if hasattr(value, name)} | attributes
        elif not written or slots or (not attributes and not self._strict):
            return self._unknown(value)
        if not written and self._strict:
            return self._unknown(value)
        return hash_texts("object", self.of(type(value)), self.of(attributes))

    def _unknown(self, value: Any) -> str:
        kind = self.of(type(value))
        if self._state:
            return hash_texts(kind, *map(self.of, functions_of(value)))
        if self._strict:
            raise Untold(f"an object of {name_of(type(value))}")
        try:
            return hash_texts(kind, pickle.dumps(value, protocol=4))
        except Exception:  # whatever an object raises that cannot be pickled
            return hash_texts(kind, _ADDRESS.sub("", repr(value)))

    # Code ----------------------------------------------------------------------------------------------------------

    def _own(self, value: Any, code: str) -> str:
        """A function or class of the user's: inside another one by its code, else by its name, with its code added to
        `code`.
        """
        if any(self._is_own(outer) for outer in self._within[:-1]):
            return hash_texts(value.__qualname__, code)
        short, count = value.__qualname__, 1
        while short in self.code:
            count += 1
            short = f"{value.__qualname__} ({count})"
        self.code[short] = f"{code} (Python {sys.version_info[0]}.{sys.version_info[1]})"
        return short

    def _is_own(self, value: Any) -> bool:
        if isinstance(value, types.FunctionType):
            return not self._foreign(value.__globals__.get("__name__"))
        # A class that is written in C may say anything.
        return isinstance(value, type) and isinstance(value.__module__, str) and not self._foreign(value.__module__)

    def _check_own(self, value: Any) -> None:
        """**Raises** `Untold`, if strict, for the user's code: nothing can tell what it reads, calls and remembers."""
        if self._strict and self._is_own(value):
            raise Untold(f"code of the user's: {name_of(value)}")

    def _class(self, kind: type) -> str:
        self._check_own(kind)
        self.homes.add(str(kind.__module__))
        if self._is_own(kind):
            fields = dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ()
            told = [hash_texts(field.name, self.of(dict(field.metadata)), self._factory(field)) for field in fields]
            maker = self.of(type(kind)) if self._is_own(type(kind)) else ""
            return self._own(kind, hash_texts(maker, *told, "|", *self._members(kind)))
        if self._strict and not self._state and lookup(kind) is not kind:
            raise Untold(f"a class that is not found by its name: {name_of(kind)}")
        return f"class {name_of(kind)}"

    def _factory(self, field: dataclasses.Field) -> str:
        """The function that makes a field's default value."""
        make = field.default_factory
        return "" if make is dataclasses.MISSING else self.of(make)

    def _members(self, kind: type) -> Iterator[str]:
        for base in kind.__mro__:
            if self._foreign(base.__module__):
                yield name_of(base)
                continue
            yield hash_texts(base.__name__, *map(str, sorted(getattr(base, "__abstractmethods__", ()))))
            for name, member in sorted(vars(base).items()):
                if name not in MADE and not is_generated(member):
                    yield hash_texts(name, self.of(member))

    def _function(self, function: types.FunctionType) -> str:
        self._check_own(function)
        origin = function.__globals__.get("__name__")  # `functools.wraps` copies every other name
        self.homes.add(str(origin))
        is_own = self._is_own(function)
        # A script and the module that it is when it is imported are the same.
        parts = [function.__qualname__ if is_own else f"{origin}.{function.__qualname__}"]
        if is_own or self._strict or "<" in function.__qualname__:
            parts.append(self._code(function.__code__))
        parts += [self.of(cell) for cell in self._cells(function, origin)]
        parts += [self.of(function.__defaults__), self.of(function.__kwdefaults__)]
        # The wrapped function and variables may matter too.
        for name, attribute in sorted(vars(function).items()):
            if name == "__wrapped__" or (is_own and not name.startswith("__")):
                parts.append(hash_texts(name, self.of(attribute)))
        if not is_own:
            return hash_texts("function", *parts)
        known = function.__globals__
        parts += [
            hash_texts(name, self.of(known[name])) for name in sorted(set(names_in(function.__code__))) if name in known
        ]
        return self._own(function, hash_texts(*parts))

    def _cells(self, function: types.FunctionType, origin: Any) -> list[Any]:
        """The values that a function closes over, without the checks of types that jaxtyping has made."""
        cells = [content(cell) for cell in function.__closure__ or ()]
        if not (self._state and str(origin).startswith("jaxtyping.")):
            return cells
        return [x for x in cells if not isinstance(x, types.FunctionType) or "__name__" in x.__globals__]

    def _code(self, code: types.CodeType) -> str:
        plain = [(type(constant).__name__, constant) for constant in code.co_consts if type(constant) in _PLAIN]
        others = [self.of(constant) for constant in code.co_consts if type(constant) not in _PLAIN]
        order = [type(constant) in _PLAIN for constant in code.co_consts]
        names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
        numbers = code.co_flags, code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount
        return hash_texts(code.co_code, code.co_exceptiontable, repr((names, numbers, plain, order)), *others)


def _is_installed(value: Any) -> bool:
    """Whether a function written in C is that of its name in a package whose version is in the keys."""
    if isinstance(value, np.ufunc):
        return getattr(np, value.__name__, None) is value
    home = getattr(value, "__module__", None)
    owner = getattr(value, "__self__", None)
    if not isinstance(home, str) and isinstance(owner, types.ModuleType):
        home = owner.__name__
    if not isinstance(home, str):
        return isinstance(owner, type) and not in_python(owner)
    return is_versioned(home)
