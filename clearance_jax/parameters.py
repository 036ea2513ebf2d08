"""The numbers of a model: array leaves with unit and bounds, each with one dotted name.

A number of the model (a mass, a clearance, a stiffness) is always an array leaf, never a Python float: a float field
would be a compile-time constant (a new compilation for every value, and no derivative).

The name of a number follows from the model's structure. A member that has a `name` starts a new name (`wrist.`); a
flattened field adds nothing, a leading field goes in front (`drive.crank.speed`), any other field adds its own name.
"""

import dataclasses
import functools
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._basis.module import PLAIN, Module, is_foreign
from clearance_jax._basis.types import Flag
from clearance_jax.errors import ClearanceError, quote, require_float64, unknown_name, wrong_value
from clearance_jax.units import resolve_unit, unit_in_words

PARAMETER = "the parameter's"
"""Stands for a unit in the declarations of a study's keys: that of the parameter which the file names."""
# Bounds of a number's field: key of its metadata, test, words.
BOUNDS = (("above", operator.gt, "greater than"), ("least", operator.ge, "at least"), ("below", operator.lt, "below"))


def as_leaf(value: Any) -> Any:
    """`value` as a float64 array leaf; `None` (the quantity is absent from the model) stays `None`."""
    if value is None or isinstance(value, eqx.Module):
        return value
    # A differentiated or mapped number may still be a Python float inside its tracer.
    if isinstance(value, (int, float, np.ndarray, np.generic, list, tuple, Tracer)):
        require_float64()
        plain = isinstance(value, (int, float, np.ndarray, np.generic))
        return jnp.asarray(np.asarray(value, float) if plain else value, dtype=float)
    return value


def outside(part: Any) -> Any:
    """The tree with NumPy's arrays for JAX's (tracers stay): outside of a solve JAX would compile each product."""
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) and not isinstance(x, Tracer) else x, part)


def physical(
    unit: str, help: str = "", example: str = "", absent: str = "", *, above: float | None = None,
    least: float | None = None, below: float | None = None, instead: str = "", lifted: bool = False, **field,
):  # fmt: skip
    """A field of a class of your own that holds one physical number, or `None` where the quantity may be absent.

    **Arguments:**

    - `unit`: the SI unit, as pint spells it; or a word that the owner of the field resolves (see `Parametrised.units`).
    - `above`, `least`, `below`: bounds of valid values: greater than, at least, less than. `simulate` and the scene
      reader check them.
    - `help`, `example`, `absent`: for the reference of scene files: what the number is, its value in TOML, and what its
      absence means.
    - `instead`: what to do instead, said where a value is out of bounds.
    - `lifted`: whether dotted names leave out the member of a tuple that it is in.
    - `field`: passed on to `dataclasses.field` (for instance `default`).
    """
    metadata = {"unit": unit, "above": above, "least": least, "below": below, "instead": instead}
    metadata |= {"help": help, "example": example, "absent": absent, "lifted": lifted}
    return eqx.field(**({"converter": as_leaf, "metadata": metadata} | field))


def describe(help: str, example: str, absent: str = "", *, least: int = 0, most: int = 10**9, **field):
    """A field that is no physical number, with texts as of `physical`; a whole number is from `least` to `most`."""
    metadata = {"help": help, "example": example, "absent": absent, "least": least, "most": most}
    return eqx.field(metadata=metadata, **field)


def flatten(member: str | None = None, **field):
    """A field whose name dotted names leave out; `member`: of a tuple the word before its members' names."""
    return eqx.field(metadata={"flattened": True, "member": member}, **field)


def lead(**field):
    """A field whose own name comes first in dotted parameter names."""
    return eqx.field(metadata={"leading": True}, **field)


def apart(**field):
    """A field that holds a model of its own: its name stands before all of its members' dotted names."""
    return eqx.field(metadata={"apart": True}, **field)


