"""Kills: a sweep in a process of its own, into a store, ended by SIGKILL at random moments and resumed."""

import importlib
import multiprocessing
import shutil
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import clearance_jax as cj
from clearance_jax.runs.journal import Journal
from experiments.common import output

# Regions of few chunks, so that few lanes make many, and kills fall within them too. What is killed must first be
# traced: of the least mechanism, that takes a tenth of what it takes of a slider-crank.
REGION, LANES, T1, RTOL = 256, 4096, 20.0, 1e-9
# How long lanes wait to be written [s]: shorter than usual by as much as the regions are smaller.
PATIENCE = 0.05
# What a process of its own takes most of its time to import. One server of processes has it, and they begin with it.
IMPORTED = ["experiments.sweeps.kills", "clearance_jax.sweep.run", "zarr", "dask.array"]


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
    """Pendulums, a grid over mass and inertia, on one core."""
    rod = cj.Body("rod", mass=1.0, inertia=0.1, center_of_mass=cj.Position(0.5, 0.0))
    pivot = cj.Revolute("pivot", "ground", "rod", motion=cj.Motion(position=1.0))
    pendulum = cj.Mechanism((rod,), (pivot,), gravity=cj.Gravity(0.0, -9.81))
    axes = {"rod.mass": np.linspace(1.0, 2.0, lanes // 16), "rod.inertia": np.linspace(0.1, 0.2, 16)}
    outputs = {"angle": "pivot", "speed": "pivot.velocity"}
    return cj.sweep(pendulum, axes, outputs, T1, rtol=RTOL, cores=1, **options)


def small_regions() -> None:
    for module, name, value in (
        ("sweep.run", "LEAST", REGION),
        ("sweep.run", "CHUNKS_A_CORE", 0),
        ("runs.partial", "PATIENCE", PATIENCE),
    ):
        setattr(importlib.import_module(f"clearance_jax.{module}"), name, value)


def victim(path: Path, lanes: int, begun: Connection) -> None:
    """The sweep that is killed; it says when it has begun to solve."""
    cj.configure(cache=True)
    small_regions()

    def tell(_progress: Any) -> None:
        if not begun.closed:
            begun.send(True)
            begun.close()

    swept(lanes, store=path, resume=True, progress=tell)


def killed(wanted: int, lanes: int, seed: int = 0) -> Kills:
    """Kill a sweep so many times, anew from the start whenever it is done."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(IMPORTED)
    random, path, survived = np.random.default_rng(seed), output("kills.zarr"), 0
    shutil.rmtree(path, ignore_errors=True)
    twice, kept, same = 0, set(), True
    expected = None
    small_regions()
    while survived < wanted:
        heard, said = processes.Pipe(duplex=False)
        process = processes.Process(target=victim, args=(path, lanes, said))
        process.start()
        said.close()
        with suppress(EOFError):  # it had nothing left to do
            heard.recv()
        time.sleep(float(random.uniform(0.0, 0.3)))
        ended = not process.is_alive()
        process.kill()
        process.join()
        if ended and process.exitcode:
            raise RuntimeError("The sweep that was to be killed ended by itself; what it said is above.")
        survived += not ended
        regions = [record["region"] for record in Journal(path / "journal.jsonl").records if "region" in record]
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
