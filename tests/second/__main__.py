"""A thousand random scenes by the library and by the second simulator: `make nightly`, or

    python -m tests.second --scenes 1000 --seed 0 --out out/second

It writes a line for every case (a structure, of which `EACH` scenes differ in their numbers) into a journal in that
folder, and goes on with what is not there. At the end it writes the table of the pairs of features that were crossed.
"""

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from pathlib import Path

# As in tests/conftest.py: what is compiled here runs less than it compiles.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
if "xla_backend_optimization_level" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=1".strip()
os.environ.setdefault("CLEARANCE_KEPT", "0")

import jax

import clearance_jax as cj

from .compare import compare
from .scenes import FEATURES, cases, scene, toml

EACH = 3
"""Scenes of one structure."""
SHOWN = 5


def main() -> int:
    """Runs what is left, and says what disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/second"))
    parser.add_argument("--only", type=int, help="one case, with every comparison and its first scene")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no case after so long")
    given = parser.parse_args()
    cj.configure()
    every = cases(-(-given.scenes // EACH), given.seed)
    given.out.mkdir(parents=True, exist_ok=True)
    journal = given.out / f"scenes_{given.seed}.jsonl"
    if given.only is not None:
        print(toml(scene(every[given.only], given.only).tables))
        print(json.dumps(run(given.only, every[given.only], 10**6), indent=1))
        return 0
    done = [json.loads(line) for line in journal.read_text().splitlines()] if journal.exists() else []
    begun = time.monotonic()
    for i in sorted(set(range(len(every))) - {one["case"] for one in done}):
        if time.monotonic() - begun > 60 * given.minutes:
            break
        done.append(run(i, every[i], SHOWN))
        with journal.open("a") as file:
            file.write(json.dumps(done[-1]) + "\n")
        print(*(done[-1][key] for key in ("case", "verdict", "features", "seconds")), flush=True)
        jax.clear_caches()
    (given.out / "pairs.md").write_text(table(done))
    bad = [one for one in done if one["verdict"] != "agree"]
    print(f"{len(done)} cases, {EACH * len(done)} scenes; {len(bad)} cases disagree or failed.")
    print((given.out / "pairs.md").read_text())
    return 1 if bad else 0


def run(i: int, case: dict, shown: int) -> dict:
    """One case: its features, whether both agree, and the worst comparisons."""
    begun = time.process_time()
    scenes = [scene(case, i, k) for k in range(EACH)]
    out = {"case": i, "features": scenes[0].case}
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = compare(scenes, Path(folder))
        out["verdict"] = "agree" if found[0].ratio <= 1 else "disagree"
        out["worst"] = [one._asdict() for one in found[:shown]]
    except Exception as error:  # the others go on
        out |= {"verdict": "failed", "worst": [], "error": f"{type(error).__name__}: {error}"[:500]}
    return out | {"seconds": round(time.process_time() - begun, 1)}


def table(done: list[dict]) -> str:
    """Which pairs of features were crossed, as a page: of every two kinds how many of the pairs, and which are left."""
    lines = ["| features | pairs crossed | of |", "| --- | --- | --- |"]
    for one, two in itertools.combinations(FEATURES, 2):
        seen = {(case["features"][one], case["features"][two]) for case in done if case["verdict"] == "agree"}
        lines.append(f"| {one} x {two} | {len(seen)} | {len(FEATURES[one]) * len(FEATURES[two])} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
