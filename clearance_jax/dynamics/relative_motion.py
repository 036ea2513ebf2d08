"""The relative motion in clearance joints of the tree, from their own coordinates, so that it keeps its digits."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from clearance_jax._basis.types import Rows, Scalar
from clearance_jax._compile.alike import results_together, side_by_side
from clearance_jax._compile.barriers import with_barriers
from clearance_jax.joints import Relative
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, parts
from clearance_jax.mechanism.tree.frame import Frame
from clearance_jax.mechanism.tree.moved import FrameStep, Moved, Values, carry, steps
from clearance_jax.mechanism.unfolded import spread, unfold
from clearance_jax.spatial import Matrix, Term, Vector, is_zero, minus, plus, product


class RelativeMotion(NamedTuple):
    """The relative motion in a joint, and its rate for given accelerations."""

    now: Relative
    rate: Relative


def coordinate_values(
    mechanism: PreparedMechanism, time: Scalar, state: State, accelerations: Rows | None = None
) -> Values:
    """The motion of every coordinate that no drive prescribes, by name; free ones without acceleration by default."""
    whole = unfold(mechanism, time, state)
    if accelerations is None:
        return moved_values(whole.mechanism, whole.state, whole.accelerations)
    if not whole.weights:
        return moved_values(mechanism, state, accelerations)
    added = spread(whole.weights, accelerations)
    rates = [plus(given, more) for given, more in zip(whole.accelerations, added, strict=True)]
    return moved_values(whole.mechanism, whole.state, rates)


def moved_values(mechanism: PreparedMechanism, state: State, accelerations: Sequence[Term]) -> Values:
    """The motion of every free coordinate, by name, with these accelerations."""
    return {c.name: Moved(v.start, state.q[q], state.v[v], tuple(accelerations[v])) for c, q, v in parts(mechanism)}


def tree_relative_motions(
    mechanism: PreparedMechanism, time: Scalar, values: Values, joints: Iterable[ClearanceJoint]
) -> dict[str, RelativeMotion]:
    """The relative motion in those clearance joints that are in the tree, by name."""
    joints = [joint for joint in joints if joint.in_tree]
    several = [joint_steps(joint, time, values) for joint in joints]
    motions = (
        [_relative_motion(*args) for args in several] if mechanism.is_plane else side_by_side(_relative_motion, several)
    )
    return {joint.name: at for joint, at in zip(joints, motions, strict=True)}


def motions_together(joints: Sequence[ClearanceJoint], time: Scalar, values: Values) -> RelativeMotion:
    """The relative motions in clearance joints of a tree, along a first axis."""

    def one(*moved):
        now, rate = _relative_motion(*moved)
        return RelativeMotion(as_numbers(now), as_numbers(rate))

    return results_together(one, [joint_steps(joint, time, values) for joint in joints])


def joint_steps(joint: ClearanceJoint, time: Scalar, values: Values) -> tuple[FrameStep, ...]:
    """The steps of a joint's own coordinates. Only their motion: joints are alike whatever the names of their
    coordinates.
    """
    moved = steps(joint.joint.own_coordinates(), time, values)
    return tuple(step._replace(by=step.by._replace(index=-1)) for step in moved)


def _relative_motion(*moved: FrameStep) -> RelativeMotion:
    """The pin's frame relative to the sleeve, after steps in the sleeve's axes."""
    frame = Frame()
    for step in moved:
        frame = carry(frame, step)
    if frame.rotation.is_plane and is_zero(frame.position[2]):
        now = Relative(frame.position, frame.rotation.angle, frame.velocity, frame.spin)
    else:
        now = with_barriers(Relative(frame.position, 0.0, frame.velocity, frame.spin, frame.rotation.rows))
    return RelativeMotion(now, rate_of(now, frame.acceleration, frame.spin_rate))


def rate_of(now: Relative, acceleration: Vector, spin_rate: Vector) -> Relative:
    """The rate of a relative motion."""
    rows = None if now.rows is None else turning_rows(now.spin, now.rows)
    return Relative(now.velocity, now.spin[2] if rows is None else 0.0, acceleration, spin_rate, rows)


def turning_rows(spin: Vector, rows: Matrix) -> Matrix:
    """The rate of a rotation's rows by its spin in the outer axes."""
    x, y, z = spin
    hat = (0.0, minus(0.0, z), y), (z, 0.0, minus(0.0, x)), (minus(0.0, y), x, 0.0)
    return product(hat, rows)


def as_numbers(at: Relative) -> Relative:
    """The relative motion with arrays for constants, except where a plane mechanism has structural zeros."""
    if at.rows is not None:
        return jax.tree.map(lambda x: jnp.asarray(x, float), at)
    x, y, w = (jnp.asarray(term, float) for term in (*at.place[:2], at.spin[2]))
    velocity = jnp.asarray(at.velocity[0], float), jnp.asarray(at.velocity[1], float), 0.0
    return Relative((x, y, 0.0), jnp.asarray(at.angle, float), velocity, (0.0, 0.0, w))
