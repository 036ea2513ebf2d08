"""Reads URDF files as links and joints, and checks them.

Pictures, collision shapes, materials and plugins of simulators are ignored. `notes` of the robot list what else is not
read, `assumed` what was assumed.
"""

import importlib
import importlib.util
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError, naming, quote, unknown_name, wrong_value
from clearance_jax.io.urdf import elements as xml
from clearance_jax.io.urdf import robot as parts
from clearance_jax.io.urdf.inertia import Weighing, with_inertias
from clearance_jax.io.urdf.mend import is_unexpanded, macros_of, mend
from clearance_jax.io.urdf.text import told
from clearance_jax.mechanism.body import Limits

# Elements without effect on the motion: looks, shapes for collisions, calibration, soft limits.
PASSED = {"visual", "collision", "collision_checking", "contact", "material", "calibration", "safety_controller"}
# The same in a <gazebo>, and what simulators run beside the motion.
OF_GAZEBO = PASSED | {"plugin", "sensor", "mu1", "mu2", "mu", "kp", "kd", "fdir1", "minDepth", "maxVel", "maxContacts"}
OF_GAZEBO |= {"selfCollide", "self_collide", "laserRetro", "provideFeedback", "springStiffness", "springReference"}
# Of a transmission: how a controller reaches the motor, and what is read of it.
OF_TRANSMISSION = {"type", "joint", "actuator", "hardwareInterface", "mechanicalReduction", "motorTorqueConstant"}
OF_TRANSMISSION |= {"rotor_inertia", "gear_ratio", "leftActuator", "rightActuator", "flexJoint", "role", "offset"}
OF_OTHERS = {"gazebo": OF_GAZEBO, "transmission": OF_TRANSMISSION, "force_element": {"torsional_spring"}}


def read_urdf(path: str | Path, weighing: Weighing = Weighing()) -> tuple[str, parts.Robot]:
    """Text of a URDF file, and the robot that it describes. **Raises** `ClearanceError` naming the file, the line, the
    element and the fix. (Whether moving bodies have mass is checked when links are merged, `bodies`.)
    """
    text, top = open_urdf(path)
    with naming(f"`{path}`"):
        return text, with_inertias(describe(top), top, Path(path).parent, weighing)


def open_urdf(path: str | Path) -> tuple[str, xml.Element]:
    """Text and outermost element of a URDF file, expanded by xacro if it has macros and xacro is installed."""
    path = Path(path)
    text, top = xml.read_xml(path, "URDF file")
    if not (is_unexpanded(top) or path.suffix.lower() == ".xacro") or importlib.util.find_spec("xacro") is None:
        return text, top
    xacro: Any = importlib.import_module("xacro")
    with naming(f"`{path}`"):
        try:
            text = xacro.process_file(str(path)).toprettyxml(indent="  ")
        except Exception as error:  # its expressions may raise anything
            why = quote(str(error))[1:-1]
            raise ClearanceError(f"xacro cannot expand it: {type(error).__name__}, {why}. Mend it there.") from None
        return text, xml.parse(text, [("the file is expanded by xacro, so that lines are those of the result", 1)])


def describe(top: xml.Element) -> parts.Robot:
    """The robot in the outermost element of a URDF, which is mended in place."""
    if top.word != "robot":
        raise ClearanceError(f"a URDF file must hold a <robot>, but it holds a <{top.tag[:60]}>. Give another file.")
    for element in macros_of(top):  # a file that xacro has expanded may still declare its namespace
        tag = f"<xacro:{element.word[:60]}>"
        raise ClearanceError(f"line {element.line}: {tag} is a macro, not yet a robot. {xml.EXPAND}")
    assumed = mend(top)
    xml.check_spelling(top, "the robot")
    check_loops(top)
    links = tuple(_link(element) for element in top if element.tag == "link")
    joints = tuple(_joint(element) for element in top if element.tag == "joint")
    name = xml.text(top, "name", "the robot") if top.get("name", "").strip() else "robot"
    robot = parts.robot_of(name, links, with_extras(joints, top))
    return robot._replace(notes=told("not read", _of(top)), assumed=tuple(assumed))


