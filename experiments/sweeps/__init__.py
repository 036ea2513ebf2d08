"""Sweeps: `python -m experiments.sweeps` writes the tables out/sweeps*.md.

The sweeps compute slider-cranks with clearances from 0.05 to 0.5 mm, for one revolution at 5000 rpm. A lane is one
motion of a sweep. Times exclude compilation. Programs that are compared take turns in one run, and the shortest time of
each counts. The ratios are more reliable than the times.

- Throughput: the final position of the slider at rtol 1e-5, by `cj.sweep` and by `cj.batch` of the same lanes.
  `CPU ms more` is the time of a whole call less that of `batch`. `over the largest` is the CPU time per lane, divided
  by that of the largest sweep. `over one core` is the gain in wall time. CPU times are more reliable than wall times if
  the machine has other work. `metrics` are peaks of error and of force, with energy balance.
- Other programs, on the same cores: hand-written C (`experiments/reference/scalar.c`, -O3 -march=native, one process
  for each core, its fastest round by CPU time), and a pool of processes, one for each core, with each of scipy's
  integrators on a right-hand side compiled by numba. `error` is the median error of the slider's final position,
  divided by its largest position, or a tenth of the largest error if that is more. The reference is an integrator that
  ends its steps at every event. Sweep and program run with the tolerances with which they reach an error in the
  shortest time: an error of 1e-5, and the smallest error that both reach. A ladder of tolerances ends if a lane takes
  more than 0.6 s.
- Memory: the peak memory of a separate process, for metrics only.
- Kills: a separate process writes a sweep (of pendulums, which compile quickly) into a store. It is killed by SIGKILL
  after random times and resumed, until the given number of kills is reached. The store is then compared, bit by bit,
  with that of a sweep without kills. The journal is searched for regions that stand there twice.
- A thousand million lanes: a calculation, and not a run. It shows how the lanes are cut for workers with several cores,
  and the number of tasks, files and bytes, with the metrics above. Hours are the sum over all cores, from the CPU time
  above.
"""

from typing import TYPE_CHECKING, NamedTuple

from experiments.common import output, table
from experiments.sweeps import budget, throughput
from experiments.sweeps.kills import LANES, Kills, killed

if TYPE_CHECKING:
    from experiments.sweeps.rivals import Duel


class Found(NamedTuple):
    """What the parts found; of memory MiB by stage."""

    rates: list[throughput.Rate]
    duels: "list[Duel]"
    memory: dict[str, float]
    kills: Kills


def main(quick: bool = False) -> Found:
    # Here, so that the processes whose memory is measured, or which are killed, need not know scipy and numba.
    from experiments.sweeps import rivals

    suffix = "_quick" if quick else ""
    rates = throughput.rates((16, throughput.USUAL // 16) if quick else throughput.SIZES, 1 if quick else 20)
    throughput.tabulate(rates, suffix)
    rungs, duels = rivals.duels(quick)
    rivals.tabulate(rungs, duels, suffix)
    memory = budget.memory(128 if quick else throughput.SIZES[-1])
    stages = [(stage, f"{size:.0f}") for stage, size in memory.items()]
    table(("a process of its own", "peak memory, MiB"), stages, output(f"sweeps_memory{suffix}.md"))
    survived = killed(2 if quick else 100, 512 if quick else LANES)
    table(
        ("kills", "regions", "twice in the journal", "bit by bit the same"),
        [(survived.kills, survived.regions, survived.twice, survived.identical)],
        output(f"sweeps_kills{suffix}.md"),
    )
    metrics = throughput.by_size(rates, throughput.METRICS) or throughput.by_size(rates, throughput.SWEEP)
    table(
        ("cores a worker", "lanes a region", "tasks", "files", "GB of answers", "s a task", "core hours"),
        budget.large(min(row.cpu / row.lanes for row in metrics.values())),
        output(f"sweeps_large{suffix}.md"),
    )
    found = Found(rates, duels, memory, survived)
    table(("asked", "required", "found"), asked(found), output(f"sweeps_asked{suffix}.md"))
    return found


def asked(found: Found) -> list[tuple[str, str, str]]:
    """What was asked of sweeps, and what of it was found."""
    ratios = throughput.found(found.rates)
    apart = " / ".join(f"{ratio:.2f}" for ratio in ratios["batch"])
    linear, cores = ratios["linear"], ratios["cores"]
    pool = [duel for duel in found.duels if duel.rival.program.startswith("scipy")]
    # The fastest of scipy's: at each kind of error the least ratio.
    at, least = ([d.ratio for d in pool if (d.error == throughput.ERROR) == usual] for usual in (True, False))
    by_c = [duel.ratio for duel in found.duels if duel.rival.program.startswith("C,")]
    return [
        ("CPU over that of `batch`, by size", "<= 1.10", apart),
        ("CPU a lane over the largest's, from 256 lanes", "0.85 .. 1.15", f"{min(linear):.2f} .. {max(linear):.2f}"),
        ("all cores over one, from 4096 lanes", ">= 1.85 (two)", " / ".join(f"{ratio:.2f}" for ratio in cores)),
        ("over scipy's fastest, error 1e-5", ">= 12", f"{min(at, default=0):.1f}"),
        ("over scipy's fastest, tightest error of both", ">= 12", f"{min(least, default=0):.1f}"),
        ("over hand-written C", "", " / ".join(f"{ratio:.2f}" for ratio in by_c)),
        ("peak memory of the largest, MiB", "<= 1024", f"{max(found.memory.values()):.0f}"),
        ("kills survived with nothing lost or twice", "100", f"{found.kills.kills * found.kills.whole}"),
    ]
