"""Every public name of the library: those of `clearance_jax/__init__.pyi` and those of the public modules in it.

No name is written here. A page of the reference says which folders of the library it shows, and a name belongs to
the folder in which it is defined.
"""

import importlib
import inspect
import re
import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.pycode import ModuleAnalyzer

ROOT = "clearance_jax"
# What a class of the library inherits from elsewhere is documented elsewhere.
OWN = f"{ROOT}."
# What every model inherits is no matter of one class.
SHARED = {f"{ROOT}.parameters"}


@dataclass(frozen=True, eq=False)
class Name:
    """A public name: `module` and `name` as a user writes them, what it is, and where it is defined."""

    module: str
    name: str
    thing: Any
    home: str

    @property
    def kind(self) -> str:
        """The word for it in addresses: two names that differ only in their capitals get different files."""
        return "class" if inspect.isclass(self.thing) else "function" if callable(self.thing) else "data"

    @property
    def full(self) -> str:
        """The name with its module."""
        return f"{self.module}.{self.name}"

    @property
    def short(self) -> str:
        """The name as the pages write it, with `cj` for the library."""
        return "cj" + self.full.removeprefix(ROOT)

    @property
    def page(self) -> str:
        """The name of its page."""
        module = self.module.removeprefix(ROOT).lstrip(".")
        return ".".join(part for part in (module, self.kind, self.name) if part)

    @property
    def doc(self) -> str:
        """Its documentation; of a constant the string below its definition."""
        text = _below_definition(self) if self.kind == "data" else self.thing.__dict__.get("__doc__", self.thing.__doc__)
        return inspect.cleandoc(text or "")

    @property
    def sentence(self) -> str:
        """The first sentence of its documentation."""
        text = " ".join(self.doc.split("\n\n")[0].split())
        end = text.find(". ")
        return text if end < 0 else text[: end + 1]

    def members(self) -> list[str]:
        """Methods and properties that have documentation of their own; a class without a public base also shows what it
        inherits from hidden ones.
        """
        public = {id(other.thing) for other in public_names()}
        bases = [base for base in self.thing.__mro__[1:] if base.__module__.startswith(OWN)]
        alone = not any(id(base) in public for base in bases)
        found: dict[str, None] = {}
        for base in [self.thing, *(base for base in bases if alone and base.__module__ not in SHARED)]:
            for name, member in vars(base).items():
                what = getattr(member, "fget", None) or getattr(member, "__func__", member)
                if not name.startswith("_") and inspect.isfunction(what) and what.__doc__:
                    found.setdefault(name)
        return list(found)


def _below_definition(name: Name) -> str:
    """The string below a constant's definition, in whichever module of its package it is defined."""
    for module in sorted(sys.modules):
        if f"{module}.".startswith(f"{name.module}."):
            found = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name.name))
            if found:
                return "\n".join(found)
    return ""


def _modules() -> Iterator[tuple[str, types.ModuleType]]:
    """The library and every module among its public names, by the name that a user writes."""
    library = importlib.import_module(ROOT)
    yield ROOT, library
    for name in library.__all__:
        if isinstance(module := getattr(library, name), types.ModuleType):
            yield f"{ROOT}.{name}", module


_FOUND: list[Name] = []


def public_names() -> list[Name]:
    """Every public name, once: one that stands in the library and in a module of it belongs to the library."""
    seen: set[int] = set()
    for module, members in _modules() if not _FOUND else ():
        for name in members.__all__:
            thing = getattr(members, name)
            if name.startswith("__") or isinstance(thing, types.ModuleType) or id(thing) in seen:
                continue
            seen.add(id(thing))
            home = getattr(thing, "__module__", None) or members.__name__
            _FOUND.append(Name(module, name, thing, home if home.startswith(OWN) else members.__name__))
    return sorted(_FOUND, key=lambda one: (one.module, one.name.lower()))


def defined_in(homes: str) -> list[Name]:
    """The public names that are defined in these folders or modules of the library, given as one text."""
    wanted = tuple(f"{ROOT}.{home}." for home in homes.split())
    return [name for name in public_names() if f"{name.home}.".startswith(wanted)]


def tables(folder: Path) -> dict[Name, list[str]]:
    """By public name the pages in a folder that show it."""
    found: dict[Name, list[str]] = {name: [] for name in public_names()}
    for page in sorted(folder.glob("*.md")):
        for homes in re.findall(r"^```{names} (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE):
            for name in defined_in(homes):
                found[name].append(page.name)
    return found
