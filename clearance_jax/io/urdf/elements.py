"""Reads XML files as trees of elements that know their lines, and the names and numbers in elements of a URDF. A file
may come from a stranger: document types, which can define endless entities or read other files, are refused, as are
texts that are too large or nested too deep, and words that are nearly known ones, for they are probably misspelt.
"""

import difflib
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.parsers.expat import errors

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from clearance_jax.errors import ClearanceError, naming, quote, unknown_name, wrong_value
from clearance_jax.io.files import read_bytes
from clearance_jax.io.keys.kinds import check_text
from clearance_jax.io.urdf.robot import NOWHERE, Triple
from clearance_jax.io.urdf.text import Note, decoded, with_prefixes
from clearance_jax.units import check_comma

LARGEST_XML = 20_000_000
# Robots need six levels, plugins of simulators inside them a few more.
DEEPEST = 100
# Known children and attributes by tag, whether they are read or not.
CHILDREN = {
    "robot": ("link", "joint", "material", "transmission", "gazebo", "force_element"),
    "link": ("inertial", "visual", "collision"),
    "inertial": ("origin", "mass", "inertia"),
}
CHILDREN["joint"] = ("origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "joint_properties")
CHILDREN["joint"] += ("calibration", "safety_controller")
ATTRIBUTES = {
    **{"robot": ("name", "version"), "link": ("name",), "joint": ("name", "type"), "parent": ("link",)},
    **{"child": ("link",), "origin": ("xyz", "rpy"), "axis": ("xyz",), "mass": ("value",)},
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "limit": ("lower", "upper", "velocity", "effort", "damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference", "armature"),
    "joint_properties": ("damping", "friction"),
}
# Elements that allow no unknown attribute: `quat_xyzw` of an `origin` would change the pose.
CLOSED = ("origin", "axis", "mass", "inertia")
# Similarity from which a word counts as misspelt: `limits` for `limit`, but not `K` for `damping`.
ALIKE = 0.75
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
EXPAND = "Install xacro (`pip install xacro`), or expand the file first: `xacro robot.urdf.xacro > robot.urdf`."
# Numbers below it have finite products.
LARGEST = 1e100


class Element(ElementTree.Element):
    """An element: its tag (`{namespace}name` where it has a namespace), `attrib`utes, the `line` that it begins at. The
    outermost one has notes of what was `mended` in the file's text.
    """

    line = 0
    mended: Sequence[Note] = ()
    if TYPE_CHECKING:  # its children are of its kind

        def __iter__(self) -> Any: ...
        def iter(self, tag: str | None = None) -> Any: ...
        def find(self, path: str, namespaces: Any = None) -> Any: ...
        def findall(self, path: str, namespaces: Any = None) -> Any: ...

    @property
    def word(self) -> str:
        """Its tag without a namespace."""
        return self.tag.rpartition("}")[2]


class _Builder(ElementTree.TreeBuilder):
    """The target of the parser: builds the tree, with the line of each element."""

    depth = 0
    line: Callable[[], int]

    def start(self, tag, attrs):
        element: Any = super().start(tag, attrs)
        element.line, self.depth = self.line(), self.depth + 1
        if self.depth > DEEPEST:
            raise ClearanceError(f"line {element.line}: nested deeper than {DEEPEST} elements. Nest a few levels only.")
        return element

    def end(self, tag):
        self.depth -= 1
        return super().end(tag)


def read_xml(path: Path, what: str) -> tuple[str, Element]:
    """Text and outermost element of an XML file; `what` it is, for messages, which name the file, line and column."""
    text, notes = decoded(read_bytes(path, what, LARGEST_XML))
    with naming(f"`{path}`"):
        top = parse(text)
    top.mended = [*notes, *top.mended]
    return text, top


def parse(text: str, notes: Sequence[Note] = ()) -> Element:
    """The outermost element of an XML text; messages name the line only. `notes` of what was mended before."""
    builder: Any = _Builder(Element)
    parser = DefusedXMLParser(target=builder, forbid_dtd=True)
    builder.line = lambda: parser.parser.CurrentLineNumber
    try:
        parser.feed(text)
        top: Any = parser.close()
        top.mended = notes
        return top
    except DefusedXmlException:
        raise ClearanceError(
            f"line {builder.line()}: declares a document type (<!DOCTYPE ...>), which could define endless entities or "
            "read other files. Remove the declaration, and write its entities out."
        ) from None
    except ClearanceError:
        raise
    except (ElementTree.ParseError, ValueError) as error:
        if getattr(error, "code", None) == errors.codes[errors.XML_ERROR_UNBOUND_PREFIX] and not notes:
            mended, notes = with_prefixes(text)
            if notes:
                return parse(mended, notes)
        raise ClearanceError(f"is not valid XML: {quote(str(error))[1:-1]}. Mend it there.") from None


def place(element: Element) -> str:
    """The name of an element in messages: its line, its tag, and its name."""
    name = element.get("name")
    if name is not None:
        name = f"`{name}`" if len(name) <= 60 and name.isprintable() else quote(name)
    return f"line {element.line}: {element.word[:60]}" + ("" if name is None else f" {name}")


def check_spelling(element: Element, where: str) -> None:
    """Raise for a misspelt child or attribute."""
    tags, allowed = {child.tag for child in element}, CHILDREN.get(element.tag, ())
    _check_words(tags, allowed, f"{where} holds <{{}}>, which is no known element", allowed)
    attributes, known = element.attrib, ATTRIBUTES.get(element.tag, ())
    wrong = f"{where}: <{element.tag}> has an attribute `{{}}`, which is not known"
    # A `gear_velocity` beside a `velocity` is not misspelt.
    meant = known if element.tag in CLOSED else [word for word in known if word not in attributes]
    _check_words(attributes, known, wrong, meant, element.tag in CLOSED)


def _check_words(
    words: Collection[str], known: Collection[str], wrong: str, meant: Collection[str], closed: bool = False
) -> None:
    """Raise for an unknown word that is similar to one in `meant`, or if `closed` for any unknown word."""
    for word in sorted(set(words) - set(known)):
        if closed or difflib.get_close_matches(word[:100].lower(), meant, n=1, cutoff=ALIKE):
            raise unknown_name(f"{wrong.format(word[:100])}.", word, known)


def only(element: Element, tag: str, where: str) -> Element | None:
    """The child of that tag, if it is there. **Raises** for several."""
    children: Any = element.findall(tag)
    if len(children) > 1:
        raise ClearanceError(f"{where} has {len(children)} <{tag}> (line {children[1].line} too). Leave one.")
    if not children:
        return None
    check_spelling(children[0], where)
    return children[0]


def need(element: Element, tag: str, where: str, example: str) -> Element:
    """The child of that tag. **Raises** where it is absent, with an example of it."""
    child = only(element, tag, where)
    if child is None:
        raise ClearanceError(f"{where} lacks <{tag}>. Add one, as {example}.")
    return child


def text(element: Element, attribute: str, where: str) -> str:
    """An attribute that must be there: a name or a word."""
    if attribute not in element.attrib:
        raise ClearanceError(f"{where} lacks the attribute `{attribute}` of <{element.tag}>. Add it.")
    value = check_text(element.attrib[attribute], f"{where}: `{attribute}` of <{element.tag}>")
    if "${" in value or "$(" in value:
        raise ClearanceError(f"{where}: {quote(value)} is to be expanded by xacro. {EXPAND}")
    return value


def numbers(
    element: Element, attribute: str, count: int, where: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """The numbers of an attribute. If it is absent, the default, or without one an error."""
    if attribute not in element.attrib and default is not None:
        return default
    words, place = text(element, attribute, where).split(), f"{where}: `{attribute}` of <{element.tag}>"
    if len(words) != count:
        for word in words:
            check_comma(word, place)
        form = "one number" if count == 1 else f"{count} numbers with spaces between them"
        raise wrong_value(place, form, element.attrib[attribute])
    return tuple(parse_number(word, place) for word in words)


def number(element: Element, attribute: str, where: str, default: float | None = None) -> float:
    """As `numbers`, of one."""
    return numbers(element, attribute, 1, where, None if default is None else (default,))[0]


def bound(element: Element, attribute: str, where: str) -> float | None:
    """A number; `None` if it is absent or infinite."""
    if INFINITE.fullmatch(element.get(attribute, "inf").strip()):
        return None
    return number(element, attribute, where)


def parse_number(word: str, where: str) -> float:
    """A plain decimal number. **Raises** `ClearanceError` for another text, and one that is not finite."""
    if not NUMBER.fullmatch(word):
        check_comma(word, where)
        if "," in word:
            raise ClearanceError(f"{where} has a comma: {quote(word)}. Separate numbers by spaces only.")
        raise ClearanceError(f"{where} must be written as plain decimal numbers, but it holds {quote(word)}.")
    value = float(word)
    if not abs(value) < LARGEST:
        raise ClearanceError(f"{where} must be finite and below {LARGEST:g}, but it holds {quote(word)}.")
    return value


def pose(element: Element, where: str) -> tuple[Triple, Triple]:
    """Position [m] and roll, pitch, yaw [rad] of an element's <origin>; zeros if it is absent."""
    origin = only(element, "origin", where)
    if origin is None:
        return NOWHERE, NOWHERE
    x, y, z = numbers(origin, "xyz", 3, where, NOWHERE)
    roll, pitch, yaw = numbers(origin, "rpy", 3, where, NOWHERE)
    return (x, y, z), (roll, pitch, yaw)


def direction(element: Element, where: str) -> Triple:
    """The unit vector of a joint's <axis>; URDF's own default where it is absent."""
    axis = only(element, "axis", where)
    if axis is None:
        return (1.0, 0.0, 0.0)
    vector = np.array(numbers(axis, "xyz", 3, where))
    largest = np.abs(vector).max()
    if not largest > 0:
        raise ClearanceError(f"{where}: its <axis> must have a direction, but it is zero. Give one, as `0 0 1`.")
    unit = vector / largest  # without this division squares of small numbers could vanish
    # An axis along a coordinate axis stays exactly there: x / hypot(x, 0, 0) is 1.
    x, y, z = (float(part) for part in unit / np.sqrt(np.sum(unit**2)))
    return x, y, z
