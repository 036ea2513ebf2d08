"""Other programs that solve the same motions: hand-written C, and scipy's integrators in a pool of processes.

A ladder of tolerances says what error a program reaches and what that takes; the error is the median over the lanes, or
a tenth of the largest where that is more. Then sweep and program take turns, each at the tolerance that is cheapest
for an error that both reach, at that and every tighter one measured.
"""

import multiprocessing
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from clearance_jax.solve.drivers.batch import cores_here
from experiments.common import output, table
from experiments.publish import say
from experiments.reference.baselines import slider_crank_end, slider_crank_truth
from experiments.scalar import compiled, read, words
from experiments.sweeps.asked import FARTHEST, clearances, swept
from experiments.sweeps.throughput import ERROR

INTEGRATORS = ("odeint", "LSODA", "DOP853", "RK45", "RK23", "BDF", "Radau")
SOLVERS = (
    ("tsit5", (1e-4, 4e-5, *(10.0**-k for k in range(5, 10)))),
    ("dopri8", tuple(10.0**-k for k in range(6, 12))),
)
# A ladder ends where a lane takes longer [s]; what is measured against lasts about so long [s].
SLOWEST, DURATION = 0.6, 1.5

Run = Callable[[float, int], tuple[np.ndarray, float]]
"""With a tolerance so many lanes: their slider's last places [m], and lanes a second on all cores."""


class Rung(NamedTuple):
    """A program at one tolerance."""

    program: str
    rtol: float
    error: float
    rate: float


class Duel(NamedTuple):
    """A sweep beside another program, at the error that was asked for."""

    error: float
    sweep: Rung
    rival: Rung

    @property
    def ratio(self) -> float:
        return self.sweep.rate / self.rival.rate


class Sizes(NamedTuple):
    """Lanes of a sweep and of a ladder of others, every so manieth of the sweep's; rounds; tolerances; integrators."""

    sweep: int = 4096
    ladder: int = 14
    rounds: int = 2
    cores: int = cores_here()
    tolerances: tuple[float, ...] = tuple(10.0**-k for k in range(4, 14))
    solvers: tuple[tuple[str, tuple[float, ...]], ...] = SOLVERS
    integrators: tuple[str, ...] = INTEGRATORS


QUICK = Sizes(128, 2, 1, 1, (1e-5, 1e-6), (("tsit5", (1e-5, 1e-6)),), ("odeint",))


# Programs ------------------------------------------------------------------------------------------------------------


def by_sweep(solver: str) -> Run:
    def run(rtol: float, lanes: int) -> tuple[np.ndarray, float]:
        clock = time.perf_counter()
        places = swept(lanes, rtol, solver=solver)["end"].values
        return places, lanes / (time.perf_counter() - clock)

    return run


def by_c(program: Path, events: int, cores: int, seconds: float) -> Run:
    """As many processes as cores, each with all of the lanes; in CPU seconds, the shortest round of each."""

    def run(rtol: float, lanes: int) -> tuple[np.ndarray, float]:
        command = words(program, lanes, rtol, seconds, events)
        running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(cores)]
        answers = [read(process.communicate()[0]) for process in running]
        return answers[0][0], sum(lanes / took for _, took, _ in answers)

    return run


def by_scipy(pool: ProcessPoolExecutor, integrator: str) -> Run:
    def run(rtol: float, lanes: int) -> tuple[np.ndarray, float]:
        clock, own = time.perf_counter(), clearances(lanes)
        places = list(pool.map(slider_crank_end, [integrator] * lanes, [rtol] * lanes, own))
        return np.array(places), lanes / (time.perf_counter() - clock)

    return run


# Ladders -------------------------------------------------------------------------------------------------------------


