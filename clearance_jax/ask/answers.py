"""Answers to a question at points: few one by one in threads, many as lanes, on this machine or on a cluster."""

from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np

from clearance_jax.ask.cluster import lanes_on
from clearance_jax.ask.lanes import Columns, answer, lanes
from clearance_jax.ask.place import HERE, SolvePlace
from clearance_jax.ask.question import Answer, Question
from clearance_jax.solve.batch import side_by_side, usual_cores

# Up to so many points are answered one by one: their program compiles sooner than that of lanes. The 299 samples that
# prove a yield of 99 % are among them.
FEW = 300


def answers(question: Question, points: Columns, place: SolvePlace = HERE) -> Answer:
    """The answers at points, each with a first axis (points,): one by one if they are few, as lanes otherwise."""
    count = len(next(iter(points.values())))
    if as_lanes(count, place):
        if place.client is None:
            return lanes(question, points, cores=place.cores)
        return lanes_on(place.client, question, points, place.cores or 1)
    each = _side_by_side(question, points, count, place.cores or usual_cores())
    return jax.tree.map(lambda *parts: np.stack([np.asarray(x) for x in parts]), *each)


def _side_by_side(question: Question, points: Columns, count: int, cores: int) -> list[Answer]:
    """The answers one by one, in a thread for each core."""

    def at(i: int) -> Answer:
        # With the numbers inside the question, points of other names share its program.
        numbers = {name: column[i] for name, column in points.items()}
        return jax.block_until_ready(answer(question.at(numbers)))

    # The first compiles for all.
    first = at(0)
    if count == 1 or cores == 1:
        return [first, *map(at, range(1, count))]
    with ThreadPoolExecutor(min(cores, side_by_side())) as pool:
        try:
            return [first, *pool.map(at, range(1, count))]
        except BaseException:  # an interruption too: start no more solves
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def as_lanes(count: int, place: SolvePlace) -> bool:
    """Whether `count` points are answered as lanes."""
    return count > (FEW if place.client is None else 1)
