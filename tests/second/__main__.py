"""A thousand random scenes by the library and by the second simulator: `make nightly`, or

    python -m tests.second --scenes 1000 --seed 0 --out out/second

It writes a line for every case (a structure, of which `EACH` scenes differ in their numbers) into a journal in that
folder, and goes on with what is not there. At the end it writes the table of the pairs of features that were crossed.

A thousand scenes have 334 structures, which cross 98 % of the pairs of features that go together: all but some pairs of
mechanism, normal law, friction law and motion with each other. Most of the time goes into tracing and compiling the
library's programs, of which a structure has one to three: some 90 s of a processor each, so that the thousand take some
four hours on two. More scenes of fewer structures would be quicker, but 250 structures cross 93 %, and 200 cross 87 %.
"""

import argparse
import itertools
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from pathlib import Path

from .case import EACH, run
from .scenes import FEATURES, cases, crossable, pairs, scene, toml

SHOWN = 5
LASTING = 10
"""Cases of one process: XLA does not give back all memory of the programs that it is told to forget."""


def main() -> int:
    """Runs what is left, and says what disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/second"))
    parser.add_argument("--only", type=int, help="one case, with every comparison and its first scene")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no case after so long")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    every = cases(-(-given.scenes // EACH), given.seed)
    given.out.mkdir(parents=True, exist_ok=True)
    journal = given.out / f"scenes_{given.seed}.jsonl"
    if given.only is not None:
        print(toml(scene(every[given.only], given.only).tables))
        print(json.dumps(run(given.only, every[given.only], 10**6), indent=1))
        return 0
    done = [json.loads(line) for line in journal.read_text().splitlines()] if journal.exists() else []
    left = sorted(set(range(len(every))) - {one["case"] for one in done})
    for one in run_all([(i, every[i]) for i in left], given.processes, given.minutes):
        done.append(one)
        with journal.open("a") as file:
            file.write(json.dumps(one) + "\n")
        print(*(one[key] for key in ("case", "verdict", "features", "seconds")), flush=True)
    (given.out / "pairs.md").write_text(table(done))
    bad = [one for one in done if one["verdict"] != "agree"]
    print(f"{len(done)} cases, {EACH * len(done)} scenes; {len(bad)} cases disagree or failed.")
    print((given.out / "pairs.md").read_text())
    return 1 if bad else 0


def run_all(left: list[tuple[int, dict]], processes: int, minutes: float) -> Iterator[dict]:
    """Cases as they are done."""
    begun, running = time.monotonic(), set()
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, fresh, max_tasks_per_child=LASTING) as pool:
        while True:
            while left and len(running) < processes and time.monotonic() - begun < 60 * minutes:
                running.add(pool.submit(run, *left.pop(0), SHOWN))
            if not running:
                return
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (one.result() for one in finished)


def table(done: list[dict]) -> str:
    """Which pairs of features were crossed, as a page: of every two kinds how many of the pairs that go together."""
    among = crossable()
    seen = among & set().union(*(pairs(case["features"]) for case in done if case["verdict"] == "agree"))
    lines = [f"{len(seen)} of {len(among)} pairs of features were crossed.", ""]
    lines += ["| features | pairs crossed | of |", "| --- | --- | --- |"]
    for one, two in itertools.combinations(FEATURES, 2):
        counts = (sum({a[0], b[0]} == {one, two} for a, b in these) for these in (seen, among))
        lines.append(f"| {one} x {two} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
