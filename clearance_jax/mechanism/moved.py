"""How coordinates move what hangs on them: frames along the tree, one elementary coordinate after the other."""

from typing import NamedTuple

from clearance_jax._types import Scalar
from clearance_jax.mechanism.frame import Column, Frame
from clearance_jax.mechanism.tree import AbstractJoint, Coordinate
from clearance_jax.spatial import UNIT, ZERO, Term, Vector, of_quaternion, subtract, transpose


class Moved(NamedTuple):
    """Where a coordinate is and how it moves: its positions, its velocities, and the accelerations that are given to it
    (0.0 where nothing moves); `index`: of its first velocity among the free ones (-1: it is prescribed).
    """

    index: int
    q: tuple[Term, ...]
    v: tuple[Term, ...]
    a: tuple[Term, ...]


Values = dict[str, Moved]
"""Every free coordinate's by its name."""


def motion_of(coordinate: Coordinate, time: Scalar, values: Values) -> Moved:
    """How a coordinate moves: as its drive says, or as the state does."""
    if coordinate.motion.drive is None:
        return values[coordinate.name]
    q, v, a = coordinate.motion.drive(time)  # a tuple, any of which may be the constant 0.0
    return Moved(-1, (q,), (v,), (a,))


def carry(frame: Frame, slides: Vector | None, turns: Vector | None, by: Moved) -> Frame:
    """The frame after an elementary coordinate, which slides along, or turns about, an axis (neither: it is a ball);
    without a word of what moves it.
    """
    if slides is None and turns is None:
        w, x, y, z = by.q
        (p, q, r), (a, b, c) = by.v, by.a
        return frame.swivel(of_quaternion(w, x, y, z), (p, q, r), (a, b, c))
    (q,), (v,), (a,) = by.q, by.v, by.a
    if turns is not None:
        return frame.turn(turns, q, v, a)
    assert slides is not None
    return frame.slid(slides, q, v, a)


def beyond(coordinate: Coordinate, by: Moved, frame: Frame) -> Frame:
    """The frame after an elementary coordinate of a joint."""
    after = carry(frame, coordinate.slides, coordinate.turns, by)
    if coordinate.is_ball:
        for k, axis in enumerate(UNIT):
            after = after.add_motion(Column(by.index + k, after.rotation.apply(axis), after.position), 0.0)
        return after
    if coordinate.turns is not None:
        column = Column(by.index, frame.rotation.apply(coordinate.turns), frame.position)
    else:
        assert coordinate.slides is not None
        column = Column(by.index, frame.rotation.apply(coordinate.slides), None)
    return after.add_motion(column, by.v[0])


def place(joint: AbstractJoint, parent: Frame, time: Scalar, values: Values) -> Frame:
    """The child's frame."""
    frame = joint.on_parent(parent)
    for coordinate in joint.coordinates():
        frame = beyond(coordinate, motion_of(coordinate, time, values), frame)
    frame = frame._replace(pivot=frame.position)
    if joint.child_orientation is not None:
        rows = joint.child_orientation.rotation.rows
        frame = frame._replace(rotation=frame.rotation.compose(transpose(rows)))
    return frame.move_origin(subtract(ZERO, joint.at_child.vector))