def _link(element: xml.Element) -> parts.Link:
    where = xml.place(element)
    name = xml.text(element, "name", where)
    xml.check_spelling(element, where)
    inertial = xml.only(element, "inertial", where)
    if inertial is None:
        return parts.Link(name, 0.0, np.zeros(3), np.zeros((3, 3)), element.line)
    mass = xml.number(xml.need(inertial, "mass", where, '<mass value="1.2"/>'), "value", where)
    if mass < 0:
        raise ClearanceError(f"{where}: its mass must not be negative, but it is {mass:g} kg. Correct <mass>.")
    center, rpy = xml.pose(inertial, where)
    example = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    given = xml.need(inertial, "inertia", where, example)
    xx, yy, zz = (xml.number(given, key, where) for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (xml.number(given, key, where, 0.0) for key in ("ixy", "ixz", "iyz"))
    turn = parts.rotation_of(rpy)
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return parts.Link(name, mass, np.array(center), (inertia + inertia.T) / 2, element.line)


def _joint(element: xml.Element) -> parts.Joint:
    where = xml.place(element)
    name, kind = xml.text(element, "name", where), xml.text(element, "type", where)
    xml.check_spelling(element, where)
    if kind not in parts.KINDS:
        raise unknown_name(f"{where} has the type {quote(kind)}, which is no known one.", kind, parts.KINDS)
    parent = xml.text(xml.need(element, "parent", where, '<parent link="base"/>'), "link", where)
    child = xml.text(xml.need(element, "child", where, '<child link="arm"/>'), "link", where)
    xyz, rpy = xml.pose(element, where)
    axis = xml.direction(element, where) if kind in parts.WITH_AXIS else (0.0, 0.0, 1.0)
    losses = _losses(element, kind, where)
    mimic = _mimic(element, kind, where)
    limits = _limits(element, kind, where)
    joint = parts.Joint(name, kind, parent, child, xyz, rpy, axis, limits, mimic, *losses, element.line)
    dynamics = xml.only(element, "dynamics", where)
    if dynamics is not None:
        joint = joint._replace(**{key: xml.number(dynamics, word, where, 0.0) for key, word in SPRING.items()})
        _check_spring(joint, where)
    return joint


def _losses(element: xml.Element, kind: str, where: str) -> tuple[float, float]:
    """Damping and friction, from whichever element the file's dialect has for them."""
    losses = {"damping": 0.0, "friction": 0.0}
    sources: dict[str, str] = {}
    for tag in ("dynamics", "limit", "joint_properties"):
        holder = xml.only(element, tag, where)
        if holder is None:
            continue
        for key in losses.keys() & holder.attrib.keys():
            value = xml.number(holder, key, where)
            if value < 0:
                raise wrong_value(f"{where}: its {key}", "at least 0", value, f"{value:g}", f"Correct <{tag}>.")
            if key in sources and value != losses[key]:
                both = f"{losses[key]:g} in <{sources[key]}> and {value:g} in <{tag}>"
                raise ClearanceError(f"{where}: its {key} is {both}. Leave one.")
            losses[key], sources[key] = value, tag
    if losses["friction"] > 0 and kind == "floating":
        raise ClearanceError(f"{where} is floating, and turns about no axis of its own: remove its friction.")
    return losses["damping"], losses["friction"]


def _limits(element: xml.Element, kind: str, where: str) -> Limits | None:
    """The limits of a joint. If one end is given, the other defaults to 0 (URDF); a continuous joint has no ends."""
    limit = xml.only(element, "limit", where)
    if limit is None:
        return None
    lower, upper = xml.bound(limit, "lower", where), xml.bound(limit, "upper", where)
    if kind not in ("revolute", "prismatic"):
        lower = upper = None
    elif {"lower", "upper"} & limit.attrib.keys():
        lower = 0.0 if "lower" not in limit.attrib else lower
        upper = 0.0 if "upper" not in limit.attrib else upper
    return Limits(lower, upper, xml.bound(limit, "velocity", where), xml.bound(limit, "effort", where))


def _mimic(element: xml.Element, kind: str, where: str) -> parts.Mimic | None:
    mimic = xml.only(element, "mimic", where)
    if mimic is None or kind == "fixed":  # who fixes a joint of a gripper often leaves its <mimic> there
        return None
    multiplier, offset = xml.number(mimic, "multiplier", where, 1.0), xml.number(mimic, "offset", where, 0.0)
    return parts.Mimic(xml.text(mimic, "joint", where), multiplier, offset)


# What dialects add ----------------------------------------------------------------------------------------------------
#
# Springs: `spring_stiffness` and `spring_reference` of <dynamics>, <springStiffness> and <springReference> of a
# <gazebo> that refers to the joint (Gazebo), <torsional_spring> of a <force_element>. Rotors: `armature` of <dynamics>
# (MuJoCo's word: as seen through the gears), <rotor_inertia> and <gear_ratio> of a transmission's <actuator> (Drake's:
# the inertia of the rotor itself, which the joint feels times the square of the ratio).

# Attributes of <dynamics> by the fields of a joint.
SPRING = {"stiffness": "spring_stiffness", "rest": "spring_reference", "rotor": "armature"}


def check_loops(top: xml.Element) -> None:
    """Raise for joints that URDF does not have: loop joints, and joints of dialects."""
    for element in top:
        inner = [child for child in element if child.word == "joint"] if element.tag == "gazebo" else []
        for joint in [element] if element.word == "loop_joint" else inner:
            raise ClearanceError(
                f"{xml.place(joint)} closes a loop, and without it another robot would move. URDF knows trees only. "
                "Remove it from the file, and close the loop in Python (`Mechanism(..., loops=...)`)."
            )
        if element.word == "joint" and element.tag != "joint":
            raise ClearanceError(
                f"{xml.place(element)} is no joint of URDF but of the dialect {quote(element.tag[1:-6])}, which is not "
                "read. Write it as joints of URDF (a universal joint as two revolute ones, with a link without mass "
                "between them)."
            )


def with_extras(joints: Sequence[parts.Joint], top: xml.Element) -> tuple[parts.Joint, ...]:
    """The joints with the springs and rotors that elements outside them describe."""
    by_name, extra = {joint.name: joint for joint in joints}, set()
    for element in top:
        for name, numbers in _extras(element):
            where = xml.place(element)
            if name not in by_name:
                raise unknown_name(f"{where}: there is no joint `{name[:60]}`.", name, by_name)
            joint = by_name[name]
            for key, value in numbers.items():
                if getattr(joint, key) not in (0.0, value):
                    both = f"{value:g} here and {getattr(joint, key):g} elsewhere in the file"
                    raise ClearanceError(f"{where}: the {key} of joint `{name}` is {both}. Leave one.")
            by_name[name] = joint._replace(**numbers)
            extra.add(name)
            _check_spring(by_name[name], where)
    # Joints of equal names stay apart, and are refused later.
    return tuple(by_name[joint.name] if joint.name in extra else joint for joint in joints)


def _extras(element: xml.Element) -> Iterator[tuple[str, dict[str, float]]]:
    """Names of joints, each with the numbers that an element outside it gives."""
    where = xml.place(element)
    if element.tag == "gazebo":
        children = {child.word: child for child in element}
        if "springStiffness" in children:
            numbers = {"stiffness": _number_in(children["springStiffness"], where)}
            if "springReference" in children:
                numbers["rest"] = _number_in(children["springReference"], where)
            yield xml.text(element, "reference", where), numbers
    elif element.tag == "force_element":
        for spring in element:
            if spring.word == "torsional_spring":
                numbers = {"stiffness": xml.number(spring, "stiffness", where)}
                numbers["rest"] = xml.number(spring, "rest_angle", where, 0.0)
                yield _joint_of(spring, where), numbers
    elif element.tag == "transmission":
        for actuator in element:
            children = {child.word: child for child in actuator} if actuator.word == "actuator" else {}
            if "rotor_inertia" in children:
                ratio = xml.number(children["gear_ratio"], "value", where) if "gear_ratio" in children else 1.0
                inertia = xml.number(children["rotor_inertia"], "value", where)
                yield _joint_of(element, where), {"rotor": ratio**2 * inertia}


def _joint_of(element: xml.Element, where: str) -> str:
    named = [child for child in element if child.word == "joint"]
    if len(named) != 1:
        raise ClearanceError(f"{where} must name one <joint>, but it names {len(named)}. Correct it.")
    return xml.text(named[0], "name", where)


def _number_in(element: xml.Element, where: str) -> float:
    """The number that an element holds as its text, without that of its children."""
    content = "".join([element.text or "", *(child.tail or "" for child in element)])
    return xml.parse_number(content.strip(), f"{where}: <{element.word}>")


def _check_spring(joint: parts.Joint, where: str) -> None:
    for what, value in (("stiffness", joint.stiffness), ("inertia of its rotor", joint.rotor)):
        if value < 0:
            raise wrong_value(f"{where}: the {what}", "at least 0", value, f"{value:g}", "Correct it.")
        if value > 0 and joint.kind not in (*parts.MAY_MIMIC, "fixed"):
            raise ClearanceError(
                f"{where}: a spring or a rotor acts along the one coordinate of a revolute, continuous or prismatic "
                f"joint, but this joint is {joint.kind}. Remove it, and add the spring in Python "
                "(`Motion(actuators=...)`)."
            )


def _of(element: xml.Element) -> Iterator[tuple[str, int]]:
    known = xml.CHILDREN.get(element.tag, ())
    for key in element.attrib if element.tag in xml.ATTRIBUTES else ():
        if key not in xml.ATTRIBUTES[element.tag]:
            yield f"`{key[:60]}` of <{element.tag}>", element.line
    for child in element:
        if child.word in PASSED:
            continue
        if child.tag in OF_OTHERS:
            yield from _beside(child, OF_OTHERS[child.tag])
        elif child.tag in known or element.tag not in xml.CHILDREN:
            yield from _of(child)
        else:
            yield f"<{child.word[:60]}> in <{element.tag}>", child.line


def _beside(element: xml.Element, passed: set[str]) -> Iterator[tuple[str, int]]:
    """Unknown children of an element for other programs."""
    for child in element:
        if child.word not in passed:
            yield f"<{child.word[:60]}> in <{element.tag}>", child.line
        elif element.tag == "transmission":
            yield from _beside(child, passed)
