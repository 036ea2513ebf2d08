"""Driving forces, the energies, and the books of work and losses that are integrated along with the motion."""

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.dynamics.equations import (
    Balance,
    Extra,
    Frames,
    Pair,
    contact,
    inertial_load,
    spring_state,
)
from clearance_jax.joints import Contact
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.spatial import (
    Term,
    add,
    as_array,
    dot,
    minus,
    plus,
    times,
    total,
)

# Quadratures in the state. What contacts and dampers absorb, minus what contacts hold elastically, is the damping loss:
# a book of the loss itself would have to follow an elastic energy that a clipped force no longer feels.
BOOKS = ("drive_work", "absorbed_work", "friction_loss", "exchanged")


def powers(
    mechanism: Mechanism,
    time: Scalar,
    y: Array,
    motion: Frames,
    contacts: dict[str, Contact],
    pairs: list[Pair],
    balance: Balance,
) -> Array:
    """Rates of the books: work of drives and actuators, work absorbed by normal forces and dampers, loss in friction,
    and the sum of the absolute powers (the energy exchanged, against which a residual is judged).
    """
    n = layout(mechanism).free
    drive = total(times(effort, speed) for effort, speed in driving(mechanism, motion, pairs, balance))
    for i, coordinate in enumerate(mechanism.free_coordinates()):
        drive = plus(drive, times(coordinate.motion.effort(time, y[i], y[n + i]), y[n + i]))
    absorbed: Term = 0.0
    friction: Term = 0.0
    for joint in mechanism.clearance_joints():
        assert joint.clearance is not None
        now = contacts[joint.name]
        absorbed = plus(absorbed, now.normal_force * now.penetration_rate)
        if joint.clearance.friction is not None:
            friction = plus(friction, -now.traction * now.slip_velocity)
    for spring in mechanism.springs:
        _, speed, _, _ = spring_state(spring, motion)
        absorbed = plus(absorbed, spring.damping * speed * speed)
    kinetic = kinetic_power(mechanism, motion, balance)
    exchanged = jnp.abs(jnp.asarray(drive)) + jnp.abs(jnp.asarray(kinetic))
    return as_array([drive, absorbed, friction, exchanged])


def driving(mechanism: Mechanism, motion: Frames, pairs: list[Pair], balance: Balance) -> list[tuple[Term, Term]]:
    """Driving force and speed of every prescribed coordinate, by d'Alembert on its own column."""
    extra = Extra(balance.acceleration)
    efforts: dict[str, list[Term]] = {}
    owners = prescribed_owners(mechanism)
    for body in mechanism.bodies:
        frame = motion[body.name]
        for key, (column, speed) in zip(owners[body.name], frame.prescribed, strict=True):
            load = inertial_load(mechanism, body, frame, column, extra)
            entry = efforts.setdefault(key, [0.0, speed])
            entry[0] = minus(entry[0], load)
    for pair in (*pairs, *balance.closures):
        for name, sign in ((pair.child, 1.0), (pair.parent, -1.0)):
            other = pair.parent if sign > 0 else pair.child
            if name == GROUND:
                continue
            for key, (column, _) in zip(owners[name], motion[name].prescribed, strict=True):
                if key in owners.get(other, ()):
                    continue
                work = plus(dot(column.velocity_at(pair.at), pair.force), times(column.spin, pair.torque))
                efforts[key][0] = minus(efforts[key][0], times(sign, work))
    # In the order of the coordinates, whatever the order of the bodies.
    return [(efforts[c.name][0], efforts[c.name][1]) for c in mechanism.coordinates() if c.name in efforts]


def prescribed_owners(mechanism: Mechanism) -> dict[str, tuple[str, ...]]:
    """Names of the prescribed coordinates that move each body, in order from the ground."""
    owners: dict[str, tuple[str, ...]] = {GROUND: ()}
    for joint in mechanism.joints:
        own = tuple(c.name for c in joint.coordinates() if not c.motion.is_free)
        owners[joint.child] = owners[joint.parent] + own
    return owners


def kinetic_power(mechanism: Mechanism, motion: Frames, balance: Balance) -> Term:
    """Rate of the kinetic energy."""
    extra = Extra(balance.acceleration)
    power: Term = 0.0
    for body in mechanism.bodies:
        frame = motion[body.name]
        centre = frame.point(body.center_of_mass.vector)
        if body.mass is not None:
            acceleration = add(frame.acceleration_at(centre), extra.at(frame, centre))
            power = plus(power, times(body.mass, dot(acceleration, frame.velocity_at(centre))))
        if body.inertia is not None:
            spin_rate = plus(frame.spin_rate, extra.spin_rate(frame))
            power = plus(power, times(body.inertia, times(spin_rate, frame.spin)))
    return power


def energies(time: Scalar, y: Array, mechanism: Mechanism) -> dict[str, Array]:
    """Kinetic, potential (weight) and elastic (contacts, springs) energy [J]."""
    motion = frames(mechanism, time, y)
    kinetic: Term = 0.0
    potential: Term = 0.0
    for body in mechanism.bodies:
        frame = motion[body.name]
        centre = frame.point(body.center_of_mass.vector)
        if body.mass is not None:
            velocity = frame.velocity_at(centre)
            kinetic = plus(kinetic, times(0.5 * body.mass, dot(velocity, velocity)))
            potential = minus(potential, times(body.mass, dot(mechanism.gravity.vector, centre)))
        if body.inertia is not None:
            kinetic = plus(kinetic, times(0.5 * body.inertia, times(frame.spin, frame.spin)))
    elastic = contact_energy(mechanism, motion, y)
    for spring in mechanism.springs:
        elongation, _, _, _ = spring_state(spring, motion)
        elastic = plus(elastic, 0.5 * spring.stiffness * elongation * elongation)
    return {
        "kinetic_energy": jnp.asarray(kinetic, dtype=float),
        "potential_energy": jnp.asarray(potential, dtype=float),
        "elastic_energy": jnp.asarray(elastic, dtype=float),
    }


def contact_energy(mechanism: Mechanism, motion: Frames, y: Array) -> Term:
    """Elastic energy of the contacts [J]."""
    return total(contact(mechanism, joint, motion, y).elastic_energy for joint in mechanism.clearance_joints())


def opened_books(time: Scalar, y: Array, mechanism: Mechanism) -> Array:
    """A state without books, with books as at the start of a solve."""
    held = contact_energy(mechanism, frames(mechanism, time, y), y)
    return jnp.concatenate([y, as_array([held if name == "absorbed_work" else 0.0 for name in BOOKS])])


def read_books(time: Scalar, y: Array, mechanism: Mechanism) -> dict[str, Array]:
    """Work of the drives, losses, and energy exchanged since the start [J]."""
    books: dict[str, Array] = dict(zip(BOOKS, y[-len(BOOKS) :], strict=True))
    books["damping_loss"] = books.pop("absorbed_work") - contact_energy(mechanism, frames(mechanism, time, y), y)
    return books
