"""clearance_jax: mechanisms and robots with clearance joints in JAX."""

from clearance_jax.analysis import metrics
from clearance_jax.analysis.measure import measure
from clearance_jax.analysis.periodic import PeriodicMotion, periodic_motion
from clearance_jax.analysis.sensitivity import Sensitivities, hessian, sensitivities
from clearance_jax.analysis.trust import GradientReport, gradient_report
from clearance_jax.configure import configure
from clearance_jax.io.scene import load
from clearance_jax.joints import RevoluteClearance
from clearance_jax.mechanism.body import (
    Body,
    ConstantEffort,
    Gravity,
    JointSpring,
    Motion,
    Point,
    Position,
    Servo,
    Spring,
)
from clearance_jax.mechanism.drives import ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.tree import Fixed, Prismatic, Revolute
from clearance_jax.parameters import parameters, replace
from clearance_jax.results.dataset import to_dataset
from clearance_jax.results.store import load_dataset, save
from clearance_jax.solve.flow import Solution
from clearance_jax.solve.simulate import simulate
from clearance_jax.solve.trace import Trace, trace

__all__ = [
    "Body",
    "ConstantEffort",
    "ConstantSpeed",
    "Fixed",
    "GradientReport",
    "Gravity",
    "Harmonic",
    "JointSpring",
    "Mechanism",
    "Motion",
    "PeriodicMotion",
    "Point",
    "Position",
    "Prismatic",
    "Revolute",
    "RevoluteClearance",
    "Sensitivities",
    "Servo",
    "Solution",
    "Spline",
    "Spring",
    "Step5Sum",
    "StepSum",
    "Trace",
    "configure",
    "gradient_report",
    "hessian",
    "load",
    "load_dataset",
    "measure",
    "metrics",
    "parameters",
    "periodic_motion",
    "replace",
    "save",
    "sensitivities",
    "simulate",
    "to_dataset",
    "trace",
]
