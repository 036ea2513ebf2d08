"""Answers to a question at points: one, few in threads, or many as lanes, on this machine or on a dask cluster.

On a cluster a task is a few chunks of lanes, and the answers come back to this process. If a worker is lost, another
repeats its tasks. Questions are sent pickled, and a worker keeps the question of bytes that it has seen, with its
compiled programs.
"""

import functools
import logging
import math
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any

import jax
import numpy as np

from clearance_jax._basis.extras import missing_extra
from clearance_jax._compile.shapes import TreeShape, tree_shape
from clearance_jax.ask.question import Answer, Columns, Question, answer, lanes
from clearance_jax.errors import ClearanceError, quote, wrong_value
from clearance_jax.solve.drivers.batch import cores_here, side_by_side, usual_cores
from clearance_jax.solve.drivers.lanes import LANES

# The name of a trial cluster: workers on this machine.
LOCAL = "local"
# Timeout of the connection to a scheduler.
PATIENCE = "10s"


@contextmanager
def client_of(cluster: Any, cores: int = 1) -> Iterator[Any]:
    """A dask client of a `cluster`: a client, the address of a scheduler, or `LOCAL` (workers on this machine with
    `cores` cores each). What is created here is closed at the end. **Raises** `ClearanceError` if no scheduler answers.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise missing_extra("A sweep on a cluster", "dask", "sweep") from None
    if isinstance(cluster, Client):
        yield cluster
        return
    if not isinstance(cluster, str):
        raise wrong_value("`cluster`", "an address or a dask client", cluster)
    with ExitStack() as made:
        if cluster == LOCAL:
            workers = max(1, cores_here() // cores)
            # Warnings about workers that end slowly do not concern the user.
            how = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.ERROR}
            cluster = made.enter_context(LocalCluster(workers, **how))
        try:
            client = made.enter_context(Client(cluster, timeout=PATIENCE))
        except (OSError, TimeoutError, ValueError) as error:
            reason = str(error).split("\n")[0]
            raise ClearanceError(
                f"No scheduler answers at `{cluster}`: {reason}. Start it, or mend the address (`{LOCAL}`: workers on "
                "this machine)."
            ).about("cluster", str(cluster)) from None
        yield client


def place_of(cluster: Any) -> AbstractContextManager[Any]:
    """A context that gives where points are solved: the client of a `cluster` (of `client_of`), or `None` for this
    machine if that is `None`.
    """
    return nullcontext() if cluster is None else client_of(cluster)


def workers_of(client: Any) -> dict[str, Any]:
    """The workers of a client by their addresses."""
    return client.scheduler_info(n_workers=-1)["workers"]


# Up to so many points are answered one by one: their program compiles sooner than that of lanes. The 299 samples that
# prove a yield of 99 % are among them.
FEW = 300


def answers(question: Question, points: Columns, place: Any = None) -> Answer:
    """The answers at points, each with a first axis (points,): one by one if they are few, as lanes otherwise; solved
    by a dask client (`place`), by default here.
    """
    count = len(next(iter(points.values())))
    if as_lanes(count, place):
        return lanes(question, points) if place is None else lanes_on(place, question, points)
    each = _side_by_side(question, points, count, usual_cores())
    return jax.tree.map(lambda *parts: np.stack([np.asarray(x) for x in parts]), *each)


def _side_by_side(question: Question, points: Columns, count: int, cores: int) -> list[Answer]:
    """The answers one by one, in a thread for each core."""

    def asked(i: int) -> Question:
        # With the numbers inside the question, points of other names share its program.
        return question.at({name: column[i] for name, column in points.items()})

    def at(i: int) -> Answer:
        return jax.block_until_ready(answer(asked(i)))

    if count == 1 or cores == 1:
        return [*map(at, range(count))]
    # The first compiles for all, unless others have.
    frame = tree_shape(asked(0))
    first = [] if frame in _COMPILED else [at(0)]
    _COMPILED.add(frame)
    with ThreadPoolExecutor(min(cores, side_by_side())) as pool:
        try:
            return [*first, *pool.map(at, range(len(first), count))]
        except BaseException:  # an interruption too: start no more solves
            pool.shutdown(wait=False, cancel_futures=True)
            raise


# Structures of questions that have been answered, so that their programs are there.
_COMPILED: set[TreeShape] = set()


def as_lanes(count: int, place: Any) -> bool:
    """Whether `count` points are answered as lanes."""
    return count > (FEW if place is None else 1)


# Tasks for each worker, if there are enough lanes: so that workers end at about the same time.
TASKS = 8


def lanes_on(client: Any, question: Question, points: Columns) -> Answer:
    """The answers at points as `lanes` gives them, solved by the workers of a dask client. **Raises** `ClearanceError`
    if the cluster has no workers, or if workers are killed again and again.
    """
    import cloudpickle

    workers = len(workers_of(client))
    if not workers:
        raise ClearanceError("The cluster has no workers. Start some.")
    count = len(next(iter(points.values())))
    size = LANES * max(1, math.ceil(count / (LANES * workers * TASKS)))
    # Fill the last chunk with copies of the last lane: a chunk of another width would be another program.
    whole = count if count <= LANES else LANES * math.ceil(count / LANES)
    places = np.minimum(np.arange(whole), count - 1)
    parts = [{name: column[places[at : at + size]] for name, column in points.items()} for at in range(0, whole, size)]
    tasks = client.map(_answers, parts, question=cloudpickle.dumps(question), pure=False)
    try:
        gathered = client.gather(tasks)
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise ClearanceError(f"Lanes failed on the cluster: {quote(str(error))}.") from error
    finally:
        client.cancel(tasks, force=True)
    return jax.tree.map(lambda *part: np.concatenate(part)[:count], *gathered)


# On a worker ---------------------------------------------------------------------------------------------------------


def _answers(points: dict[str, np.ndarray], question: bytes) -> Answer:
    return lanes(unpickled(question), points, cores=1)


@functools.lru_cache(maxsize=8)
def unpickled(content: bytes) -> Any:
    """What was sent to this worker, which reads it once, and from then on keeps compiled programs on disk."""
    import cloudpickle

    from clearance_jax.configure import configure

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the worker may have used JAX already
        configure(cache=True)
    return cloudpickle.loads(content)