class Demand(NamedTuple):
    """A condition on a number of a part relative to the others: its field's `name`, whether the condition `holds` (a
    flag, also for tracers), and `words` for a violation: "must be ...".
    """

    name: str
    holds: Flag
    words: Callable[[], str]


class Parametrised(Module):
    """A part of a model whose numbers have units that depend on its other members."""

    def units(self) -> dict[str, str]:
        """SI units by the words that its fields and its members' fields use for them. None by default."""
        return {}

    def units_within(self, member: Any) -> dict[str, str]:
        """The same for a member, however deep, that does not know them itself. None by default."""
        del member
        return {}

    def demands(self) -> Iterator[Demand]:
        """Conditions of its numbers on each other. None by default."""
        yield from ()


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One number of a model: dotted name, attribute path, value and its field's metadata; `owners`: the parts that
    contain it, the nearest last; `former`: its name in older files, in which its actuator had no name.
    """

    name: str
    path: tuple[str, ...]
    value: Any
    metadata: Any
    owners: tuple[Any, ...] = ()
    former: str | None = None

    @property
    def unit(self) -> str:
        """The SI unit, with its owners' words replaced."""
        return resolve_unit(self.metadata["unit"], self.words)

    @property
    def words(self) -> dict[str, str]:
        """The units by the words that its owners' fields use for them."""
        words: dict[str, str] = {}
        for i, owner in enumerate(self.owners):
            if not isinstance(owner, Parametrised):
                continue
            words |= type(owner).units(owner)  # by its class: equinox flattens a module when it binds a method
            for member in self.owners[i + 1 :]:
                words |= type(owner).units_within(owner, member)
        return words


def leaves(
    module: eqx.Module, path: tuple[str, ...] = (), prefix: str = "", owners: tuple = (), former: str | None = None,
    outer: str = "",
) -> Iterator[Leaf]:  # fmt: skip
    """Every number of `module` with name and path; `prefix`, `former`, `outer` (of lifted ones): begins of names."""
    owners, values = (*owners, module), vars(module)
    for field in _fields(type(module)):
        name = _extended(outer if field.metadata.get("lifted") else prefix, field)
        value, here = values[field.name], (*path, field.name)
        before = None if former is None else _extended(former, field)
        declared = "unit" in field.metadata and not isinstance(value, eqx.Module)
        if declared or (is_foreign(type(module)) and eqx.is_inexact_array(value)):
            if value is not None:
                metadata = field.metadata if declared else PLAIN
                yield Leaf(name[:-1], here, value, metadata, owners, before and before[:-1])
        elif isinstance(value, eqx.Module) and field.metadata.get("apart"):
            for leaf in leaves(value, here):
                yield dataclasses.replace(leaf, name=name + leaf.name)
        elif isinstance(value, eqx.Module):
            label = None if field.metadata.get("flattened") else getattr(value, "name", None)
            yield from leaves(value, here, name if label is None else f"{label}.", owners, before)
        elif isinstance(value, tuple):
            word = field.metadata.get("member")
            for index, member in enumerate(value):
                if not isinstance(member, eqx.Module):
                    continue
                label, numbered = getattr(member, "name", None), f"{name}{index}."
                inner = numbered if label is None else f"{label}." if word is None else f"{name}{word}.{label}."
                old = None if label is None or word is None else numbered
                yield from leaves(member, (*here, str(index)), inner, owners, old, name)


def _extended(prefix: str, field: dataclasses.Field) -> str:
    """The beginning of the names of a field's numbers."""
    if field.metadata.get("leading"):
        return f"{field.name}.{prefix}"
    return prefix if field.metadata.get("flattened") else f"{prefix}{field.name}."


@functools.cache
def _fields(kind: type[eqx.Module]) -> tuple[dataclasses.Field, ...]:
    return tuple(field for field in dataclasses.fields(kind) if not field.metadata.get("static", False))


def parameters(module: eqx.Module) -> dict[str, Leaf]:
    """Every number of a model by its one dotted name, with value, unit and bounds; arrays of other classes have none.

    **Arguments:** `module`: a mechanism, or a part of one.
    """
    return {leaf.name: leaf for leaf in leaves(module)}


