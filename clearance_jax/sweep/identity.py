"""The description of a sweep's question, by names (see `clearance_jax.runs.identity`)."""

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
    """The description of a question: numbers and short texts by name."""
    described: dict[str, Any] = versions()
    for dimension in grid.dims:
        described[f"{AXIS}{dimension.name}"] = _axis(dimension)
    varied = {name: np.nan for dimension in grid.dims for name in dimension.columns}
    for label, question in zip(labels(grid), grid.questions, strict=True):
        model = replace(question.model, {k: v for k, v in varied.items() if k not in OPTIONS})
        described |= numbers(model, label)
    question = grid.questions[0]
    for name, metric in question.metrics.items():
        described |= {f"{what} (output {name})": value for what, value in numbers(metric).items()}
    described["wrt"] = list(question.by)
    described["derivatives_of"] = list(question.differentiated)
    if "t1" not in varied:
        described["t1"] = float(question.t1)
    described |= {f"option {name}": value for name, value in solve_words(question.settings).items()}
    return described


def solve_words(settings: Settings) -> dict[str, Any]:
    """Settings as short texts and numbers."""
    return settings_in_words(settings._asdict())


def labels(grid: Grid) -> list[str]:
    """A suffix for the names of each model's numbers; empty for a single model."""
    suffixes = [""]
    for dimension in grid.dims:
        if dimension.models:
            suffixes = [f"{before} ({dimension.name}: {label})" for before in suffixes for label in dimension.labels]
    return suffixes


def _axis(dimension: Dimension) -> str:
    if dimension.models:
        return ", ".join(dimension.labels)
    parts = [f"{name}: {len(v)} from {v[0]:.9g} to {v[-1]:.9g}, {digest(v)}" for name, v in dimension.columns.items()]
    drawn = [f"{k} {v}" for k, v in dimension.sampling.items() if k in ("method", "seed")]
    return "; ".join([*drawn, *parts])
