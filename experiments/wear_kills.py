"""Simulations of wear that are killed and resumed: `python -m experiments.wear_kills` writes out/wear_kills.md.

`clearance run` runs in a separate process. The process is killed by SIGKILL and resumed with `--resume`, again and
again. A finished run is started anew, until the given number of kills is reached. The instants of the kills are random.
One kill in four comes while the run starts and compiles. The others come after its first new block, within the time
that a run without kills takes from there. Each finished run is checked for two things: every number of its dataset is
bit-identical to that of a run without kills, and every block that was in the journal at a kill is still there.
"""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax.runs.journal import Journal
from experiments.common import SCENES, output, table
from experiments.publish import command

STUDY = """
scene = "{scene}"

[wear]
joint = "pin"
length = "50 mm"
cycles = {cycles}
sectors = 90
tolerance = {tolerance}
law = {{ kind = "archard", coefficient = "6e-5 mm^3/(N*m)" }}
pressure = {{ kind = "foundation", stiffness = "2e13 Pa/m" }}
until = {{ kind = "depth", bound = "{bound} um" }}
"""


class Kills(NamedTuple):
    """Kills survived, of them those after a new block; runs that came to their end, blocks of one; whether every block
    was kept, and every dataset that of a run which nobody killed; the seconds of that one.
    """

    kills: int
    amidst: int
    ended: int
    blocks: int
    kept: bool
    identical: bool
    seconds: float


def life(study: Path, result: Path, *options: str) -> subprocess.Popen:
    """The command, on its way."""
    run = "from clearance_jax.cli.main import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", run, "run", str(study), "-o", str(result), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def journal(result: Path) -> list[dict]:
    return Journal(result.with_suffix(".journal")).records


def grown(process: subprocess.Popen, result: Path, count: int) -> None:
    """Wait until there are more blocks than that, or the process has ended."""
    while process.poll() is None and len(journal(result)) <= count:
        time.sleep(0.01)


def finished(process: subprocess.Popen) -> None:
    """Wait for a run that must succeed."""
    _, said = process.communicate()
    if process.returncode:
        raise RuntimeError(said.decode())


def kills(wanted: int, cycles: int, bound: float, tolerance: float, warm: bool = True, seed: int = 0) -> Kills:
    """Kill a life so many times; `warm`: by the time that a run takes which has nothing to compile."""
    random, study = np.random.default_rng(seed), output("wear_kills.toml")
    study.write_text(
        STUDY.format(scene=(SCENES / "disc.toml").resolve(), cycles=cycles, bound=bound, tolerance=tolerance)
    )
    whole, result = output("wear_whole.nc"), output("wear_killed.nc")

    def anew(path: Path) -> None:
        path.unlink(missing_ok=True)
        path.with_suffix(".journal").unlink(missing_ok=True)

    first = lasts = 0.0
    for _ in range(1 + warm):
        anew(whole)
        begin = time.perf_counter()
        process = life(study, whole)
        grown(process, whole, 0)
        first = time.perf_counter() - begin
        finished(process)
        lasts = time.perf_counter() - begin
    expected, blocks = cj.load_dataset(whole), len(journal(whole))
    survived, amidst, ended, kept, same = 0, 0, 0, True, True
    anew(result)
    while survived < wanted:
        before = journal(result)
        process = life(study, result, "--resume")
        early = random.uniform() < 0.25
        if not early:
            grown(process, result, len(before))
        try:
            process.wait(float(random.uniform(0, first if early else lasts - first)))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            survived += 1
        _, said = process.communicate()
        now = journal(result)
        kept &= now[: len(before)] == before
        amidst += process.returncode != 0 and len(now) > len(before)
        if process.returncode == 0 or survived == wanted:
            finished(life(study, result, "--resume"))
            same &= cj.load_dataset(result).identical(expected)
            kept &= journal(result) == journal(whole)
            ended += 1
            anew(result)
        elif process.returncode != -signal.SIGKILL:
            raise RuntimeError(said.decode())
    return Kills(survived, amidst, ended, blocks, bool(kept), bool(same), lasts)


def main(quick: bool = False) -> Kills:
    """Write what was found."""
    found = kills(2, 2000, 0.05, 1e-2, warm=False) if quick else kills(20, 30_000, 3.0, 2e-3)
    rows = [
        ("kills survived", found.kills),
        ("of them after a new block", found.amidst),
        ("runs that came to their end", found.ended),
        ("blocks of a run", found.blocks),
        ("seconds of a run", f"{found.seconds:.1f}"),
        ("every block in the journal was kept", "yes" if found.kept else "NO"),
        ("every dataset is that of the run which nobody killed", "yes" if found.identical else "NO"),
    ]
    table(("", ""), rows, output("wear_kills.md"))
    return found


if __name__ == "__main__":
    command(main, __doc__, "2 kills of a short life")
