"""Drives that give way, and couplings with backlash, under load: deflected, on the flanks that bear it.

Drives are held at trial deflections, as if prescribed, and couplings at trial places in their gaps. The mechanism then
says which effort each must exert (`drive_forces`, `mesh_efforts`), with all that acts on it: weight, motion, loops,
friction. The place at which a flank gives that effort is the next trial. A deflection changes the loads by about its
own angle, so that a few rounds are exact. A gap that nothing loads stays in the middle.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.small_matrices import small_eigh
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.applied import measure
from clearance_jax.dynamics.closures import assemble
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.field import drive_forces, mesh_efforts
from clearance_jax.dynamics.gaps import gap_motions, wave_of
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import TOUCHING
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.actuators import DriveSpring
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, parts
from clearance_jax.mechanism.variants import DRIVE, gives_way, motor_of, rigid, without_gaps
from clearance_jax.spatial import Term, as_array, plus, times, total

# Rounds of loads and deflections. Each reduces the error by the change of a load by a deflection over the stiffness.
ROUNDS = 24
# A place that the last round still moves by more than this part of it is not found: the start is then refused.
FOUND, SMALLEST = 1e-6, 1e-12


class Deflected(NamedTuple):
    """A mechanism whose couplings with backlash have their loaded flanks as `offset`, and the `places` of its drives'
    deflections by coordinate [rad or m].
    """

    mechanism: PreparedMechanism
    places: dict[str, Scalar]

    def held(self) -> PreparedMechanism:
        """The mechanism with its drives held there."""
        return hold_drives(self.mechanism, self.places)


def deflect(time: Scalar, mechanism: PreparedMechanism) -> Deflected:
    """The mechanism with drives that give way deflected by their loads, and gaps on the flanks that bear them.

    **Raises:** `ClearanceError` for flanks without a place of rest.
    """
    mechanism = mechanism.without_sampling()
    for gap in mechanism.gaps:
        if gap.what != "friction" and not gap.clearance.normal.law.has_static_force:
            law = type(gap.clearance.normal.law).__name__
            text = f"How far `{law}` of `{gap.name}` has given way before is not known. Begin otherwise than settled."
            raise ClearanceError(text).about(gap.name, law)
    springs = springs_of(mechanism)
    meshes = [coupling.name for coupling in mechanism.couplings if coupling.backlash is not None]

    def put(at: Array) -> Deflected:
        rests = dict(zip(meshes, at[len(springs) :], strict=True))
        couplings = tuple(
            dataclasses.replace(c, offset=c.offset + rests[c.name]) if c.name in rests else c
            for c in mechanism.couplings
        )
        places = dict(zip(springs, at[: len(springs)], strict=True))
        return Deflected(dataclasses.replace(mechanism, couplings=couplings), places)

    def once(_, at: Array) -> Array:
        fixed = put(at).held().ideal()
        y = closed(fixed, time)
        state = layout(fixed).split(jnp.concatenate([y, jnp.zeros(layout(fixed).remembered)]))
        now = balance(fixed, time, state)
        followers = {coupling.follower for coupling in fixed.firm_couplings}
        named = [c.name for c in fixed.coordinates() if not c.motion.is_free and c.name not in followers]
        needed = dict(zip(named, (effort for effort, _ in drive_forces(fixed, now)), strict=True))
        seen = measure(fixed, time, state)
        after = [_deflection(spring, needed[name], seen[motor_of(name)]) for name, spring in springs.items()]
        if meshes:
            exerted = dict(zip((c.name for c in fixed.couplings), mesh_efforts(fixed, time, state, now), strict=True))
            gaps = {gap.name: gap for gap in mechanism.gaps}
            # Teeth that load their bearings start in the middle of their gap.
            after += [_seat(gaps[name], exerted[name]) if name in gaps else 0.0 for name in meshes]
        return as_array(after)

    def again(k: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        after = once(k, now[0])
        return after, jnp.abs(after - now[0])

    begin = jnp.zeros(len(springs) + len(meshes))
    if not begin.size:
        return put(begin)
    at, change = jax.lax.fori_loop(0, ROUNDS, again, (begin, begin))
    return put(jnp.where(jnp.all(change <= FOUND * jnp.abs(at) + SMALLEST), at, jnp.nan))


def springs_of(mechanism: AbstractMechanism) -> dict[str, DriveSpring]:
    """By coordinate the springs of drives that give way."""
    moved = [c for c in mechanism.moved_coordinates() if gives_way(c.motion)]
    return {c.name: next(a for a in c.motion.actuators if isinstance(a, DriveSpring)) for c in moved}


def _deflection(spring: DriveSpring, effort: Term, motor: tuple[Term, Term]) -> Array:
    """The deflection at which the spring of a drive exerts an effort on its link, for place and speed of the motor."""
    size, half = jnp.abs(jnp.asarray(effort, float)), 0.5 * (0.0 if spring.backlash is None else spring.backlash)
    depth = spring.flank.depth(size)
    loaded = jnp.where(depth > TOUCHING * half, half + depth, 0.0)
    place = spring.rest + jnp.where(jnp.asarray(effort) > 0, -loaded, loaded)
    return place if spring.wave is None else place + wave_of(spring.wave, *motor, 0.0).value


def _seat(gap: CoordinateGap, effort: Term) -> Array:
    """The place in a gap at which its flanks exert an effort; the middle where nothing loads it."""
    (place, _), pressed = gap.clearance.seat((jnp.asarray(effort, float), jnp.zeros(())))
    return jnp.where(pressed, place, 0.0)


def closed(mechanism: PreparedMechanism, time: Scalar) -> Array:
    """The initial positions and velocities of a mechanism without play, its loops closed."""
    y = engage(mechanism, time, initial_values(mechanism))
    if not (mechanism.loops and mechanism.assemble):
        return y
    whole = jnp.concatenate([y, jnp.zeros(layout(mechanism).remembered)])
    return assemble(time, whole, mechanism.as_small_program())[0][: y.shape[0]]


def has_drives(mechanism: AbstractMechanism) -> bool:
    """Whether drives give way, or couplings have backlash."""
    gives = any(gives_way(c.motion) for c in mechanism.moved_coordinates())
    return gives or any(coupling.backlash is not None for coupling in mechanism.couplings)


def deflections(mechanism: AbstractMechanism) -> dict[str, Scalar]:
    """The deflections of drives that give way, by coordinate, as a mechanism starts with them."""
    return {c.name: c.motion.position for c in mechanism.moved_coordinates() if gives_way(c.motion)}


def hold_drives(mechanism: PreparedMechanism, places: Mapping[str, Term]) -> PreparedMechanism:
    """The mechanism with drives that do not give way, held at deflections by coordinate, and couplings without backlash
    (at their `offset`); without stops.
    """
    at = {DRIVE.format(name): place for name, place in places.items()}
    firm = mechanism._with_joints(lambda joint: rigid(without_gaps(joint), at))
    return firm._without_gaps()


def released(
    mechanism: PreparedMechanism, time: Scalar, y: Array, places: Mapping[str, Term], given: bool = False
) -> Array:
    """The state of a mechanism from that of the one whose drives are held at `places` (`hold_drives`). `given`: as the
    mechanism's own initial values say, apart from what is held; else at rest, with the flanks as they touch.
    """
    firm, plan, first = layout(hold_drives(mechanism, places)), layout(mechanism), initial_values(mechanism)
    names = (*plan.positions, *(f"{name}'" for name in plan.velocities))
    known = dict(zip(names, first, strict=True)) if given else {}
    known |= {name: jnp.asarray(place, float) for name, place in places.items()}
    known |= {name: y[i] for i, name in enumerate((*firm.positions, *(f"{name}'" for name in firm.velocities)))}
    moved = engage(mechanism, time, as_array([known.get(name, 0.0) for name in names]))
    memory = [jnp.zeros(len(gap.clearance.remembers)) for gap in mechanism.gaps]
    touched = jnp.concatenate([jnp.zeros(0), *memory]) if given else as_array(touching_gaps(mechanism, time, moved))
    kept = sum(len(names) for joint, names in firm.memories if joint in {j.name for j in mechanism.clearance_joints()})
    return jnp.concatenate([moved, y[firm.v.stop : firm.v.stop + kept], touched])


def drive_frequency(time: Scalar, deflected: Deflected) -> Array:
    """The lowest frequency [Hz] of the springs of deflected drives, with pins held; 0 where a gap is unloaded; infinite
    without springs.
    """
    springs, places = springs_of(deflected.mechanism), deflected.places
    if not springs:
        return jnp.asarray(jnp.inf)
    ideal = deflected.mechanism.ideal().without_sampling()
    by_name = {part.coordinate.name: part for part in parts(ideal)}
    chosen = [by_name[name] for name in springs]
    y = initial_values(ideal).at[np.array([part.q.start for part in chosen])].set(jnp.stack([*places.values()]))
    state = layout(ideal).split(jnp.concatenate([y, jnp.zeros(layout(ideal).remembered)]))
    inertia = frames(ideal.at(time), time, state).mass_matrix()
    stiff = []
    for name, spring in springs.items():
        half = 0.0 if spring.backlash is None else 0.5 * spring.backlash
        depth = jnp.abs(places[name] - spring.rest) - half
        firm = jax.grad(spring.flank.curve.effort)(jnp.maximum(depth, 0.0))
        stiff.append(firm if spring.backlash is None else jnp.where(depth > 0, firm, 0.0))
    root, speeds = jnp.sqrt(jnp.stack(stiff)), np.array([part.v.start for part in chosen])

    def accelerations(force: Array) -> Array:
        return as_array(inertia.solve([force[i] for i in range(layout(ideal).free)]))

    inverse = jax.vmap(accelerations)(jnp.eye(layout(ideal).free)[speeds])[:, speeds]
    squares, _ = small_eigh(root[:, None] * inverse * root[None, :])
    return jnp.sqrt(jnp.maximum(squares[0], 0.0)) / (2 * jnp.pi)


def engage(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Array:
    """The state with every follower with backlash where its coupling has it, and what the state says beyond that."""
    meshes = {c.follower: c for c in mechanism.couplings if c.backlash is not None}
    if not meshes:
        return y
    plan, firm = layout(mechanism), {c.follower: c for c in mechanism.firm_couplings}
    states = {part.coordinate.name: (part.q.start, plan.v.start + part.v.start) for part in parts(mechanism)}
    drives = {c.name: c.motion.drive for c in mechanism.coordinates() if c.motion.drive is not None}
    springs, done = springs_of(mechanism), {}

    def of(name: str) -> tuple[Term, Term]:
        if name not in done:
            if name in drives:
                done[name] = drives[name](time)[:2]
                return done[name]
            motion: tuple[Term, Term] = (0.0, 0.0)
            if name in states:
                motion = y[states[name][0]], y[states[name][1]]
            coupling = meshes.get(name, firm.get(name))
            if coupling is not None:
                factors = [*coupling.terms, *((motor_of(n), k) for n, k in coupling.terms if n in springs)]
                led = [(of(leader), ratio) for leader, ratio in factors]
                place = plus(coupling.offset, total(times(ratio, at) for (at, _), ratio in led))
                motion = plus(motion[0], place), plus(motion[1], total(times(ratio, v) for (_, v), ratio in led))
            done[name] = motion
        return done[name]

    for name in meshes:
        (q, v), (place, speed) = states[name], of(name)
        y = y.at[q].set(place).at[v].set(speed)
    return y


def touching_gaps(mechanism: PreparedMechanism, time: Scalar, y: Array) -> list[Array | float]:
    """The first memory of the gaps' laws in a state: which flank touches."""
    state = layout(mechanism).split(jnp.concatenate([y, jnp.zeros(layout(mechanism).size - y.shape[0])]))
    memory: list[Array | float] = []
    for gap, at in zip(mechanism.gaps, gap_motions(mechanism, time, state), strict=True):
        depth, _ = gap.clearance.depths(at.now)
        touches, width = jnp.where(depth > 0, 1.0, 0.0), len(gap.clearance.remembers) // depth.shape[0]
        named = enumerate(gap.clearance.remembers)
        memory += [touches[i // width] if name.startswith("touching") else 0.0 for i, name in named]
    return memory
