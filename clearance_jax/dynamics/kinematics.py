"""Where everything is and how it moves: poses of the bodies, relative motion in the joints, springs."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import safe_sqrt, safe_unit
from clearance_jax._sharing import kept, shared
from clearance_jax._types import Rows, Scalar
from clearance_jax.dynamics.table import Columns, Table, three
from clearance_jax.joints import Relative
from clearance_jax.mechanism.body import GROUND, Spring
from clearance_jax.mechanism.frame import Frame
from clearance_jax.mechanism.mechanism import ClearanceJoint, Mechanism
from clearance_jax.mechanism.state import State, layout, parts
from clearance_jax.mechanism.tree import AbstractJoint, AbstractPlayed, Values, place, within
from clearance_jax.spatial import (
    IDENTITY,
    UNIT,
    ZERO,
    Matrix,
    Rotation,
    Term,
    Vector,
    add,
    as_array,
    cross,
    dot,
    is_zero,
    minus,
    product,
    scale,
    subtract,
    transpose,
)

Frames = Mapping[str, Frame]
"""The frames of all bodies by name: a dictionary, or of a large mechanism a `Table`."""


def frames(mechanism: Mechanism, time: Scalar, state: State) -> Frames:
    """Pose and motion of every body: one sweep from the ground."""
    if mechanism.is_tabled:
        return Table(mechanism, time, state)
    values = coordinate_rows(mechanism, state)
    out = {GROUND: Frame()}
    for joint in mechanism.joints:
        frame = place(joint, out[joint.parent], time, values)
        out[joint.child] = frame if mechanism.is_plane else kept(frame)
    return out


def coordinate_rows(mechanism: Mechanism, state: State) -> Values:
    """Of every free coordinate by its name: where its velocities begin, its positions, its velocities."""
    return {c.name: (v.start, state.q[q], state.v[v]) for c, q, v in parts(mechanism)}


class Play(NamedTuple):
    """A clearance joint's relative motion; `rotation` takes the sleeve's axes to the world's, `pin` is the pin's centre
    in the world; `local`: of a joint of the tree the frame that its coordinates make, in the joint's own.
    """

    relative: Relative
    rotation: Rotation
    pin: Vector
    local: Frame | None = None


def play(mechanism: Mechanism, joint: ClearanceJoint, time: Scalar, state: State, motion: Frames) -> Play:
    """Kinematics of a clearance joint: in the tree by its coordinates, which keep the digits of a small play on a large
    machine; in a loop a difference of positions.
    """
    sleeve, pin = motion[joint.parent], motion[joint.child]
    rotation, centre = sleeve_axes(joint.joint, motion), pin.point(joint.joint.at_child.vector)
    if joint.in_tree:
        local = within(joint.joint, time, coordinate_rows(mechanism, state))
        return Play(shared(_of_frame(joint.joint, local)), rotation, centre, local)
    gap = subtract(centre, sleeve.point(joint.joint.at_parent.vector))
    # As the sleeve sees it: against its own point that the pin's centre is at.
    rate = subtract(pin.velocity_at(centre), sleeve.velocity_at(centre))
    place, velocity = rotation.undo(gap), rotation.undo(rate)
    if rotation.is_plane and pin.rotation.is_plane:
        angle, spin = minus(pin.angle, sleeve.angle), (0.0, 0.0, minus(pin.spin[2], sleeve.spin[2]))
        return Play(shared(Relative(place, angle, velocity, spin)), rotation, centre)
    rows = product(transpose(rotation.rows), pin_axes(joint.joint, motion).rows)
    spin = rotation.undo(subtract(pin.spin, sleeve.spin))
    return Play(kept(Relative(place, 0.0, velocity, spin, rows)), rotation, centre)


def _of_frame(joint: AbstractPlayed, local: Frame) -> Relative:
    """The relative motion of a joint of the tree, by the frame that its coordinates make in the joint's own."""
    inner = _along(joint, IDENTITY)
    place, velocity, spin = (inner.undo(v) for v in (local.position, local.velocity, local.spin))
    if inner is IDENTITY and local.rotation.is_plane:
        return Relative(place, local.rotation.angle, velocity, spin)
    rows = product(transpose(inner.rows), product(local.rotation.rows, inner.rows))
    return kept(Relative(place, 0.0, velocity, spin, rows))


def sleeve_axes(joint: AbstractPlayed, motion: Frames) -> Rotation:
    """The sleeve's axes, of which z is the joint's own."""
    return _along(joint, sleeve_rotation(joint, motion))


def pin_axes(joint: AbstractPlayed, motion: Frames) -> Rotation:
    """The pin's axes, of which z is its own."""
    return _along(joint, joint.on_child(motion[joint.child]))


def _along(joint: AbstractPlayed, rotation: Rotation) -> Rotation:
    return rotation if joint.sleeve is UNIT else rotation.followed(joint.sleeve)


def sleeve_rotation(joint: AbstractJoint, motion: Frames) -> Rotation:
    """Orientation of the joint's frame on its parent."""
    return motion[joint.parent].rotated(joint.turned).rotation


def relative_motions(time: Scalar, y: Array | Rows, mechanism: Mechanism) -> list[Relative]:
    """The relative motion in every clearance joint."""
    state = layout(mechanism).split(y)
    motion = frames(mechanism, time, state)
    return [_arrays(play(mechanism, joint, time, state, motion).relative) for joint in mechanism.clearance_joints()]


