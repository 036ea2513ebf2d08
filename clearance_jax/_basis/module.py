"""The base of the library's own modules: an `equinox.Module` with ordinary attribute lookup."""

import functools
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx


class Module(eqx.Module):
    """A frozen dataclass and pytree.

    equinox turns every requested method into a module of its own, and for that checks every attribute and flattens the
    whole module. Tracing a solve requests several hundred thousand attributes, which took a large part of its time.
    Here a method is an ordinary bound method. Give `eqx.filter_jit` a function or a lambda, not such a method.
    """

    if not TYPE_CHECKING:  # a type checker would let a class with this method have any attribute
        __getattribute__ = object.__getattribute__


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
