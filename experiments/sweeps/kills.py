"""Kills: a sweep in a process of its own, into a store, ended by SIGKILL at random moments and resumed."""

import importlib
import shutil
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import clearance_jax as cj
from clearance_jax.sweep.journal import Journal
from experiments.common import output
from experiments.sweeps.asked import CLEARANCE, PEAK, mechanism

# Regions of few chunks, so that few lanes make many, and kills fall within them too; and a short motion, so that
# processes are what takes the time.
REGION, LANES, T1, RTOL = 256, 4096, 2e-3, 1e-5


class Kills(NamedTuple):
    """Kills survived, regions in all, those written before the last kill, regions twice in the journal, and whether the
    answers are those of a sweep that nobody killed.
    """

    kills: int
    regions: int
    twice: int
    identical: bool

    @property
    def whole(self) -> bool:
        """Whether nothing was lost, and nothing there twice."""
        return self.identical and not self.twice


def swept(lanes: int, **options: Any) -> xr.Dataset:
    """A grid over clearance and speed, on one core."""
    axes = {CLEARANCE: np.linspace(1e-4, 5e-4, lanes // 16), "drive.main.speed": np.linspace(400.0, 600.0, 16)}
    return cj.sweep(mechanism(), axes, {"peak": PEAK}, T1, rtol=RTOL, cores=1, **options)


def small_regions() -> None:
    module: Any = importlib.import_module("clearance_jax.sweep.run")
    module.LEAST, module.CHUNKS_A_CORE = REGION, 0


def victim(path: str, lanes: int) -> None:
    """The sweep that is killed."""
    small_regions()
    swept(lanes, store=path, resume=True, progress=lambda p: print(p.done, flush=True))


def killed(wanted: int, lanes: int, seed: int = 0) -> Kills:
    """Kill a sweep so many times, anew from the start whenever it is done."""
    random, path, survived = np.random.default_rng(seed), output("kills.zarr"), 0
    arguments = [sys.executable, "-m", "experiments.sweeps", "victim", str(path), str(lanes)]
    shutil.rmtree(path, ignore_errors=True)
    twice, kept, same = 0, set(), True
    expected = None
    small_regions()
    while survived < wanted:
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE)
        assert process.stdout is not None
        process.stdout.readline()  # it has begun to solve
        time.sleep(float(random.uniform(0.0, 0.3)))
        ended = process.poll() is not None
        if ended and process.returncode:
            raise RuntimeError("The sweep that was to be killed ended by itself; what it said is above.")
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        survived += not ended
        regions = [r["region"] for r in Journal(path / "journal.jsonl").read() if r["event"] == "region"]
        twice += len(regions) - len(set(regions))
        same &= kept <= set(regions)  # what was there is there
        kept = set(regions)
        if ended or survived == wanted:
            found = swept(lanes, store=path, resume=True).load()
            expected = expected if expected is not None else swept(lanes)
            same &= found.drop_attrs().identical(expected.drop_attrs()[list(found.data_vars)])
            shutil.rmtree(path)
            kept = set()
    return Kills(survived, lanes // REGION, twice, bool(same))
