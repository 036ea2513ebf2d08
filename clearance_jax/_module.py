"""The base of the library's own modules: an `equinox.Module` whose attributes are looked up as those of any object."""

from typing import TYPE_CHECKING

import equinox as eqx


class Module(eqx.Module):
    """A frozen dataclass and pytree.

    equinox makes every method that is asked for a module of its own, and for that looks at every attribute and flattens
    the whole module. Tracing a solve asks for some hundred thousand attributes: that was a third of its time. Here a
    method is an ordinary bound method. What is given to `eqx.filter_jit` is a function or a lambda, not such a method.
    """

    if not TYPE_CHECKING:  # a class with this method may have any attribute, as far as a type checker knows
        __getattribute__ = object.__getattribute__
