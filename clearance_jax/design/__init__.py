"""Tolerance design: the largest or cheapest clearances that keep errors and forces within bounds."""

from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import ChosenClasses, ToleranceClass, fit_costs
from clearance_jax.design.asked.conditions import Payload, condition_product
from clearance_jax.design.asked.costs import AbstractCost, CostTable, Exponential, ExponentialReciprocal, Reciprocal
from clearance_jax.design.asked.formulation import formulate
from clearance_jax.design.asked.manufacture import AbstractManufacture, AsDesigned, Band, Part, Yield
from clearance_jax.design.asked.problem import ToleranceProblem
from clearance_jax.design.asked.specification import Limit, Specification
from clearance_jax.design.judge.budget import ErrorBudget, error_budget
from clearance_jax.design.judge.certificate import Certificate
from clearance_jax.design.judge.explain import Maintenance, Response, Tradeoff, maintenances, responses, tradeoff
from clearance_jax.design.judge.findings import Findings, findings
from clearance_jax.design.judge.observed import JointDrawing, JointLoad
from clearance_jax.design.judge.standard import StandardFits, chosen_fits, nearest_fits
from clearance_jax.design.judge.standings import Standing, TimeHistory, time_histories
from clearance_jax.design.judge.static import static_weights
from clearance_jax.design.search.methods import METHODS, Method
from clearance_jax.design.search.program import Evaluation, Program
from clearance_jax.design.search.run import run
from clearance_jax.design.search.scaling import ScaledProgram
from clearance_jax.design.search.yields import YieldEstimate, YieldWarning

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
