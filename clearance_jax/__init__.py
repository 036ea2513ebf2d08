"""clearance_jax: mechanisms and robots with clearance joints in JAX."""

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
from clearance_jax.results import load_dataset, save, to_dataset
from clearance_jax.scene import load
from clearance_jax.solve import simulate
from clearance_jax.trace import Trace, trace

__all__ = [
    "Body",
    "ConstantEffort",
    "ConstantSpeed",
    "Fixed",
    "Gravity",
    "Harmonic",
    "JointSpring",
    "Mechanism",
    "Motion",
    "Point",
    "Position",
    "Prismatic",
    "Revolute",
    "RevoluteClearance",
    "Servo",
    "Solution",
    "Spline",
    "Spring",
    "Step5Sum",
    "StepSum",
    "Trace",
    "configure",
    "load",
    "load_dataset",
    "parameters",
    "replace",
    "save",
    "simulate",
    "to_dataset",
    "trace",
]
