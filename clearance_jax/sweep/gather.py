"""Answers from the workers of a cluster into this process: of a question whose lanes are too few for a store.

A task is a few chunks. A worker that is lost takes its tasks with it, and another does them again. Functions travel
pickled, and a worker that has seen the same bytes has their programs still.
"""

import dataclasses
import functools
import math
from contextlib import suppress
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError, quoted
from clearance_jax.solve.lanes import LANES
from clearance_jax.sweep.axes import Dimension
from clearance_jax.sweep.question import Question

# Tasks for each worker, where there are lanes enough: the last ones end together.
TASKS = 8


def gathered(client: Any, question: Question, cores: int = 1) -> dict[str, np.ndarray]:
    """Every variable of every lane of a question without models, shape (lanes, ...), as `Question.answer` gives them;
    solved on the workers of a dask client, on `cores` cores each.

    **Raises:** `ClearanceError` where the cluster has no workers, or none that lives through a task.
    """
    import cloudpickle

    workers = len(client.scheduler_info(n_workers=-1)["workers"])
    if not workers:
        raise ClearanceError("The cluster has no workers. Start some.")
    count, unit = question.count, LANES * cores
    size = unit * max(1, math.ceil(count / (unit * workers * TASKS)))
    # Whole chunks, by copies of the last lane: a chunk of another width would be another program.
    whole = count if count <= LANES else LANES * math.ceil(count / LANES)
    numbers = question.numbers(np.minimum(np.arange(whole), count - 1))
    parts = [{name: one[at : at + size] for name, one in numbers.items()} for at in range(0, whole, size)]
    function = cloudpickle.dumps(dataclasses.replace(question, dims=()))
    tasks = client.map(_answer, parts, function=function, cores=cores, pure=False)
    try:
        found = client.gather(tasks)
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise ClearanceError(f"Lanes failed on the cluster: {quoted(str(error))}.") from error
    finally:
        client.cancel(tasks, force=True)
    return {name: np.concatenate([part[name] for part in found])[:count] for name in question.kinds}


# On a worker ---------------------------------------------------------------------------------------------------------


def _answer(numbers: dict[str, np.ndarray], function: bytes, cores: int) -> dict[str, np.ndarray]:
    count = len(next(iter(numbers.values())))
    part = dataclasses.replace(_loaded(function), dims=(Dimension("lane", count, numbers, {}, {}),))
    return part.answer(np.arange(count), cores)


@functools.lru_cache(maxsize=8)
def _loaded(function: bytes) -> Question:
    """What is asked of each lane, read once by each worker."""
    import cloudpickle

    from clearance_jax.configure import configure

    with suppress(ClearanceError):  # where the worker has used JAX before, set up for it then
        configure(cache=True)
    return cloudpickle.loads(function)
