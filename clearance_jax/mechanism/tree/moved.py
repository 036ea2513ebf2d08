"""Frames along the tree, moved by one elementary coordinate after the other."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.frame import Frame, JacobianColumn
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.spatial import (
    UNIT,
    ZERO,
    Swing,
    Term,
    Vector,
    add,
    of_quaternion,
    plus,
    scale,
    subtract,
    swing,
    times,
    transpose,
)


class Moved(NamedTuple):
    """Positions, velocities and given accelerations of a coordinate; `index` of its velocity (-1: prescribed)."""

    index: int
    q: tuple[Term, ...]
    v: tuple[Term, ...]
    a: tuple[Term, ...]


Values = dict[str, Moved]
"""The motion of every free coordinate, by name."""


def motion_of(coordinate: Coordinate, time: Scalar, values: Values) -> Moved:
    """The motion of a coordinate, from its drive or the state."""
    if coordinate.motion.drive is None:
        return values[coordinate.name]
    q, v, a = coordinate.motion.drive(time)  # a tuple, any of which may be the constant 0.0
    return Moved(-1, (q,), (v,), (a,))


class FrameStep(NamedTuple):
    """One motion of a frame: it slides along or turns about an axis (neither: a ball), or swings by two `tilts`."""

    by: Moved
    slides: Vector | None = None
    turns: Vector | None = None
    tilts: tuple[Vector, Vector] | None = None


def steps(coordinates: Iterable[Coordinate], time: Scalar, values: Values) -> Iterator[FrameStep]:
    """The steps of a joint."""
    tilt = None
    for coordinate in coordinates:
        step = FrameStep(motion_of(coordinate, time, values), coordinate.slides, coordinate.turns)
        if not coordinate.swings:
            yield step
        elif tilt is None:
            tilt = step
        else:
            first, second = tilt.by, step.by
            by = Moved(first.index, first.q + second.q, first.v + second.v, first.a + second.a)
            yield FrameStep(by, tilts=(tilt.turns or ZERO, step.turns or ZERO))


def carry(frame: Frame, step: FrameStep) -> Frame:
    """The frame after a step, without the columns of what moves it."""
    by, slides, turns, tilts = step
    if tilts is not None:
        at = swing(*tilts, *by.q)
        return frame.swivel(at.rows, *swing_rates(at, by))
    if slides is None and turns is None:
        w, x, y, z = by.q
        (p, q, r), (a, b, c) = by.v, by.a
        return frame.swivel(of_quaternion(w, x, y, z), (p, q, r), (a, b, c))
    (q,), (v,), (a,) = by.q, by.v, by.a
    if turns is not None:
        return frame.turn(turns, q, v, a)
    assert slides is not None
    return frame.slid(slides, q, v, a)


def swing_rates(at: Swing, by: Moved) -> tuple[Vector, Vector]:
    """The spin of a swing and the rate of its components, in the rotated axes."""
    (a, b), (p, q), (u, v) = by.q, by.v, by.a
    spin, faster = (add(scale(x, at.inside[0]), scale(y, at.inside[1])) for x, y in ((p, q), (u, v)))
    # The spin has the divisor 1 + g^2 (`spatial.swing`), g = (a, b) / 2, whose rate is (a p + b q) / 2.
    growth = times(0.5, plus(times(a, p), times(b, q)))
    return spin, subtract(faster, scale(times(at.part, growth), spin))


def carry_with_columns(frame: Frame, step: FrameStep) -> Frame:
    """The frame after a step (see `carry`), with the columns of the coordinates that make it."""
    by, slides, turns, tilts = step
    if tilts is not None:
        at = swing(*tilts, *by.q)
        after = frame.swivel(at.rows, *swing_rates(at, by))
        axes = [frame.rotation.apply(axis) for axis in at.outside]
    else:
        after = carry(frame, step)
        if slides is not None:
            return after.add_motion(JacobianColumn(by.index, frame.rotation.apply(slides), None), by.v[0])
        if turns is not None:
            return after.add_motion(JacobianColumn(by.index, frame.rotation.apply(turns), frame.position), by.v[0])
        axes = [after.rotation.apply(axis) for axis in UNIT]
    for k, axis in enumerate(axes):
        after = after.add_motion(JacobianColumn(by.index + k, axis, frame.position), 0.0)
    return after


def place(joint: AbstractJoint, parent: Frame, time: Scalar, values: Values) -> Frame:
    """The frame of a joint's child."""
    frame = joint.on_parent(parent)
    for step in steps(joint.coordinates(), time, values):
        frame = carry_with_columns(frame, step)
    frame = frame._replace(pivot=frame.position)
    if joint.child_orientation is not None:
        rows = joint.child_orientation.rotation.rows
        frame = frame._replace(rotation=frame.rotation.compose(transpose(rows)))
    return frame.move_origin(subtract(ZERO, joint.at_child.vector))
