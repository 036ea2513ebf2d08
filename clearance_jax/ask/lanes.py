"""Answers to a question at one point, or at many points as lanes of a batch."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._compile.kept import kept_jit
from clearance_jax.ask.question import Answer, Question
from clearance_jax.solve.batch import BatchReport, batch

Columns = Mapping[str, np.ndarray]
"""The numbers of points by name, shape (points,) each."""


def answer(question: Question, numbers: Mapping[str, Any] | None = None) -> Answer:
    """The answer at one point. Other names of `numbers` compile another program; with `Question.at` they share one."""
    return _program(question, {name: jnp.asarray(value, float) for name, value in (numbers or {}).items()})


@kept_jit
def _program(question: Question, numbers: dict[str, Any]) -> Answer:
    return question(numbers)


def lanes(
    question: Question,
    points: Columns,
    *,
    width: int = 1,
    cores: int | None = None,
    progress: Callable[[float], Any] | None = None,
    ready: Callable[[np.ndarray, Answer], Any] | None = None,
    report: Callable[[BatchReport], Any] | None = None,
) -> Answer:
    """The answers at points, as lanes of a batch, on every core.

    **Arguments:** `width`: solve at least so many lanes, by copies of the last one (a chunk of another width is another
    program, with other last digits); the others as `batch`'s.
    """
    count = len(next(iter(points.values())))
    filled = {name: np.pad(column, (0, max(0, width - count)), mode="edge") for name, column in points.items()}

    def chunk(places: np.ndarray, part: Answer) -> None:
        wanted = places < count
        if ready is not None:
            ready(places[wanted], jax.tree.map(lambda x: x[wanted], part))

    whole = batch(question, filled, cores=cores, progress=progress, ready=chunk, report=report)
    return jax.tree.map(lambda x: x[:count], whole)
