"""Batches compared with a hand-written scalar C program, in one run: `python -m experiments.scalar` writes
out/scalar.md.

The problem is a batch of slider-cranks with clearances from 0.05 to 0.5 mm, for one revolution at 5000 rpm. Each motion
is a lane. Only the final state is computed. The C program (`experiments/reference/scalar.c`, compiled with -O3
-march=native) is Tsit5 with an elementary error control. It runs in two forms: at rtol 1e-5 without event location, and
at rtol 1e-8 with steps that end at a change of the force law. The median error of the second form is that of the lanes
at 1e-7. All times are CPU seconds of one core, the shortest of several rounds. The ratios are throughputs divided by
those of the two forms. The reference for errors is a solve at rtol 1e-10; errors are those of the slider's position,
divided by its largest value.
"""

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from experiments.batches import END
from experiments.common import output, slider_crank, table
from experiments.publish import command, say

SOURCE = Path(__file__).parent / "reference" / "scalar.c"
C_RTOL = {"scalar C, no events": 1e-5, "scalar C, located events": 1e-8}


def compiled(folder: str | Path) -> Path | None:
    """The C program, compiled into a folder; `None` without a C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    program = Path(folder) / "scalar"
    subprocess.run([compiler, "-O3", "-march=native", "-o", program, SOURCE, "-lm"], check=True)
    return program


def words(program: Path, lanes: int, rtol: float, seconds: float, events: int) -> list[str]:
    """The command by which the C program solves so many lanes, over and over for so long."""
    return [str(word) for word in (program, lanes, rtol, seconds, events)]


def read(answer: str) -> tuple[np.ndarray, float, int]:
    """Of what the C program writes the final slider positions, CPU seconds of one round and attempts of all lanes."""
    *states, last = answer.splitlines()
    took, attempts = last.split()
    return np.array([line.split()[1] for line in states], float), float(took), int(attempts)


def by_c(lanes: int, seconds: float) -> dict[str, tuple[np.ndarray, float, int]]:
    """Final slider positions, CPU seconds of one round and attempts of all lanes; nothing without a C compiler."""
    known = {}
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(folder)
        if program is None:
            return {}
        for events, (name, rtol) in enumerate(C_RTOL.items()):
            command = words(program, lanes, rtol, seconds, events)
            known[name] = read(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return known


def by_lanes(clearances, repeats: int, **options) -> tuple[np.ndarray, float, float]:
    """Final slider positions, CPU seconds of one round, and attempts of a lane on average."""

    def lane(clearance):
        mechanism = cj.replace(slider_crank(), {"wrist.radial_clearance": clearance})
        solution = cj.simulate(mechanism, END, **options)
        return solution["piston.position.x"], solution.steps + solution.rejected

    run = jax.jit(jax.vmap(lane))
    places, attempts = jax.block_until_ready(run(clearances))
    took = []
    for _ in range(repeats):
        clock = time.process_time()
        jax.block_until_ready(run(clearances))
        took.append(time.process_time() - clock)
    return np.asarray(places), min(took), float(np.mean(attempts))


def main(quick: bool = False) -> float:
    """Write the table; returns the largest error of the lanes with event location."""
    lanes, repeats = (8, 1) if quick else (1000, 5)
    clearances = jnp.linspace(5e-5, 5e-4, lanes)
    truth, *_ = by_lanes(clearances, 1, rtol=1e-8 if quick else 1e-10, solver="dopri8", energy_balance=False)
    known = by_c(lanes, 0.1 if quick else 5.0)
    if not known:
        say("There is no C compiler: the lanes alone.")
    runs = [
        ("lanes", {"rtol": 1e-4, "energy_balance": False}),
        ("lanes", {"rtol": 4e-5, "energy_balance": False}),
        ("lanes", {"rtol": 1e-5, "energy_balance": False}),
        ("lanes", {"rtol": 1e-7, "energy_balance": False}),
        ("lanes, energy balance", {"rtol": 1e-5}),
        ("lanes, no events", {"rtol": 1e-4, "energy_balance": False, "locate_events": False}),
    ]
    yardsticks = [known[name][1] if known else np.nan for name in C_RTOL]
    rows, worst = [], 0.0
    for name, (places, took, attempts) in known.items():
        rows.append(_row(name, C_RTOL[name], np.abs(places - truth), took, yardsticks, attempts / lanes))
    for name, options in runs[:1] if quick else runs:
        places, took, attempts = by_lanes(clearances, repeats, **options)
        error = np.abs(places - truth)
        worst = max(worst, float(error.max())) if options.get("locate_events", True) else worst
        rows.append(_row(name, options["rtol"], error, took, yardsticks, attempts))
    ratios = ("ratio", "ratio to located events")
    head = ("program", "rtol", "lanes/s", *ratios, "attempts a lane", "error median", "error max")
    table(head, rows, output(f"scalar{'_quick' if quick else ''}.md"))
    return worst


def _row(name, rtol, error, took, yardsticks, attempts) -> tuple:
    relative = error / 0.17  # the slider's farthest place [m]
    return (
        name,
        f"{rtol:.0e}",
        f"{len(error) / took:.0f}",
        *(f"{known / took:.2f}" for known in yardsticks),
        f"{attempts:.0f}",
        f"{np.median(relative):.1e}",
        f"{relative.max():.1e}",
    )


if __name__ == "__main__":
    command(main, __doc__)
