"""Descriptions of questions, by names: a run on disk keeps its own in its journal and refuses any other question.

A description has every number of the models by its name, the settings, the versions with a digest of this library's
source, and a digest of each function and class of the user's that takes part. Code of other packages counts by its name
only.
"""

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import equinox as eqx
import jax
import numpy as np

from clearance_jax._compile.library import source_digest
from clearance_jax._compile.structure import Reader
from clearance_jax.errors import ClearanceError
from clearance_jax.parameters import parameters

SOURCE, STRUCTURE = "source of clearance_jax", "structure of the model"
# The names of what computes an answer; all others belong to the question.
VERSIONS = ("clearance_jax", SOURCE, "jax")


def versions() -> dict[str, str]:
    """The versions that compute: this library, a digest of its source, and JAX."""
    return dict(zip(VERSIONS, (version("clearance-jax"), source_digest(), jax.__version__), strict=True))


def numbers(model: Any, label: str = "") -> dict[str, Any]:
    """The description of a model: every number by its name, its structure as a short text, and a digest of each
    function and class of the user's in it. The `label` is added to every name.
    """
    known = parameters(model) if isinstance(model, eqx.Module) else {}
    reader = Reader({id(leaf.value) for leaf in known.values()})
    structure = f"{type(model).__qualname__} {reader.of(model)}"
    described = {f"{name}{label}": np.asarray(leaf.value).tolist() for name, leaf in known.items()}
    described |= {f"code of {name}{label}": code for name, code in reader.code.items()}
    return described | {f"{STRUCTURE}{label}": structure}


def settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name as numbers and short texts, without those that are `None`."""
    return {name: short(value) for name, value in given.items() if value is not None}


def short(value: Any) -> Any:
    """A value as a number, a short list, or a short text with a digest."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        array = np.asarray(value)
        return array.tolist() if array.size <= 8 else f"{array.shape} {digest(array)}"
    if isinstance(value, list | tuple) and all(isinstance(entry, str | int | float) for entry in value):
        return list(value) if len(value) <= 8 else f"{len(value)} of them, {digest(list(value))}"
    return value if isinstance(value, str | int | float | bool) else f"{type(value).__qualname__} {digest(value)}"


def as_in_file(described: Mapping[str, Any]) -> dict[str, Any]:
    """A description as JSON gives it back, to compare it with one from a file."""
    return json.loads(json.dumps(described), parse_constant=str)


def fingerprint(described: Mapping[str, Any]) -> str:
    """The digest of a description."""
    return hashlib.blake2b(json.dumps(described, sort_keys=True).encode(), digest_size=16).hexdigest()


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, str]:
    """How the `new` question differs from the `old` one on disk: a sentence by name, those of `VERSIONS` last."""
    names = sorted({**old, **new}, key=lambda name: name in VERSIONS)
    return {
        name: f"`{name}` is {_put(new.get(name))} here and {_put(old.get(name))} there"
        for name in names
        if old.get(name) != new.get(name)
    }


def refusal(path: Any, changes: Mapping[str, str]) -> ClearanceError:
    """The error that refuses to continue a run at a path, by the `differences` of the questions: its `allowed`."""
    computes = [name for name in changes if name in VERSIONS]
    # Another version of the library may give models another structure.
    asked = [name for name in changes if name not in VERSIONS and not (computes and name.startswith(STRUCTURE))]
    names = [*asked, *(name for name in changes if name not in asked)] if asked else computes or list(changes)
    more = f"; and {len(names) - 3} more" if len(names) > 3 else ""
    reasons = "; ".join(changes[name] for name in names[:3]) + more
    if asked or not computes:
        return ClearanceError(f"`{path}` belongs to another question: {reasons}. Choose another path.").about(
            path, names[0]
        )
    return ClearanceError(
        f"`{path}` was begun by another version of the library: {reasons}. The digits of its answers may differ. "
        "Choose another path, or go on with the version that began it."
    ).about(path, names[0])


def _put(value: Any) -> str:
    text = "absent" if value is None else value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def digest(value: Any) -> str:
    """The digest of a value by its content, also of nested objects."""
    reader = Reader()
    return reader.whole(reader.of(value))
