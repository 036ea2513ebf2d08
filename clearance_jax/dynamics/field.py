"""The vector field in rows, scalars in and scalars out, with the energies and the balance of work and losses along it.

It reads as the physics does: where everything is, what the joints exert, the equations of motion, the rates of the
laws' memories, the energy balance. The mechanism is an argument, so that no solve traces it again.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Flag, Rows, Scalar
from clearance_jax._compile.alike import each_joint
from clearance_jax._compile.solo import whole
from clearance_jax.dynamics.applied import exert_each, integral_rates, load_powers
from clearance_jax.dynamics.equations import Balance, balance
from clearance_jax.dynamics.forms.coupled import CoupledFrames
from clearance_jax.dynamics.forms.frames import Frames, rotors
from clearance_jax.dynamics.gaps import terms_of
from clearance_jax.dynamics.kinematics import frames, relative_motions, spring_state
from clearance_jax.joints import PreparedClearance
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.followers import relations_of
from clearance_jax.mechanism.gaps import flanks_of
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout, parts, position_rates, vector
from clearance_jax.mechanism.tree.compounds import Ball
from clearance_jax.mechanism.unfolded import unfold
from clearance_jax.mechanism.variants import acting
from clearance_jax.spatial import Term, minus, plus, put, times, total

# Quadratures beside the state. `absorbed_work` is what contacts and dampers take up; less the contacts' elastic energy
# it is the damping loss. The loss itself is not integrated: its rate would contain the rate of the elastic energy, also
# where the force is clipped to zero.
BALANCE_TERMS = ("drive_work", "absorbed_work", "friction_loss", "exchanged")
# Part of all energies that counts as exchanged: a million round-offs, so that one round-off is a residual of 1e-6.
RESTING = 1e6 * float(np.finfo(np.float64).eps)
# Part of the time, to look back over a break: a step starts four round-offs past it, the one before ended four before.
HAIR = 16 * float(np.finfo(np.float64).eps)


def powers(mechanism: PreparedMechanism, time: Scalar, state: State, now: Balance) -> Rows:
    """Rates of the energy balance [W]: work of drives, actuators and loads; work absorbed by normal forces, films and
    dampers; loss in friction; and the sum of absolute powers (the energy exchanged, to judge a residual by).
    """
    prescribed = [times(effort, speed) for effort, speed in drive_forces(mechanism, now)]
    efforts = (*now.on_driven.values(), *zip(now.efforts, state.v, strict=True))
    # The joints' losses are part of the efforts, but not work.
    damped, rubbed = joint_losses(mechanism, time, state)
    actuators = plus(total(times(effort, speed) for effort, speed in efforts), plus(damped, rubbed))
    absorbed: Term = plus(total(action.absorbed_power for action in now.actions.values()), damped)
    friction: Term = plus(total(action.friction_power for action in now.actions.values()), rubbed)
    for spring in mechanism.springs:
        absorbed = plus(absorbed, spring.damping * spring_state(spring, now.motion).rate ** 2)
    # Each by itself: what an actuator or a load gives may be what a prescribed drive takes.
    works = [*prescribed, actuators, *load_powers(mechanism, time, now.motion)]
    exchanged = sum(jnp.abs(jnp.asarray(work)) for work in works) + now.motion.kinetic_exchange(now.acceleration)
    drive = total(works)
    return tuple(jnp.asarray(power, float) for power in (drive, absorbed, friction, exchanged))


def joint_losses(mechanism: PreparedMechanism, time: Scalar, state: State) -> tuple[Term, Term]:
    """Powers lost in damping and in friction of coordinates [W]: of lossy actuators and of balls."""
    mechanism, state, *_ = unfold(mechanism, time, state)
    damped, rubbed = [], []
    for part in parts(mechanism):
        motion = part.coordinate.motion
        if isinstance(motion, Ball) and motion.damping is not None:
            damped.append(motion.damping * sum(spin**2 for spin in state.v[part.v]))
        acts = [actuator for _, actuator in acting(motion)] if isinstance(motion, Motion) else []
        for losses in (actuator.losses(state.v[part.v.start]) for actuator in acts):
            damped.append(losses[0])
            rubbed.append(losses[1])
    return total(damped), total(rubbed)


def drive_forces(mechanism: PreparedMechanism, now: Balance) -> list[tuple[Term, Term]]:
    """Driving force and speed of every prescribed coordinate that follows no other."""
    forces = _prescribed(mechanism, now)
    if not (forces and mechanism.firm_couplings):
        return [*forces.values()]
    needed = carrying_efforts(mechanism, now, forces)
    for name, relation in relations_of(mechanism).items():
        forces.pop(name, None)
        for leader in relation.terms.keys() & forces.keys():
            effort, speed = forces[leader]
            forces[leader] = plus(effort, times(relation.terms[leader], needed[name])), speed
    return [*forces.values()]


def _prescribed(mechanism: PreparedMechanism, now: Balance) -> dict[str, tuple[Term, Term]]:
    """By prescribed coordinate the effort that it needs beside those of its gaps and actuators, and its speed."""
    driven = [c.name for c in mechanism.coordinates() if not c.motion.is_free]
    if not driven:
        return {}
    needed = zip(driven, now.motion.drive_forces([*now.pairs, *now.closing], now.acceleration), strict=True)
    given = {name: plus(now.in_gaps.get(name, 0.0), now.on_driven.get(name, (0.0, 0.0))[0]) for name in driven}
    return {name: (minus(effort, given[name]), speed) for name, (effort, speed) in needed}


def carrying_efforts(
    mechanism: PreparedMechanism, now: Balance, forces: Mapping[str, tuple[Term, Term]], efforts: Sequence[Term] = ()
) -> dict[str, Term]:
    """By follower the effort that makes it follow, without that of what follows it; `forces`: of the prescribed
    coordinates; `efforts`: of actuators on all others.
    """
    moved = [c.name for c in mechanism.moved_coordinates() for _ in c.velocities]
    out = {
        coupling.follower: forces[coupling.follower][0]
        for coupling in mechanism.firm_couplings
        if coupling.follower in forces
    }
    if isinstance(now.motion, CoupledFrames) and len(out) < len(mechanism.firm_couplings):
        load = now.motion.whole_load([*now.pairs, *now.closing], now.acceleration)
        for i in now.motion.followers:
            given = plus(now.in_gaps.get(moved[i], 0.0), efforts[i] if efforts else 0.0)
            out[moved[i]] = minus(0.0, plus(load[i], given))
    return out


def mesh_efforts(mechanism: PreparedMechanism, time: Scalar, state: State, now: Balance) -> list[Term]:
    """By coupling what it exerts on its follower, with what that passes on to its own followers [N m or N]."""
    forces = _prescribed(mechanism, now)
    whole = unfold(mechanism, time, state)
    alone = carrying_efforts(mechanism, now, forces, exert_each(whole.mechanism, time, whole.state))
    done: dict[str, Term] = {}

    def of(name: str) -> Term:
        if name not in done:
            firm = mechanism.firm_couplings
            passed = [times(dict(c.terms)[name], of(c.follower)) for c in firm if name in dict(c.terms)]
            done[name] = plus(alone[name], total(passed))
        return done[name]

    return [
        of(coupling.follower) if coupling.backlash is None else _through_gaps(mechanism, now, coupling)
        for coupling in mechanism.couplings
    ]


def _through_gaps(mechanism: PreparedMechanism, now: Balance, coupling: Coupling) -> Term:
    """What the flanks of a coupling exert on its follower, with their friction."""
    parts: list[Term] = []
    for gap in mechanism.gaps:
        if gap.name in flanks_of(coupling):
            push, rub, _ = now.actions[gap.name].force
            sliding = None if gap.teeth is None else gap.teeth.sliding
            parts.append(times(dict(terms_of(gap))[coupling.follower], push))
            parts += [] if sliding is None else [times(sliding, rub)]
    return total(parts)


class Energies(NamedTuple):
    """Kinetic energy, potential energy of weight, and elastic energy of springs and contacts [J]."""

    kinetic: Scalar
    potential: Scalar
    springs: Scalar
    contacts: Scalar

    @property
    def elastic(self) -> Scalar:
        """Of springs and contacts [J]."""
        return self.springs + self.contacts

    @property
    def total(self) -> Scalar:
        """All together [J]."""
        return self.kinetic + self.potential + self.elastic


@whole
def energies(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Energies:
    """The energies of a state."""
    mechanism = mechanism.at(time)
    state = layout(mechanism).split(y)
    motion = frames(mechanism, time, state)
    kinetic, potential = motion.energies()
    whole = unfold(mechanism, time, state)
    for i, inertia in rotors(whole.mechanism).items():
        kinetic = plus(kinetic, 0.5 * inertia * whole.state.v[i] ** 2)
    springs: Term = 0.0
    for spring in mechanism.springs:
        springs = plus(springs, 0.5 * spring.stiffness * spring_state(spring, motion).elongation ** 2)
    contacts = contact_energy(mechanism, time, y, motion)
    return Energies(*(jnp.asarray(energy, float) for energy in (kinetic, potential, springs, contacts)))


def contact_energy(mechanism: PreparedMechanism, time: Scalar, y: Array, motion: Frames | None = None) -> Term:
    """Elastic energy of the contacts [J]; `motion`: the frames of all bodies, if they are known."""
    joints, motions = mechanism.contacts(), relative_motions(time, y, mechanism, motion)
    stored = [(joint.clearance, at) for joint, at in zip(joints, motions, strict=True)]
    return total(each_joint(PreparedClearance.elastic_energy, stored))


def balance_at_start(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Float[Array, " terms"]:
    """The energy balance of a state in which a solve starts."""
    stored = jnp.asarray(contact_energy(mechanism, time, y), float)
    return jnp.stack([stored if name == "absorbed_work" else jnp.zeros(()) for name in BALANCE_TERMS])


def hand_over(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """A state with the energy balance, where payloads that came or went just before `time` add their energy as work."""
    brought = energies(time, y, mechanism).total - energies(time, y, just_before(mechanism, time)).total
    changed = layout(mechanism).size + np.array([BALANCE_TERMS.index(name) for name in ("drive_work", "exchanged")])
    return put(y, changed, y[changed] + jnp.stack([brought, jnp.abs(brought)]))


def just_before(mechanism: PreparedMechanism, time: Scalar) -> PreparedMechanism:
    """The mechanism with the payloads that it has just before a time."""
    return mechanism.at(time - HAIR * jnp.abs(time))


def read_balance(energy_balance: Float[Array, " terms"], contact: Scalar) -> dict[str, Array]:
    """Work of the drives, losses and exchanged energy since the start [J]; `contact`: the contacts' elastic energy."""
    out: dict[str, Array] = dict(zip(BALANCE_TERMS, energy_balance, strict=True))
    out["damping_loss"] = out.pop("absorbed_work") - contact
    return out


