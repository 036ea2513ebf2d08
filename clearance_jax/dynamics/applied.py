"""What acts on a mechanism beside its joints: springs, loads from outside, actuators and controllers.

Actuators and controllers act by what they measure now; sampled ones by what they measured at the last sampling instant.
"""

from collections.abc import Sequence

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.forms.frames import Frames, Pair
from clearance_jax.dynamics.gaps import gap_actions, gap_efforts
from clearance_jax.dynamics.kinematics import frames, spring_state
from clearance_jax.mechanism.actuators import AbstractActuator, is_instant
from clearance_jax.mechanism.body import GROUND, Motion, Wrench
from clearance_jax.mechanism.followers import Following
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import Acting, State, effort_sources, layout, parts
from clearance_jax.mechanism.tree.compounds import Ball
from clearance_jax.mechanism.unfolded import fold, unfold
from clearance_jax.mechanism.variants import acting
from clearance_jax.spatial import ZERO, Term, dot, minus, plus, scale, total

Measured = dict[str, tuple[Term, Term]]
"""Position and velocity by coordinate, balls aside."""


def measure(mechanism: PreparedMechanism, time: Scalar, state: State) -> Measured:
    """Position and velocity of every coordinate that encoders can see."""
    mechanism, state, *_ = unfold(mechanism, time, state)
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
    """Efforts of actuators, controllers and dampers of balls, by free velocity."""
    whole = unfold(mechanism, time, state)
    efforts = exert_each(whole.mechanism, time, whole.state)
    return fold(whole.weights, efforts, layout(mechanism).free) if whole.weights else efforts


def exert_each(mechanism: PreparedMechanism, time: Scalar, state: State) -> list[Term]:
    """`exert` of a mechanism without couplings."""
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
    for source in every:
        now = command(source, time, seen) if source.period is None else state.memory[source.name]
        if isinstance(source.part, AbstractActuator) and source.part.integrates:
            now = [plus(now[0], source.part.from_integral(state.memory[source.name][0]))]
        for name, effort in zip(source.coordinates, now, strict=True):
            efforts[places[name]] = plus(efforts[places[name]], effort)
    return efforts


def exert_on_driven(mechanism: PreparedMechanism, time: Scalar, state: State) -> dict[str, tuple[Term, Term]]:
    """Efforts of actuators on followers of driven coordinates, by name, with the speeds."""
    led = [c for c in mechanism.coordinates() if isinstance(c.motion, Motion) and isinstance(c.motion.drive, Following)]
    sources = {c.name: [Acting(c.name, (c.name,), actuator) for _, actuator in acting(c.motion)] for c in led}
    seen = measure(mechanism, time, state) if any(sources.values()) else {}
    each = {name: total(command(source, time, seen)[0] for source in by) for name, by in sources.items() if by}
    return {name: (effort, seen[name][1]) for name, effort in each.items()}


def integral_rates(mechanism: PreparedMechanism, time: Scalar, state: State) -> list[Term]:
    """The rates of the integrals of servos: the errors that they see."""
    every = [source for source in effort_sources(mechanism) if source.integrates]
    seen, out = measure(mechanism, time, state) if every else {}, []
    for source in every:
        assert isinstance(source.part, AbstractActuator)
        position, _ = _read(source.part.measures() or source.coordinates, seen)
        out.append(source.part.error(time, jnp.asarray(position, float)))
    return out


def renew(mechanism: PreparedMechanism, time: Scalar, state: State, starts: bool = False) -> list[Term]:
    """The efforts that sampled sources hold: new ones where the time is a sampling instant or a solve starts."""
    seen, out = measure(mechanism, time, state), []
    for source in effort_sources(mechanism):
        if source.period is None:
            continue
        now = [jnp.asarray(effort, float) for effort in command(source, time, seen)]
        fresh = True if starts else is_instant(source.period, time)
        out += [jnp.where(fresh, new, old) for new, old in zip(now, state.memory[source.name], strict=True)]
    return out


def command(source: Acting, time: Scalar, seen: Measured) -> Sequence[Term]:
    """The efforts of an actuator or a controller from a measurement now."""
    if isinstance(source.part, AbstractActuator):
        position, _ = _read(source.part.measures() or source.coordinates, seen)
        _, velocity = _read(source.part.measures_rate() or source.coordinates, seen)
        return [source.part(time, jnp.asarray(position, float), jnp.asarray(velocity, float))]
    # Inverse dynamics of the controller's model, in the order of its references.
    model: PreparedMechanism = source.part.model
    read = {r.name: _read(r.encoder or (r.name,), seen) for r in source.part.references}
    names = [part.coordinate.name for part in parts(model)]
    wanted = dict(zip(read, source.part.accelerations(time, *zip(*read.values(), strict=True)), strict=True))
    q, v = (tuple(jnp.asarray(read[name][i], float) for name in names) for i in (0, 1))
    efforts = inverse_dynamics(model, time, State(q, v, {}), [wanted[name] for name in names])
    efforts = dict(zip(names, efforts, strict=True))
    return [efforts[name] for name in read]


def _read(encoder: Sequence[str], seen: Measured) -> tuple[Term, Term]:
    """Position and velocity that an encoder shows: sums over its coordinates."""
    return total(seen[name][0] for name in encoder), total(seen[name][1] for name in encoder)


def inverse_dynamics(mechanism: PreparedMechanism, time: Scalar, state: State, acceleration: list[Term]) -> list[Term]:
    """The efforts that give a tree's free velocities these rates, in addition to those of its own actuators."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, state)
    missing = motion.load(applied_pairs(mechanism, time, motion), acceleration)
    rubbed = gap_efforts(mechanism, time, state, gap_actions(mechanism, time, state)).free
    exerted = exert(mechanism, time, state)
    return [minus(0.0, total(terms)) for terms in zip(missing, exerted, rubbed, strict=True)]


def applied_pairs(mechanism: PreparedMechanism, time: Scalar, motion: Frames) -> list[Pair]:
    """Wrench pairs of springs and loads."""
    pairs = []
    for spring in mechanism.springs:
        now = spring_state(spring, motion)
        # Along the line through both points the place of application does not matter: one point serves both bodies.
        end = motion[spring.body_b].point(spring.at_b.vector)
        pairs.append(Pair(spring.body_a, spring.body_b, scale(-now.tension, now.along), ZERO, end))
    return pairs + [load_pair(wrench, time, motion) for wrench in mechanism.wrenches]


def load_pair(wrench: Wrench, time: Scalar, motion: Frames) -> Pair:
    """A load as a wrench pair between the ground and its body."""
    frame = motion[wrench.body]
    force, torque = wrench.now(time)
    if wrench.axes == "body":
        force, torque = frame.rotation.apply(force), frame.rotation.apply(torque)
    return Pair(GROUND, wrench.body, force, torque, frame.point(wrench.at.vector))


def load_powers(mechanism: PreparedMechanism, time: Scalar, motion: Frames) -> list[Term]:
    """Power of each load from outside [W]."""
    powers = []
    for wrench in mechanism.wrenches:
        frame, pair = motion[wrench.body], load_pair(wrench, time, motion)
        powers.append(plus(dot(pair.force, frame.velocity_at(pair.at)), dot(pair.torque, frame.spin)))
    return powers
