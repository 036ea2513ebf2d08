"""Answers to a question at points: one by one, as lanes, or on a cluster, by how many they are."""

import jax
import numpy as np

from clearance_jax.ask.cluster import lanes_on
from clearance_jax.ask.lanes import Columns, answer, lanes
from clearance_jax.ask.place import HERE, Place
from clearance_jax.ask.question import Answer, Question

# Up to so many points are answered one by one where lanes are not asked for: their program compiles sooner.
FEW = 250


def answers(question: Question, points: Columns, place: Place = HERE) -> Answer:
    """The answers at points: one by one where they are few, else, and on a cluster, as lanes."""
    count = len(next(iter(points.values())))
    if as_lanes(count, place):
        if place.client is None:
            return lanes(question, points, cores=place.cores)
        return lanes_on(place.client, question, points, place.cores or 1)
    # Points of other names share the program of these.
    found = [answer(question.at({name: column[i] for name, column in points.items()})) for i in range(count)]
    return jax.tree.map(lambda *one: np.stack([np.asarray(x) for x in one]), *found)


def as_lanes(count: int, place: Place) -> bool:
    """Whether so many points are answered as lanes."""
    return count > (FEW if place.client is None else 1)