def follow(module: Any, path: tuple[str, ...]) -> Any:
    """The member of `module` at an attribute path (digits index tuples)."""
    for step in path:
        module = module[int(step)] if step.isdigit() else getattr(module, step)
    return module


def find(known: Mapping[str, Leaf], name: str) -> tuple[Leaf, int | None]:
    """The leaf with a name, and the entry (`name.i`) of an array. **Raises** `ClearanceError` if there is none."""
    leaf, entry = lookup(known, name)
    if leaf is None:
        raise unknown_name(f"There is no parameter `{name}`.", str(name), known)
    shape = np.shape(leaf.value)
    if entry is not None and not (len(shape) == 1 and entry < shape[0]):
        raise ClearanceError(f"`{name.rpartition('.')[0]}` has shape {shape}: there is no entry {entry}.")
    return leaf, entry


def lookup(known: Mapping[str, Leaf], name: str) -> tuple[Leaf | None, int | None]:
    """The leaf with a name, present or former, and the entry of an array; `None` if there is none."""

    def leaf(name: str) -> Leaf | None:
        return known.get(name) or next((leaf for leaf in known.values() if leaf.former == name), None)

    whole, (head, _, tail) = leaf(name), str(name).rpartition(".")
    if whole is None and tail.isdecimal() and len(tail) < 10:
        return leaf(head), int(tail)
    return whole, None


def replace(module: Any, values: Mapping[str, Any]) -> Any:
    """A new mechanism with other numbers.

    **Arguments:**

    - `module`: the mechanism, or another model; it stays as it is.
    - `values`: dotted name to number or array, in SI units, traced or not; `name.i` names one entry of an array.

    **Raises:** `ClearanceError` for an unknown name.
    """
    if not isinstance(values, Mapping):
        raise wrong_value("`values`", "numbers by name", values)
    known, changed = parameters(module), {}
    for name, value in values.items():
        leaf, index = find(known, name)
        given, (new, entries) = jnp.asarray(value, dtype=float), changed.get(leaf.path, (leaf.value, {}))
        new, entries = (given, {}) if index is None else (new, {**entries, index: given})
        other = leaf.metadata is PLAIN and np.shape(new)[np.ndim(new) - np.ndim(leaf.value) :] != np.shape(leaf.value)
        if other or np.ndim(new) < np.ndim(leaf.value):
            text = f"a value of shape {np.shape(new)} was given. Name one entry as `{name}.0`."
            raise ClearanceError(f"`{name}` must have shape {np.shape(leaf.value)}, but {text}").about(name, new.shape)
        changed[leaf.path] = new, entries
    new = [jnp.asarray(x).at[np.array([*e])].set(jnp.stack([*e.values()])) if e else x for x, e in changed.values()]
    return eqx.tree_at(lambda m: [follow(m, path) for path in changed], module, new) if new else module


def values_of(module: eqx.Module, names: Sequence[str]) -> dict[str, Array]:
    """The present values of named parameters (`name.i`: one entry of an array)."""
    known = parameters(module)
    each = {name: find(known, name) for name in names}
    return {n: jnp.asarray(x.value if i is None else x.value[i], float) for n, (x, i) in each.items()}


def units_of(module: eqx.Module, names: Iterable[str]) -> dict[str, str]:
    """The SI units of named parameters."""
    known = parameters(module)
    return {name: find(known, name)[0].unit for name in names}


def violations(value: Any, metadata: Mapping[str, Any]) -> Iterator[tuple[str, float, Any]]:
    """By bound of a number's field: its condition in words, its limit, and whether it holds (a flag)."""
    for key, holds, words in BOUNDS:
        limit = metadata.get(key)
        if limit is not None:
            yield words, limit, holds(value, limit)


