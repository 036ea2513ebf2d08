"""Tolerance design: the largest or cheapest clearances that keep errors and forces within bounds."""

from clearance_jax.design.answer import Design
from clearance_jax.design.budget import ErrorBudget, error_budget
from clearance_jax.design.certificate import Certificate
from clearance_jax.design.classes import ChosenClasses, ToleranceClass, fit_costs
from clearance_jax.design.conditions import Payload, condition_product
from clearance_jax.design.costs import AbstractCost, CostTable, Exponential, ExponentialReciprocal, Reciprocal
from clearance_jax.design.explain import Maintenance, Response, Tradeoff, maintenances, responses, tradeoff
from clearance_jax.design.findings import Findings, findings
from clearance_jax.design.formulation import formulate
from clearance_jax.design.manufacture import AbstractManufacture, AsDesigned, Band, Part, Yield
from clearance_jax.design.methods import METHODS, Method
from clearance_jax.design.observed import JointDrawing, JointLoad
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.program import Evaluation, Program
from clearance_jax.design.run import run
from clearance_jax.design.scaling import ScaledProgram
from clearance_jax.design.specification import Limit, Specification
from clearance_jax.design.standard import StandardFits, chosen_fits, nearest_fits
from clearance_jax.design.standings import Standing, TimeHistory, time_histories
from clearance_jax.design.static import static_weights
from clearance_jax.design.yields import YieldEstimate, YieldWarning

__all__ = [
    "METHODS",
    "AbstractCost",
    "AbstractManufacture",
    "AsDesigned",
    "Band",
    "Certificate",
    "ChosenClasses",
    "CostTable",
    "Design",
    "ErrorBudget",
    "Evaluation",
    "Exponential",
    "ExponentialReciprocal",
    "Findings",
    "JointDrawing",
    "JointLoad",
    "Limit",
    "Maintenance",
    "Method",
    "Part",
    "Payload",
    "Program",
    "Reciprocal",
    "Response",
    "ScaledProgram",
    "Specification",
    "StandardFits",
    "Standing",
    "TimeHistory",
    "ToleranceClass",
    "ToleranceProblem",
    "Tradeoff",
    "Yield",
    "YieldEstimate",
    "YieldWarning",
    "chosen_fits",
    "condition_product",
    "error_budget",
    "findings",
    "fit_costs",
    "formulate",
    "maintenances",
    "nearest_fits",
    "responses",
    "run",
    "static_weights",
    "time_histories",
    "tradeoff",
]
