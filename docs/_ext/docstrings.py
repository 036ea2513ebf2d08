"""Docstrings as reStructuredText: the library writes them in Markdown, and autodoc reads the other.

What they use: `code`, **bold**, lists with two spaces of indent, and formulas or examples that are indented by four.
"""

import re

# Code stays as it is; a bold word stays bold; of the rest each character with a meaning of its own loses it.
_PARTS = re.compile(r"(`[^`]+`)|(\*\*[^*]+\*\*)")


def _plain(text: str) -> str:
    return re.sub(r"([\\*|_])", r"\\\1", text)


def inline(text: str) -> str:
    """One line or paragraph."""
    pieces, end = [], 0
    for found in _PARTS.finditer(text):
        code, bold = found.groups()
        before = _plain(text[end : found.start()])
        # Code that touches a word or a mark is separated by an escaped space, which nobody sees.
        pieces += [before, f"\\ ``{code[1:-1]}``\\ " if code else bold]
        end = found.end()
    return "".join(pieces) + _plain(text[end:])


def restructured(lines: list[str]) -> list[str]:
    """The lines of a docstring as reStructuredText."""
    out: list[str] = []
    for block in re.split(r"\n\s*\n", "\n".join(lines)):
        if block.startswith("    "):
            out += ["::", "", *block.split("\n")]
        else:
            # A list item begins a paragraph of its own; so does what stands in front of a list.
            for item in re.split(r"\n(?=- )", block):
                mark = "- " if item.startswith("- ") else ""
                out += [*(mark + inline(item.removeprefix(mark))).split("\n"), ""]
        out.append("")
    return out
