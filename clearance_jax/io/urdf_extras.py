"""Springs, rotors of motors and loop joints of URDF dialects, which stand outside a joint's own elements.

Springs: `spring_stiffness` and `spring_reference` of <dynamics>, <springStiffness> and <springReference> of a <gazebo>
that refers to the joint (Gazebo), <torsional_spring> of a <force_element>. Rotors: `armature` of <dynamics> (MuJoCo's
word: as seen through the gears), <rotor_inertia> and <gear_ratio> of a transmission's <actuator> (Drake's: the inertia
of the rotor itself, which the joint feels times the square of the ratio).
"""

from collections.abc import Iterator, Sequence

from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.io.urdf_elements import number, only, parse_number, place, text
from clearance_jax.io.urdf_parts import MAY_MIMIC, Joint
from clearance_jax.io.xml_file import Element


def check_loops(top: Element) -> None:
    """Raise for joints that URDF does not have: loop joints, and joints of dialects."""
    for element in top.children:
        inner = [child for child in element.children if child.word == "joint"] if element.tag == "gazebo" else []
        for joint in [element] if element.word == "loop_joint" else inner:
            raise ClearanceError(
                f"{place(joint)} closes a loop, and without it another robot would move. URDF knows trees only. Remove "
                "it from the file, and close the loop in Python (`Mechanism(..., loops=...)`)."
            )
        if element.word == "joint" and element.tag != "joint":
            raise ClearanceError(
                f"{place(element)} is no joint of URDF but of the dialect {quote(element.tag[1:-7])}, which is not "
                "read. Write it as joints of URDF (a universal joint as two revolute ones, with a link without mass "
                "between them)."
            )


def spring_of(element: Element, kind: str, where: str) -> tuple[float, float, float]:
    """Stiffness and rest of a joint's spring, and the inertia of its motor seen through the gears, from <dynamics>."""
    dynamics = only(element, "dynamics", where)
    if dynamics is None:
        return 0.0, 0.0, 0.0
    stiffness = number(dynamics, "spring_stiffness", where, 0.0)
    rest, rotor = number(dynamics, "spring_reference", where, 0.0), number(dynamics, "armature", where, 0.0)
    _check(kind, stiffness, rotor, where)
    return stiffness, rest, rotor


def with_extras(joints: Sequence[Joint], top: Element) -> tuple[Joint, ...]:
    """The joints with the springs and rotors that elements outside them describe."""
    by_name, extra = {joint.name: joint for joint in joints}, set()
    for element in top.children:
        for name, given in _extras(element):
            where = place(element)
            if name not in by_name:
                raise ClearanceError(f"{where}: there is no joint `{name[:60]}`. " + suggest(name, by_name))
            joint = by_name[name]
            for key, value in given.items():
                if getattr(joint, key) not in (0.0, value):
                    raise ClearanceError(
                        f"{where}: the {key} of joint `{name}` is {value:g} here and {getattr(joint, key):g} elsewhere "
                        "in the file. Leave one."
                    )
            by_name[name] = joint._replace(**given)
            extra.add(name)
            _check(joint.kind, by_name[name].stiffness, by_name[name].rotor, where)
    # Joints of equal names stay apart, and are refused later.
    return tuple(by_name[joint.name] if joint.name in extra else joint for joint in joints)


def _extras(element: Element) -> Iterator[tuple[str, dict[str, float]]]:
    """Names of joints, each with the numbers that an element outside it gives."""
    where = place(element)
    if element.tag == "gazebo":
        given = {child.word: child for child in element.children}
        if "springStiffness" in given:
            numbers = {"stiffness": _number_in(given["springStiffness"], where)}
            if "springReference" in given:
                numbers["rest"] = _number_in(given["springReference"], where)
            yield text(element, "reference", where), numbers
    elif element.tag == "force_element":
        for spring in element.children:
            if spring.word == "torsional_spring":
                numbers = {"stiffness": number(spring, "stiffness", where)}
                numbers["rest"] = number(spring, "rest_angle", where, 0.0)
                yield _joint_of(spring, where), numbers
    elif element.tag == "transmission":
        for actuator in element.children:
            given = {child.word: child for child in actuator.children} if actuator.word == "actuator" else {}
            if "rotor_inertia" in given:
                ratio = number(given["gear_ratio"], "value", where) if "gear_ratio" in given else 1.0
                yield _joint_of(element, where), {"rotor": ratio**2 * number(given["rotor_inertia"], "value", where)}


def _joint_of(element: Element, where: str) -> str:
    named = [child for child in element.children if child.word == "joint"]
    if len(named) != 1:
        raise ClearanceError(f"{where} must name one <joint>, but it names {len(named)}. Correct it.")
    return text(named[0], "name", where)


def _number_in(element: Element, where: str) -> float:
    """The number that an element holds as its text."""
    return parse_number(element.text, f"{where}: <{element.word}>")


def _check(kind: str, stiffness: float, rotor: float, where: str) -> None:
    if stiffness < 0 or rotor < 0:
        what, value = ("stiffness", stiffness) if stiffness < 0 else ("inertia of its rotor", rotor)
        raise ClearanceError(f"{where}: the {what} must be at least 0, but it is {value:g}. Correct it.")
    if (stiffness > 0 or rotor > 0) and kind not in (*MAY_MIMIC, "fixed"):
        raise ClearanceError(
            f"{where}: a spring or a rotor acts along the one coordinate of a revolute, continuous or prismatic joint, "
            f"but this joint is {kind}. Remove it, and add the spring in Python (`Motion(actuators=...)`)."
        )
