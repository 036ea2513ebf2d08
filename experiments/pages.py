"""Write all benchmark pages anew: `python -m experiments.pages` (`make pages`).

The commands are those that the pages name in their first lines (`python -m experiments.batches --save`). They run one
after another, each in a process of its own, and the time that each took goes to out/pages.md. A page that cannot be
written here is passed over, with the reason: it needs a GPU, a package that is not installed, or a variable that is not
set. A command that fails leaves what it has found, and the others go on.

`--list` prints the commands, with the commit and the verdict of each page, and runs nothing. Names of pages as
arguments run these alone.
"""

import argparse
import importlib
import importlib.util
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

from experiments.publish import PAGES, ROOT

COMMAND = re.compile(r"`python -m ([\w.]+(?: \w+)?) --save`")
# What a page needs beside the library, by its file.
PACKAGES = {"forward_dynamics": ("mujoco", "pinocchio"), "mjcf": ("mujoco",)}
# What names the models and the tool of a page. Without it, the command has only a small example.
VARIABLES = {"mimic": "PINOCCHIO_PYTHON", "mjcf": "MENAGERIE", "robots": "PINOCCHIO_PYTHON"}
NEED_GPU = {"gpu"}
# Pages whose first lines do not have a command with `--save`: they are older than it.
OLDER = {
    "allocate_four_bar": "optimize.allocate_four_bar",
    "allocate_planar_arm": "optimize.allocate_planar_arm",
    "allocate_slider_crank": "optimize.allocate_slider_crank",
    "largest_clearance": "optimize.largest_clearance",
}
# First what others read, last what runs for hours.
LAST = ("bifurcation", "sweeps", "searches", "yields", "trust", "work_precision")


def commands(folder: Path = PAGES) -> dict[str, list[str]]:
    """By page the words of its command, in the order in which they run."""
    found = {page: [module, "--save"] for page, module in OLDER.items()}
    for page in sorted(folder.glob("*.md")):
        if page.stem != "index" and (named := COMMAND.search(page.read_text(encoding="utf-8"))):
            found[page.stem] = [*shlex.split(named[1]), "--save"]
    return dict(sorted(found.items(), key=lambda one: (LAST.index(one[0]) + 1 if one[0] in LAST else 0, one[0])))


def has_gpu() -> bool:
    """Whether JAX sees a GPU; asked in a process of its own, which then lets it go."""
    asked = "import jax; raise SystemExit(0 if any(d.platform == 'gpu' for d in jax.devices()) else 1)"
    return subprocess.run([sys.executable, "-c", asked], capture_output=True).returncode == 0


def why_not(page: str) -> str:
    """Why a page cannot be written here, or nothing."""
    lacking = [name for name in PACKAGES.get(page, ()) if importlib.util.find_spec(name) is None]
    if lacking:
        return f"not installed: {', '.join(lacking)}"
    if (variable := VARIABLES.get(page)) and not os.environ.get(variable):
        return f"{variable} is not set"
    return "JAX sees no GPU" if page in NEED_GPU and not has_gpu() else ""


def row(page: str, words: list[str], outcome: str, seconds: str = "") -> str:
    """A line of out/pages.md."""
    return f"| {page} | `python -m {' '.join(words)}` | {outcome} | {seconds} |"


def write(wanted: list[str]) -> int:
    """Run the commands; how many failed."""
    report, failed = Path("out") / "pages.md", 0
    report.parent.mkdir(exist_ok=True)
    rows = ["| page | command | outcome | seconds |", "| --- | --- | --- | --- |"]
    for page, words in commands().items():
        if wanted and page not in wanted:
            continue
        if reason := why_not(page):
            rows.append(row(page, words, f"passed over: {reason}"))
        else:
            began = time.perf_counter()
            code = subprocess.run([sys.executable, "-m", *words], cwd=ROOT).returncode
            failed += code != 0
            took = f"{time.perf_counter() - began:.0f}"
            rows.append(row(page, words, "written" if code == 0 else f"failed with code {code}", took))
        print(rows[-1], flush=True)
        report.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return failed


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", help="pages to write, such as `batches`; all if none is named")
    parser.add_argument("--list", action="store_true", help="print the commands and run nothing")
    given = parser.parse_args()
    known = commands()
    if unknown := set(given.pages) - set(known):
        parser.error(f"there is no page {', '.join(sorted(unknown))} that a command writes")
    if not given.list:
        return 1 if write(given.pages) else 0
    sys.path.append(str(ROOT / "docs" / "_ext"))
    verdict = importlib.import_module("stale").verdict
    for page, words in known.items():
        path = PAGES / f"{page}.md"
        said = verdict(path.read_text(encoding="utf-8")) if path.exists() else "There is no such page yet."
        print(f"python -m {' '.join(words)}\n    {said}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
