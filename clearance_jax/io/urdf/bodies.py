"""Rigid bodies of a URDF's robot: links that are fixed to one another are one body, which must have mass to move. The
frame of each link stays known by the link's name. A link may lack mass, as a sensor does: whole bodies are checked.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from clearance_jax.errors import ClearanceError
from clearance_jax.io.urdf import robot as parts
from clearance_jax.io.urdf.text import Note
from clearance_jax.mechanism.tree.frame import JacobianColumn

# Least radius of gyration [m]: a smaller one is round-off of printed digits.
SMALLEST = 1e-7
# Moments that miss the triangle rule by less are those of a flat body in three digits; by more they are noted, and from
# `ROUNDED` on refused.
DIGITS, ROUNDED = 1e-3, 1e-2
# A negative moment that is, compared with the greatest, round-off of printed products.
NEGATIVE = 1e-6
# Least eigenvalue of the mass matrix, scaled to a unit diagonal, that is no round-off.
NOTHING = 1e-12
X, Y, Z = np.eye(3)
Weight = tuple[float, parts.Vector3, parts.Matrix3]
"""Mass [kg], centre of mass [m] and inertia [kg m^2] about it."""


class LinkFrame(NamedTuple):
    """The frame of a link: the body that it is on, and its pose there."""

    body: str
    pose: parts.FramePose


class Assembly(NamedTuple):
    """Bodies and the joints that move them, parents first; `frames` of all links by their names. A body has the name,
    frame and line of the first of its `links`.
    """

    name: str
    root: str
    bodies: dict[str, parts.Link]
    joints: tuple[parts.Joint, ...]
    frames: dict[str, LinkFrame]


def merge(robot: parts.Robot) -> Assembly:
    """The robot without fixed joints: a body has mass, centre and inertia of its links, and the joints on them."""
    frames = {robot.root: LinkFrame(robot.root, parts.HERE)}
    joints = []
    for joint in robot.joints:
        carrier = frames[joint.parent]
        pose = carrier.pose.of(np.array(joint.xyz), parts.rotation_of(joint.rpy))
        frames[joint.child] = LinkFrame(joint.child, parts.HERE) if joint.moves else LinkFrame(carrier.body, pose)
        if joint.moves:
            # Without a further rotation the angles stay those of the file.
            rpy = joint.rpy if parts.is_identity(carrier.pose.rotation) else parts.triple(parts.rpy_of(pose.rotation))
            joints.append(joint._replace(parent=carrier.body, xyz=parts.triple(pose.position), rpy=rpy))
    of_links: dict[str, list[parts.Link]] = {frame.body: [] for frame in frames.values()}
    # The link that gives the body its name comes first.
    for link in sorted(robot.links, key=lambda link: frames[link.name].body != link.name):
        of_links[frames[link.name].body].append(link)
    bodies = {name: _together(of, frames) for name, of in of_links.items()}
    return Assembly(robot.name, robot.root, bodies, tuple(joints), frames)


def _together(links: Sequence[parts.Link], frames: Mapping[str, LinkFrame]) -> parts.Link:
    body = links[0]._replace(links=tuple(link.name for link in links))
    weighing = [_in_body(link, frames[link.name].pose) for link in links if link.mass > 0 or link.inertia.any()]
    if not weighing:
        return body._replace(center=np.zeros(3))
    if len(weighing) == 1:  # as the file has it, to the last digit
        mass, center, inertia = weighing[0]
        return body._replace(mass=mass, center=center, inertia=inertia)
    mass, center, inertia = sum_of(weighing)
    return body._replace(mass=mass, center=center, inertia=inertia)


def sum_of(weighing: Sequence[Weight]) -> Weight:
    """Mass, centre of mass and inertia of several together, in one frame."""
    masses, centers, inertias = (np.array(values) for values in zip(*weighing, strict=True))
    mass = masses.sum()
    center = masses @ centers / mass if mass > 0 else np.zeros(3)
    center = parts.clean(center, np.abs(centers).max())
    inertia = np.zeros((3, 3))
    for mass_of, arm, own_inertia in zip(masses, centers - center, inertias, strict=True):  # by Steiner
        inertia = inertia + (own_inertia + mass_of * (arm @ arm * np.eye(3) - np.outer(arm, arm)))
    return float(mass), center, inertia


def _in_body(link: parts.Link, pose: parts.FramePose) -> Weight:
    """Mass, centre of mass and inertia of a link, in the frame and along the axes of its body."""
    if parts.is_identity(pose.rotation):
        return link.mass, pose.position + link.center, link.inertia
    center, _ = pose.of(link.center, pose.rotation)
    inertia = pose.rotation @ link.inertia @ pose.rotation.T
    return link.mass, center, parts.clean((inertia + inertia.T) / 2, np.abs(inertia).max())


def check_bodies(
    joints: Sequence[parts.Joint], bodies: Mapping[str, parts.Link], say: Callable[[str], str]
) -> list[Note]:
    """What is assumed of inertias. **Raises** for an impossible one, and for a joint that moves no mass. `joints`:
    parents first; `say`: writes the option `inertia` with a word.
    """
    notes, light = [], False
    for body in bodies.values():
        missing = lack(body)
        if missing > ROUNDED or (body.mass == 0 and body.inertia.any()):
            raise _impossible(body, say)
        if missing > DIGITS:
            notes.append(("moments of inertia of which two add up to less than the third, by less than 1 %", body.line))
        is_thin = np.linalg.eigvalsh(body.inertia)[0] <= body.mass * SMALLEST**2
        if is_thin and body.mass > 0:
            notes.append(("mass without inertia about some axis is that of a point or a rod", body.line))
        light |= bool(is_thin)
    if light:
        _check_moved(joints, bodies, say)
    return notes


def lack(body: parts.Link) -> float:
    """By which part of the greatest principal moment the sum of the other two is less; infinite for a negative one."""
    scale = np.abs(body.inertia).max()
    if not scale > body.mass * SMALLEST**2:
        return 0.0
    least, middle, greatest = np.linalg.eigvalsh(body.inertia / scale)
    is_negative = least < -max(body.mass * SMALLEST**2 / scale, NEGATIVE)
    return float("inf") if is_negative else max(0.0, float(1 - (least + middle) / greatest))


def _impossible(body: parts.Link, say: Callable[[str], str]) -> ClearanceError:
    fixed = len(body.links) - 1
    others = f" (with {fixed} link{'s' if fixed > 1 else ''} fixed to it)" if fixed else ""
    where = f"line {body.line}: link `{body.name}`{others}"
    if body.mass == 0:
        return ClearanceError(f"{where} has inertia without mass. Give it a mass, or take its <inertial> out.")
    shown = "{:.3g}, {:.3g} and {:.3g} kg*m^2".format(*np.linalg.eigvalsh(body.inertia))
    return ClearanceError(
        f"{where}: no body has its principal moments of inertia {shown}: none may be negative, and the two smaller "
        f"ones must add up to the greatest at least. Correct <inertia> (about the centre of mass; signs; units), or "
        f"load the robot with {say('balance')} or, if the link has shapes, {say('from-geometry')}."
    )


def _check_moved(joints: Sequence[parts.Joint], bodies: Mapping[str, parts.Link], say: Callable[[str], str]) -> None:
    """Raise where joints move no mass, by the mass matrix at a random pose, where no axes are aligned by chance."""
    matrix, owners = mass_matrix(joints, bodies, 0)
    met = np.diag(matrix)
    # A radius of gyration below the smallest, of the lightest body, is round-off.
    floor = SMALLEST**2 * min((body.mass for body in bodies.values() if body.mass > 0), default=0.0)
    matrix = np.where(np.minimum.outer(met, met) > floor, matrix, 0.0)
    met = np.diag(matrix)
    size = 1 / np.sqrt(np.where(met > 0, met, 1.0))  # so that metres and radians compare
    values, vectors = np.linalg.eigh(matrix * np.outer(size, size))
    if values[0] > NOTHING:
        return
    joint = owners[int(np.argmax(np.abs(vectors[:, 0])))]
    raise ClearanceError(
        f"line {joint.line}: joint `{joint.name}` can move without moving any mass. Give the link `{joint.child}`, or "
        f"what it carries, an <inertial>, or shapes and load the robot with {say('from-geometry')}, or fix the joint."
    )


def mass_matrix(
    joints: Sequence[parts.Joint], bodies: Mapping[str, parts.Link], seed: int
) -> tuple[Float[np.ndarray, "n n"], list[parts.Joint]]:
    """The mass matrix at a random pose, and the joint of each coordinate."""
    rng = np.random.default_rng(seed)
    columns: list[JacobianColumn] = []
    owners: list[parts.Joint] = []
    moving: dict[str, list[int]] = {}  # the indices of the columns that move each body
    poses: dict[str, parts.FramePose] = {}
    for joint in joints:
        frame = poses.get(joint.parent, parts.HERE).of(np.array(joint.xyz), parts.rotation_of(joint.rpy))
        columns += _columns(joint, frame)
        moving[joint.child] = [*moving.get(joint.parent, []), *range(len(owners), len(columns))]
        owners += [joint] * (len(columns) - len(owners))
        poses[joint.child] = frame.of(*_move(joint, rng))
    matrix = np.zeros((len(columns), len(columns)))
    for name, body in bodies.items():
        pose, which = poses[name], moving[name]
        center = parts.triple(pose.position + pose.rotation @ body.center)
        rates = np.array([[*columns[i].velocity_at(center), *columns[i].spin] for i in which])
        inertia = np.zeros((6, 6))
        inertia[:3, :3], inertia[3:, 3:] = body.mass * np.eye(3), pose.rotation @ body.inertia @ pose.rotation.T
        matrix[np.ix_(which, which)] += rates @ inertia @ rates.T
    return matrix, owners


def _columns(joint: parts.Joint, frame: parts.FramePose) -> list[JacobianColumn]:
    """The columns of a joint's coordinates at zero. Those of several coordinates span the same motions at any value."""
    axis = np.array(joint.axis)
    across = np.cross(axis, X if abs(axis[0]) < 0.9 else Y)
    slides = {"prismatic": [axis], "planar": [across, np.cross(axis, across)], "floating": [X, Y, Z]}
    turns = {"revolute": [axis], "continuous": [axis], "planar": [axis], "floating": [X, Y, Z]}
    return [
        JacobianColumn(0, parts.triple(frame.rotation @ axis), pivot)
        for pivot, axes in ((None, slides), (parts.triple(frame.position), turns))
        for axis in axes.get(joint.kind, [])
    ]


def _move(joint: parts.Joint, rng: np.random.Generator) -> tuple[parts.Vector3, parts.Matrix3]:
    """A random position and rotation of the child in the joint's frame that the joint allows."""
    by, turn = np.zeros(3), np.eye(3)
    for column in _columns(joint, parts.HERE):
        if column.pivot is None:
            by = by + rng.uniform(0.1, 1.0) * np.array(column.axis)
        else:
            angle, across = rng.uniform(0.3, 1.2), np.cross(np.eye(3), np.array(column.axis))  # by Rodrigues
            turn = turn @ (np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across)
    return by, turn
