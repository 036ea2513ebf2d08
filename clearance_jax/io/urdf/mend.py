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
# Entries of the inertia by the name of the same entry, mirrored.
MIRRORED = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
ENDS = ("lower", "upper")
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def macros_of(top: Element) -> list[Element]:
    """The elements that xacro must expand before the file is a robot."""
    of_xacro = [element for element in top.iter() if _is_xacro(element)]
    expanding = {*MACROS, *(element.get("name", "") for element in of_xacro if element.word == "macro")}
    return [element for element in of_xacro if element.word in expanding]


def is_unexpanded(top: Element) -> bool:
    """Whether xacro must expand a file before it is a robot."""
    parts = [element for part in top if part.tag in ("link", "joint") for element in part.iter()]
    return bool(macros_of(top)) or any("${" in value for element in parts for value in element.attrib.values())


def _is_xacro(element: Element) -> bool:
    return "xacro}" in element.tag


def mend(top: Element) -> list[Note]:
    """Mend the elements of a robot in place. What was assumed, with its line."""
    notes = [*top.mended, *_namespace(top), *_leftovers(top)]
    for inertial in (each for link in top if link.tag == "link" for each in link.findall("inertial")):
        notes += _inertial(inertial)
    joints = [element for element in top if element.tag == "joint"]
    kinds = {joint.get("name"): joint.get("type", "") for joint in joints}
    for joint in joints:
        of_limit = list(_limit(joint))  # a fixed joint has none, whatever it says
        notes += [*_axis(joint), *(of_limit if joint.get("type") != "fixed" else ()), *_mimic(joint, kinds)]
        notes += _damping(joint)
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
        left = [child for child in parent if _is_xacro(child)]
        if left:
            parent[:] = [child for child in parent if not _is_xacro(child)]
        for child in left:
            yield f"<xacro:{child.word[:60]}> is left over from xacro, and not expanded", child.line


def _value(element: Element, key: str) -> float | None:
    """The number of an attribute; `None`: absent, or a text of which the reader will say that it is no number."""
    try:
        return float(element.get(key, ""))
    except ValueError:
        return None


def _inertial(inertial: Element) -> Iterator[Note]:
    for inertia in inertial.findall("inertia"):
        for mirrored, key in MIRRORED.items():
            if mirrored in inertia.attrib and key in inertia.attrib:
                differs = ", though it differs" if _value(inertia, key) != _value(inertia, mirrored) else ""
                del inertia.attrib[mirrored]
                yield f"`{mirrored}` of <inertia> beside `{key}` is left out{differs}", inertia.line
    mass = inertial.find("mass")
    if mass is not None and inertial.find("inertia") is None:
        _add(inertial, "inertia", **dict.fromkeys(MOMENTS, "0"))
        if (_value(mass, "value") or 0.0) > 0:
            yield "mass without <inertia> is a point mass", inertial.line


def _add(parent: Element, tag: str, **attributes: str) -> None:
    child = Element(tag, attributes)
    child.line = parent.line
    parent.insert(0, child)


def _axis(joint: Element) -> Iterator[Note]:
    for axis in joint.findall("axis"):
        if axis.attrib.pop("rpy", None) is not None:
            yield "`rpy` of <axis>, which URDF does not have, is left out", axis.line


def _limit(joint: Element) -> Iterator[Note]:
    """Limits that say nothing, and limits in the wrong order."""
    for limit in joint.findall("limit"):
        for key in ("effort", "velocity"):
            value = _value(limit, key)
            if value is not None and value <= 0:
                del limit.attrib[key]
                yield f"`{key}` {value:g} of <limit> is taken as unknown", limit.line
        ends: Any = [_value(limit, key) if key in limit.attrib else 0.0 for key in ENDS]
        if joint.get("type") not in ("revolute", "prismatic") or None in ends or not {*ENDS} & limit.attrib.keys():
            continue
        lower, upper = ends
        if lower == upper:
            limit.attrib = {key: value for key, value in limit.attrib.items() if key not in ENDS}
            yield f"`lower` and `upper` that are both {lower:g} are taken as unknown", limit.line
        elif lower > upper:
            limit.attrib |= {"lower": repr(upper), "upper": repr(lower)}
            yield "`lower` above `upper` is taken the other way round", limit.line


def _mimic(joint: Element, kinds: dict[str | None, str]) -> Iterator[Note]:
    """A <mimic> that no joint can obey is left out: the joint moves by itself."""
    several = joint.findall("mimic")
    if len(several) != 1 or "joint" not in several[0].attrib:  # the reader refuses more than one
        return
    (mimic,), kind = several, joint.get("type", "")
    leader = mimic.get("joint", "")
    if kind in MAY_MIMIC and kinds.get(leader) in MAY_MIMIC:
        if _value(mimic, "multiplier") == 0:
            yield "a joint whose <mimic> has the multiplier 0 stays at the offset", mimic.line
        return
    joint.remove(mimic)
    of = f" of `{leader[:60]}`, which is {kinds.get(leader, 'no joint')[:60]}," if kind in MAY_MIMIC else ""
    yield f"<mimic>{of or f' on a {kind[:60]} joint'} is left out", mimic.line


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
