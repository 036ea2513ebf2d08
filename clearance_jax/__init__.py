"""clearance_jax: mechanisms and robots with clearance joints in JAX."""

from clearance_jax import metrics
from clearance_jax.configure import configure
from clearance_jax.flow import Solution
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
from clearance_jax.mechanism.mechanism import Mechanism, parameters, replace
from clearance_jax.mechanism.tree import Fixed, Prismatic, Revolute
from clearance_jax.periodic import PeriodicMotion, periodic_motion
from clearance_jax.results import load_dataset, save, to_dataset
from clearance_jax.scene import load
from clearance_jax.sensitivity import Sensitivities, hessian, sensitivities
from clearance_jax.solve import simulate
from clearance_jax.trace import Trace, trace
from clearance_jax.trust import GradientReport, gradient_report

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
