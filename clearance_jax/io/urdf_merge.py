"""Links that are fixed to one another become one rigid body; the frame of each stays known by the link's name."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from clearance_jax.io.poses import HERE, FramePose, clean, is_identity, rotation_of, rpy_of
from clearance_jax.io.urdf_parts import Joint, Link, Matrix3, Robot, Triple, Vector3


class LinkFrame(NamedTuple):
    """The frame of a link: the body that it is on, and its pose there."""

    body: str
    pose: FramePose


class Rigid(NamedTuple):
    """A body that has the frame and the name of the first of the `links` that it is made of.

    **Arguments:** `mass` [kg]; `center` of mass [m] in that frame; `inertia` [kg m^2] about the centre of mass, along
    that frame's axes; the `line` of the file that its first link begins at.
    """

    name: str
    mass: float
    center: Vector3
    inertia: Matrix3
    links: tuple[str, ...]
    line: int


class Assembly(NamedTuple):
    """Bodies and the joints that move them, parents first; `frames` of all links by their names."""

    name: str
    root: str
    bodies: dict[str, Rigid]
    joints: tuple[Joint, ...]
    frames: dict[str, LinkFrame]


def merge(robot: Robot) -> Assembly:
    """The robot without fixed joints.

    A body has the total mass, the centre of mass and the inertia of its links. Joints of a merged link move to its
    body.
    """
    frames = {robot.root: LinkFrame(robot.root, HERE)}
    joints = []
    for joint in robot.joints:
        carrier = frames[joint.parent]
        if joint.moves:
            joints.append(_carry_over(joint, carrier))
            frames[joint.child] = LinkFrame(joint.child, HERE)
        else:
            frames[joint.child] = LinkFrame(carrier.body, carrier.pose.of(np.array(joint.xyz), rotation_of(joint.rpy)))
    return Assembly(robot.name, robot.root, _bodies(robot.links, frames), tuple(joints), frames)


def _carry_over(joint: Joint, parent: LinkFrame) -> Joint:
    """The joint, on the body that its parent was merged into."""
    pose = parent.pose.of(np.array(joint.xyz), rotation_of(joint.rpy))
    # Without a further rotation the angles stay those of the file.
    rpy = joint.rpy if is_identity(parent.pose.rotation) else triple(rpy_of(pose.rotation))
    return joint._replace(parent=parent.body, xyz=triple(pose.position), rpy=rpy)


def triple(values: Vector3) -> Triple:
    """Three Python floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def _bodies(links: Sequence[Link], frames: Mapping[str, LinkFrame]) -> dict[str, Rigid]:
    parts: dict[str, list[Link]] = {frame.body: [] for frame in frames.values()}
    for link in links:
        # The link that gives the body its name comes first.
        parts[frames[link.name].body].insert(0 if frames[link.name].body == link.name else 10**9, link)
    return {name: _together(of, frames) for name, of in parts.items()}


def _together(links: Sequence[Link], frames: Mapping[str, LinkFrame]) -> Rigid:
    """One body of links (the first gives it its name and frame)."""
    first, names = links[0], tuple(link.name for link in links)
    weighing = [_in_body(link, frames[link.name].pose) for link in links if link.mass > 0 or link.inertia.any()]
    if not weighing:
        return Rigid(first.name, 0.0, np.zeros(3), np.zeros((3, 3)), names, first.line)
    if len(weighing) == 1:  # as the file has it, to the last digit
        (mass, center, inertia), *_ = weighing
        return Rigid(first.name, mass, center, inertia, names, first.line)
    masses, centers, inertias = (np.array(values) for values in zip(*weighing, strict=True))
    mass = masses.sum()
    center = masses @ centers / mass if mass > 0 else np.zeros(3)
    center = clean(center, np.abs(centers).max())
    inertia = sum(_about(*part, center) for part in zip(masses, centers, inertias, strict=True))
    return Rigid(first.name, float(mass), center, np.asarray(inertia), names, first.line)


def _in_body(link: Link, pose: FramePose) -> tuple[float, Vector3, Matrix3]:
    """Mass, centre of mass and inertia of a link, in the frame and along the axes of its body."""
    if is_identity(pose.rotation):
        return link.mass, pose.position + link.center, link.inertia
    center, _ = pose.of(link.center, pose.rotation)
    inertia = pose.rotation @ link.inertia @ pose.rotation.T
    return link.mass, center, clean((inertia + inertia.T) / 2, np.abs(inertia).max())


def _about(mass: float, center: Vector3, inertia: Matrix3, point: Vector3) -> Matrix3:
    """The inertia about another point than the centre of mass (Steiner)."""
    arm = center - point
    return inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
