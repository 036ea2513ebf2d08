"""Lanes against hand-written scalar C, in one run: `python -m experiments.scalar` writes out/scalar.md.

Slider-cranks with clearances from 0.05 to 0.5 mm, one revolution at 5000 rpm, the final state and nothing else. The C
program (`experiments/reference/scalar.c`, compiled with -O3 -march=native) is Tsit5 with an elementary error control at
rtol 1e-5 and no watch over the contacts. Both are timed in CPU seconds of one core, the shortest of several rounds;
`ratio` is their throughput over that of C. Errors are those of the slider's position over its largest, against a solve
at rtol 1e-10.
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
C_RTOL = 1e-5


def by_c(lanes: int, seconds: float) -> tuple[np.ndarray, float] | None:
    """Final states (lanes, 4) and CPU seconds of one round; `None` without a C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "scalar"
        subprocess.run([compiler, "-O3", "-march=native", "-o", program, SOURCE, "-lm"], check=True)
        answer = subprocess.run(
            [program, str(lanes), str(C_RTOL), str(seconds)], capture_output=True, text=True, check=True
        )
    *states, last = answer.stdout.splitlines()
    return np.array([line.split() for line in states], float), float(last.split()[0])


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
    """Write the table; returns the largest error of the watched lanes."""
    lanes, repeats = (8, 1) if quick else (1000, 5)
    clearances = jnp.linspace(5e-5, 5e-4, lanes)
    truth, *_ = by_lanes(clearances, 1, rtol=1e-8 if quick else 1e-10, solver="dopri8", books=False)
    known = by_c(lanes, 0.1 if quick else 5.0)
    if known is None:
        say("There is no C compiler: the lanes alone.")
    runs = [
        ("lanes", {"rtol": 1e-4, "books": False}),
        ("lanes", {"rtol": 4e-5, "books": False}),
        ("lanes", {"rtol": 1e-5, "books": False}),
        ("lanes", {"rtol": 1e-7, "books": False}),
        ("lanes, energy books", {"rtol": 1e-5}),
        ("lanes, no watch", {"rtol": 1e-4, "books": False, "watch": False}),
    ]
    rows, worst = [], 0.0
    if known is not None:
        rows.append(_row("scalar C, no watch", C_RTOL, np.abs(known[0][:, 1] - truth), lanes, known[1], known[1], ""))
    for name, options in runs[:1] if quick else runs:
        places, took, attempts = by_lanes(clearances, repeats, **options)
        error = np.abs(places - truth)
        worst = max(worst, float(error.max())) if options.get("watch", True) else worst
        reference = np.nan if known is None else known[1]
        rows.append(_row(name, options["rtol"], error, lanes, took, reference, f"{attempts:.0f}"))
    head = ("program", "rtol", "lanes/s", "ratio", "attempts a lane", "error median", "error max")
    table(head, rows, output(f"scalar{'_quick' if quick else ''}.md"))
    return worst


def _row(name, rtol, error, lanes, took, reference, attempts) -> tuple:
    relative = error / 0.17  # the slider's farthest place [m]
    return (
        name,
        f"{rtol:.0e}",
        f"{lanes / took:.0f}",
        f"{reference / took:.2f}",
        attempts,
        f"{np.median(relative):.1e}",
        f"{relative.max():.1e}",
    )


if __name__ == "__main__":
    command(main, __doc__)