def bounds_hold(module: eqx.Module) -> Flag:
    """Whether every number is finite and inside its bounds (a flag, also for tracers)."""
    every = [(jnp.ravel(jnp.asarray(leaf.value)), leaf.metadata) for leaf in leaves(module)]
    if not every:
        return jnp.asarray(True)
    numbers = jnp.concatenate([value for value, _ in every])
    good = jnp.isfinite(numbers)
    for key, holds, _ in BOUNDS:
        limit = np.concatenate([np.full(v.shape, np.nan if m.get(key) is None else m[key]) for v, m in every])
        good &= holds(numbers, jnp.asarray(limit)) | jnp.asarray(np.isnan(limit))
    together = [demand.holds for _, part, _ in _parts(leaves(module)) for demand in part.demands()]
    return jnp.all(jnp.stack([jnp.all(good), *(jnp.all(jnp.asarray(holds)) for holds in together)]))


def _parts(every: Iterable[Leaf]) -> Iterator[tuple[str, Parametrised, Leaf]]:
    """Every part that directly owns some of these numbers, with the beginning of their names, and one of them."""
    seen = set()
    for leaf in every:
        part = leaf.owners[-1]
        if isinstance(part, Parametrised) and id(part) not in seen:
            seen.add(id(part))
            yield leaf.name.rpartition(leaf.path[-1])[0], part, leaf


def check_values(module: eqx.Module) -> None:
    """Raise for a number that is not finite or not inside its bounds. Tracers pass."""
    known = parameters(module)
    for name, leaf in known.items():
        if isinstance(leaf.value, Tracer):
            continue
        try:
            value = np.asarray(leaf.value, float)
        except (TypeError, ValueError):
            raise ClearanceError(f"`{name}` must be a number in {leaf.unit}, not {leaf.value!r}.") from None
        if not np.all(np.isfinite(value)):
            raise wrong_value(f"`{name}`", "finite", value.tolist(), shown=str(value.tolist()))
        # A unit is looked up for a message only: for all numbers that takes longer than a solve.
        if not all(np.all(holds) for *_, holds in violations(value, leaf.metadata)):
            check_bounds(value, leaf.metadata, f"`{name}`", leaf.unit)
    for begin, part, leaf in _parts(known.values()):
        check_demands(part, begin, lambda leaf=leaf: leaf.words)


def check_demands(part: Parametrised, begin: str = "", words: Callable[[], Mapping[str, str]] = dict) -> None:
    """Raise if numbers of a part contradict each other. Tracers pass. `begin` ("wrist.") of names; `words` of units."""
    with np.errstate(all="ignore"):  # of numbers near the largest ones
        demands = list(outside(part).demands())
    for demand in demands:
        if isinstance(demand.holds, Tracer) or np.all(demand.holds):
            continue
        given = quote(np.asarray(getattr(part, demand.name)).tolist())
        unit = next(field.metadata["unit"] for field in dataclasses.fields(part) if field.name == demand.name)
        name, unit = f"{begin}{demand.name}", unit_in_words(resolve_unit(unit, words()))
        raise ClearanceError(f"`{name}` {demand.words()}, but it is {f'{given} {unit}'.rstrip()}.").about(name)


def check_bounds(value: Any, metadata: Mapping[str, Any], where: str, unit: str, given: Any = None) -> None:
    """Raise for a number outside its field's bounds, naming its place `where`; `given`: how it was written."""
    value = np.asarray(value)
    checks = list(violations(value, metadata))
    if all(np.all(holds) for *_, holds in checks):
        return
    unit = unit_in_words(unit)
    demanded = [f"{words} {limit:g} {unit}".rstrip() for words, limit, _ in checks]
    if metadata.get("above") is not None and metadata.get("below") is not None:
        demanded = [f"between {metadata['above']:g} and {metadata['below']:g} {unit}".rstrip()]
    shown = quote(given)[1:-1] if isinstance(given, str) else f"{quote(value.tolist())} {unit}".rstrip()
    plain = value.tolist() if given is None else given
    raise wrong_value(where, " and ".join(demanded), plain, shown, metadata.get("instead") or "")
