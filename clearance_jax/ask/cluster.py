"""Lanes solved on the workers of a dask cluster; the answers come back to this process.

A task is a few chunks of lanes. If a worker is lost, another repeats its tasks. Questions are sent pickled, and a
worker keeps the question of bytes that it has seen, with its compiled programs.
"""

import functools
import math
import warnings
from typing import Any

import jax
import numpy as np

from clearance_jax.ask.lanes import Columns, lanes
from clearance_jax.ask.place import workers_of
from clearance_jax.ask.question import Answer, Question
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.solve.lanes import LANES

# Tasks for each worker, if there are enough lanes: so that workers end at about the same time.
TASKS = 8


def lanes_on(client: Any, question: Question, points: Columns, cores: int = 1) -> Answer:
    """The answers at points as `lanes` gives them, solved by the workers of a dask client on `cores` cores each.

    **Raises:** `ClearanceError` if the cluster has no workers, or if workers are killed again and again.
    """
    import cloudpickle

    workers = len(workers_of(client))
    if not workers:
        raise ClearanceError("The cluster has no workers. Start some.")
    count, unit = len(next(iter(points.values()))), LANES * cores
    size = unit * max(1, math.ceil(count / (unit * workers * TASKS)))
    # Fill the last chunk with copies of the last lane: a chunk of another width would be another program.
    whole = count if count <= LANES else LANES * math.ceil(count / LANES)
    places = np.minimum(np.arange(whole), count - 1)
    parts = [{name: column[places[at : at + size]] for name, column in points.items()} for at in range(0, whole, size)]
    pickled = cloudpickle.dumps(question)
    tasks = client.map(_answers, parts, question=pickled, cores=cores, pure=False)
    try:
        answers = client.gather(tasks)
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise ClearanceError(f"Lanes failed on the cluster: {quote(str(error))}.") from error
    finally:
        client.cancel(tasks, force=True)
    return jax.tree.map(lambda *part: np.concatenate(part)[:count], *answers)


# On a worker ---------------------------------------------------------------------------------------------------------


def _answers(points: dict[str, np.ndarray], question: bytes, cores: int) -> Answer:
    return lanes(_load(question), points, cores=cores)


@functools.lru_cache(maxsize=8)
def _load(question: bytes) -> Question:
    """The question of pickled bytes, read once by each worker."""
    import cloudpickle

    from clearance_jax.configure import configure

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the worker may have used JAX already
        configure(cache=True)
    return cloudpickle.loads(question)