def _arrays(at: Relative) -> Relative:
    """With numbers for constants, but for what a mechanism in the plane has not."""
    if at.rows is not None:
        return jax.tree.map(lambda x: jnp.asarray(x, float), at)
    x, y, w = (jnp.asarray(term, float) for term in (*at.place[:2], at.spin[2]))
    velocity = jnp.asarray(at.velocity[0], float), jnp.asarray(at.velocity[1], float), 0.0
    return Relative((x, y, 0.0), jnp.asarray(at.angle, float), velocity, (0.0, 0.0, w))


class Extra(NamedTuple):
    """What the free coordinates' accelerations add to the accelerations of `Frame`."""

    acceleration: list[Term]

    def at(self, frame: Frame, point: Vector) -> Vector:
        """Extra acceleration of a body's point."""
        if isinstance(frame.free, Columns):
            return three(as_array(self.acceleration) @ frame.free.velocity_at(point))
        out = ZERO
        for column in frame.free:
            out = add(out, scale(self.acceleration[column.index], column.velocity_at(point)))
        return out

    def spin_rate(self, frame: Frame) -> Vector:
        """Extra spin rate of a body."""
        if isinstance(frame.free, Columns):
            return three(as_array(self.acceleration) @ frame.free.spin)
        out = ZERO
        for column in frame.free:
            out = add(out, scale(self.acceleration[column.index], column.spin))
        return out


def relative_accelerations(
    time: Scalar, y: Array, slope: Array, mechanism: Mechanism
) -> list[tuple[Relative, Relative]]:
    """The relative motion in every clearance joint, and its rate along the motion, for a state and its slope.

    With u the pin's place in the sleeve's axes, R these axes, w the sleeve's spin: u'' = R^T (a_pin - a_sleeve) - 2 w
    x u', of the pin's centre and the sleeve's material point there.
    """
    plan = layout(mechanism)
    state, motion = plan.split(y), frames(mechanism, time, plan.split(y))
    speeds = [slope[i] for i in range(plan.v.start, plan.v.stop)]
    extra, out = Extra(speeds), []
    for joint in mechanism.clearance_joints():
        at = play(mechanism, joint, time, state, motion)
        now, (sleeve, pin) = at.relative, (motion[joint.parent], motion[joint.child])
        local, inner = at.local, _along(joint.joint, IDENTITY)
        if local is not None:
            gain = inner.undo(add(local.acceleration, extra.at(local, local.position)))
            spin_rate = inner.undo(add(local.spin_rate, extra.spin_rate(local)))
        else:
            apart = subtract(
                add(pin.acceleration_at(at.pin), extra.at(pin, at.pin)),
                add(sleeve.acceleration_at(at.pin), extra.at(sleeve, at.pin)),
            )
            turning = cross(scale(2.0, at.rotation.undo(sleeve.spin)), now.velocity)
            gain = subtract(at.rotation.undo(shared(apart)), turning)
            spin_rate = subtract(
                add(pin.spin_rate, extra.spin_rate(pin)), add(sleeve.spin_rate, extra.spin_rate(sleeve))
            )
            if now.rows is not None:
                spin_rate = subtract(spin_rate, cross(sleeve.spin, subtract(pin.spin, sleeve.spin)))
                spin_rate = at.rotation.undo(spin_rate)
        rows = None if now.rows is None else turning_rows(now.spin, now.rows)
        rate = Relative(now.velocity, now.spin[2] if rows is None else 0.0, gain, spin_rate, rows)
        out.append((_arrays(now), shared(_arrays(rate))))
    return out


def turning_rows(spin: Vector, rows: Matrix) -> Matrix:
    """The rate of a rotation's rows by its spin in the outer axes."""
    x, y, z = spin
    hat = (0.0, minus(0.0, z), y), (z, 0.0, minus(0.0, x)), (minus(0.0, y), x, 0.0)
    return product(hat, rows)


class SpringState(NamedTuple):
    """Elongation [m], its rate, tension [N] and direction (a to b) of a spring."""

    elongation: Array
    rate: Array
    tension: Array
    along: Vector


def spring_state(spring: Spring, motion: Frames) -> SpringState:
    """What a spring does."""
    frame_a, frame_b = motion[spring.body_a], motion[spring.body_b]
    a, b = frame_a.point(spring.at_a.vector), frame_b.point(spring.at_b.vector)
    span = subtract(b, a)
    length, along = _unit(span)
    rate = jnp.asarray(dot(along, subtract(frame_b.velocity_at(b), frame_a.velocity_at(a))))
    elongation = length - spring.free_length
    return SpringState(elongation, rate, spring.stiffness * elongation + spring.damping * rate, along)


def _unit(span: Vector) -> tuple[Array, Vector]:
    """Length and direction of a span; of none the direction is zero."""
    if is_zero(span[2]):
        length, x, y = safe_unit(jnp.asarray(span[0], dtype=float), jnp.asarray(span[1], dtype=float))
        return length, (x, y, 0.0)
    length = safe_sqrt(jnp.asarray(dot(span, span), float))
    return length, scale(1.0 / jnp.where(length > 0, length, 1.0), span)
