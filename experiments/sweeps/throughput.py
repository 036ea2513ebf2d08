"""How many lanes a second: sweeps beside bare lanes, on one core and on all, of every size."""

import shutil
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from experiments.common import output, table
from experiments.sweeps.asked import CLEARANCE, bare, clearances, measured, swept

# The tolerance, and the error that programs are compared at.
RTOL = ERROR = 1e-5
SIZES = (1, 16, 256, 4096, 65_536)
BARE, SWEEP, STORE, ONE, METRICS = "`batch`", "`sweep`", "`sweep` into a store", "`sweep`, one core", "`sweep`, metrics"
# Metrics are looked at in a sweep of this size alone.
USUAL = 4096


class Rate(NamedTuple):
    """Of so many lanes run in one way the shortest wall time and CPU time of one call [s]."""

    lanes: int
    way: str
    wall: float
    cpu: float


def ways(lanes: int) -> dict[str, Callable[[], Any]]:
    """Ways to run so many lanes."""
    path, values = output("sweeps.zarr"), {CLEARANCE: clearances(lanes)}
    found: dict[str, Callable[[], Any]] = {
        BARE: lambda: cj.batch(bare(RTOL), values),
        SWEEP: lambda: swept(lanes, RTOL),
    }
    if lanes >= 256:
        found[STORE] = lambda: swept(lanes, RTOL, store=path)
        found[ONE] = lambda: swept(lanes, RTOL, cores=1)
    if lanes == USUAL:
        found[METRICS] = lambda: measured(lanes, RTOL)
    return found


def rates(sizes: tuple[int, ...], most: int) -> list[Rate]:
    """Every way of every size, in turns; at `most` so many rounds."""
    rows, path = [], output("sweeps.zarr")
    for lanes in sizes:
        best: dict[str, Rate] = {}
        rounds = min(most, max(1, 20_000 // lanes))
        # Programs of few lanes are compiled in a round that does not count; those of 64 lanes are known by then.
        for turn in range(-1 if lanes <= USUAL else 0, rounds):
            for way, run in ways(lanes).items():
                shutil.rmtree(path, ignore_errors=True)
                wall, cpu = time.perf_counter(), time.process_time()
                run()
                took = Rate(lanes, way, time.perf_counter() - wall, time.process_time() - cpu)
                least = best.get(way, took)
                if turn >= 0:
                    best[way] = took._replace(wall=min(took.wall, least.wall), cpu=min(took.cpu, least.cpu))
        rows += best.values()
    shutil.rmtree(path, ignore_errors=True)
    return rows


def by_size(rows: list[Rate], way: str) -> dict[int, Rate]:
    return {row.lanes: row for row in rows if row.way == way}


def gain(rows: list[Rate]) -> dict[int, float]:
    """Of each size the rate on all cores over that on one."""
    alone, all_of = by_size(rows, ONE), by_size(rows, SWEEP)
    return {lanes: one.wall / all_of[lanes].wall for lanes, one in alone.items()}


def tabulate(rows: list[Rate], suffix: str) -> None:
    known, largest, gains = by_size(rows, BARE), max(by_size(rows, SWEEP).items())[1], gain(rows)

    def cells(row: Rate) -> tuple[Any, ...]:
        beside = known[row.lanes]
        return (
            *(row.lanes, row.way, f"{row.lanes / row.wall:.0f}", f"{1e3 * row.cpu / row.lanes:.3f}"),
            *(f"{row.wall / beside.wall:.3f}", f"{row.cpu / beside.cpu:.3f}", f"{1e3 * (row.cpu - beside.cpu):.1f}"),
            f"{row.cpu / row.lanes / (largest.cpu / largest.lanes):.3f}" if row.way == SWEEP else "",
            f"{gains[row.lanes]:.2f}" if row.way == SWEEP and row.lanes in gains else "",
        )

    head = "lanes", "way", "lanes/s", "CPU ms a lane", "wall over `batch`", "CPU over `batch`", "CPU ms more"
    table((*head, "over the largest", "over one core"), [cells(row) for row in rows], output(f"sweeps{suffix}.md"))


def found(rows: list[Rate]) -> dict[str, list[float]]:
    """What is asked of throughput: ratios by size."""
    bare_ones, sweeps = by_size(rows, BARE), by_size(rows, SWEEP)
    largest = max(sweeps.items())[1]
    linear = [row.cpu / row.lanes / (largest.cpu / largest.lanes) for n, row in sweeps.items() if n >= 256]
    return {
        "batch": [row.cpu / bare_ones[n].cpu for n, row in sweeps.items()],
        "linear": linear or [np.nan],
        "cores": [ratio for lanes, ratio in gain(rows).items() if lanes >= USUAL] or [np.nan],
    }
