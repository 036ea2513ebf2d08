"""Reads XML files as trees of elements that know their lines.

A file may come from a stranger. Document types, which can define endless entities or read other files, are refused. So
are texts that are too large or nested too deep.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from clearance_jax.errors import ClearanceError, quote
from clearance_jax.io.files import read_text

LARGEST_XML = 20_000_000
# Robots need six levels, plugins of simulators inside them a few more.
DEEPEST = 100


@dataclasses.dataclass(frozen=True, eq=False)
class Element:
    """An element: its tag (`{namespace}name` where it has a namespace), attributes, children, the line that it begins
    at, and the pieces of the text in it.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list["Element"] = dataclasses.field(default_factory=list)
    pieces: list[str] = dataclasses.field(default_factory=list)

    @property
    def text(self) -> str:
        """The text in it, without that of its children."""
        return "".join(self.pieces).strip()

    @property
    def word(self) -> str:
        """Its tag without a namespace."""
        return self.tag.rpartition("}")[2]


class _Builder:
    """The target of the parser: builds the tree, with the line of each element."""

    def __init__(self):
        self.top: Element | None = None
        self.open: list[Element] = []
        self.line: Callable[[], int] = lambda: 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, dict(attributes), self.line())
        if len(self.open) >= DEEPEST:
            raise ClearanceError(f"line {element.line}: nested deeper than {DEEPEST} elements. Nest a few levels only.")
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.top = element
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def data(self, text: str) -> None:
        if self.open:
            self.open[-1].pieces.append(text)

    def close(self) -> None:
        """The parser ends; the tree is `top`."""


def read_xml(path: Path, what: str) -> tuple[str, Element]:
    """Text and outermost element of an XML file.

    **Arguments:** `what` the file is, for messages.

    **Raises:** `ClearanceError` naming the file: for what is no file, no text in UTF-8, too large or nested too deep,
    no valid XML (with line and column), and for a document type, with the entities that it may define.
    """
    text = read_text(path, what, LARGEST_XML)
    try:
        return text, parse(text)
    except ClearanceError as error:
        raise ClearanceError(f"`{path}`: {error}") from None


def parse(text: str) -> Element:
    """The outermost element of an XML text; messages name the line only."""
    builder = _Builder()
    parser = DefusedXMLParser(target=builder, forbid_dtd=True)
    builder.line = lambda: parser.parser.CurrentLineNumber
    try:
        parser.feed(text)
        parser.close()
    except DefusedXmlException:
        raise ClearanceError(
            f"line {builder.line()}: declares a document type (<!DOCTYPE ...>), which could define endless entities or "
            "read other files. Remove the declaration, and write its entities out."
        ) from None
    except ClearanceError:
        raise
    except (ParseError, ValueError) as error:
        raise ClearanceError(f"is not valid XML: {quote(str(error))[1:-1]}. Mend it there.") from None
    assert builder.top is not None  # a text without an element is no valid XML
    return builder.top
