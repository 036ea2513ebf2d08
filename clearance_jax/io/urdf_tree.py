"""Checks that the links and joints of a URDF form one tree with unique names."""

import collections
from collections.abc import Mapping, Sequence

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.io.urdf_parts import MAY_MIMIC, Joint, Link, Robot

# The compiled program grows with the links.
MOST_LINKS = 2000
# Most names in a message.
SHOWN = 4


def robot_of(name: str, links: Sequence[Link], joints: Sequence[Joint]) -> Robot:
    """The robot of these links and joints.

    **Raises:** `ClearanceError` where they are no tree, or where a joint follows what it cannot.
    """
    if not links:
        raise ClearanceError("the robot has no <link>. Add one.")
    if len(links) > MOST_LINKS:
        raise ClearanceError(f"the robot has {len(links)} links, but {MOST_LINKS} are the most. Split the file.")
    _check_unique("link", links)
    _check_unique("joint", joints)
    for joint in joints:
        _check_links(joint, {link.name for link in links})
    carried = _carriers(joints)
    root = _root(links, carried)
    ordered = _order(root, joints)
    _check_reached(root, links, ordered, carried)
    _check_mimics({joint.name: joint for joint in joints})
    return Robot(name, tuple(links), ordered, root)


def _check_unique(what: str, parts: Sequence[Link] | Sequence[Joint]) -> None:
    first: dict[str, int] = {}
    for part in parts:
        if part.name in first:
            raise ClearanceError(
                f"lines {first[part.name]} and {part.line}: two {what}s are called `{part.name}`. Rename one."
            )
        first[part.name] = part.line


def _check_links(joint: Joint, known: set[str]) -> None:
    for key, link in (("parent", joint.parent), ("child", joint.child)):
        if link not in known:
            raise ClearanceError(f"{_say(joint)}: there is no link `{link}` to be its {key}. " + suggest(link, known))
    if joint.parent == joint.child:
        raise ClearanceError(f"{_say(joint)} has the link `{joint.parent}` as parent and as child. Change one.")


def _say(joint: Joint) -> str:
    return f"line {joint.line}: joint `{joint.name}`"


def _carriers(joints: Sequence[Joint]) -> dict[str, Joint]:
    """The joint that carries each link."""
    carriers: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in carriers:
            other = carriers[joint.child]
            raise ClearanceError(
                f"{_say(joint)} closes a loop: the link `{joint.child}` hangs on joint `{other.name}` (line "
                f"{other.line}) already. URDF knows trees only. Remove one of both, and close the loop in Python "
                "(`Mechanism(..., loops=...)`)."
            )
        carriers[joint.child] = joint
    return carriers


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
    seen: list[str] = []
    while link not in seen:
        seen.append(link)
        link = carried[link].parent
    joints = [f"`{carried[name].name}`" for name in reversed(seen[seen.index(link) :])]
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


def _check_reached(root: str, links: Sequence[Link], ordered: Sequence[Joint], carried: Mapping[str, Joint]) -> None:
    reached = {root, *(joint.child for joint in ordered)}
    for link in links:
        if link.name not in reached:
            circle = _circle(link.name, carried)
            raise ClearanceError(f"link `{link.name}` (line {link.line}) does not hang on `{root}`: {circle}. Mend it.")


def _check_mimics(joints: Mapping[str, Joint]) -> None:
    for joint in joints.values():
        if joint.mimic is not None:
            _check_followed(joint, joint.mimic.joint, joints)
    led: set[str] = set()  # by a joint that follows none
    for joint in joints.values():
        seen = [joint.name]
        while seen[-1] not in led and (mimic := joints[seen[-1]].mimic) is not None:
            if mimic.joint in seen:
                _refuse_circle(joints[mimic.joint], seen)
            seen.append(mimic.joint)
        led |= set(seen)


def _refuse_circle(joint: Joint, followers: Sequence[str]) -> None:
    if len(followers) == 1:
        raise ClearanceError(f"{_say(joint)} mimics itself. Name another joint, or remove <mimic>.")
    named = _list([f"`{name}`" for name in followers])
    raise ClearanceError(f"{_say(joint)} follows itself: {named} mimic one another. Let one of them lead.")


def _check_followed(joint: Joint, followed: str, joints: Mapping[str, Joint]) -> None:
    if followed not in joints:
        raise ClearanceError(f"{_say(joint)} mimics `{followed}`, which is no joint. " + suggest(followed, joints))
    if joints[followed].kind not in MAY_MIMIC:
        raise ClearanceError(
            f"{_say(joint)} mimics `{followed}`, which is {joints[followed].kind}: it has no single coordinate to "
            "follow. Name another joint."
        )
