"""Tolerance design: the largest, or the cheapest, clearances that keep errors and forces within bounds."""

from clearance_jax.design.answer import Design
from clearance_jax.design.costs import AbstractCost, Exponential, ExponentialReciprocal, Reciprocal, Table
from clearance_jax.design.explain import Response, Tradeoff, responses, tradeoff
from clearance_jax.design.findings import Findings, findings
from clearance_jax.design.formulation import formulate
from clearance_jax.design.histories import History, histories
from clearance_jax.design.made import Band, Yield, Yielded
from clearance_jax.design.methods import CHOICES, METHODS, Method
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.program import Point, Program
from clearance_jax.design.run import run
from clearance_jax.design.scaling import ScaledProgram
from clearance_jax.design.specification import Limit, Specification
from clearance_jax.design.standard import StandardFits, nearest_fits
from clearance_jax.design.static import static_weights
from clearance_jax.design.verify import Certificate

__all__ = [
    "CHOICES",
    "METHODS",
    "AbstractCost",
    "Band",
    "Certificate",
    "Design",
    "Exponential",
    "ExponentialReciprocal",
    "Findings",
    "History",
    "Limit",
    "Method",
    "Point",
    "Program",
    "Reciprocal",
    "Response",
    "ScaledProgram",
    "Specification",
    "StandardFits",
    "Table",
    "ToleranceProblem",
    "Tradeoff",
    "Yield",
    "Yielded",
    "findings",
    "formulate",
    "histories",
    "nearest_fits",
    "responses",
    "run",
    "static_weights",
    "tradeoff",
]
