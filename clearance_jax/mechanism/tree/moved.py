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
    """One motion of a frame: it slides along axes or turns about one (neither: a ball), or swings by two `tilts`."""

    by: Moved
    slides: tuple[Vector, ...] | None = None
    turns: Vector | None = None
    tilts: tuple[Vector, ...] | None = None


def steps(coordinates: Iterable[Coordinate], time: Scalar, values: Values) -> Iterator[FrameStep]:
    """The steps of a joint. Free slides that follow each other are one step, as are the tilts of a swing."""
    step: FrameStep | None = None
    for coordinate in coordinates:
        by, slides, turns = motion_of(coordinate, time, values), coordinate.slides, coordinate.turns
        if step is not None and step.slides is not None and slides is not None and _follows(by, step.by):
            step = FrameStep(_joined(step.by, by), (*step.slides, slides))
            continue
        if step is not None and coordinate.swings and step.tilts == ():
            step = FrameStep(_joined(step.by, by), tilts=(step.turns or ZERO, turns or ZERO))
            continue
        if step is not None:
            yield step
        # The first tilt of a swing waits for the second.
        step = FrameStep(by, slides and (slides,), turns, () if coordinate.swings else None)
    if step is not None:
        yield step


def _follows(by: Moved, before: Moved) -> bool:
    return before.index >= 0 and by.index == before.index + len(before.v)


def _joined(a: Moved, b: Moved) -> Moved:
    return Moved(a.index, a.q + b.q, a.v + b.v, a.a + b.a)


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
    if slides is not None:
        return frame.slid(*(_combined(numbers, slides) for numbers in (by.q, by.v, by.a)))
    assert turns is not None
    return frame.turn(turns, by.q[0], by.v[0], by.a[0])


def _combined(numbers: tuple[Term, ...], axes: tuple[Vector, ...]) -> Vector:
    """The vector with these components along axes."""
    out = ZERO
    for number, axis in zip(numbers, axes, strict=True):
        out = add(out, scale(number, axis))
    return out


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
            for k, axis in enumerate(slides):
                column = JacobianColumn(by.index + k if by.index >= 0 else -1, frame.rotation.apply(axis), None)
                after = after.add_motion(column, by.v[k])
            return after
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
