"""The robot of a URDF file: its links and joints, poses of their frames, and checks that they form one tree.

Units are SI. A pose is a place `xyz` [m] and a turn `rpy` [rad], R = Rz(yaw) Ry(pitch) Rx(roll).
"""

import collections
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.io.urdf.text import Note
from clearance_jax.mechanism.body import Limits

Triple = tuple[float, float, float]
Vector3 = Float[np.ndarray, "3"]
Matrix3 = Float[np.ndarray, "3 3"]
NOWHERE: Triple = (0.0, 0.0, 0.0)

# Degrees of freedom of each kind of joint.
KINDS = {"revolute": 1, "continuous": 1, "prismatic": 1, "fixed": 0, "floating": 6, "planar": 3}
# Those that have an axis; of a planar one it is the plane's normal.
WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
# Those whose one coordinate may follow another's.
MAY_MIMIC = ("revolute", "continuous", "prismatic")
# The compiled program grows with the links.
MOST_LINKS = 2000
# Most names in a message.
SHOWN = 4
# Round-off of a zero in a product of a few rotations, relative to the largest entries.
ROUNDING = 8 * np.finfo(float).eps


class Link(NamedTuple):
    """A rigid body with the frame of its joint: `mass` [kg], 0 where nothing is said of it; `center` of mass [m] in
    that frame; `inertia` [kg m^2] about the centre of mass, along its axes; the `line` of the file that it begins at;
    the names of the `links` that it is merged from.
    """

    name: str
    mass: float
    center: Vector3
    inertia: Matrix3
    line: int
    links: tuple[str, ...] = ()


class Mimic(NamedTuple):
    """What a joint's coordinate follows: that of the `joint` of this name, times the `multiplier` plus the `offset`
    [rad or m]. With a multiplier of 0 it stays at the offset.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


class Joint(NamedTuple):
    """A joint, one of `KINDS`. Its frame is the child's; at zero this has the pose `xyz`, `rpy` in the parent's frame.
    `axis`: a unit vector there; `mimic`: what its coordinate follows; `damping` [N m s/rad or N s/m];
    `friction` [N m or N]; `stiffness` of a spring [N m/rad or N/m], relaxed at `rest` [rad or m]; `rotor` [kg m^2 or
    kg]: inertia of its motor, seen through its gears.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    limits: Limits | None
    mimic: Mimic | None
    damping: float
    friction: float
    line: int
    stiffness: float = 0.0
    rest: float = 0.0
    rotor: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it has a coordinate."""
        return KINDS[self.kind] > 0


class Robot(NamedTuple):
    """A robot: links in the file's order, joints parents first, the `root` link. `notes`: what was not read, in words;
    `assumed`: what was assumed, with its lines.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    root: str
    notes: tuple[str, ...] = ()
    assumed: tuple[Note, ...] = ()


class FramePose(NamedTuple):
    """A frame in another one: its origin there [m], and the rotation from its axes to the other's."""

    position: Vector3
    rotation: Matrix3

    def of(self, position: Vector3, rotation: Matrix3) -> "FramePose":
        """The pose in the outer frame of what has this `position` and `rotation` in the frame."""
        moved = self.rotation @ position
        scale = max(np.abs(self.position).max(), np.abs(position).max())
        return FramePose(clean(self.position + moved, scale), clean(self.rotation @ rotation))


HERE = FramePose(np.zeros(3), np.eye(3))


