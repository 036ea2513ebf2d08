"""A sweep in a process of its own, to be killed: `python tests/sweeping.py STORE LANES_A_REGION`."""

import importlib
import sys
from pathlib import Path

import numpy as np
import xarray as xr

import clearance_jax as cj

SCENE = Path(__file__).parents[1] / "experiments/scenes/slider_crank.toml"
CLEARANCES, SPEEDS = np.linspace(1e-4, 5e-4, 32), np.linspace(400.0, 500.0, 16)
OUTPUTS = {
    "peak": cj.metrics.Peak(cj.metrics.PositionError("piston")),
    "end": "piston.position",
}


def small_regions(patch=None, least=64) -> None:
    """Regions of few lanes, so that few lanes make many regions, and chunks that do not wait to be written; for good,
    or as long as a pytest's `patch`.
    """
    change = setattr if patch is None else patch.setattr
    for module, name, value in (
        ("sweep.run", "LEAST", least),
        ("sweep.run", "CHUNKS_A_CORE", 0),
        ("runs.partial", "PATIENCE", 0.0),
    ):
        change(importlib.import_module(f"clearance_jax.{module}"), name, value)


def swept(store=None, clearances=CLEARANCES, speeds=SPEEDS, t1=5e-4, **options):
    """A small sweep of the slider-crank: 512 lanes in 8 regions."""
    axes = {"wrist.radial_clearance": clearances, "drive.main.speed": speeds}
    return cj.sweep(cj.load(SCENE), axes, OUTPUTS, t1, store=store, cores=1, rtol=1e-6, **options)


def same(found, expected):
    """Bit by bit, coordinates too."""
    xr.testing.assert_identical(found.load().drop_attrs(), expected.drop_attrs()[list(found.data_vars)])


if __name__ == "__main__":
    cj.configure(cache=True)
    small_regions(least=int(sys.argv[2]))
    print("ready", flush=True)

    def in_step(progress):
        """Say how far it is, and wait for a line, so that it is not done before anyone has killed it."""
        print(progress.done, flush=True)
        sys.stdin.readline()

    swept(Path(sys.argv[1]), resume=True, progress=in_step)
    print("done", flush=True)