def energy_residual(mechanism: PreparedMechanism, times: tuple, states: tuple) -> Scalar:
    """|energy gained - work of drives + losses| / energy exchanged, between two states with the energy balance.

    A mechanism at rest exchanges nothing, and its round-off must not be divided by that. So the contacts' energy at
    either end counts as exchanged, and a trace (`RESTING`) of all energies. The springs' energy does not count: beside
    a preload of a thousand joules a motion could lose all its energy unseen.
    """
    y = jnp.stack(states)

    def at(end):
        time, y = end
        # A payload that comes or goes just then is handed over by the step that begins there, not by one that ends.
        now = energies(time, y, just_before(mechanism, time))
        return now.total, now.contacts, sum(jnp.abs(part) for part in now)

    # A loop: the program has one copy for both ends, of single numbers.
    whole, contacts, present = jax.lax.map(at, (jnp.stack(times), y))
    size = layout(mechanism).size
    energy_balance = slice(size, size + len(BALANCE_TERMS))
    moved = read_balance(y[1, energy_balance] - y[0, energy_balance], contacts[1] - contacts[0])
    lost = moved["damping_loss"] + moved["friction_loss"]
    exchanged = moved["exchanged"] + jnp.max(contacts) + RESTING * jnp.max(present)
    return jnp.abs(whole[1] - whole[0] - moved["drive_work"] + lost) / jnp.where(exchanged > 0, exchanged, 1.0)


