"""Explicit Runge-Kutta methods as arrays: diffrax's tableaus, with the end of the step as their last stage."""

from typing import Any, NamedTuple

import numpy as np


class Tableau(NamedTuple):
    """Stage i is at `nodes[i]` and starts from the slopes before it by `lower[i]`; the last stage is the step's end.
    `weights`: of the end; `errors`: of its estimated error; `stages`: those of the method itself, without a last one
    added here.
    """

    lower: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    errors: np.ndarray
    stages: int


def tableau_of(solver: Any) -> Tableau:
    """The tableau of a diffrax solver."""
    given = solver.tableau
    stages = len(given.a_lower) + 1
    count = stages if given.fsal else stages + 1
    lower, nodes = np.zeros((count, count)), np.zeros(count)
    for i, row in enumerate(given.a_lower):
        lower[i + 1, : len(row)] = row
    nodes[1:stages] = given.c
    lower[-1, :stages], nodes[-1] = given.b_sol, 1.0
    lower[-1, -1] = 0.0
    weights, errors = np.zeros(count), np.zeros(count)
    weights[:stages], errors[:stages] = given.b_sol, given.b_error
    return Tableau(lower, nodes, weights, errors, stages)
