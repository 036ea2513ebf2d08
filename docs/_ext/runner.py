"""Runs the code that a page shows, as its reader would: in page order, in one folder that is empty at first.

What runs: blocks of Python, in one namespace, and lines of `sh` that call `clearance`. Files that a page shows with
their name in the first line (`# name.toml`) are written where they stand. A block's outcome is what it prints, what
its last line is worth (as in a notebook), and the pictures that it draws or writes. The site (`outputs.py`) and the
tests of the pages use this one runner.
"""

import ast
import contextlib
import hashlib
import io
import json
import os
import re
import shlex
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT / "clearance_jax"
SHOWN = (".png", ".gif")
WIDEST = 900
"""Of a picture that is kept [pixels]."""
COLOURS = 64
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block of a page: its language, and its text as it stands there."""

    language: str
    text: str

    @property
    def key(self) -> str:
        """A short name of its text."""
        return hashlib.sha256(f"{self.language}\n{self.text.strip()}".encode()).hexdigest()[:16]

    @property
    def name(self) -> str | None:
        """The file that it shows, by the comment in its first line."""
        found = re.match(r"# ([\w-]+\.(?:toml|csv|py))\n", self.text)
        return found[1] if found else None

    @property
    def runs(self) -> bool:
        """Whether it can have an outcome."""
        return self.language == "python" or (self.language == "sh" and bool(commands(self.text)))


def blocks(text: str) -> list[Block]:
    """The fenced blocks of a page that have a language."""
    return [Block(*found) for found in FENCE.findall(text)]


def commands(text: str) -> list[list[str]]:
    """The calls of `clearance` in a block of `sh`, each as its words."""
    lines = (shlex.split(line, comments=True) for line in text.replace("\\\n", "").splitlines())
    return [words for words in lines if words[:1] == ["clearance"]]


def page_key(text: str) -> str:
    """A name of all that a page runs or writes: its outcomes belong to it."""
    told = [block.key for block in blocks(text) if block.runs or block.name]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]


def library_key() -> str:
    """A name of the library's source and of its example files."""
    found = hashlib.sha256()
    kinds = ("*.py", "*.toml", "*.urdf", "*.csv")
    for path in sorted(path for kind in kinds for path in LIBRARY.rglob(kind)):
        found.update(str(path.relative_to(LIBRARY)).encode())
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def python(text: str, names: dict[str, Any], title: str) -> Any:
    """Run a block of Python; what its last line is worth, if that is an expression."""
    tree = ast.parse(text, title)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, title, "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), title, "eval"), names)


def command(words: list[str]) -> str:
    """Run `clearance` in this process; what it says on its standard output. Raises `RuntimeError` where it fails."""
    from typer.testing import CliRunner

    from clearance_jax.cli.main import app

    result = CliRunner().invoke(app, words[1:], env={"COLUMNS": "110", "NO_COLOR": "1"})
    if result.exit_code:
        raise RuntimeError(
            f"{shlex.join(words)} ended with code {result.exit_code}:\n{result.output}{result.exception!r}"
        )
    return result.stdout


def takes_minutes(words: list[str]) -> bool:
    """Whether a command is of an arm with play in space: it is not run for a page, which shows what it is asked."""
    return words[1] != "examples" and any(word.endswith(".urdf") or "arm_with_play" in word for word in words)


def is_figure(value: Any) -> bool:
    """Whether it is a figure of matplotlib, which is not imported for this question."""
    return any(kind.__module__ == "matplotlib.figure" for kind in type(value).__mro__)


class Outcome(NamedTuple):
    """What a block shows: its text, and its pictures by their files."""

    key: str
    text: str
    pictures: list[str]


def run_page(text: str, folder: Path, title: str = "page") -> Iterator[Outcome]:
    """Run a page in a folder, which must be the current one; the outcomes of its blocks, in order."""
    names: dict[str, Any] = {"__name__": "example"}
    for number, block in enumerate(blocks(text)):
        if block.name:
            (folder / block.name).write_text(block.text, encoding="utf-8")
        if not block.runs:
            continue
        before, said, value = _pictures(folder), io.StringIO(), None
        with contextlib.redirect_stdout(said):
            if block.language == "python":
                value = python(block.text, names, title)
            else:
                for words in commands(block.text):
                    said.write("" if takes_minutes(words) else command(words))
        pictures = [path.name for path, stamp in _pictures(folder).items() if before.get(path) != stamp]
        if is_figure(value):
            pictures.append(f"figure_{number}.png")
            value.savefig(folder / pictures[-1], dpi=100)
        elif value is not None:
            said.write(f"{value!r}\n")
        yield Outcome(block.key, said.getvalue().strip("\n"), pictures)


def _pictures(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in sorted(folder.iterdir()) if path.suffix in SHOWN}


def kept(picture: Path, target: Path) -> None:
    """Copy a picture to where the site has it: of few colours, and no wider than a page."""
    from PIL import Image

    if picture.suffix == ".gif":
        target.write_bytes(picture.read_bytes())
        return
    image = Image.open(picture).convert("RGB")
    if image.width > WIDEST:
        image = image.resize((WIDEST, round(image.height * WIDEST / image.width)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS).save(target, optimize=True)


def write(page: Path, target: Path) -> dict[str, Any]:
    """Run a page in the current folder and write its outcomes to `target`, with its pictures beside it."""
    text, began = page.read_text(encoding="utf-8"), time.perf_counter()
    target.parent.mkdir(parents=True, exist_ok=True)
    for old in target.parent.glob(f"{target.stem}_[0-9]*"):
        old.unlink()
    outcomes, count = [], 0
    for outcome in run_page(text, Path.cwd(), page.name):
        names = []
        for picture in outcome.pictures:
            names.append(f"{target.stem}_{count}{Path(picture).suffix}")
            count += 1
            kept(Path(picture), target.parent / names[-1])
        outcomes.append({"key": outcome.key, "text": outcome.text, "pictures": names})
    from clearance_jax import __version__

    written = {
        "page": page_key(text),
        "library": library_key(),
        "made": f"clearance_jax {__version__}, Python {sys.version.split()[0]}, {os.cpu_count()} cores",
        "seconds": round(time.perf_counter() - began),
        "blocks": outcomes,
    }
    target.write_text(json.dumps(written, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return written


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    write(Path(sys.argv[1]), Path(sys.argv[2]))
