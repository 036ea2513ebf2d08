"""Lists the elements and attributes of a URDF file that were not read and may be physics."""

from collections import Counter
from collections.abc import Iterator

from clearance_jax.io.urdf_elements import ATTRIBUTES, CHILDREN
from clearance_jax.io.xml_file import Element

# Elements without effect on the motion: looks, shapes for collisions, calibration, soft limits.
PASSED = {"visual", "collision", "collision_checking", "contact", "material", "calibration", "safety_controller"}
# The same in a <gazebo>, and what simulators run beside the motion.
OF_GAZEBO = PASSED | {"plugin", "sensor", "mu1", "mu2", "mu", "kp", "kd", "fdir1", "minDepth", "maxVel", "maxContacts"}
OF_GAZEBO |= {"selfCollide", "self_collide", "laserRetro", "provideFeedback", "springStiffness", "springReference"}
# Of a transmission: how a controller reaches the motor, and what is read of it.
OF_TRANSMISSION = {"type", "joint", "actuator", "hardwareInterface", "mechanicalReduction", "motorTorqueConstant"}
OF_TRANSMISSION |= {"rotor_inertia", "gear_ratio", "leftActuator", "rightActuator", "flexJoint", "role", "offset"}
# Most kinds in a message.
SHOWN = 8


def unread(top: Element) -> tuple[str, ...]:
    """Kinds of elements and attributes that were not read, each with its first line and how often it stands in the
    file; at most `SHOWN` kinds.
    """
    count, first = Counter(), {}
    for words, line in _of(top):
        count[words] += 1
        first.setdefault(words, line)
    told = [f"{words} (line {first[words]}" + (f", {n} times)" if n > 1 else ")") for words, n in count.items()]
    return tuple(told if len(told) <= SHOWN else [*told[:SHOWN], f"{len(told) - SHOWN} kinds more"])


def _of(element: Element) -> Iterator[tuple[str, int]]:
    known = CHILDREN.get(element.tag, ())
    for key in element.attributes if element.tag in ATTRIBUTES else ():
        if key not in ATTRIBUTES[element.tag]:
            yield f"`{key[:60]}` of <{element.tag}>", element.line
    for child in element.children:
        if child.word in PASSED:
            continue
        if child.tag == "gazebo":
            yield from _beside(child, OF_GAZEBO)
        elif child.tag == "transmission":
            yield from _beside(child, OF_TRANSMISSION)
        elif child.tag == "force_element":
            yield from _beside(child, {"torsional_spring"})
        elif child.tag in known or element.tag not in CHILDREN:
            yield from _of(child)
        else:
            yield f"<{child.word[:60]}> in <{element.tag}>", child.line


def _beside(element: Element, passed: set[str]) -> Iterator[tuple[str, int]]:
    """Unknown children of an element for other programs."""
    for child in element.children:
        if child.word not in passed:
            yield f"<{child.word[:60]}> in <{element.tag}>", child.line
        elif element.tag == "transmission":
            yield from _beside(child, passed)
