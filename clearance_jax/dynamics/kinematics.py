"""Where everything is and how it moves: poses of the bodies, relative motion in the joints, springs."""

from collections.abc import Mapping
from typing import NamedTuple

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
from clearance_jax.mechanism.tree import AbstractJoint, place
from clearance_jax.spatial import (
    ZERO,
    Rotation,
    Term,
    Vector,
    add,
    as_array,
    cross,
    dot,
    is_zero,
    minus,
    plus,
    scale,
    subtract,
)

Frames = Mapping[str, Frame]
"""The frames of all bodies by name: a dictionary, or of a large mechanism a `Table`."""


def frames(mechanism: Mechanism, time: Scalar, state: State) -> Frames:
    """Pose and motion of every body: one sweep from the ground."""
    if mechanism.is_tabled:
        return Table(mechanism, time, state)
    values = {c.name: (v.start, state.q[q], state.v[v]) for c, q, v in parts(mechanism)}
    out = {GROUND: Frame()}
    for joint in mechanism.joints:
        frame = place(joint, out[joint.parent], time, values)
        out[joint.child] = frame if mechanism.is_plane else kept(frame)
    return out


class Play(NamedTuple):
    """A clearance joint's relative motion; `rotation` takes the sleeve's axes to the world's, `pin` is the pin's centre
    in the world.
    """

    relative: Relative
    rotation: Rotation
    pin: Vector


def play(joint: ClearanceJoint, motion: Frames, state: State) -> Play:
    """Kinematics of a clearance joint: in the tree its coordinates, in a loop a difference of positions."""
    sleeve, pin = motion[joint.parent], motion[joint.child]
    centre = pin.point(joint.joint.at_child.vector)
    angle, spin = minus(pin.angle, sleeve.angle), minus(pin.spin[2], sleeve.spin[2])
    rotation = sleeve_rotation(joint.joint, motion)
    if joint.play is not None:
        at = Relative(joint.slid(state.q), angle, joint.slid(state.v), spin)
        return Play(shared(at), rotation, centre)
    gap = subtract(centre, sleeve.point(joint.joint.at_parent.vector))
    rate = subtract(pin.velocity_at(centre), sleeve.velocity_at(centre))
    place, velocity = rotation.undo(gap)[:2], rotation.undo(rate)[:2]
    return Play(shared(Relative(place, angle, velocity, spin)), rotation, centre)


def sleeve_rotation(joint: AbstractJoint, motion: Frames) -> Rotation:
    """Orientation of the joint's frame on its parent (of a sleeve's axes)."""
    return motion[joint.parent].rotated(joint.turned).rotation


def relative_motions(time: Scalar, y: Array | Rows, mechanism: Mechanism) -> list[Relative]:
    """The relative motion in every clearance joint."""
    state = layout(mechanism).split(y)
    motion = frames(mechanism, time, state)
    return [_arrays(play(joint, motion, state).relative) for joint in mechanism.clearance_joints()]


def _arrays(at: Relative) -> Relative:
    x, y = (jnp.asarray(p, float) for p in at.place)
    vx, vy = (jnp.asarray(v, float) for v in at.velocity)
    return Relative((x, y), jnp.asarray(at.angle, float), (vx, vy), jnp.asarray(at.spin, float))


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
        at = play(joint, motion, state)
        now, (sleeve, pin) = at.relative, (motion[joint.parent], motion[joint.child])
        spin_rate = minus(
            plus(pin.spin_rate[2], extra.spin_rate(pin)[2]), plus(sleeve.spin_rate[2], extra.spin_rate(sleeve)[2])
        )
        if joint.play is not None:
            gain = joint.slid(speeds)
        else:
            apart = subtract(
                add(pin.acceleration_at(at.pin), extra.at(pin, at.pin)),
                add(sleeve.acceleration_at(at.pin), extra.at(sleeve, at.pin)),
            )
            turning = cross(scale(2.0, sleeve.spin), (*now.velocity, 0.0))
            gain = subtract(at.rotation.undo(shared(apart)), turning)[:2]
        out.append((_arrays(now), shared(_arrays(Relative(now.velocity, now.spin, gain, spin_rate)))))
    return out


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