def rate(
    time: Scalar, y: Rows, mechanism: PreparedMechanism, energy_balance: bool = False, counts: Flag | None = None
) -> Rows:
    """The rate of the state `[q, v, memory]` and of any energy balance, whose part is zero where `counts` is false."""
    mechanism = mechanism.at(time)
    state = layout(mechanism).split(y)
    now = balance(mechanism, time, state)
    memory = [rate for action in now.actions.values() for rate in action.memory_rate]
    memory += [*integral_rates(mechanism, time, state), *[jnp.zeros(())] * layout(mechanism).held]
    rates = (*position_rates(mechanism, state.q, state.v), *(jnp.asarray(a, float) for a in now.acceleration), *memory)
    if not energy_balance:
        return rates
    return *rates, *where_it_counts(counts, lambda: powers(mechanism, time, state, now))


def where_it_counts(counts: Flag | None, rows: Callable[[], Rows]) -> Rows:
    """Rates that only some stages of a step need; zeros at the others."""
    if counts is None:
        return rows()
    shapes = jax.eval_shape(rows)
    return jax.lax.cond(counts, rows, lambda: tuple(jnp.zeros(x.shape, x.dtype) for x in shapes))


def slope(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """Time derivative of a state given as one vector `[q, v, memory]`."""
    return vector(rate(time, tuple(y[i] for i in range(layout(mechanism).size)), mechanism))
