"""Formulas as MathML, made when the site is built: browsers show it without a script, so the site loads nothing.

Bold letters are written as the characters that Unicode has for them: browsers with MathML Core drop the attribute
`mathvariant="bold"`.
"""

import re
import unicodedata

from docutils import nodes
from latex2mathml.converter import convert

_BOLD = re.compile(r'<(m[ion]) mathvariant="(bold|bold-italic)">([^<]*)</\1>')
_STYLED = re.compile(r'<mstyle mathvariant="(bold|bold-italic)">(.*?)</mstyle>', re.DOTALL)


def bold(text: str, style: str = "bold") -> str:
    """Letters and digits as bold mathematical characters; what has none stays."""
    kind = "MATHEMATICAL " + ("BOLD ITALIC" if style == "bold-italic" else "BOLD")
    out = []
    for letter in text:
        name = unicodedata.name(letter, "").replace("GREEK ", "").replace("LATIN ", "").replace(" LETTER", "")
        try:
            out.append(unicodedata.lookup(f"{kind} {name}"))
        except KeyError:
            out.append(letter)
    return "".join(out)


def converted(latex: str, display: str) -> str:
    """A formula as MathML, with bold letters as characters of their own."""
    text = convert(latex, display=display)
    text = _BOLD.sub(lambda found: f"<{found[1]}>{bold(_character(found[3]), found[2])}</{found[1]}>", text)
    return _STYLED.sub(
        lambda found: re.sub(r">([^<]+)<", lambda one: f">{bold(_character(one[1]), found[1])}<", found[2]), text
    )


def _character(text: str) -> str:
    """Characters that are written as numbers (`&#x003C9;`), as they are."""
    return re.sub(r"&#x([0-9A-Fa-f]+);", lambda found: chr(int(found[1], 16)), text)


def _inline(writer, node):
    writer.body.append(converted(node.astext(), "inline"))
    raise nodes.SkipNode


def _block(writer, node):
    writer.body.append(f'<div class="math">{converted(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app):
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
