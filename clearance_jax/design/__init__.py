"""Tolerance design: the largest, or the cheapest, clearances that keep errors and forces within bounds."""

from clearance_jax.design.costs import AbstractCost, Exponential, ExponentialReciprocal, Reciprocal, Table
from clearance_jax.design.made import Band, Yield, Yielded
from clearance_jax.design.problem import Design, Limit, ToleranceProblem
from clearance_jax.design.program import Point, Program
from clearance_jax.design.solvers import SOLVERS
from clearance_jax.design.verify import Certificate, static_weights

__all__ = [
    "SOLVERS",
    "AbstractCost",
    "Band",
    "Certificate",
    "Design",
    "Exponential",
    "ExponentialReciprocal",
    "Limit",
    "Point",
    "Program",
    "Reciprocal",
    "Table",
    "ToleranceProblem",
    "Yield",
    "Yielded",
    "static_weights",
]
