"""Elements of a URDF file read one by one: their names, numbers and children, with messages that say where they stand.

What a file holds beside the dynamics (pictures, collision shapes, plugins) is passed over (`urdf_unread` says what
else); a word that is nearly one of those that are read is not, for then what was meant would be missing without a sign.
"""

import difflib
import re
from collections.abc import Collection

import numpy as np

from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.io.kinds import check_text
from clearance_jax.io.urdf_parts import Triple
from clearance_jax.io.xml_file import Element
from clearance_jax.units import check_comma

# What is read, and what else has its place there: children, and attributes.
CHILDREN = {
    "robot": ("link", "joint", "material", "transmission", "gazebo", "force_element"),
    "link": ("inertial", "visual", "collision"),
    "inertial": ("origin", "mass", "inertia"),
    "joint": (
        "origin",
        "parent",
        "child",
        "axis",
        "limit",
        "mimic",
        "dynamics",
        "joint_properties",
        "calibration",
        "safety_controller",
    ),
}
ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name",),
    "joint": ("name", "type"),
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort", "damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference", "armature"),
    "joint_properties": ("damping", "friction"),
}
# An `origin` says the whole pose: any other word there (`quat_xyzw`) says something of it too.
CLOSED = ("origin", "axis", "mass", "inertia")
# Words so alike are one word and a slip; `limits` is `limit`, `K` is no `damping`.
ALIKE = 0.75
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
# Beyond it a product of two numbers may no longer be finite, and no robot is so large, heavy or strong.
LARGEST = 1e100


def place(element: Element) -> str:
    """How a message names an element: its line, its tag, and its name."""
    name = element.attributes.get("name")
    return f"line {element.line}: {element.word[:60]}" + ("" if name is None else f" {_name(name)}")


def _name(name: str) -> str:
    return f"`{name}`" if len(name) <= 60 and name.isprintable() else quote(name)


def check_spelling(element: Element, where: str) -> None:
    """Raise for a child or an attribute that is nearly one that is read (see the head of this module)."""
    tags, allowed = {child.tag for child in element.children}, CHILDREN.get(element.tag, ())
    _check_words(tags, allowed, f"{where} holds <{{}}>, which is no known element", allowed)
    given, known = element.attributes, ATTRIBUTES.get(element.tag, ())
    wrong = f"{where}: <{element.tag}> has an attribute `{{}}`, which is not known"
    # Beside a `velocity` a `gear_velocity` is meant as it is.
    meant = known if element.tag in CLOSED else [word for word in known if word not in given]
    _check_words(given, known, wrong, meant, element.tag in CLOSED)


def _check_words(
    given: Collection[str], known: Collection[str], wrong: str, meant: Collection[str], closed: bool = False
) -> None:
    """Raise for a word that is not known and nearly one of those that may be `meant`."""
    for word in sorted(set(given) - set(known)):
        if closed or difflib.get_close_matches(word[:100].lower(), meant, n=1, cutoff=ALIKE):
            raise ClearanceError(f"{wrong.format(word[:100])}. " + suggest(word, known))


def only(element: Element, tag: str, where: str) -> Element | None:
    """The child of that tag, if it is there. **Raises** for several."""
    children = [child for child in element.children if child.tag == tag]
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
    if attribute not in element.attributes:
        raise ClearanceError(f"{where} lacks the attribute `{attribute}` of <{element.tag}>. Add it.")
    value = check_text(element.attributes[attribute], f"{where}: `{attribute}` of <{element.tag}>")
    if "${" in value or "$(" in value:
        raise ClearanceError(f"{where}: {quote(value)} is to be expanded by xacro. {EXPAND}")
    return value


EXPAND = "Expand the file first: `xacro robot.urdf.xacro > robot.urdf`."


def numbers(
    element: Element, attribute: str, count: int, where: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """The numbers of an attribute; the default where it is absent, or else it must be there."""
    if attribute not in element.attributes and default is not None:
        return default
    words = text(element, attribute, where).split()
    if len(words) != count:
        for word in words:
            check_comma(word, f"{where}: `{attribute}` of <{element.tag}>")
        raise ClearanceError(
            f"{where}: `{attribute}` of <{element.tag}> must be {_count(count)}, but it is "
            f"{quote(element.attributes[attribute])}."
        )
    return tuple(parse_number(word, f"{where}: `{attribute}` of <{element.tag}>") for word in words)


def number(element: Element, attribute: str, where: str, default: float | None = None) -> float:
    """As `numbers`, of one."""
    return numbers(element, attribute, 1, where, None if default is None else (default,))[0]


def bound(element: Element, attribute: str, where: str) -> float | None:
    """A number that may be absent, or infinite, which says the same."""
    if INFINITE.fullmatch(element.attributes.get(attribute, "inf").strip()):
        return None
    return number(element, attribute, where)


def _count(count: int) -> str:
    return "one number" if count == 1 else f"{count} numbers with spaces between them"


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
    """Place and turn of an element's <origin>; none where it is absent."""
    origin = only(element, "origin", where)
    if origin is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    x, y, z = numbers(origin, "xyz", 3, where, (0.0, 0.0, 0.0))
    roll, pitch, yaw = numbers(origin, "rpy", 3, where, (0.0, 0.0, 0.0))
    return (x, y, z), (roll, pitch, yaw)


def direction(element: Element, where: str) -> Triple:
    """The unit vector of a joint's <axis>; URDF's own default where it is absent."""
    axis = only(element, "axis", where)
    if axis is None:
        return (1.0, 0.0, 0.0)
    given = np.array(numbers(axis, "xyz", 3, where))
    largest = np.abs(given).max()
    if not largest > 0:
        raise ClearanceError(f"{where}: its <axis> must have a direction, but it is zero. Give one, as `0 0 1`.")
    unit = given / largest  # first, for squares of small numbers may vanish
    # An axis along a coordinate axis stays exactly there: x / hypot(x, 0, 0) is 1.
    x, y, z = (float(part) for part in unit / np.sqrt(np.sum(unit**2)))
    return x, y, z
