"""Calibration: the numbers of a mechanism from its measured motion or forces."""

from clearance_jax.calibrate.options import LOSSES, FitOptions
from clearance_jax.calibrate.result import Calibration, Minimum

__all__ = ["LOSSES", "Calibration", "FitOptions", "Minimum"]
