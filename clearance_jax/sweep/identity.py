"""What makes one question another: a description that can be kept, compared, and told apart in words."""

import hashlib
import json
import re
import types
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import jax
import numpy as np

from clearance_jax.parameters import parameters, replace
from clearance_jax.solve.settings import Settings
from clearance_jax.sweep.axes import Dimension
from clearance_jax.sweep.question import Question

_ADDRESS = re.compile(r"0x[0-9a-f]+")
AXIS = "axis "


def description(question: Question) -> dict[str, Any]:
    """A question by the names of its parts, each a number or a short text."""
    found: dict[str, Any] = {"clearance_jax": version("clearance-jax"), "jax": jax.__version__}
    for dimension in question.dims:
        found[f"{AXIS}{dimension.name}"] = _axis(dimension)
    varied = {name: np.nan for dimension in question.dims for name in dimension.columns}
    labels = _labels(question)
    for label, function in zip(labels, question.functions, strict=True):
        model = replace(function.mechanism, {k: v for k, v in varied.items() if k not in ("t1", "rtol")})
        found |= numbers(model, label)
    function = question.functions[0]
    for name, metric in function.metrics.items():
        found[f"output {name}"] = f"{type(metric).__name__} {digest(metric)}"
    found["wrt"] = list(function.wrt)
    found["derivatives_of"] = list(function.differentiated)
    if "t1" not in varied:
        found["t1"] = float(function.t1)
    found |= {f"option {name}": value for name, value in solving(function.settings).items()}
    return kept(found)


def numbers(model: Any, label: str = "") -> dict[str, Any]:
    """Every number of a model by its name, and what else it is made of as one short text."""
    found = {f"{name}{label}": np.asarray(leaf.value).tolist() for name, leaf in parameters(model).items()}
    return found | {f"structure of the model{label}": digest(model)}


def kept(described: Mapping[str, Any]) -> dict[str, Any]:
    """A description as it comes back from a file."""
    return json.loads(json.dumps(described), parse_constant=str)


def solving(settings: Settings) -> dict[str, Any]:
    """Settings as short texts and numbers."""
    return {name: _shown(value) for name, value in settings._asdict().items() if value is not None}


def fingerprint(described: Mapping[str, Any]) -> str:
    """A description as one short text."""
    return hashlib.blake2b(json.dumps(described, sort_keys=True).encode(), digest_size=16).hexdigest()


def differences(old: Mapping[str, Any], new: Mapping[str, Any], where: str = "in the store") -> dict[str, str]:
    """What the `new` question has otherwise than the `old`, which is kept somewhere: by name, in words."""
    return {
        name: f"`{name}` is {_put(new.get(name))} here and {_put(old.get(name))} {where}"
        for name in {**old, **new}
        if old.get(name) != new.get(name)
    }


def _put(value: Any) -> str:
    text = "absent" if value is None else value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _labels(question: Question) -> list[str]:
    """What tells the names of several models apart."""
    labels = [""]
    for dimension in question.dims:
        if dimension.models:
            labels = [f"{before} ({dimension.name}: {label})" for before in labels for label in dimension.labels]
    return labels


def _axis(dimension: Dimension) -> str:
    if dimension.models:
        return ", ".join(dimension.labels)
    parts = [f"{name}: {len(v)} from {v[0]:.9g} to {v[-1]:.9g}, {_of([v])}" for name, v in dimension.columns.items()]
    drawn = [f"{k} {v}" for k, v in dimension.sampling.items() if k in ("method", "seed")]
    return "; ".join([*drawn, *parts])


def _shown(value: Any) -> Any:
    array = np.asarray(value) if isinstance(value, jax.Array | np.ndarray) else None
    if array is not None:
        return array.tolist() if array.size <= 8 else f"{array.shape} {_of([array])}"
    return value if isinstance(value, str | int | float | bool) else _ADDRESS.sub("", repr(value))


def digest(tree: Any) -> str:
    """What a tree is made of, without where in memory it lies."""
    leaves, structure = jax.tree.flatten(tree)
    return _of([_ADDRESS.sub("", str(structure)), *leaves])


def _of(parts: Any) -> str:
    found = hashlib.blake2b(digest_size=6)
    for part in parts:
        if isinstance(part, str):
            found.update(part.encode())
        elif isinstance(part, jax.Array | np.ndarray):
            found.update(np.ascontiguousarray(part).tobytes())
        else:
            found.update(_code(part).encode())
    return found.hexdigest()


def _code(part: Any) -> str:
    """A function by what it does, as far as that can be told: its code and what it has kept; anything else in words."""
    if isinstance(part, types.FunctionType):
        kept = [cell.cell_contents for cell in part.__closure__ or ()] + list(part.__defaults__ or ())
        return " ".join([_code(part.__code__), *(_code(one) for one in kept)])
    if isinstance(part, types.CodeType):
        return " ".join([part.co_code.hex(), *part.co_names, *(_code(constant) for constant in part.co_consts)])
    if isinstance(part, jax.Array | np.ndarray):
        return _of([part])
    return _ADDRESS.sub("", repr(part))
