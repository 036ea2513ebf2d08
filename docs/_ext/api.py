"""The reference of the public names: a page for each, made by autodoc, and tables of them in pages that say what for.

A page of the reference names folders or modules of the library:

    ```{names} sweep solve.drivers.batch
    ```

becomes a table of the public names that are defined there, each with its first sentence. Every public name must stand
in one table. Where any page says `cj.simulate`, the name leads to its page.
"""

import inspect
import re
from pathlib import Path
from typing import Any, get_args

from docstrings import restructured
from docutils import nodes
from names import Name, addresses, defined_in, public_names, tables
from sphinx.errors import ExtensionError
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.docutils import SphinxDirective
from tried import example

FOLDER, TABLES = "reference/names", "reference/python"
CLASSES = {name.full: name for name in public_names() if name.kind == "class"}
LONGEST = 60  # of an annotation that is shown
AUTODOC = {"class": "autoclass", "function": "autofunction"}


def page(name: Name, table: str) -> str:
    """A name's page, in Markdown around what autodoc makes. It is in no list of contents, and links to its table."""
    if name.kind == "data":
        lines = [f".. py:data:: {name.full}", "", *(f"   {line}" for line in restructured(name.doc.splitlines()))]
    else:
        lines = [f".. {AUTODOC[name.kind]}:: {name.full}"]
        if name.kind == "class" and (members := name.members()):
            lines.append(f"   :members: {', '.join(members)}")
    head = ["---", "orphan: true", "---", "", f"# `{name.short}`", "", f"In [](/{TABLES}/{table}).", ""]
    return "\n".join([*head, "```{eval-rst}", *lines, "```", "", *example(name)])


def write_pages(app) -> None:
    """Write each name's page where it has changed, and remove those of names that are gone."""
    source = Path(app.srcdir)
    places = tables(source / TABLES)
    folder = source / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {}
    for name in public_names():
        stands = places[name]
        if len(stands) != 1:
            where = f"in {', '.join(stands)}" if stands else f"in no table of docs/{TABLES}"
            raise ExtensionError(f"{name.full}, defined in {name.home}, must stand in one table, but stands {where}.")
        wanted[f"{name.page}.md"] = page(name, stands[0])
    for old in folder.glob("*.md"):
        if old.name not in wanted:
            old.unlink()
    for file, text in wanted.items():
        path = folder / file
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


class Names(SphinxDirective):
    """A table of the public names that are defined in some folders or modules."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """The table."""
        names = defined_in(self.arguments[0])
        if not names:
            raise self.error(f"No public name is defined in {self.arguments[0]}.")
        rows = [f"| [`{name.short}`](/{FOLDER}/{name.page}.md) | {_cell(name.sentence)} |" for name in names]
        return self.parse_text_to_nodes("\n".join(["| name | what it is |", "| --- | --- |", *rows]))


def _cell(text: str) -> str:
    """Text as it may stand in a cell: code stays, of the rest no character has a meaning."""
    escaped = re.sub(r"`[^`]*`|[*$<_\\]", lambda found: found[0] if found[0][0] == "`" else f"\\{found[0]}", text)
    return escaped.replace("|", "\\|")


class Links(SphinxPostTransform):
    """Code that is a public name leads to the name's page."""

    default_priority = 500

    def run(self, **kwargs) -> None:
        """Wrap the name in a link, unless it stands in one or on its own page."""
        here = self.env.docname
        pages = {address: name.page for address, name in addresses().items()}
        if here.startswith((FOLDER, TABLES)):
            pages |= {name.name: name.page for name in public_names() if name.kind == "class"}
        for code in list(self.document.findall(nodes.literal)):
            target = pages.get(re.sub(r"\(.*\)$", "", code.astext()))
            if not target or here == f"{FOLDER}/{target}" or _is_linked(code):
                continue
            link = nodes.reference("", "", internal=True)
            link["refuri"] = self.app.builder.get_relative_uri(here, f"{FOLDER}/{target}")
            code.replace_self(link)
            link += code


def _is_linked(node: nodes.Node | None) -> bool:
    """Whether it stands in a link or a title."""
    return node is not None and (isinstance(node, (nodes.reference, nodes.title)) or _is_linked(node.parent))


def returned(function: Any) -> str:
    """What a function returns, by its annotation: nothing where that says no more than its summary."""
    kind = inspect.signature(function).return_annotation
    text = kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind)
    text = re.sub(r"(?:\w+\.)+(\w+)", r"\1", text)
    if shape := re.fullmatch(r"(?:Float|Int|Bool)\[\w+, '([\w ]*)'\]", text):
        axes = shape[1].split()
        return f"an array of shape ({', '.join(axes)}{',' * (len(axes) == 1)})." if axes else "a number."
    text = re.sub(r"(?:Float|Int|Bool)\[\w+, '(.*?)'\]", lambda found: "Array" if found[1] else "number", text)
    return "" if text in ("None", "Any", "_empty", "Self", "Array") or len(text) > LONGEST else f"``{text}``."


def process_docstring(app, what, name, thing, options, lines) -> None:
    """Autodoc's hook: the docstring, arguments of a class that it leaves to their declarations, and what a function
    returns where it does not say so itself.
    """
    if what == "class" and (declared := CLASSES[name].declared()):
        title = "Further arguments" if any("**Arguments" in line for line in lines) else "Arguments"
        lines += [f"**{title}:**", "", *(f"- `{argument}`{text}." for argument, text in declared.items())]
    lines[:] = restructured(lines)
    if what in ("function", "method") and not any("**Returns" in line for line in lines) and returned(thing):
        lines += ["", f"**Returns:** {returned(thing)}"]


def process_signature(app, what, name, thing, options, signature, answer):
    """Autodoc's hook: defaults that Python prints as an address, or that are made anew each time, are left out."""
    if signature:
        signature = re.sub(r"<function (\w+) at 0x[0-9a-f]+>", r"\1", signature)
        signature = re.sub(r"=<[^<>]*>", "=...", signature)
    return signature, None


def setup(app):
    """Called by Sphinx."""
    app.setup_extension("sphinx.ext.autodoc")
    app.add_directive("names", Names)
    app.add_post_transform(Links)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-process-signature", process_signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
