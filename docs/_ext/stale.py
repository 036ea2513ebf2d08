"""Says on a benchmark page whether its code has changed since it was measured.

A page has the command and the commit that wrote it in its first lines. What it measures is the command's module, what
that imports of `experiments` and `optimize`, and the library. Git says which commits have touched these files since.
Without git, or without that commit, the page says that this is not known.
"""

import ast
import functools
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
STAMP = re.compile(r"^\*Written by `python -m ([\w.]+)[^`]*`\s+at\s+commit\s+([0-9a-f]{7,40})(-dirty)?;[^*]*\*$", re.M)
OLD = re.compile(r"figures\s+as\s+they\s+stood\s+at\s+commit `?([0-9a-f]{7,40})`?", re.I)
LIBRARY = "clearance_jax"
OWN = ("experiments", "optimize")


def _git(*words: str) -> str | None:
    """What git says, or nothing where there is no git, no repository or no such commit."""
    try:
        done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _file(module: str) -> Path | None:
    """The file of a module of the repository."""
    path = ROOT.joinpath(*module.split("."))
    for found in (path.with_suffix(".py"), path / "__main__.py", path / "__init__.py"):
        if found.exists():
            return found
    return None


@functools.cache
def measured(module: str) -> frozenset[Path]:
    """The files of `experiments` and `optimize` that a command runs: its own and what they import."""
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        path = _file(waiting.pop())
        if path is None or path in found:
            continue
        found |= {path, *(path.parent.glob("*.py") if path.name.startswith("__") else ())}
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if isinstance(node, ast.ImportFrom):
                names += [f"{node.module}.{alias.name}" for alias in node.names]
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            waiting += [name for name in names if name.split(".")[0] in OWN]
    return frozenset(found)


def verdict(text: str) -> str:
    """A sentence about the age of a page's figures; nothing for a page that no command wrote."""
    found, old = STAMP.search(text), OLD.search(text)
    if not found and not old:
        return ""
    commit = found[2] if found else old[1] if old else ""
    if _git("cat-file", "-e", f"{commit}^{{commit}}") is None:
        known = "cannot be known here: git or the commit is not there."
        return f"Whether the code of this page has changed since commit {commit} {known}"
    own = measured(found[1]) if found else frozenset()
    files = [LIBRARY, *(str(path.relative_to(ROOT)) for path in sorted(own))]
    since = (_git("log", "--format=%h %cs", f"{commit}..HEAD", "--", *files) or "").splitlines()
    parts = []
    if found and found[3]:
        parts.append("It was measured on files that differed from that commit.")
    if since:
        newest, day = since[0].split()
        s = "s" if len(since) > 1 else ""
        parts.append(
            f"The code that this page measures has changed since: {len(since)} commit{s}, the last one {newest} "
            f"of {day}. "
            f"The figures are those of commit {commit}."
        )
    return " ".join(parts) or "The code that this page measures has not changed since."


def source_read(app, docname: str, source: list[str]) -> None:
    """Put the verdict below the line that says when a page was written."""
    if not docname.startswith("benchmarks/") or not (said := verdict(source[0])):
        return
    box = f"\n\n:::{{note}}\n{said}\n:::\n"
    if found := STAMP.search(source[0]):
        source[0] = source[0][: found.end()] + box + source[0][found.end() :]
    else:
        source[0] = source[0].replace("\n", box, 1)


def setup(app):
    """Called by Sphinx."""
    app.connect("source-read", source_read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
