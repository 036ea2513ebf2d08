"""An example for the page of each public name: statements of a block of Python that a page shows and the tests run.

A name is used where code has its address (`cj.metrics.Peak`, or `metrics.Peak` after an import) or, of a class, one of
its bases or a preset calls it. Of all uses the shortest statement is shown, and a link leads to the page, whose code
makes the values that the statement needs. Names that no guide uses have their use in docs/reference/uses.md.
"""

import ast
import functools
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from names import Name, addresses, public_names
from runner import ROOT, blocks

DOCS = ROOT / "docs"
LONGEST = 14
"""Of a statement that is shown [lines]; a longer one is shown where nothing else is there."""


class Use(NamedTuple):
    """A statement, and the page that it stands on, relative to docs."""

    code: str
    page: str

    @property
    def cost(self) -> tuple[bool, bool, int]:
        """What decides between two uses: guides before the page of uses, short before long."""
        lines = self.code.count("\n") + 1
        return lines > LONGEST, self.page.startswith("reference"), lines


def pages() -> list[Path]:
    """Pages whose code is run by the tests."""
    return [*sorted(DOCS.glob("*.md")), *sorted((DOCS / "tutorials").glob("*.md")), DOCS / "reference" / "uses.md"]


def _called(node: ast.AST) -> str:
    """The dotted name that a piece of code is, or nothing."""
    if isinstance(node, ast.Name):
        return node.id
    before = _called(node.value) if isinstance(node, ast.Attribute) else ""
    return f"{before}.{node.attr}" if before and isinstance(node, ast.Attribute) else ""


def _imports(tree: ast.Module, known: dict[str, str]) -> None:
    """Add what a block imports of the library to what names stand for."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("clearance_jax"):
            home = "cj" + (node.module or "").removeprefix("clearance_jax")
            known |= {alias.asname or alias.name: f"{home}.{alias.name}" for alias in node.names}


def _statements(text: str) -> Iterator[tuple[str, set[str]]]:
    """The statements of a page's code, each with the dotted names in it, written as `cj...`."""
    known: dict[str, str] = {}
    for block in blocks(text):
        if block.language != "python":
            continue
        tree = ast.parse(block.text)
        _imports(tree, known)
        # A module that is a variable of the page: `design = cj.design`.
        for node in tree.body:
            if (
                isinstance(node, ast.Assign)
                and isinstance(node.targets[0], ast.Name)
                and (value := _called(node.value))
            ):
                known[node.targets[0].id] = value
        lines = block.text.splitlines()
        for node in tree.body:
            code = "\n".join(lines[node.lineno - 1 : node.end_lineno])
            found = {name for part in ast.walk(node) if (name := _called(part))}
            heads = {name: known.get(name.split(".")[0], name.split(".")[0]) for name in found}
            if not isinstance(node, ast.Import | ast.ImportFrom):
                yield code, {".".join([heads[name], *name.split(".")[1:]]) for name in found}


@functools.cache
def uses() -> dict[str, Use]:
    """The best use of each public name, by its full name."""
    best: dict[str, Use] = {}
    known = addresses()
    for path in pages():
        if not path.exists():
            continue
        for code, found in _statements(path.read_text(encoding="utf-8")):
            for address in found & known.keys():
                use, name = Use(code, str(path.relative_to(DOCS).with_suffix(""))), known[address].full
                if name not in best or use.cost < best[name].cost:
                    best[name] = use
    return best


def _kin(name: Name) -> Iterator[Name]:
    """Names whose use shows this one too: functions that return it, and classes that inherit from it."""
    for other in public_names():
        if inspect.isclass(other.thing):
            methods = (vars(other.thing).get(member) for member in other.members())
            given = [getattr(method, "__annotations__", {}).get("return") for method in methods]
            if name.kind == "class" and other is not name and name.thing in other.thing.__mro__:
                yield other
        else:
            given = [getattr(other.thing, "__annotations__", {}).get("return")]
        if name.name in (word for one in given for word in re.findall(r"\w+", getattr(one, "__name__", str(one)))):
            yield other


def example(name: Name) -> list[str]:
    """The lines of an example, in Markdown; none where no page uses the name."""
    use, said = uses().get(name.full), "**Example**, from"
    if use is None:
        for other in _kin(name):
            if use := uses().get(other.full):
                said = f"**Example**, of `{other.short}`, from"
                break
        else:
            return []
    title = re.search(r"^# (.*)$", (DOCS / f"{use.page}.md").read_text(encoding="utf-8"), re.MULTILINE)
    link = f"[{title[1] if title else use.page}](/{use.page}.md)"
    return ["", f"{said} {link}, whose code the tests run:", "", "```python", *use.code.splitlines(), "```", ""]
