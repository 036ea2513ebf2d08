"""What the fuzzer tries of URDF files: valid ones with a few things changed, as texts and as trees."""

import random
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

from tests.urdf_cases import ARM, BAD, INERTIA, MASS, RIG

FLYING = ARM.replace('<link name="base"/>', f'<link name="base"><inertial>{MASS}{INERTIA}</inertial></link>')
SOURCES = (ARM, FLYING, RIG)
WORDS = (
    "0", "1", "-1", "1e-300", "1e308", "1e999", "-0.0", "nan", "inf", "-inf", "0x10", "1_0", "1,5", "1.2.3", "--1",
    "1e", "0 0 0", "0 0 1", "1e-200 0 0", "0 0", "0 0 0 0", "1e90 1e90 1e90", "1.570796326794897 0 0", "",
    " ", "base", "upper", "fore", "tool", "shoulder", "elbow", "grip", "cart", "slide.1", "ground", "gravity", "drive",
    "fixed", "floating", "planar", "revolute", "continuous", "prismatic", "a.b", "a=b", "é" * 300, "x" * 5000,
    "\u202e\U0001f529", "${x}", "$(find pkg)", "__import__('os').system('touch canary')", "../../etc/passwd",
    "/dev/zero", "%s%n", "{0.__class__}", "null", "true", "\t\n", "a\0b", "\ud7ff", "٣", "1" * 100, "9" * 5000,
)  # fmt: skip
TAGS = (
    "robot", "link", "joint", "inertial", "origin", "mass", "inertia", "parent", "child", "axis", "limit", "limits",
    "mimic", "dynamics", "visual", "gazebo", "safety_controller", "xacro:macro", "a:b", "x" * 3000, "é", "Link",
)  # fmt: skip
KEYS = (
    "name", "type", "xyz", "rpy", "value", "ixx", "ixy", "iyz", "link", "joint", "multiplier", "offset", "lower",
    "upper", "velocity", "effort", "damping", "friction", "xyzw", "quat_xyzw", "xmlns", "xmlns:xacro", "a:b",
)  # fmt: skip
HEADS = (
    '<!DOCTYPE r [<!ENTITY a "&#97;">]>', '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    '<!DOCTYPE r SYSTEM "http://localhost:9/x.dtd">', "<!DOCTYPE r>", "<?xml-stylesheet href='x'?>", "<!-- -- -->",
    "<?xml version='1.1'?>", "<?xml version='1.0' encoding='utf-7'?>", "<![CDATA[x]]>", "&a;", "\ufeff", "text",
)  # fmt: skip


def urdf(rng: random.Random) -> bytes:
    """A URDF file with a few things changed."""
    kind = rng.random()
    if kind < 0.1:
        old, new, _ = BAD[rng.choice(sorted(BAD))]
        return ARM.replace(old, new, 1).encode("utf-8", "replace")
    if kind < 0.25:
        return mangled(rng.choice(SOURCES), rng)
    top = ET.fromstring(rng.choice(SOURCES))
    change = rng.choice((changed, changed, nudged))
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        change(top, rng)
    return written(top).encode("utf-8", "replace")


def nested(top: ET.Element) -> Iterator[tuple[ET.Element, ET.Element]]:
    """Every (parent, child)."""
    for parent in top.iter():
        for child in parent:
            yield parent, child


def nudged(top: ET.Element, rng: random.Random) -> None:
    """Numbers of an attribute changed: what often still loads."""
    found = [(element, key) for element in top.iter() for key in element.attrib]
    element, key = rng.choice(found)
    words = element.attrib[key].split()
    for i, word in enumerate(words):
        try:
            factor = rng.choice((-1, 0, 1, rng.uniform(0, 2), 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-320, 300)))
            words[i] = repr(float(word) * factor)
        except ValueError:
            return
    element.attrib[key] = " ".join(words)


def changed(top: ET.Element, rng: random.Random) -> None:
    """One change of a tree of elements, in place."""
    pairs = list(nested(top))
    if not pairs:
        return
    parent, child = rng.choice(pairs)
    kind = rng.randrange(12)
    if kind == 0:
        parent.remove(child)
    elif kind == 1:
        parent.append(child)  # twice
    elif kind == 2:
        child.tag = rng.choice(TAGS)
    elif kind == 3:
        other = rng.choice(pairs)[1]
        if child not in other.iter() and other not in child.iter():
            other.append(child)  # somewhere else too
    elif kind == 4:
        at = ET.SubElement(child, rng.choice(TAGS))
        at.set(rng.choice(KEYS), rng.choice(WORDS))
    elif kind == 5 and child.attrib:
        del child.attrib[rng.choice(sorted(child.attrib))]
    elif kind == 6:
        child.set(rng.choice(KEYS), rng.choice(WORDS))
    elif kind == 7:
        child.text = rng.choice(WORDS)
    elif child.attrib:
        names = [element.get("name", "x") for element in top]
        child.attrib[rng.choice(sorted(child.attrib))] = rng.choice((rng.choice(WORDS), rng.choice(names)))


def written(element: ET.Element) -> str:
    """An element as a text; what cannot stand in XML stays as it is."""
    attributes = "".join(f" {key}={quoteattr(value)}" for key, value in element.attrib.items())
    inner = escape(element.text or "") + "\n".join(written(child) for child in element)
    return f"<{element.tag}{attributes}>{inner}</{element.tag}>"


def mangled(text: str, rng: random.Random) -> bytes:
    """The text of a file, spoiled as a text."""
    lines = text.splitlines()
    kind, at = rng.randrange(8), rng.randrange(len(lines))
    if kind == 0:
        lines[at : at + rng.randrange(1, 4)] = []
    elif kind == 1:
        lines.insert(at, rng.choice(lines))
    elif kind == 2:
        lines.insert(at, "<a>" * rng.choice((50, 3000, 100_000)))
    elif kind == 3:
        depth = rng.choice((5, 90, 3000))
        lines.insert(at, "<a>" * depth + "</a>" * depth)
    elif kind == 4:
        lines.insert(rng.choice((0, 1, at)), rng.choice(HEADS))
    elif kind == 5:
        return text.encode()[: rng.randrange(len(text))]
    elif kind == 6:
        return text.encode(rng.choice(("utf-16", "utf-32", "cp037", "latin-1")), "replace")
    else:
        raw = bytearray(text.encode())
        for _ in range(rng.randrange(1, 5)):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        return bytes(raw)
    return "\n".join(lines).encode()
