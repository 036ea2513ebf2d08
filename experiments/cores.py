"""Batches on several cores: `python -m experiments.cores` writes out/cores.md, out/cores_orders.md,
out/cores_memory.md.

The program is `cj.batch` of slider-cranks: one revolution at 5000 rpm, rtol 1e-5. A lane is one motion of the batch,
and has two output numbers. The times exclude compilation.

- Cores: batches of several sizes over the clearance (0.05 to 0.5 mm). One core and all cores take turns in several
  rounds, and the shortest times count. `over the largest` is the CPU time per lane, divided by that of the largest
  batch. `over one core` is the gain in wall time. It is smaller if the cores have other work too.
- Orders: the lane efficiency (attempts of the lanes, divided by the attempts that their chunks made) for four orders of
  the lanes: the given one (`as they come`), sorted by an estimate from the first chunks (`learned`), sorted by a probe,
  and sorted by their true costs. A probe is a solve with a loose tolerance. Its price is the number of its attempts,
  divided by that of the solve.
- Memory: the peak memory of a separate process, after each stage of its work.
"""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import clearance_jax as cj
from experiments.batches import END
from experiments.common import output, peak_memory, slider_crank, table
from experiments.publish import command, say

RTOL, PROBE = 1e-5, 1e-4
SWEEP = (5e-5, 5e-4)
CLEARANCE = "wrist.radial_clearance"
SCATTERED = (CLEARANCE, "slider.mass", "wrist.normal.stiffness.pin_modulus", "wrist.normal.damping")
MOST = 65_536


class Size(NamedTuple):
    """A sweep: how full its chunks were, and the shortest wall and CPU times per lane [s]."""

    lanes: int
    cores: int
    efficiency: float
    wall: float
    cpu: float


class Order(NamedTuple):
    """Lanes in an order: how full their chunks were, and the price of knowing it [attempts over those of the lanes]."""

    lanes: str
    order: str
    efficiency: float
    price: float


def solved(lane: dict[str, Any]) -> tuple[jax.Array, jax.Array]:
    """Where the slider ends [m], and how many attempts that took; the tolerance is a number of the lane."""
    numbers = {name: value for name, value in lane.items() if name != "rtol"}
    solution = cj.simulate(cj.replace(slider_crank(), numbers), END, rtol=lane["rtol"], energy_balance=False)
    return solution["piston.position.x"], solution.steps + solution.rejected


def at(rtol: float, lanes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """These lanes, to be solved with this tolerance."""
    return {**lanes, "rtol": np.full(len(lanes[CLEARANCE]), rtol)}


def sweep(lanes: int) -> dict[str, np.ndarray]:
    return at(RTOL, {CLEARANCE: np.linspace(*SWEEP, lanes)})


def reported(lanes, **options) -> tuple[Any, cj.BatchReport]:
    reports: list[cj.BatchReport] = []
    return cj.batch(solved, lanes, report=reports.append, **options), reports[0]


def over_cores(quick: bool) -> list[Size]:
    """Sweeps of several sizes, on one core and on all."""
    sizes = (64,) if quick else (64, 256, 1024, 4096, 16_384, MOST)
    _, known = reported(sweep(256))  # several chunks, so that every core has one
    rows = []
    for lanes in sizes:
        best: dict[int, Size] = {}
        # Much the same time goes to every size, but for the largest.
        for _ in range(1 if quick else min(40, max(2, 20_000 // lanes))):
            for cores in sorted({1, known.cores}):
                clock = time.process_time()
                _, report = reported(sweep(lanes), cores=cores)
                took = report.running / lanes, (time.process_time() - clock) / lanes
                least = best.get(report.cores, Size(lanes, report.cores, report.efficiency or np.nan, *took))
                best[report.cores] = least._replace(wall=min(least.wall, took[0]), cpu=min(least.cpu, took[1]))
        rows += best.values()
    return rows


def over_orders(quick: bool) -> list[Order]:
    """Every order of every kind of lanes."""
    lanes, rng = 256 if quick else 4096, np.random.default_rng(0)
    usual = {name: float(cj.parameters(slider_crank())[name].value) for name in SCATTERED}
    mixed = rng.permutation(lanes)
    kinds = {
        "sweep over the clearance": sweep(lanes),
        "the same, shuffled": {name: values[mixed] for name, values in sweep(lanes).items()},
        "four numbers, each up to 50 % off": {n: x * rng.uniform(0.5, 1.5, lanes) for n, x in usual.items()},
        "four numbers, scatter 5 %": {n: x * np.exp(rng.normal(0, 0.05, lanes)) for n, x in usual.items()},
    }
    rows = []
    for kind, given in kinds.items():
        places, attempts = cj.batch(solved, at(RTOL, given), cost=None)
        _, probe = cj.batch(solved, at(PROBE, given))
        for order, cost, price in (
            ("as they come", None, 0.0),
            ("learned", "learned", 0.0),
            (f"by a probe at rtol {PROBE:.0e}", probe, float(np.sum(probe) / np.sum(attempts))),
            ("by their true costs", attempts, 1.0),
        ):
            (again, _), report = reported(at(RTOL, given), cost=cost)
            assert np.array_equal(again, places), "the order changes a lane"
            assert report.efficiency is not None
            rows.append(Order(kind, order, report.efficiency, price))
    return rows


def memory() -> dict[str, float]:
    """The peak of this process [MiB], after each stage."""
    stages = {"Python, JAX and this library imported": peak_memory()}
    cj.batch(solved, sweep(32))
    stages["compiled, 32 lanes"] = peak_memory()
    cj.batch(solved, sweep(MOST))
    stages[f"{MOST} lanes"] = peak_memory()
    return stages


def main(quick: bool = False) -> list[Order]:
    """Write the tables; returns the orders."""
    end = "_quick" if quick else ""
    sizes = over_cores(quick)
    alone = {size.lanes: size.wall for size in sizes if size.cores == 1}
    largest = {size.cores: size.cpu for size in sizes}
    table(
        ("lanes", "cores", "lane efficiency", "ms per lane", "CPU ms per lane", "over the largest", "over one core"),
        [
            (
                *(size.lanes, size.cores, f"{size.efficiency:.3f}", f"{size.wall * 1e3:.3f}", f"{size.cpu * 1e3:.3f}"),
                f"{size.cpu / largest[size.cores]:.2f}",
                f"{alone[size.lanes] / size.wall:.2f}",
            )
            for size in sizes
        ],
        output(f"cores{end}.md"),
    )
    orders = over_orders(quick)
    table(
        ("lanes", "order", "lane efficiency", "price"),
        [(*row[:2], f"{row.efficiency:.3f}", f"{row.price:.2f}") for row in orders],
        output(f"cores_orders{end}.md"),
    )
    if not quick and Path("/proc/self/status").exists():
        answer = subprocess.run(
            [sys.executable, "-m", "experiments.cores", "--memory"], capture_output=True, text=True, check=True
        )
        stages = json.loads(answer.stdout.splitlines()[-1])
        rows = [(stage, f"{size:.0f}") for stage, size in stages.items()]
        table(("a process of its own", "peak memory, MiB"), rows, output("cores_memory.md"))
    say("Every order gave every lane the same place, bit for bit.")
    return orders


if __name__ == "__main__":
    if "--memory" in sys.argv:
        cj.configure()
        print(json.dumps(memory()))
    else:
        command(main, __doc__)
