"""First results in fresh processes: `python -m experiments.first_results` writes out/first_results.md.

What one waits for who asks a question for the first time, and again: CPU seconds (user and system), wall seconds and
peak memory of a process, cold (empty cache folders) and with everything kept that the library keeps (the second
process after it); and how many files its cache folders then hold. `simulate` writes a dataset, `gradient` is that of a
peak by a clearance, in Python; `optimize` ends with its first evaluation. `--before PATH` measures another checkout
too, in turn with this one; `--repeat N` gives the medians of N such pairs of processes.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from experiments.common import SCENES, output, table
from experiments.publish import ROOT, command


class Case(NamedTuple):
    """A mechanism: its scene, the end [s], a clearance and a signal to differentiate, its study if any."""

    name: str
    scene: str
    t1: float
    clearance: str
    signal: str
    study: str = ""


class Row(NamedTuple):
    """One process: of which checkout, what it did, whether cold; CPU, wall time [s], peak memory [MiB], files kept."""

    checkout: str
    case: str
    task: str
    state: str
    cpu: float
    wall: float
    memory: float
    files: int


CASES = (
    Case(
        "slider-crank", "slider_crank.toml", 0.012, "wrist.radial_clearance", 'PositionError("piston")', "slider_crank"
    ),
    Case("squeezer", "squeezer.toml", 0.03, "", 'Acceleration("knot")'),
    Case("tool changer", "tool_changer.toml", 1.5, "joint5.radial_clearance", 'PositionError("end")', "tool_changer"),
    Case("six axes, three sleeves", "arm_with_play.toml", 0.01, "axis_2.radial_clearance", 'PositionError("tcp")'),
)
RTOL = 1e-6
SIMULATE = "import sys; from clearance_jax.cli import main; sys.argv[0] = 'clearance'; main()"
GRADIENT = """
import clearance_jax as cj
cj.configure(cache=True)
import jax
mechanism, peak = cj.load({scene!r}), cj.metrics.Peak(cj.metrics.{signal})
print(jax.grad(lambda x: peak(cj.replace(mechanism, {{{clearance!r}: x}}), {t1}, rtol={rtol}))(1e-4))
"""
# The first evaluation ends the process, as a Ctrl-C would, but without another evaluation on the way.
OPTIMIZE = """
import os, sys
import clearance_jax.cli.design as command
command.Pace.tick = lambda self: (print("evaluated", flush=True), os._exit(0))
from clearance_jax.cli import main
sys.argv[0] = "clearance"
main()
"""


def arguments(case: Case, task: str, folder: Path) -> list[str]:
    """What follows `python` for a task."""
    if task == "simulate":
        scene, written = str(SCENES / case.scene), str(folder / "out.nc")
        return ["-c", SIMULATE, "simulate", scene, "--t1", f"{case.t1}s", "-o", written]
    if task == "gradient":
        scene = str(SCENES / case.scene)
        given = {"scene": scene, "signal": case.signal, "clearance": case.clearance, "t1": case.t1, "rtol": RTOL}
        return ["-c", GRADIENT.format(**given)]
    return ["-c", OPTIMIZE, "run", str(ROOT / "optimize" / "studies" / f"{case.study}.toml")]


def tasks(case: Case) -> list[str]:
    """What is asked of a mechanism."""
    return ["simulate", *(["gradient"] if case.clearance else []), *(["optimize"] if case.study else [])]


def measured(checkout: Path, case: Case, task: str, folder: Path, state: str) -> Row:
    """One process with its caches in that folder. **Raises** `RuntimeError` where it fails."""
    folders = {"JAX_COMPILATION_CACHE_DIR": str(folder / "jax"), "XDG_CACHE_HOME": str(folder / "xdg")}
    begin = time.monotonic()
    with (folder / "said.txt").open("w+", encoding="utf-8") as said:
        process = subprocess.Popen(
            [sys.executable, *arguments(case, task, folder)],
            env=os.environ | folders | {"PYTHONPATH": str(checkout)},
            cwd=folder,
            stdout=said,
            stderr=said,
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.monotonic() - begin
        if process.returncode:
            said.seek(0)
            raise RuntimeError(f"{case.name}, {task}: {said.read()[-2000:]}")
    name = "this" if checkout == ROOT else "before"
    # JAX writes when it last read a program beside it, in a file of its own.
    kept = [path for cache in ("jax", "xdg") for path in (folder / cache).rglob("*") if path.is_file()]
    files = [path for path in kept if not path.name.endswith("-atime")]
    return Row(name, case.name, task, state, used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 2**10, len(files))


def median(rows: list[Row]) -> Row:
    """The median of each number of rows of one kind."""
    numbers = {name: statistics.median(getattr(row, name) for row in rows) for name in ("cpu", "wall", "memory")}
    return rows[0]._replace(**numbers, files=round(statistics.median(row.files for row in rows)))


def main(quick: bool = False, before: Path | None = None, repeat: int = 1) -> list[Row]:
    """Write the table; returns its rows."""
    measurements = defaultdict(list)
    if repeat < 1:
        raise ValueError(f"`repeat` must be at least 1, but it is {repeat}.")
    checkouts = {**({"before": before.resolve()} if before else {}), "this": ROOT}
    asked = [(case, task) for case in CASES for task in tasks(case)]
    for _ in range(repeat):
        for case, task in asked[:1] if quick else asked:
            for name, checkout in checkouts.items():
                with tempfile.TemporaryDirectory() as folder:
                    for state in ("cold", "kept"):
                        row = measured(checkout, case, task, Path(folder), state)._replace(checkout=name)
                        measurements[row[:4]].append(row)
    rows = [median(group) for group in measurements.values()]
    table(
        ("checkout", "mechanism", "task", "caches", "CPU s", "wall s", "peak MiB", "files"),
        [(*r[:4], f"{r.cpu:.1f}", f"{r.wall:.1f}", f"{r.memory:.0f}", r.files) for r in rows],
        output(f"first_results{'_quick' if quick else ''}.md"),
    )
    return rows


if __name__ == "__main__":
    # The command of all experiments knows nothing of another checkout.
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--repeat", type=int, default=1)
    given, sys.argv[1:] = parser.parse_known_args()
    command(
        lambda quick: main(quick, given.before, given.repeat), __doc__, quick="`simulate` of the slider-crank alone"
    )
