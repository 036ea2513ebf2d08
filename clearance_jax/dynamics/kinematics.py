"""Where everything is and how it moves: poses of the bodies, relative motion in the joints, springs."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import safe_unit
from clearance_jax._sharing import shared
from clearance_jax._types import Rows, Scalar
from clearance_jax.joints import Relative
from clearance_jax.mechanism.body import GROUND, Spring
from clearance_jax.mechanism.mechanism import ClearanceJoint, Mechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.mechanism.tree import Frame, Revolute, place
from clearance_jax.spatial import (
    Rotation,
    Term,
    Vector,
    add,
    dot,
    minus,
    plus,
    scale,
    spin_cross,
    subtract,
    times,
    total,
)

Frames = dict[str, Frame]


def frames(mechanism: Mechanism, time: Scalar, state: State) -> Frames:
    """Pose and motion of every body: one sweep from the ground."""
    names = layout(mechanism).velocities
    values = {name: (i, state.q[i], state.v[i]) for i, name in enumerate(names)}
    out = {GROUND: Frame()}
    for joint in mechanism.joints:
        out[joint.child] = place(joint, out[joint.parent], time, values)
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
    angle, spin = minus(pin.angle, sleeve.angle), minus(pin.spin, sleeve.spin)
    rotation = sleeve_rotation(joint.joint, motion)
    if joint.play is not None:
        at = Relative(joint.slid(state.q), angle, joint.slid(state.v), spin)
        return Play(shared(at), rotation, centre)
    gap = subtract(centre, sleeve.point(joint.joint.at_parent.vector))
    rate = subtract(pin.velocity_at(centre), sleeve.velocity_at(centre))
    return Play(shared(Relative(rotation.undo(gap), angle, rotation.undo(rate), spin)), rotation, centre)


def sleeve_rotation(joint: Revolute, motion: Frames) -> Rotation:
    """Orientation of the sleeve's axes: the parent's, turned by the joint's own angle."""
    frame = motion[joint.parent]
    return frame.rotation if joint.angle is None else frame.turned(joint.angle).rotation


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
        out: Vector = (0.0, 0.0)
        for column in frame.free:
            out = add(out, scale(self.acceleration[column.index], column.velocity_at(point)))
        return out

    def spin_rate(self, frame: Frame) -> Term:
        """Extra spin rate of a body."""
        return total(times(column.spin, self.acceleration[column.index]) for column in frame.free)


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
        spin_rate = minus(plus(pin.spin_rate, extra.spin_rate(pin)), plus(sleeve.spin_rate, extra.spin_rate(sleeve)))
        if joint.play is not None:
            gain = joint.slid(speeds)
        else:
            apart = subtract(
                add(pin.acceleration_at(at.pin), extra.at(pin, at.pin)),
                add(sleeve.acceleration_at(at.pin), extra.at(sleeve, at.pin)),
            )
            turning = scale(2.0, spin_cross(sleeve.spin, now.velocity))
            gain = subtract(at.rotation.undo(shared(apart)), turning)
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
    length, ux, uy = safe_unit(jnp.asarray(span[0], dtype=float), jnp.asarray(span[1], dtype=float))
    rate = jnp.asarray(dot((ux, uy), subtract(frame_b.velocity_at(b), frame_a.velocity_at(a))))
    elongation = length - spring.free_length
    return SpringState(elongation, rate, spring.stiffness * elongation + spring.damping * rate, (ux, uy))
