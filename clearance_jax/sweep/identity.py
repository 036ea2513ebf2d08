"""What makes one sweep another, by names (see `clearance_jax.runs.identity`)."""

from typing import Any

import numpy as np

from clearance_jax.ask.question import OPTIONS
from clearance_jax.parameters import replace
from clearance_jax.runs.identity import digest, numbers, versions
from clearance_jax.runs.identity import settings as settings_in_words
from clearance_jax.solve.settings import Settings
from clearance_jax.sweep.axes import Dimension
from clearance_jax.sweep.grid import Grid

AXIS = "axis "


def description(grid: Grid) -> dict[str, Any]:
    """A question by the names of its parts, each a number or a short text."""
    found: dict[str, Any] = versions()
    for dimension in grid.dims:
        found[f"{AXIS}{dimension.name}"] = _axis(dimension)
    varied = {name: np.nan for dimension in grid.dims for name in dimension.columns}
    for label, question in zip(labels(grid), grid.questions, strict=True):
        model = replace(question.model, {k: v for k, v in varied.items() if k not in OPTIONS})
        found |= numbers(model, label)
    question = grid.questions[0]
    for name, metric in question.metrics.items():
        found |= {f"{what} (output {name})": value for what, value in numbers(metric).items()}
    found["wrt"] = list(question.by)
    found["derivatives_of"] = list(question.differentiated)
    if "t1" not in varied:
        found["t1"] = float(question.t1)
    found |= {f"option {name}": value for name, value in solve_words(question.settings).items()}
    return found


def solve_words(settings: Settings) -> dict[str, Any]:
    """Settings as short texts and numbers."""
    return settings_in_words(settings._asdict())


def labels(grid: Grid) -> list[str]:
    """What tells the names of several models apart."""
    found = [""]
    for dimension in grid.dims:
        if dimension.models:
            found = [f"{before} ({dimension.name}: {label})" for before in found for label in dimension.labels]
    return found


def _axis(dimension: Dimension) -> str:
    if dimension.models:
        return ", ".join(dimension.labels)
    parts = [f"{name}: {len(v)} from {v[0]:.9g} to {v[-1]:.9g}, {digest(v)}" for name, v in dimension.columns.items()]
    drawn = [f"{k} {v}" for k, v in dimension.sampling.items() if k in ("method", "seed")]
    return "; ".join([*drawn, *parts])
