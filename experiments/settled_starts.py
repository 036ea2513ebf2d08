"""Settled starts of a moving robot: `python -m experiments.settled_starts` writes out/settled_starts.md.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.dynamics.quantities import evaluated
from clearance_jax.mechanism.state import layout
from experiments.common import SCENES, output, table
from experiments.publish import command, say

SEED, EACH, SPAN, SAMPLES, RTOL = 11, 50, 0.02, 2001, 1e-6
PLAY = ("axis_2", "axis_3", "axis_5")
# Of axes 1 to 6: how far from zero postures are drawn [deg], and the limits of the speeds of the file [rad/s].
RANGES = np.radians([170, 60, 120, 180, 110, 180])
SPEEDS = np.array([2.6, 2.6, 3.1, 4.0, 4.0, 5.0])
# Limits of the issue
AT_REST, TIMES = 0.05, 5.0


def quintic(begin, took, at, rise, via):
    return cj.Quintic([begin, begin + took], [at, at + rise])


def trapezoid(begin, took, at, rise, via):
    return cj.Trapezoid([begin], [rise], duration=[took], offset=at)


def spline(begin, took, at, rise, via):
    times = begin + took * np.array([0, 1 / 3, 2 / 3, 1])
    return cj.Spline(times, at + rise * np.array([0, *via, 1]), ends="clamped")


def five_step(begin, took, at, rise, via):
    return cj.Step5Sum([begin], [begin + took], [rise], at)


DRIVES: dict[str, Callable] = {"quintic": quintic, "trapezoid": trapezoid, "spline": spline, "five-step": five_step}
