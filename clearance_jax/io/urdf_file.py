"""Reads URDF files as links and joints, and checks them.

Pictures, collision shapes, materials and plugins of simulators are ignored. `urdf_unread` lists what else is not read.
"""

from pathlib import Path

import numpy as np

from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.io.poses import rotation_of
from clearance_jax.io.table import naming
from clearance_jax.io.urdf_elements import (
    EXPAND,
    bound,
    check_spelling,
    direction,
    need,
    number,
    only,
    place,
    pose,
    text,
)
from clearance_jax.io.urdf_extras import check_loops, spring_of, with_extras
from clearance_jax.io.urdf_parts import KINDS, MAY_MIMIC, WITH_AXIS, Joint, Link, Matrix3, Mimic, Robot
from clearance_jax.io.urdf_tree import robot_of
from clearance_jax.io.urdf_unread import unread
from clearance_jax.io.xml_file import Element, read_xml
from clearance_jax.mechanism.limits import Limits


def read_urdf(path: str | Path) -> tuple[str, Robot]:
    """Text of a URDF file, and the robot that it describes.

    **Raises:** `ClearanceError` naming the file, the line, the element and the fix: for another file, unknown kinds of
    joints and names of links, links with two joints or none above them, garbled numbers, negative masses. (Whether
    moving bodies have mass and inertia is checked when links are merged, `urdf_bodies`.)
    """
    path = Path(path)
    written, top = read_xml(path, "URDF file")
    with naming(f"`{path}`"):
        return written, describe(top)


def describe(top: Element) -> Robot:
    """The robot in the outermost element of a URDF."""
    if top.tag != "robot":
        raise ClearanceError(f"a URDF file must hold a <robot>, but it holds a <{top.tag[:60]}>. Give another file.")
    _check_expanded(top)
    check_spelling(top, "the robot")
    check_loops(top)
    links = tuple(_link(element) for element in top.children if element.tag == "link")
    joints = tuple(_joint(element) for element in top.children if element.tag == "joint")
    name = text(top, "name", "the robot") if top.attributes.get("name", "").strip() else "robot"
    return robot_of(name, links, with_extras(joints, top))._replace(unread=unread(top))


def _check_expanded(top: Element) -> None:
    """Raise for macros. (A file that xacro has expanded may still declare their namespace.)"""
    waiting = [top]
    while waiting:
        element = waiting.pop()
        if "xacro}" in element.tag:
            tag = element.tag.rpartition("}")[2][:60]
            raise ClearanceError(f"line {element.line}: <xacro:{tag}> is a macro, not yet a robot. {EXPAND}")
        waiting += element.children


# Links ----------------------------------------------------------------------------------------------------------------


def _link(element: Element) -> Link:
    where = place(element)
    name = text(element, "name", where)
    check_spelling(element, where)
    inertial = only(element, "inertial", where)
    if inertial is None:
        return Link(name, 0.0, np.zeros(3), np.zeros((3, 3)), element.line)
    mass = number(need(inertial, "mass", where, '<mass value="1.2"/>'), "value", where)
    if mass < 0:
        raise ClearanceError(f"{where}: its mass must not be negative, but it is {mass:g} kg. Correct <mass>.")
    center, rpy = pose(inertial, where)
    turn = rotation_of(rpy)
    inertia = turn @ _inertia(inertial, where) @ turn.T
    return Link(name, mass, np.array(center), (inertia + inertia.T) / 2, element.line)


def _inertia(inertial: Element, where: str) -> Matrix3:
    """The inertia along the axes that it is given in [kg m^2], shape (3, 3)."""
    example = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    element = need(inertial, "inertia", where, example)
    xx, yy, zz = (number(element, key, where) for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (number(element, key, where, 0.0) for key in ("ixy", "ixz", "iyz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# Joints ---------------------------------------------------------------------------------------------------------------


def _joint(element: Element) -> Joint:
    where = place(element)
    name, kind = text(element, "name", where), text(element, "type", where)
    check_spelling(element, where)
    if kind not in KINDS:
        raise ClearanceError(f"{where} has the type {quote(kind)}, which is no known one. " + suggest(kind, KINDS))
    parent = text(need(element, "parent", where, '<parent link="base"/>'), "link", where)
    child = text(need(element, "child", where, '<child link="arm"/>'), "link", where)
    xyz, rpy = pose(element, where)
    axis = direction(element, where) if kind in WITH_AXIS else (0.0, 0.0, 1.0)
    damping, friction = _losses(element, kind, where)
    mimic = _mimic(element, kind, where)
    limits = _limits(element, kind, where)
    spring = spring_of(element, kind, where)
    return Joint(name, kind, parent, child, xyz, rpy, axis, limits, mimic, damping, friction, element.line, *spring)


def _losses(element: Element, kind: str, where: str) -> tuple[float, float]:
    """Damping and friction, from whichever element the file's dialect has for them."""
    losses = {"damping": 0.0, "friction": 0.0}
    sources: dict[str, str] = {}
    for tag in ("dynamics", "limit", "joint_properties"):
        given = only(element, tag, where)
        if given is None:
            continue
        for key in losses.keys() & given.attributes.keys():
            value = number(given, key, where)
            if value < 0:
                raise ClearanceError(f"{where}: its {key} must be at least 0, but it is {value:g}. Correct <{tag}>.")
            if key in sources and value != losses[key]:
                raise ClearanceError(
                    f"{where}: its {key} is {losses[key]:g} in <{sources[key]}> and {value:g} in <{tag}>. Leave one."
                )
            losses[key], sources[key] = value, tag
    if losses["friction"] > 0 and kind == "floating":
        raise ClearanceError(f"{where} is floating, and turns about no axis of its own: remove its friction.")
    return losses["damping"], losses["friction"]


def _limits(element: Element, kind: str, where: str) -> Limits | None:
    """The limits of a joint. If one end is given, the other defaults to 0 (URDF); a continuous joint has no ends."""
    limit = only(element, "limit", where)
    if limit is None:
        return None
    lower, upper = bound(limit, "lower", where), bound(limit, "upper", where)
    if kind not in ("revolute", "prismatic"):
        lower = upper = None
    elif {"lower", "upper"} & set(limit.attributes):
        lower = 0.0 if "lower" not in limit.attributes else lower
        upper = 0.0 if "upper" not in limit.attributes else upper
    if lower is not None and upper is not None and lower > upper:
        raise ClearanceError(f"{where}: its lower limit {lower:g} is above the upper {upper:g}. Correct <limit>.")
    most = [bound(limit, key, where) for key in ("velocity", "effort")]
    for key, value in zip(("velocity", "effort"), most, strict=True):
        if value is not None and value < 0:
            raise ClearanceError(f"{where}: its limit of {key} must be at least 0, but it is {value:g}. Correct it.")
    return Limits(lower, upper, *most)


def _mimic(element: Element, kind: str, where: str) -> Mimic | None:
    mimic = only(element, "mimic", where)
    if mimic is None or kind == "fixed":  # who fixes a joint of a gripper often leaves its <mimic> there
        return None
    if kind not in MAY_MIMIC:
        raise ClearanceError(f"{where} is {kind}: it has no single coordinate to follow another's. Remove <mimic>.")
    followed = text(mimic, "joint", where)
    multiplier = number(mimic, "multiplier", where, 1.0)
    return Mimic(followed, multiplier, number(mimic, "offset", where, 0.0))
