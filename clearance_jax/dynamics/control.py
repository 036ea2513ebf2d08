"""What actuators and controllers exert: of what they measure now, or of what they have measured last and hold."""

from collections.abc import Sequence

import jax.numpy as jnp

from clearance_jax._types import Scalar
from clearance_jax.dynamics.applied import applied_pairs
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.actuators import AbstractActuator
from clearance_jax.mechanism.compounds import Ball
from clearance_jax.mechanism.controllers import AbstractController, Reference
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.sampling import is_instant
from clearance_jax.mechanism.state import Acting, State, effort_sources, layout, parts
from clearance_jax.spatial import Term, minus, plus, total

Measured = dict[str, tuple[Term, Term]]
"""Position and velocity by coordinate, balls aside."""


def measure(mechanism: PreparedMechanism, time: Scalar, state: State) -> Measured:
    """What encoders can see."""
    free = {part.coordinate.name: part for part in parts(mechanism)}
    out: Measured = {}
    for c in mechanism.coordinates():
        if c.motion.drive is not None:
            position, velocity, _ = c.motion.drive(time)
            out[c.name] = position, velocity
        elif not c.is_ball:
            out[c.name] = state.q[free[c.name].q.start], state.v[free[c.name].v.start]
    return out


def exert(mechanism: PreparedMechanism, time: Scalar, state: State) -> list[Term]:
    """What actuators, controllers and the dampers of balls exert, by free velocity."""
    efforts: list[Term] = [0.0] * layout(mechanism).free
    for part in parts(mechanism):
        motion = part.coordinate.motion
        if isinstance(motion, Ball) and motion.damping is not None:
            efforts[part.v] = [-motion.damping * spin for spin in state.v[part.v]]
    every = effort_sources(mechanism)
    if not every:
        return efforts
    places = {part.coordinate.name: part.v.start for part in parts(mechanism)}
    seen = measure(mechanism, time, state)
    for one in every:
        now = command(one, time, seen) if one.period is None else state.memory[one.name]
        for name, effort in zip(one.coordinates, now, strict=True):
            efforts[places[name]] = plus(efforts[places[name]], effort)
    return efforts


def renew(mechanism: PreparedMechanism, time: Scalar, state: State, starts: bool = False) -> list[Term]:
    """What everything that is sampled holds: anew where the time is one of its instants, or where a solve starts."""
    seen, out = measure(mechanism, time, state), []
    for one in effort_sources(mechanism):
        if one.period is None:
            continue
        now = [jnp.asarray(effort, float) for effort in command(one, time, seen)]
        fresh = True if starts else is_instant(one.period, time)
        out += [jnp.where(fresh, new, old) for new, old in zip(now, state.memory[one.name], strict=True)]
    return out


def command(one: Acting, time: Scalar, seen: Measured) -> Sequence[Term]:
    """The efforts of an actuator or a controller that measures now."""
    if isinstance(one.part, AbstractActuator):
        position, velocity = _read(one.part.measures() or one.coordinates, seen)
        return [one.part(time, jnp.asarray(position, float), jnp.asarray(velocity, float))]
    return _compute(one.part, time, seen)


def _read(encoder: Sequence[str], seen: Measured) -> tuple[Term, Term]:
    """Position and velocity that an encoder shows."""
    return total(seen[name][0] for name in encoder), total(seen[name][1] for name in encoder)


def _compute(controller: AbstractController, time: Scalar, seen: Measured) -> list[Term]:
    """Efforts by the inverse dynamics of the controller's model, in the order of its references."""
    model: PreparedMechanism = controller.model
    read = {reference.name: _read(_encoder(reference), seen) for reference in controller.references}
    names = [part.coordinate.name for part in parts(model)]
    wanted = dict(zip(read, controller.accelerations(time, *zip(*read.values(), strict=True)), strict=True))
    state = State(
        tuple(jnp.asarray(read[name][0], float) for name in names),
        tuple(jnp.asarray(read[name][1], float) for name in names),
        {},
    )
    efforts = dict(zip(names, inverse_dynamics(model, time, state, [wanted[name] for name in names]), strict=True))
    return [efforts[name] for name in read]


def _encoder(reference: Reference) -> tuple[str, ...]:
    return reference.encoder or (reference.name,)


def inverse_dynamics(mechanism: PreparedMechanism, time: Scalar, state: State, acceleration: list[Term]) -> list[Term]:
    """The efforts that give a tree's free velocities these rates, beside what its own actuators exert."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, state)
    missing = motion.load(applied_pairs(mechanism, time, motion), acceleration)
    own = exert(mechanism, time, state)
    return [minus(0.0, plus(load, effort)) for load, effort in zip(missing, own, strict=True)]
