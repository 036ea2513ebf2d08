"""THE vector field, and what can be observed of a state.

`rate` reads as the physics does: where everything is, what the joints exert, the equations of motion, the rates of the
laws' memories, the energy books. The mechanism comes in as an argument, so that nothing is traced again at every solve.
"""

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.dynamics.energy import driving, energies, powers, read_books
from clearance_jax.dynamics.equations import (
    Balance,
    Extra,
    Frames,
    Pair,
    accelerations,
    contact,
    internal_pairs,
    play,
    sleeve_rotation,
)
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.spatial import (
    Term,
    Vector,
    add,
    as_array,
    scale,
    subtract,
)


def rate(time: Scalar, y: Array, mechanism: Mechanism) -> Array:
    """Time derivative of the state `[q, v, memory, books]`."""
    plan = layout(mechanism)
    n = plan.free
    motion = frames(mechanism, time, y)
    contacts = {joint.name: contact(mechanism, joint, motion, y) for joint in mechanism.clearance_joints()}
    pairs = internal_pairs(mechanism, motion, y, contacts)
    balance = accelerations(mechanism, time, y, motion, pairs)
    parts = [y[n : 2 * n], as_array(balance.acceleration), *(c.memory_rate for c in contacts.values())]
    if y.shape[0] > plan.size:
        parts.append(powers(mechanism, time, y, motion, contacts, pairs, balance))
    return jnp.concatenate(parts)


# Observables -------------------------------------------------------------------------------------------------------


def observe(time: Scalar, y: Array, mechanism: Mechanism) -> dict[str, Array]:
    """Everything reported of one state. Rows follow the mechanism's own order of coordinates, joints and points."""
    plan = layout(mechanism)
    motion = frames(mechanism, time, y)
    contacts = {joint.name: contact(mechanism, joint, motion, y) for joint in mechanism.clearance_joints()}
    pairs = internal_pairs(mechanism, motion, y, contacts)
    balance = accelerations(mechanism, time, y, motion, pairs)
    extra = Extra(balance.acceleration)
    out = coordinate_values(mechanism, time, y)
    if mechanism.points:
        places, speeds, rates = [], [], []
        for point in mechanism.points:
            frame = motion[point.body]
            at = frame.point(point.at.vector)
            places.append(as_array(list(at)))
            speeds.append(as_array(list(frame.velocity_at(at))))
            rates.append(as_array(list(add(frame.acceleration_at(at), extra.at(frame, at)))))
        out |= {"position": jnp.stack(places), "velocity": jnp.stack(speeds), "acceleration": jnp.stack(rates)}
    if contacts:
        eccentric = []
        for joint in mechanism.clearance_joints():
            at = play(mechanism, joint, motion, y)
            world = at.rotation.apply(at.eccentricity)
            eccentric.append(as_array(list(sleeve_rotation(joint, motion).undo(world))))
        seen = list(contacts.values())
        out |= {
            "eccentricity": jnp.stack(eccentric),
            "penetration": jnp.stack([c.penetration for c in seen]),
            "penetration_rate": jnp.stack([c.penetration_rate for c in seen]),
            "contact_force": jnp.stack([c.normal_force for c in seen]),
            "friction_force": jnp.stack([c.traction for c in seen]),
            "slip_velocity": jnp.stack([c.slip_velocity for c in seen]),
        }
    out["joint_reaction"] = jnp.stack([as_array(list(f)) for f in reactions(mechanism, motion, pairs, balance)])
    efforts = driving(mechanism, motion, pairs, balance)
    if efforts:
        out["drive_force"] = as_array([effort for effort, _ in efforts])
    out |= energies(time, y, mechanism)
    if y.shape[0] > plan.size:
        out |= read_books(time, y, mechanism)
    return out


def coordinate_values(mechanism: Mechanism, time: Scalar, y: Array) -> dict[str, Array]:
    """Position and velocity of every elementary coordinate, prescribed ones too."""
    n, i = layout(mechanism).free, 0
    q: list[Term] = []
    v: list[Term] = []
    for coordinate in mechanism.coordinates():
        if coordinate.motion.drive is None:
            q.append(y[i])
            v.append(y[n + i])
            i += 1
        else:
            now = coordinate.motion.drive(time)
            q.append(now[0])
            v.append(now[1])
    return {"q": as_array(q), "v": as_array(v)}


def reactions(mechanism: Mechanism, motion: Frames, pairs: list[Pair], balance: Balance) -> list[Vector]:
    """World force on the child in every joint, tree then loops, by the momentum of what hangs on it."""
    extra = Extra(balance.acceleration)
    clearance = {joint.name for joint in mechanism.clearance_joints()}
    by_name = dict(zip([j.name for j in mechanism.clearance_joints()], pairs, strict=False))
    closing = dict(zip([j.name for j in mechanism.closures()], balance.closures, strict=True))
    out: list[Vector] = []
    for joint in mechanism.joints:
        if joint.name in clearance:
            out.append(by_name[joint.name].force)
            continue
        beyond = descendants(mechanism, joint.child)
        force: Vector = (0.0, 0.0)
        for body in mechanism.bodies:
            if body.name in beyond and body.mass is not None:
                frame = motion[body.name]
                centre = frame.point(body.center_of_mass.vector)
                acceleration = add(frame.acceleration_at(centre), extra.at(frame, centre))
                force = add(force, scale(body.mass, subtract(acceleration, mechanism.gravity.vector)))
        for pair in (*pairs, *balance.closures):
            inside = (pair.child in beyond) - (pair.parent in beyond)
            force = subtract(force, scale(float(inside), pair.force))
        out.append(force)
    return out + [(by_name | closing)[loop.name].force for loop in mechanism.loops]


def descendants(mechanism: Mechanism, body: str) -> set[str]:
    """A body and every body that hangs on it."""
    beyond = {body}
    for joint in mechanism.joints:
        if joint.parent in beyond:
            beyond.add(joint.child)
    return beyond
