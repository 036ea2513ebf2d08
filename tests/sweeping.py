"""A small sweep of a slider-crank, into small regions."""

import importlib

import numpy as np
import xarray as xr
from places import SCENES

import clearance_jax as cj

SCENE = SCENES / "slider_crank.toml"
CLEARANCES, SPEEDS = np.linspace(1e-4, 5e-4, 32), np.linspace(400.0, 500.0, 16)
OUTPUTS = {
    "peak": cj.metrics.Peak(cj.metrics.PositionError("piston")),
    "end": "piston.position",
}


def small_regions(patch, least=64) -> None:
    """Regions of few lanes, so that few lanes make many regions, and chunks that do not wait to be written, as long
    as a pytest's `patch`.
    """
    for module, name, value in (
        ("sweep.run", "LEAST", least),
        ("sweep.run", "CHUNKS_A_CORE", 0),
        ("runs.partial", "PATIENCE", 0.0),
    ):
        patch.setattr(importlib.import_module(f"clearance_jax.{module}"), name, value)


def swept(store=None, clearances=CLEARANCES, speeds=SPEEDS, t1=5e-4, **options):
    """A small sweep of the slider-crank: 512 lanes in 8 regions."""
    axes = {"wrist.radial_clearance": clearances, "drive.main.speed": speeds}
    return cj.sweep(cj.load(SCENE), axes, OUTPUTS, t1, store=store, cores=1, rtol=1e-6, **options)


def same(found, expected):
    """Bit by bit, coordinates too."""
    xr.testing.assert_identical(found.load().drop_attrs(), expected.drop_attrs()[list(found.data_vars)])
