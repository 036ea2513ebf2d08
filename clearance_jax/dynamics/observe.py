"""Observables of a state."""

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.energy import BALANCE_TERMS, drive_forces, energies, read_balance
from clearance_jax.dynamics.equations import Balance, balance
from clearance_jax.dynamics.reactions import reactions
from clearance_jax.joints import Action
from clearance_jax.laws._friction import speed_of
from clearance_jax.mechanism._base import AbstractMechanism, ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, actuated_coordinates, layout, parts
from clearance_jax.spatial import Term, Vector, add, as_array, length_of, rotation_vector, scale


def observe(time: Scalar, y: Array, mechanism: PreparedMechanism) -> dict[str, Array]:
    """Everything reported of one state. Rows follow the mechanism's own order of coordinates, joints and points."""
    mechanism, plan = mechanism.at(time), layout(mechanism)
    state = plan.split(y)
    now = balance(mechanism, time, state)
    out = coordinate_values(mechanism, time, state) | point_motions(mechanism, now) | contacts(mechanism, now)
    axes = len(axes_of(mechanism))
    exerted = reactions(mechanism, now)
    out["joint_reaction"] = jnp.stack([as_array(w.force[:axes]) for w in exerted])
    if axes == 3:
        out["joint_moment"] = jnp.stack([as_array(w.moment) for w in exerted])
    efforts = drive_forces(mechanism, now)
    if efforts:
        out["drive_force"] = as_array([effort for effort, _ in efforts])
    moved = actuated_coordinates(mechanism)
    if moved:
        out["actuator_effort"] = as_array([now.efforts[part.v.start] for part in moved])
    energy = energies(time, y, mechanism)
    out |= {"kinetic_energy": energy.kinetic, "potential_energy": energy.potential, "elastic_energy": energy.elastic}
    if y.shape[0] > plan.size:
        out |= read_balance(y[plan.size : plan.size + len(BALANCE_TERMS)], energy.contacts)
    return out


def contacts(mechanism: PreparedMechanism, now: Balance) -> dict[str, Array]:
    """By clearance joint: place of the pin (joints, axes), normal force, and the values at its deepest contact
    point.
    """
    if not now.actions:
        return {}
    plays = [now.plays[joint.name].relative for joint in mechanism.clearance_joints()]
    points = [action.deepest for action in now.actions.values()]
    patterns = {}
    if len(axes_of(mechanism)) == 3:
        joints = [joint.clearance.joint for joint in mechanism.clearance_joints()]
        bearing = [joint.pattern(joint.points(at)) for joint, at in zip(joints, plays, strict=True)]
        # A ball has no axis, and does not lean.
        leans = [any(coordinate.turns is not None for coordinate in joint.play()) for joint in joints]
        tilts = [as_array(at.axis[:2]) if leant else jnp.zeros(2) for at, leant in zip(plays, leans, strict=True)]
        patterns = {"contact_pattern": jnp.stack(bearing), "pin_tilt": jnp.stack(tilts)}
    return patterns | {
        "eccentricity": jnp.stack([as_array(at.place[: len(axes_of(mechanism))]) for at in plays]),
        "penetration": jnp.stack([p.penetration for p in points]),
        "penetration_rate": jnp.stack([p.penetration_rate for p in points]),
        "contact_force": jnp.stack([action.normal_force for action in now.actions.values()]),
        "contact_power": jnp.stack([_power(action) for action in now.actions.values()]),
        "friction_force": jnp.stack([_friction(mechanism, now, joint) for joint in mechanism.clearance_joints()]),
        "slip_velocity": jnp.stack([p.slip[0] if len(p.slip) == 1 else speed_of(p.slip) for p in points]),
    }


def _power(action: Action) -> Array:
    """The power that the normal forces of a joint's contacts take from the motion [W]."""
    return jnp.sum(action.points.normal_force * action.points.penetration_rate)


def _friction(mechanism: PreparedMechanism, now: Balance, joint: ClearanceJoint) -> Array:
    """Friction in a joint [N]: with its sign where it has one direction, else the magnitude of all points' together."""
    acted = now.actions[joint.name].points
    if len(acted.traction) == 1:
        return now.actions[joint.name].deepest.traction[0]
    along: Vector = (0.0, 0.0, 0.0)
    tangents = joint.clearance.joint.points(now.plays[joint.name].relative).tangents
    for traction, tangent in zip(acted.traction, tangents, strict=True):
        along = add(along, scale(traction, tangent))
    x, y, z = (jnp.sum(jnp.asarray(term, float)) for term in along)
    return length_of((x, y, z))


def point_motions(mechanism: PreparedMechanism, now: Balance) -> dict[str, Array]:
    """Position, velocity and acceleration of every named point, shape (points, 2), in space (points, 3)."""
    if not mechanism.points:
        return {}
    extra, axes, places, speeds, rates = now.motion.extra(now.acceleration), len(axes_of(mechanism)), [], [], []
    for point in mechanism.points:
        frame = now.motion[point.body]
        at = frame.point(point.at.vector)
        places.append(as_array(at[:axes]))
        speeds.append(as_array(frame.velocity_at(at)[:axes]))
        rates.append(as_array(add(frame.acceleration_at(at), extra.at(point.body, at))[:axes]))
    return {"position": jnp.stack(places), "velocity": jnp.stack(speeds), "acceleration": jnp.stack(rates)}


def coordinate_values(mechanism: PreparedMechanism, time: Scalar, state: State) -> dict[str, Array]:
    """Position and velocity of every elementary coordinate, prescribed ones too; of an orientation its rotation vector
    and its spin.
    """
    free = iter(parts(mechanism))
    q: list[Term] = []
    v: list[Term] = []
    for coordinate in mechanism.coordinates():
        if coordinate.motion.drive is None:
            part = next(free)
            q += rotation_vector(state.q[part.q]) if coordinate.is_ball else state.q[part.q]
            v += state.v[part.v]
        else:
            now = coordinate.motion.drive(time)
            q.append(now[0])
            v.append(now[1])
    return {"q": as_array(q), "v": as_array(v)}


def axes_of(mechanism: AbstractMechanism) -> tuple[str, ...]:
    """The axes along which a mechanism's vectors are reported."""
    return ("x", "y") if mechanism.is_plane else ("x", "y", "z")
