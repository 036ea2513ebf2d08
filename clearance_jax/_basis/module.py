"""The base of the library's own modules: an `equinox.Module` with ordinary attribute lookup."""

import functools
import inspect
import types
import typing
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from clearance_jax.errors import quote, wrong_value

# Numbers of an array up to which it is printed.
FEW = 8


class Module(eqx.Module):
    """A frozen dataclass and pytree.

    equinox turns every requested method into a module of its own, and for that checks every attribute and flattens the
    whole module. Tracing a solve requests several hundred thousand attributes, which took a large part of its time.
    Here a method is an ordinary bound method. Give `eqx.filter_jit` a function or a lambda, not such a method.
    """

    def __check_init__(self):
        for name, (kinds, many) in _members(type(self)).items():
            value = getattr(self, name)
            for part in value if many and isinstance(value, tuple | list) else (value,):
                if not isinstance(part, kinds):
                    raise _wrong_member(self, name, part, kinds)

    def __repr__(self):
        return eqx.tree_pformat(jax.tree.map(_shown, self))

    if not TYPE_CHECKING:  # a type checker would let a class with this method have any attribute
        __getattribute__ = object.__getattribute__


@functools.cache
def _members(kind: type) -> dict[str, tuple[tuple[type, ...], bool]]:
    """By field of a class that holds nothing but modules: their classes, and whether it holds several."""
    members = {}
    for base in reversed(kind.__mro__):
        for name, hint in inspect.get_annotations(base).items():
            many = typing.get_origin(hint) is tuple
            parts = [part for part in typing.get_args(hint) if part is not ...] if many else [hint]
            kinds = tuple(kind for part in parts for kind in _kinds(part))
            # A field of any type is still what its base class says.
            if kinds and all(member is types.NoneType or issubclass(member, Module) for member in kinds):
                members[name] = kinds, many
            elif hint is not Any:
                members.pop(name, None)
    return {name: kinds for name, kinds in members.items() if name in getattr(kind, "__dataclass_fields__", ())}


def _shown(leaf: Any) -> Any:
    """A leaf as it is printed: a few numbers as such, more of them by their shape."""
    is_number = isinstance(leaf, jax.Array | np.ndarray) and not isinstance(leaf, Tracer)
    return leaf.tolist() if is_number and leaf.size <= FEW else leaf


def _wrong_member(module: Module, name: str, part: Any, kinds: tuple[type, ...]) -> Exception:
    none, classes = types.NoneType in kinds, [kind.__name__ for kind in kinds if kind is not types.NoneType]
    # What is prepared is the library's own affair.
    words = [f"a module `{word}`" for word in classes if not word.startswith("Prepared")] + ["`None`"] * none
    fix = f"Give it its numbers: `{part.__name__}(...)`." if isinstance(part, type) else ""
    return wrong_value(f"`{name}` of `{type(module).__name__}`", " or ".join(words), part, quote(part), fix, name)


def _kinds(hint: Any) -> list[type]:
    """The classes of a hint; one that is no class stands as `object`."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType, eqx.AbstractVar):
        return [kind for part in typing.get_args(hint) for kind in _kinds(part)]
    return [hint if isinstance(hint, type) and typing.get_origin(hint) is None else object]


class structural_property:
    """A property that follows from a module's structure, computed once for each module.

    `functools.cached_property` would store it among the module's attributes, which equinox counts as part of the
    pytree's structure. The same module before and after would then be two structures, which are compiled twice and do
    not match. Here it is stored apart.
    """

    def __init__(self, function: Callable[[Any], Any]):
        self.function = function
        self.__doc__ = function.__doc__
        self._known: dict[int, tuple[weakref.ref, Any]] = {}

    def __get__(self, module: Any, owner: Any = None) -> Any:
        if module is None:
            return self
        key = id(module)
        if key not in self._known or self._known[key][0]() is not module:
            value = self.function(module)
            self._known[key] = weakref.ref(module, lambda gone: self._forget(key, gone)), value
        return self._known[key][1]

    def _forget(self, key: int, gone: weakref.ref) -> None:
        if key in self._known and self._known[key][0] is gone:
            del self._known[key]


PLAIN = {"unit": ""}
"""What is declared of an array in a class that is not the library's."""


@functools.cache
def is_foreign(kind: type) -> bool:
    """Whether a class is none of the library's: all of its arrays are numbers, such as a network's weights."""
    return kind.__module__.partition(".")[0] != __name__.partition(".")[0]
