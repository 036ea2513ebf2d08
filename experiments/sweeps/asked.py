"""What is swept: slider-cranks over their clearance, 0.05 to 0.5 mm, through one revolution at 5000 rpm."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

import clearance_jax as cj
from experiments.batches import END
from experiments.common import slider_crank

CLEARANCE, PLACE = "wrist.radial_clearance", "piston.position.x"
FARTHEST = 0.17
"""The slider's farthest place [m]; errors are over it."""
PEAK = cj.metrics.Peak(cj.metrics.PositionError("piston"))
METRICS = {"peak": PEAK, "force": cj.metrics.Peak(cj.metrics.ContactForce("wrist"))}


@functools.cache
def mechanism() -> cj.Mechanism:
    return slider_crank()


def clearances(lanes: int) -> np.ndarray:
    """So many clearances [m]."""
    return np.linspace(5e-5, 5e-4, lanes)


def swept(lanes: int, rtol: float, **options: Any) -> xr.Dataset:
    """The slider's last place (`end`), without energy balance, which no other program here keeps."""
    axes = {CLEARANCE: clearances(lanes)}
    return cj.sweep(mechanism(), axes, {"end": PLACE}, END, rtol=rtol, energy_balance=False, **options)


def measured(lanes: int, rtol: float, **options: Any) -> xr.Dataset:
    """Metrics of the same motions: peaks of error and force, and what every lane says beside."""
    return cj.sweep(mechanism(), {CLEARANCE: clearances(lanes)}, METRICS, END, rtol=rtol, **options)


@functools.cache
def bare(rtol: float) -> Any:
    """The function of a lane that `cj.batch` maps: the same last place."""
    return jax.tree_util.Partial(_lane, mechanism(), jnp.asarray(END), jnp.asarray(rtol))


def _lane(crank, t1, rtol, lane):
    return cj.simulate(cj.replace(crank, lane), t1, rtol=rtol, energy_balance=False)[PLACE]
