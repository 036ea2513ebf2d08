"""What the code of a page shows, below the code: `runner.py` runs it when the site is built.

A page that runs for long has its outcomes in docs/outputs, kept with the source: `make outputs` writes them, and a test
says when the page's code is another one. The other pages run here, two at a time, into docs/_outputs, which git
ignores. These outcomes are used again while the page's code, the library and its examples are the same.
"""

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from docutils import nodes
from runner import ROOT, Block, blocks, library_key, page_key
from sphinx.errors import ExtensionError
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

DOCS = ROOT / "docs"
KEPT, MADE = DOCS / "outputs", DOCS / "_outputs"
AT_ONCE = max(1, min(4, os.cpu_count() or 1))
LONGEST = 1800
"""Of one page [s]."""
log = logging.getLogger(__name__)


def pages() -> list[Path]:
    """The pages whose code runs."""
    found = [*sorted(DOCS.glob("*.md")), *sorted((DOCS / "tutorials").glob("*.md")), DOCS / "reference" / "uses.md"]
    return [page for page in found if any(block.runs for block in blocks(page.read_text(encoding="utf-8")))]


def place(page: Path, folder: Path) -> Path:
    """The file of a page's outcomes."""
    return folder / f"{'_'.join(page.relative_to(DOCS).with_suffix('').parts)}.json"


def outcomes(page: Path) -> tuple[Path, dict[str, Any]] | None:
    """The file of its outcomes and what it holds, if there are any of this code."""
    text = page.read_text(encoding="utf-8")
    for folder in (KEPT, MADE):
        path = place(page, folder)
        if path.exists():
            found = json.loads(path.read_text(encoding="utf-8"))
            if found["page"] == page_key(text) and (folder == KEPT or found["library"] == library_key()):
                return path, found
    return None


def run(page: Path, folder: Path) -> str:
    """Run a page in a process and an empty folder of its own; what went wrong, or nothing."""
    target = place(page, folder)
    with tempfile.TemporaryDirectory() as empty:
        paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        asked = [sys.executable, str(Path(__file__).with_name("runner.py")), str(page), str(target)]
        settings = os.environ | {"PYTHONPATH": paths, "MPLBACKEND": "Agg"}
        try:
            done = subprocess.run(asked, cwd=empty, env=settings, capture_output=True, text=True, timeout=LONGEST)
        except subprocess.TimeoutExpired:
            return f"{page.name} did not end within {LONGEST} s"
    return "" if done.returncode == 0 else f"{page.name}: {done.stderr[-1500:]}"


def run_missing(app) -> None:
    """Run every page that has no outcomes of its code; `-D outputs_run=0` leaves it out, for a quick look."""
    if not app.config.outputs_run:
        return
    missing = [page for page in pages() if outcomes(page) is None]
    for page in missing:
        if place(page, KEPT).exists():
            log.warning("%s: its kept outcomes are of other code. Run `make outputs`.", page.name)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        wrong = [found for found in pool.map(lambda page: run(page, MADE), missing) if found]
    if wrong:
        raise ExtensionError("\n".join(wrong))


class Outputs(SphinxTransform):
    """Put what a block shows below it."""

    default_priority = 30

    def apply(self, **kwargs) -> None:
        """Every block of this page."""
        page = Path(self.env.doc2path(self.env.docname))
        if page not in pages() or (found := outcomes(page)) is None:
            return
        path, written = found
        self.env.note_dependency(str(path))
        shown = {one["key"]: one for one in written["blocks"]}
        last = None
        for code in list(self.document.findall(nodes.literal_block)):
            one = shown.get(Block(str(code.get("language", "")), code.astext()).key)
            if one and (one["text"] or one["pictures"]):
                last = _shown(one, path.parent)
                code.parent.insert(code.parent.index(code) + 1, last)
        if last is not None and path.parent == KEPT:
            note = nodes.paragraph("", "", classes=["made"])
            note += nodes.emphasis("", f"Outputs of this page: {written['made']}, {written['seconds']} s.")
            self.document.children[-1].append(note)


def _shown(one: dict[str, Any], folder: Path) -> nodes.container:
    """The outcome of a block."""
    box = nodes.container(classes=["output"])
    if one["text"]:
        box += nodes.literal_block(one["text"], one["text"], language="none", classes=["output"])
    for picture in one["pictures"]:
        uri = f"/{folder.name}/{picture}"
        box += nodes.image("", uri=uri, alt="What the code above draws", candidates={})
    return box


def setup(app):
    """Called by Sphinx."""
    app.add_config_value("outputs_run", True, "env", bool)
    app.connect("builder-inited", run_missing)
    app.add_transform(Outputs)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    # `make outputs`: those that are kept run again, or the pages that are named; says the seconds that each took.
    wanted = [DOCS / name for name in sys.argv[1:]] or [page for page in pages() if place(page, KEPT).exists()]
    wanted = pages() if sys.argv[1:] == ["all"] else wanted
    for one in wanted:
        wrong = run(one, KEPT)
        took = "" if wrong else f"{json.loads(place(one, KEPT).read_text(encoding='utf-8'))['seconds']} s"
        print(wrong or f"{one.name}: {took}", flush=True)
