"""Kinematics: frames of the bodies, relative motion in the joints, springs."""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.numerics import safe_sqrt, safe_unit
from clearance_jax._basis.types import Rows, Scalar
from clearance_jax._compile.alike import stack_trees
from clearance_jax._compile.barriers import share, with_barriers
from clearance_jax.dynamics.forms.coupled import coupled
from clearance_jax.dynamics.forms.frames import Extra, Frames
from clearance_jax.dynamics.forms.table import TabledFrames
from clearance_jax.dynamics.forms.written_out import write_out
from clearance_jax.dynamics.gaps import gap_motions
from clearance_jax.dynamics.relative_motion import (
    as_numbers,
    coordinate_values,
    motions_together,
    rate_of,
    tree_relative_motions,
)
from clearance_jax.joints import Relative
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.body import Spring
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed
from clearance_jax.mechanism.unfolded import unfold
from clearance_jax.spatial import (
    UNIT,
    Rotation,
    Vector,
    add,
    cross,
    dot,
    is_zero,
    minus,
    product,
    scale,
    subtract,
    transpose,
)


def frames(mechanism: PreparedMechanism, time: Scalar, state: State) -> Frames:
    """Pose and motion of every body, in the form of the mechanism's equations."""
    whole = unfold(mechanism, time, state)
    form = TabledFrames if mechanism.is_tabled else write_out
    tree = form(whole.mechanism, time, whole.state, whole.accelerations)
    return coupled(mechanism, whole, tree) if whole.weights else tree


Groups: TypeAlias = Sequence[int | Sequence[int]]
"""Clearance joints by number: one by itself, or alike ones (all in the tree, or none) together, with an axis of joints.
"""


class PinMotion(NamedTuple):
    """Relative motion of a clearance joint; `rotation` from the sleeve's axes to the world's; the pin's centre [m]."""

    relative: Relative
    rotation: Rotation
    pin: Vector


def plays(mechanism: PreparedMechanism, time: Scalar, state: State, motion: Frames) -> dict[str, PinMotion]:
    """Kinematics of every clearance joint: in the tree from its own coordinates, which keep a small play's digits."""
    in_tree = tree_relative_motions(
        mechanism, time, coordinate_values(mechanism, time, state), mechanism.clearance_joints()
    )
    out = {}
    for joint in mechanism.clearance_joints():
        pin, rotation = pin_and_axes(joint, motion)
        relative = share(in_tree[joint.name].now) if joint.in_tree else across_loop(joint, pin, rotation, motion)
        out[joint.name] = PinMotion(relative, rotation, pin)
    return out


def pin_and_axes(joint: ClearanceJoint, motion: Frames) -> tuple[Vector, Rotation]:
    """The pin's centre in the world, and the sleeve's axes."""
    return motion[joint.child].point(joint.joint.at_child.vector), sleeve_axes(joint.joint, motion)


def across_loop(joint: ClearanceJoint, centre: Vector, rotation: Rotation, motion: Frames) -> Relative:
    """The relative motion in a joint that closes a loop, from its pin's centre and the sleeve's axes."""
    sleeve, pin = motion[joint.parent], motion[joint.child]
    gap = subtract(centre, sleeve.point(joint.joint.at_parent.vector))
    # Relative to the sleeve's material point at the pin's centre.
    rate = subtract(pin.velocity_at(centre), sleeve.velocity_at(centre))
    place, velocity = rotation.undo(gap), rotation.undo(rate)
    if rotation.is_plane and pin.rotation.is_plane:
        angle, spin = minus(pin.angle, sleeve.angle), (0.0, 0.0, minus(pin.spin[2], sleeve.spin[2]))
        return share(Relative(place, angle, velocity, spin))
    rows = product(transpose(rotation.rows), _along(joint.joint, joint.joint.on_child(pin)).rows)
    spin = rotation.undo(subtract(pin.spin, sleeve.spin))
    return with_barriers(Relative(place, 0.0, velocity, spin, rows))


def sleeve_axes(joint: AbstractPlayed, motion: Frames) -> Rotation:
    """The sleeve's axes; z is the axis of the joint."""
    return _along(joint, sleeve_rotation(joint, motion))


def _along(joint: AbstractPlayed, rotation: Rotation) -> Rotation:
    return rotation if joint.sleeve is UNIT else rotation.compose(joint.sleeve)


def sleeve_rotation(joint: AbstractJoint, motion: Frames) -> Rotation:
    """Orientation of the joint's frame on its parent."""
    return motion[joint.parent].rotate(joint.turned).rotation


def relative_motions(
    time: Scalar, y: Array | Rows, mechanism: PreparedMechanism, motion: Frames | None = None
) -> list[Relative]:
    """The relative motion of every contact (`contacts`); `motion`: the frames of all bodies, if they are known."""
    state = layout(mechanism).split(y)
    in_tree = tree_relative_motions(
        mechanism, time, coordinate_values(mechanism, time, state), mechanism.clearance_joints()
    )
    loops = loop_plays(mechanism, time, state, motion)
    motions = {name: at.now for name, at in in_tree.items()} | {name: at.relative for name, (at, _) in loops.items()}
    joints = [as_numbers(motions[joint.name]) for joint in mechanism.clearance_joints()]
    return joints + [as_numbers(at.now) for at in gap_motions(mechanism, time, state)]