def clean(values: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """The values with round-off set to zero, so that the compiled program can leave it out."""
    return np.where(np.abs(values) <= ROUNDING * scale, 0.0, values)


def rotation_of(rpy) -> Matrix3:
    """The rotation by roll, pitch and yaw [rad]; a zero among them leaves exact zeros and ones."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return z @ y @ x


def rpy_of(rotation: Matrix3) -> Vector3:
    """Roll, pitch and yaw [rad] of a rotation. Near a pitch of 90 deg only the sum or difference of roll and yaw is
    well defined, so the yaw is taken out of the rotation first.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    if np.hypot(rotation[1, 0], rotation[0, 0]) <= ROUNDING:
        yaw = 0.0  # any will do
    rest = rotation_of((0.0, 0.0, -yaw)) @ rotation
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    roll = np.arctan2(-rest[1, 2], rest[1, 1])
    return clean(np.array([roll, pitch, yaw]))


def triple(values: Vector3) -> Triple:
    """Three Python floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def is_identity(rotation: Matrix3) -> bool:
    """Whether the rotation is exactly the identity."""
    return bool(np.array_equal(rotation, np.eye(3)))


def robot_of(name: str, links: Sequence[Link], joints: Sequence[Joint]) -> Robot:
    """The robot of these links and joints. **Raises** where they are no tree, or a joint follows what it cannot."""
    if not links:
        raise ClearanceError("the robot has no <link>. Add one.")
    if len(links) > MOST_LINKS:
        raise ClearanceError(f"the robot has {len(links)} links, but {MOST_LINKS} are the most. Split the file.")
    for what, several in (("link", links), ("joint", joints)):
        first: dict[str, int] = {}
        for part in several:
            if part.name in first:
                where = f"lines {first[part.name]} and {part.line}"
                raise ClearanceError(f"{where}: two {what}s are called `{part.name}`. Rename one.")
            first[part.name] = part.line
    known = {link.name for link in links}
    for joint in joints:
        for key, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise unknown_name(f"{_say(joint)}: there is no link `{link}` to be its {key}.", link, known)
        if joint.parent == joint.child:
            raise ClearanceError(f"{_say(joint)} has the link `{joint.parent}` as parent and as child. Change one.")
    carried: dict[str, Joint] = {}
    for joint in joints:
        other = carried.setdefault(joint.child, joint)
        if other is not joint:
            raise ClearanceError(
                f"{_say(joint)} closes a loop: the link `{joint.child}` hangs on joint `{other.name}` (line "
                f"{other.line}) already. URDF knows trees only. Remove one of both, and close the loop in Python "
                "(`Mechanism(..., loops=...)`)."
            )
    root = _root(links, carried)
    ordered = _order(root, joints)
    reached = {root, *(joint.child for joint in ordered)}
    for link in links:
        if link.name not in reached:
            circle = _circle(link.name, carried)
            raise ClearanceError(f"link `{link.name}` (line {link.line}) does not hang on `{root}`: {circle}. Mend it.")
    _check_mimics({joint.name: joint for joint in joints})
    return Robot(name, tuple(links), ordered, root)


def _say(joint: Joint) -> str:
    return f"line {joint.line}: joint `{joint.name}`"


def _root(links: Sequence[Link], carried: Mapping[str, Joint]) -> str:
    roots = [link for link in links if link.name not in carried]
    if not roots:
        circle = _circle(links[0].name, carried)
        raise ClearanceError(f"no link is the root: {circle}. Remove one of these joints.")
    if len(roots) > 1:
        named = _list([f"`{link.name}` (line {link.line})" for link in roots])
        raise ClearanceError(
            f"a robot has one root, but {len(roots)} links hang on no joint: {named}. Connect them by joints, or "
            "remove what does not belong to the robot."
        )
    return roots[0].name


def _list(names: Sequence[str]) -> str:
    return ", ".join(names[:SHOWN]) + (f", ... ({len(names)} in all)" if len(names) > SHOWN else "")


def _circle(link: str, carried: Mapping[str, Joint]) -> str:
    """The loop of joints above a link, in words."""
    passed: list[str] = []
    while link not in passed:
        passed.append(link)
        link = carried[link].parent
    joints = [f"`{carried[name].name}`" for name in reversed(passed[passed.index(link) :])]
    return f"joints {_list(joints)} go round in a circle" if len(joints) > 1 else f"joint {joints[0]} goes round"


def _order(root: str, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints that hang on the root, parents first: each limb as a whole, limbs in the file's order."""
    children = collections.defaultdict(list)
    for joint in joints:
        children[joint.parent].append(joint)
    ordered, waiting = [], children[root][::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += children[joint.child][::-1]
    return tuple(ordered)


def _check_mimics(joints: Mapping[str, Joint]) -> None:
    led: set[str] = set()  # by a joint that follows none
    for joint in joints.values():
        followers = [joint.name]
        while followers[-1] not in led and (mimic := joints[followers[-1]].mimic) is not None:
            leader = mimic.joint
            if leader in followers and len(followers) == 1:
                raise ClearanceError(f"{_say(joint)} mimics itself. Name another joint, or remove <mimic>.")
            if leader in followers:
                named, first = _list([f"`{name}`" for name in followers]), _say(joints[leader])
                raise ClearanceError(f"{first} follows itself: {named} mimic one another. Let one of them lead.")
            followers.append(leader)
        led |= set(followers)
