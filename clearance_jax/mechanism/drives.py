"""Drives: the motion of a coordinate as a function of time."""

from clearance_jax.mechanism.motion_laws import AbstractDrive, ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.profiles import Constant, Quintic, Trapezoid

__all__ = [
    "AbstractDrive",
    "Constant",
    "ConstantSpeed",
    "Harmonic",
    "Quintic",
    "Spline",
    "Step5Sum",
    "StepSum",
    "Trapezoid",
]