def loop_plays(
    mechanism: PreparedMechanism, time: Scalar, state: State, motion: Frames | None = None
) -> dict[str, tuple[PinMotion, Frames]]:
    """Kinematics of the clearance joints that close loops, with the frames of all bodies."""
    loops, out = [joint for joint in mechanism.clearance_joints() if not joint.in_tree], {}
    if not loops:
        return out
    motion = frames(mechanism, time, state) if motion is None else motion
    for joint in loops:
        pin, rotation = pin_and_axes(joint, motion)
        out[joint.name] = PinMotion(across_loop(joint, pin, rotation, motion), rotation, pin), motion
    return out


def relative_accelerations(
    time: Scalar, y: Array, slope: Array, mechanism: PreparedMechanism, groups: Groups | None = None
) -> list[tuple[Relative, Relative]]:
    """The relative motion of every contact and its rate, from a state and its slope; or of groups of them."""
    plan, joints = layout(mechanism), mechanism.contacts()
    state, speeds = plan.split(y), tuple(slope[i] for i in range(plan.v.start, plan.v.stop))
    values, loops = coordinate_values(mechanism, time, state, speeds), loop_plays(mechanism, time, state)
    groups = range(len(joints)) if groups is None else groups
    alone_ones = [joints[i] for i in groups if isinstance(i, int)]
    pins = [joint for joint in alone_ones if isinstance(joint, ClearanceJoint)]
    in_tree, motions = tree_relative_motions(mechanism, time, values, pins), {}
    if mechanism.gaps:
        seen = gap_motions(mechanism, time, state, speeds)
        motions = {gap.name: at for gap, at in zip(mechanism.gaps, seen, strict=True)}

    def alone(joint: ClearanceJoint | CoordinateGap) -> tuple[Relative, Relative]:
        if isinstance(joint, CoordinateGap):
            at, rise = motions[joint.name]
            return as_numbers(at), as_numbers(rise)
        if joint.in_tree:
            now, rate = in_tree[joint.name]
        else:
            at, motion = loops[joint.name]
            now, rate = at.relative, loop_rate(joint, at, motion, motion.extra(list(speeds)))
        return as_numbers(now), share(as_numbers(rate))

    out = []
    for group in groups:
        if isinstance(group, int):
            out.append(alone(joints[group]))
        elif joints[group[0]].in_tree and isinstance(joints[group[0]], ClearanceJoint):
            several = [joints[i] for i in group]
            now, rate = motions_together([j for j in several if isinstance(j, ClearanceJoint)], time, values)
            out.append((now, share(rate)))
        else:
            out.append(stack_trees([alone(joints[i]) for i in group]))
    return out


def loop_rate(joint: ClearanceJoint, at: PinMotion, motion: Frames, extra: Extra) -> Relative:
    """The rate of the relative motion in a joint that closes a loop: for the pin's place u in the sleeve's axes R, of
    the spin w, u'' = R^T (a_pin - a_sleeve) - 2 w x u', of the pin's centre and the sleeve's material point there.
    """
    now, sleeve, pin = at.relative, motion[joint.parent], motion[joint.child]
    apart = subtract(
        add(pin.acceleration_at(at.pin), extra.at(joint.child, at.pin)),
        add(sleeve.acceleration_at(at.pin), extra.at(joint.parent, at.pin)),
    )
    turning = cross(scale(2.0, at.rotation.undo(sleeve.spin)), now.velocity)
    gain = subtract(at.rotation.undo(share(apart)), turning)
    spin_rate = subtract(
        add(pin.spin_rate, extra.spin_rate(joint.child)), add(sleeve.spin_rate, extra.spin_rate(joint.parent))
    )
    if now.rows is not None:
        spin_rate = subtract(spin_rate, cross(sleeve.spin, subtract(pin.spin, sleeve.spin)))
        spin_rate = at.rotation.undo(spin_rate)
    return rate_of(now, gain, spin_rate)


class SpringState(NamedTuple):
    """A spring's elongation [m], the rate of that [m/s], its tension [N], and the direction `along` it from a to b."""

    elongation: Array
    rate: Array
    tension: Array
    along: Vector


def spring_state(spring: Spring, motion: Frames) -> SpringState:
    """Elongation, tension and direction of a spring."""
    frame_a, frame_b = motion[spring.body_a], motion[spring.body_b]
    a, b = frame_a.point(spring.at_a.vector), frame_b.point(spring.at_b.vector)
    span = subtract(b, a)
    length, along = _unit(span)
    rate = jnp.asarray(dot(along, subtract(frame_b.velocity_at(b), frame_a.velocity_at(a))))
    elongation = length - spring.free_length
    return SpringState(elongation, rate, spring.stiffness * elongation + spring.damping * rate, along)


def _unit(span: Vector) -> tuple[Array, Vector]:
    """Length and direction of a span; the direction of a zero span is zero."""
    if is_zero(span[2]):
        length, x, y = safe_unit(jnp.asarray(span[0], dtype=float), jnp.asarray(span[1], dtype=float))
        return length, (x, y, 0.0)
    length = safe_sqrt(jnp.asarray(dot(span, span), float))
    return length, scale(1.0 / jnp.where(length > 0, length, 1.0), span)
