"""Mends in the elements of a URDF what other readers accept, and notes each. What is left is plain URDF, which the
reader may take at its word.
"""

from collections.abc import Iterator
from typing import Any

from clearance_jax.io.urdf.elements import Element
from clearance_jax.io.urdf.robot import MAY_MIMIC
from clearance_jax.io.urdf.text import Note

# Elements of xacro whose expansion says what the robot is. (A macro that nothing calls, a property and an argument say
# nothing of it.)
MACROS = ("include", "if", "unless", "call", "insert_block", "element", "attribute")
# Elements that stand once.
ONCE = ("origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "inertial", "mass", "inertia")
# Entries of the inertia by the name of the same entry, mirrored.
MIRRORED = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def macros_of(top: Element) -> list[Element]:
    """The elements that xacro must expand before the file is a robot."""
    of_xacro = [element for element in top.iter() if _is_xacro(element)]
    defined = {element.get("name", "") for element in of_xacro if element.word == "macro"}
    return [element for element in of_xacro if element.word in (*MACROS, *defined)]


def is_unexpanded(top: Element) -> bool:
    """Whether xacro must expand a file before it is a robot."""
    parts = [element for part in top if part.tag in ("link", "joint") for element in part.iter()]
    return bool(macros_of(top)) or any("${" in value for element in parts for value in element.attrib.values())


def _is_xacro(element: Element) -> bool:
    return "xacro}" in element.tag


def mend(top: Element) -> list[Note]:
    """Mend the elements of a robot in place. What was assumed, with its line."""
    notes = [*top.mended, *_namespace(top), *_leftovers(top), *_twice(top)]
    for inertial in (each for link in top if link.tag == "link" for each in link.findall("inertial")):
        notes += _inertial(inertial)
    joints = [element for element in top if element.tag == "joint"]
    kinds = {joint.get("name"): joint.get("type", "") for joint in joints}
    for joint in joints:
        notes += [*_axis(joint), *_limit(joint), *_mimic(joint, kinds), *_damping(joint)]
    return [*notes, *_world(top, joints)]


def _namespace(top: Element) -> Iterator[Note]:
    """A default namespace, of which the file's own elements are not."""
    space = top.tag.removesuffix("robot")
    if space and top.tag != space:
        for element in top.iter():
            element.tag = element.tag.removeprefix(space)
        yield f"the namespace `{space[1:-1][:60]}` of <robot> means nothing", top.line


def _leftovers(top: Element) -> Iterator[Note]:
    for parent in list(top.iter()):
        for child in [each for each in parent if _is_xacro(each)]:
            yield f"<xacro:{child.word[:60]}> is left over from xacro, and not expanded", child.line
            parent.remove(child)


def _twice(top: Element) -> Iterator[Note]:
    for parent in list(top.iter()):
        first: dict[str, Element] = {}
        for child in [each for each in parent if each.tag in ONCE]:
            if child is not first.setdefault(child.tag, child) and _is_same(child, first[child.tag]):
                yield f"<{child.tag}> stands twice, with the same numbers", child.line
                parent.remove(child)


def _is_same(one: Element, other: Element) -> bool:
    same = (one.tag, one.attrib, len(one)) == (other.tag, other.attrib, len(other))
    return same and all(_is_same(*pair) for pair in zip(one, other, strict=True))


def _value(element: Element, key: str) -> float | None:
    """The number of an attribute; `None`: absent, or a text of which the reader will say that it is no number."""
    try:
        return float(element.get(key, ""))
    except ValueError:
        return None


def _inertial(inertial: Element) -> Iterator[Note]:
    for inertia in inertial.findall("inertia"):
        for mirrored, key in MIRRORED.items():
            value = _value(inertia, key)
            if value is not None and value == _value(inertia, mirrored):
                del inertia.attrib[mirrored]
                yield "entries of <inertia> that stand twice (`iyx` beside `ixy`) are the same", inertia.line
    mass = inertial.find("mass")
    if mass is None or not (_value(mass, "value") or 0.0) > 0:
        return
    if inertial.find("inertia") is None:
        _add(inertial, "inertia", **dict.fromkeys(MOMENTS, "0"))
        yield "mass without <inertia> is a point mass", inertial.line


def _add(parent: Element, tag: str, at: int = 0, **attributes: str) -> None:
    child = Element(tag, attributes)
    child.line = parent.line
    parent.insert(at, child)


def _axis(joint: Element) -> Iterator[Note]:
    for axis in joint.findall("axis"):
        if axis.attrib.pop("rpy", None) is not None:
            yield "`rpy` of <axis>, which URDF does not have, is left out", axis.line


def _limit(joint: Element) -> list[Note]:
    """Limits that say nothing, and limits in the wrong order. A fixed joint has none, whatever it says."""
    notes: list[Note] = []
    for limit in joint.findall("limit"):
        for key in ("effort", "velocity"):
            value = _value(limit, key)
            if value is not None and value <= 0:
                del limit.attrib[key]
                notes.append((f"`{key}` {value:g} of <limit> is taken as unknown", limit.line))
        ends: Any = [_value(limit, key) if key in limit.attrib else 0.0 for key in ("lower", "upper")]
        if joint.get("type") not in ("revolute", "prismatic") or None in ends:
            continue
        if ends[0] == ends[1] and limit.attrib.keys() & {"lower", "upper"}:
            for key in ("lower", "upper"):
                limit.attrib.pop(key, None)
            notes.append((f"`lower` and `upper` that are both {ends[0]:g} are taken as unknown", limit.line))
        elif ends[0] > ends[1]:
            limit.set("lower", f"{ends[1]!r}")
            limit.set("upper", f"{ends[0]!r}")
            notes.append(("`lower` above `upper` is taken the other way round", limit.line))
    return [] if joint.get("type") == "fixed" else notes


def _mimic(joint: Element, kinds: dict[str | None, str]) -> Iterator[Note]:
    """A <mimic> that no joint can obey is left out: the joint moves by itself."""
    for mimic in [each for each in joint.findall("mimic") if "joint" in each.attrib]:
        leader, kind, name = mimic.get("joint", ""), joint.get("type", ""), joint.get("name", "")[:60]
        why = f"mimics `{leader[:60]}`, which is {kinds.get(leader, 'no joint')[:60]}"
        if kind not in MAY_MIMIC:
            why = f"is {kind[:60]}, and has no coordinate of its own to follow another's"
        elif kinds.get(leader) in MAY_MIMIC:
            if _value(mimic, "multiplier") == 0:
                yield (
                    f"joint `{joint.get('name', '')[:60]}` stays at the offset of its <mimic>, of multiplier 0",
                    mimic.line,
                )
            continue
        joint.remove(mimic)
        yield f"<mimic> is left out, for joint `{name}` {why}", mimic.line


def _damping(joint: Element) -> Iterator[Note]:
    for dynamics in joint.findall("dynamics") if joint.get("type") == "planar" else ():
        words = dynamics.get("damping", "").split()
        if len(words) == 3 and len(set(words)) == 1:
            dynamics.set("damping", words[0])
            yield "three equal numbers of `damping` are one for each motion of the joint", dynamics.line


def _world(top: Element, joints: list[Element]) -> Iterator[Note]:
    named = {link.get("name") for link in top if link.tag == "link"}
    for joint in joints:
        parent = joint.find("parent")
        if "world" not in named and parent is not None and parent.get("link") == "world":
            named.add("world")
            _add(top, "link", name="world")
            yield "a link `world`, which is not declared, carries the robot", joint.line
