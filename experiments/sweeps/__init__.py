"""Sweeps: `python -m experiments.sweeps` writes the tables out/sweeps*.md.

Slider-cranks over their clearance, 0.05 to 0.5 mm, one revolution at 5000 rpm; compiling excluded. Programs that are
compared take turns in one run, each keeps its shortest time, and what counts are ratios.

- Throughput: the slider's last place at rtol 1e-5, by `cj.sweep` and by `cj.batch` of the same lanes. `CPU ms more`:
  what a whole call takes beyond `batch`. `over the largest`: CPU time a lane over that of the largest sweep. `over one
  core`: the gain in wall time. CPU times bear it where the machine has other work. `metrics`: peaks of error and of
  force, with energy balance.
- Other programs, on the same cores: hand-written C (`experiments/reference/scalar.c`, -O3 -march=native, a process a
  core, its fastest round by CPU time), and a pool of processes, one a core, with each of scipy's integrators on a
  right-hand side compiled by numba. `error`: the median of the slider's last place over its farthest, against an
  integrator that ends its steps at every switching; or a tenth of the largest error, where that is more. Sweep and
  program have the tolerances that reach an error soonest: 1e-5, and the tightest that both reach. A ladder of
  tolerances ends where a lane takes more than 0.6 s.
- Memory: the peak of a process of its own, metrics only.
- Kills: a sweep (of pendulums, which are soon compiled) in a process of its own into a store, killed by SIGKILL after
  random times and resumed, again and again, until so many kills have been survived; then the store against one that
  nobody killed, bit by bit, and the journal for regions that are there twice.
- A thousand million lanes, on paper: how they are cut for workers of some cores each, and what that is in tasks, files
  and bytes, with metrics as above. Hours are those of all cores together, by the CPU time above.
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