def error_of(places: np.ndarray, truth: np.ndarray) -> float:
    """The median over the lanes, or a tenth of the largest; of some of them, evenly spread, the truth is known."""
    apart = np.abs(places[:: (len(places) - 1) // (len(truth) - 1)] - truth) / FARTHEST
    return float(max(np.median(apart), apart.max() / 10))


def ladder(
    program: str, run: Run, tolerances: Iterable[float], lanes: int, truth: np.ndarray, cores: int
) -> list[Rung]:
    """A program at every tolerance, down to the first at which a lane takes too long."""
    rungs = []
    for rtol in tolerances:
        places, rate = run(rtol, lanes)
        rungs.append(Rung(program, rtol, error_of(places, truth), rate))
        if cores / rate > SLOWEST:
            break
    return rungs


def cheapest(rungs: list[Rung], error: float) -> Rung | None:
    """The fastest that has this error, and has it at every tighter tolerance."""
    good = []
    for rung in reversed(rungs):
        if rung.error > error:
            break
        good.append(rung)
    return max(good, key=lambda rung: rung.rate, default=None)


def duel(
    error: float, own: dict[str, list[Rung]], rival: list[Rung], runs: dict[str, Run], sizes: Sizes
) -> Duel | None:
    """Sweep and rival in turns, at the cheapest tolerances for an error; each one's highest rate."""
    mine = max((r for r in (cheapest(rungs, error) for rungs in own.values()) if r), key=lambda r: r.rate, default=None)
    other = cheapest(rival, error)
    if mine is None or other is None:
        return None
    lanes, best = max(sizes.ladder, int(other.rate * DURATION)), (0.0, 0.0)
    for _ in range(sizes.rounds):
        rates = runs[mine.program](mine.rtol, sizes.sweep)[1], runs[other.program](other.rtol, lanes)[1]
        best = max(best[0], rates[0]), max(best[1], rates[1])
    return Duel(error, mine._replace(rate=best[0]), other._replace(rate=best[1]))


def duels(quick: bool) -> tuple[list[Rung], list[Duel]]:
    """Every rung, and every duel."""
    sizes = QUICK if quick else Sizes()
    seconds = 0.1 if quick else DURATION
    workers = ProcessPoolExecutor(sizes.cores, multiprocessing.get_context("spawn"))
    with workers as pool, tempfile.TemporaryDirectory() as folder:
        truth = np.array(list(pool.map(slider_crank_truth, clearances(sizes.ladder))))
        runs = {solver: by_sweep(solver) for solver, _ in sizes.solvers}
        own = {}
        for solver, tolerances in sizes.solvers:
            runs[solver](tolerances[0], sizes.sweep)  # compiles
            own[solver] = ladder(solver, runs[solver], tolerances, sizes.sweep, truth, sizes.cores)
        program = compiled(folder)
        others: dict[str, Run] = {}
        if program is None:
            say("There is no C compiler: scipy alone.")
        else:
            for events, name in enumerate(("C, no events", "C, located events")):
                others[name] = by_c(program, events, sizes.cores, seconds)
        others |= {f"scipy {name}": by_scipy(pool, name) for name in sizes.integrators}
        runs |= others
        rungs, found = [rung for one in own.values() for rung in one], []
        for name, run in others.items():
            if not name.startswith("C,"):
                run(sizes.tolerances[0], 4 * sizes.cores)  # compiles, or loads what is compiled
            theirs = ladder(name, run, sizes.tolerances, sizes.ladder, truth, sizes.cores)
            rungs += theirs
            # The tightest that both reach, by the tightest tolerance of each.
            least = max(min(one[-1].error for one in own.values()), theirs[-1].error)
            found += [duel(error, own, theirs, runs, sizes) for error in (ERROR, least)]
    return rungs, [one for one in found if one is not None]


def tabulate(rungs: list[Rung], found: list[Duel], suffix: str) -> None:
    cells = [
        (
            *(one.rival.program, f"{one.error:.1e}", f"{one.rival.rtol:.0e}", f"{one.rival.rate:.1f}"),
            *(one.sweep.program, f"{one.sweep.rtol:.0e}", f"{one.sweep.error:.1e}", f"{one.sweep.rate:.0f}"),
            f"{one.ratio:.1f}",
        )
        for one in found
    ]
    head = "program", "error", "rtol", "lanes/s", "sweep with", "rtol", "error", "lanes/s", "ratio"
    table(head, cells, output(f"sweeps_rivals{suffix}.md"))
    say("Every tolerance that was tried:")
    steps = [(r.program, f"{r.rtol:.0e}", f"{r.error:.1e}", f"{r.rate:.1f}") for r in rungs]
    table(("program", "rtol", "error", "lanes/s"), steps, output(f"sweeps_ladders{suffix}.md"))
