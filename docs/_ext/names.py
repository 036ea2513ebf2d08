"""Every public name of the library: those of `clearance_jax/__init__.pyi` and those of the public modules in it.

No name is written here. A page of the reference says which folders of the library it shows, and a name belongs to
the folder in which it is defined.
"""

import dataclasses
import functools
import importlib
import inspect
import re
import sys
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.pycode import ModuleAnalyzer

ROOT = "clearance_jax"
# What a class of the library inherits from elsewhere is documented elsewhere.
OWN = f"{ROOT}."
# What every model inherits is no matter of one class.
SHARED = {f"{ROOT}.parameters"}
# How a page writes the bounds of a number.
BOUNDS = (("above", ">"), ("least", ">="), ("below", "<"))


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
        text = (
            _below_definition(self) if self.kind == "data" else self.thing.__dict__.get("__doc__", self.thing.__doc__)
        )
        return inspect.cleandoc(text or "")

    @property
    def sentence(self) -> str:
        """The first sentence of its documentation."""
        text = " ".join(self.doc.split("\n\n")[0].split())
        end = text.find(". ")
        return text if end < 0 else text[: end + 1]

    @property
    def arguments(self) -> list[str]:
        """Names of its arguments, nothing for what takes none."""
        try:
            given = inspect.signature(self.thing).parameters.values()
        except (TypeError, ValueError):
            return []
        return [one.name for one in given if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)]

    @property
    def told(self) -> set[str]:
        """The words that its documentation has in code: arguments among them."""
        return {word for code in re.findall(r"`([^`]+)`", self.doc) for word in re.findall(r"\w+", code)}

    def declared(self) -> dict[str, str]:
        """Arguments that the documentation does not name, with what their declarations say of them."""
        fields = dataclasses.fields(self.thing) if dataclasses.is_dataclass(self.thing) else ()
        metadata = {field.name: field.metadata for field in fields}
        said = {name: _declared(metadata.get(name, {})) or self._below(name) for name in self.arguments}
        return {name: text for name, text in said.items() if text and name not in self.told}

    def _below(self, field: str) -> str:
        """The string below a field, in the class or in one of its bases."""
        for base in self.thing.__mro__:
            if base.__module__.startswith(OWN):
                docs = ModuleAnalyzer.for_module(base.__module__).find_attr_docs()
                if lines := docs.get((base.__name__, field)):
                    return ": " + " ".join(" ".join(lines).split()).removesuffix(".")
        return ""

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


def _declared(metadata: Mapping[str, Any]) -> str:
    """What the declaration of a field says: unit, bounds, meaning, and what its absence means."""
    unit = f" [{metadata['unit']}]" if metadata.get("unit") else ""
    bounds = [f"{sign} {metadata[key]:g}" for key, sign in BOUNDS if unit and metadata.get(key) is not None]
    meaning = f": {metadata['help']}" if metadata.get("help") else ""
    absent = f"; `None`: {metadata['absent']}" if metadata.get("absent") else ""
    return f"{unit}{', '.join(['', *bounds])}{meaning}{absent}"


def _below_definition(name: Name) -> str:
    """The string below a constant's definition, in whichever module of its package it is defined. A public module may
    lie elsewhere than its address says.
    """
    for module in sorted(sys.modules):
        if f"{module}.".startswith((f"{name.module}.", f"{name.home}.")):
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


@functools.cache
def addresses() -> dict[str, Name]:
    """Every address under which a user finds a public name, such as `cj.metrics.Peak`. What stands in the library and
    in a module of it is one name, that of the library.
    """
    found: dict[int, Name] = {}
    under: dict[str, Name] = {}
    for module, members in _modules():
        for name in members.__all__:
            thing = getattr(members, name)
            if name.startswith("__") or isinstance(thing, types.ModuleType):
                continue
            home = getattr(thing, "__module__", None) or members.__name__
            here = Name(module, name, thing, home if home.startswith(OWN) else members.__name__)
            under[here.short] = found.setdefault(id(thing), here)
    return under


@functools.cache
def public_names() -> tuple[Name, ...]:
    """Every public name, once."""
    return tuple(sorted(set(addresses().values()), key=lambda one: (one.module, one.name.lower())))


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
