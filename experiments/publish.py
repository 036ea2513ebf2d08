"""The command line of experiments and studies, and the page that `--save` makes of what they found.

Whatever is tabulated (`common.table`), said (`say`), written (`write`) or drawn (`picture`) while one runs goes to the
terminal at once and, with `--save`, to docs/benchmarks, with the commit it was measured at: a run that is broken off
leaves what it has found by then.
"""

import argparse
import inspect
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import clearance_jax as cj
from experiments.titles import title

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "benchmarks"
IMAGES = ROOT / "docs" / "images"
found: list[str] = []
"""What this process has found so far, in Markdown."""
drawn: list[Path] = []
"""The pictures among it."""
UNENDED = "*This run has not ended: more was to come.*\n"


class Page(NamedTuple):
    """The page of this process: where it is, and what stands above all that is found."""

    path: Path
    head: str

    def write(self, *last: str) -> None:
        """Write it with what has been found by now."""
        self.path.write_text("\n".join([self.head, *found, *last]), encoding="utf-8")
        for image in drawn:
            shutil.copy(image, IMAGES / image.name)


pages: list[Page] = []
"""None, or the one that is asked for."""


def keep(markdown: str) -> None:
    """Keep something for the page, and write that at once."""
    found.append(markdown)
    for page in pages:
        page.write(UNENDED)


def say(*things: Any) -> None:
    """Print, and keep for the page."""
    text = "\n".join(str(thing) for thing in things)
    print(text, flush=True)
    keep(f"```text\n{text}\n```\n")


def write(text: str) -> None:
    """Print Markdown, and keep it for the page as it is."""
    print(text, flush=True)
    keep(text + "\n")


def picture(path: Path, caption: str) -> None:
    """Keep a picture for the page."""
    drawn.append(path)
    write(f"![{caption}](../images/{path.name})\n\n*{caption}.*")


def commit() -> str:
    """The commit that is measured; with a mark where files differ from it (pages aside, which others wrote)."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    differs = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs")
    return git("rev-parse", "--short=7", "HEAD") + "-dirty" * bool(differs)


def stem(name: str) -> str:
    """The file of a command's page: its module, with the package it is in, and the part where the command names one."""
    return "_".join(name.split(".")[1:]).replace(" ", "_")


def head_of(name: str, doc: str) -> str:
    """What stands above what an experiment finds, by its module's name and documentation."""
    heading = title(stem(name))
    where = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    stamp = f"*Written by `python -m {name} --save` at commit {commit()}; {where}.*"
    return "\n".join([f"# {heading}\n", doc.strip() + "\n", stamp + "\n"])


def command(main: Callable, doc: str | None, quick: str = "a tiny version of each") -> None:
    """Run an experiment from the command line; `quick` says what its quick mode leaves out."""
    doc = doc or ""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--save", action="store_true", help="write docs/benchmarks/NAME.md with what was found")
    elsewhere = "out" in inspect.signature(main).parameters
    if elsewhere:
        parser.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="where files go (`out`)")
    given = parser.parse_args()
    if given.quick and given.save:
        parser.error("what a quick run finds is not worth publishing: give `--save` alone")
    named = re.search(r"python -m\s+([\w.]+(?: \w+)?)`", doc)
    if given.save:
        if not named:
            parser.error("the documentation of an experiment must name its command, `python -m ...`: it names the page")
        pages.append(Page(PAGES / f"{stem(named[1])}.md", head_of(named[1], doc)))
    cj.configure(cache=True)
    try:
        main(given.quick, given.out) if elsewhere else main(given.quick)
        for page in pages if found else ():
            page.write()
            print(f"written {page.path}")
    finally:
        pages.clear()
