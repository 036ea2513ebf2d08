"""Drives that give way, and gears with backlash, under the load of the start: deflected, on the flank that bears it.

The ideal mechanism has no backlash. Its springs and couplings are put where the loaded flanks are (`DriveSpring.rest`,
by half a gap; `Coupling.offset`, by the place in the gap), so its loads are those of the settled mechanism. A gap that
nothing loads starts in the middle.
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
from clearance_jax.dynamics.applied import Measured, measure
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.field import mesh_efforts, slope
from clearance_jax.dynamics.gaps import gap_motions, wave_of
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.actuators import DriveSpring
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import StateSlices, initial_values, layout, parts
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.variants import DRIVE, gives_way, motor_of, rigid, with_motions, without_gaps
from clearance_jax.spatial import Term, as_array, plus, times

# Newton's iterations for the deflections. The problem is nearly linear: the second one changes round-off only. Two more
# make first and second derivatives right.
DEFLECTIONS = 4
# Rounds of loads and flanks. A flank moves its link by half a gap, and changes the loads by about that angle.
ROUNDS = 4


def deflect(time: Scalar, mechanism: PreparedMechanism) -> PreparedMechanism:
    """The mechanism with drives that give way deflected, so that they do not accelerate while joints are ideal, and
    with gaps on the flanks that bear the load.
    """
    springs = _springs(mechanism.ideal())
    gaps = [gap for gap in mechanism.gaps if gap.is_play or gap.wave is not None]
    if not springs and not gaps:
        return mechanism
    places = np.array([part.q.start for part in springs], int)
    begin = Flanks(initial_values(mechanism.ideal())[places], jnp.zeros(len(gaps)), jnp.zeros(len(gaps)))
    if not gaps:
        return _put(mechanism, gaps, begin._replace(deflections=_deflections(time, mechanism, begin.deflections)))

    def once(_, now: Flanks) -> Flanks:
        moved = _put(mechanism, gaps, now)
        moved = _put(mechanism, gaps, now._replace(deflections=_deflections(time, moved, now.deflections)))
        return _flanks(time, mechanism, moved, gaps, places)

    now = jax.lax.fori_loop(0, ROUNDS, once, begin)
    return _put(mechanism, gaps, now)


class Flanks(NamedTuple):
    """The deflections of drives [rad or m]; by gap the place of the middle of its flank, and of rest [rad or m]."""

    deflections: Array
    middles: Array
    rests: Array


def _springs(ideal: PreparedMechanism) -> list[StateSlices]:
    return [part for part in parts(ideal) if gives_way(part.coordinate.motion)]


def _deflections(time: Scalar, mechanism: PreparedMechanism, begin: Array) -> Array:
    """The deflections at which the load accelerates no spring of the ideal mechanism."""
    ideal = mechanism.ideal().without_sampling().as_small_program()
    springs, first = _springs(ideal), initial_values(ideal)
    if not springs:
        return begin
    places, speeds = (np.array([getattr(part, which).start for part in springs]) for which in "qv")

    def accelerations(x: Array) -> Array:
        return slope(time, first.at[places].set(x), ideal)[layout(ideal).v][speeds]

    def newton(_, x):
        stiff = jax.lax.stop_gradient(jax.jacfwd(accelerations)(jax.lax.stop_gradient(x)))
        return x - jnp.linalg.solve(stiff, accelerations(x))

    return jax.lax.fori_loop(0, DEFLECTIONS, newton, begin)


def _flanks(
    time: Scalar, given: PreparedMechanism, moved: PreparedMechanism, gaps: list[CoordinateGap], places: np.ndarray
) -> Flanks:
    """The flanks that bear the efforts of a mechanism whose springs and couplings are `moved`."""
    ideal = moved.ideal().without_sampling()
    y = initial_values(ideal)
    # The springs' efforts on their links, and those of the meshes.
    pull: dict[str, Term] = {
        DRIVE.format(c.name): spring(time, jnp.asarray(c.motion.position, float), jnp.zeros(()))
        for c in (part.coordinate for part in _springs(ideal))
        for spring in c.motion.actuators
        if isinstance(spring, DriveSpring)
    }
    if any(coupling.backlash is not None for coupling in given.couplings):
        state = layout(ideal).split(y)
        meshes = mesh_efforts(ideal, time, state, balance(ideal, time, state))
        pull |= dict(zip((c.name for c in ideal.couplings), meshes, strict=True))
    whole = jnp.concatenate([initial_values(moved), jnp.zeros(layout(moved).remembered)])
    seen = measure(moved, time, layout(moved).split(whole))
    seats = [_seat(gap, jnp.asarray(pull[gap.name], float), seen) for gap in gaps]
    return Flanks(y[places], *(jnp.stack(several) for several in zip(*seats, strict=True)))


def _seat(gap: CoordinateGap, effort: Array, seen: Measured) -> tuple[Array, Array]:
    """The place of the middle of the flank that gives an effort, that of the gap where nothing loads it; and the place
    of rest.
    """
    error = jnp.zeros(())
    if gap.wave is not None:
        place, speed = seen[gap.motor]
        error = wave_of(gap.wave, place, speed, 0.0).value
    if not gap.is_play:
        return error, error
    (place, _), pressed = gap.clearance.seat((effort, jnp.zeros(())))
    side = jnp.where(pressed, -jnp.sign(effort), 0.0)
    return error + side * gap.size, error + jnp.where(pressed, place, 0.0)


def _put(mechanism: PreparedMechanism, gaps: list[CoordinateGap], flanks: Flanks) -> PreparedMechanism:
    """The mechanism with its springs deflected; the ideal one has its springs and couplings where the flanks are."""
    at = {part.coordinate.name: flanks.deflections[i] for i, part in enumerate(_springs(mechanism.ideal()))}
    middles, rests = ({gap.name: each[i] for i, gap in enumerate(gaps)} for each in (flanks.middles, flanks.rests))

    def change(c: Coordinate) -> Motion:
        if c.name not in at:
            return c.motion
        rest = middles.get(DRIVE.format(c.name))
        actuators = tuple(
            dataclasses.replace(spring, rest=rest) if isinstance(spring, DriveSpring) and rest is not None else spring
            for spring in c.motion.actuators
        )
        return dataclasses.replace(c.motion, position=at[c.name], actuators=actuators)

    joints = tuple(with_motions(joint, change) for joint in mechanism.joints)
    couplings = tuple(
        dataclasses.replace(c, offset=c.offset + rests[c.name]) if c.name in rests else c for c in mechanism.couplings
    )
    return dataclasses.replace(mechanism, joints=joints, couplings=couplings)


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


def released(mechanism: PreparedMechanism, time: Scalar, y: Array, places: Mapping[str, Term]) -> Array:
    """The state of a mechanism from that of the one whose drives are held at `places` (`hold_drives`)."""
    held, plan = layout(hold_drives(mechanism, places)), layout(mechanism)
    known = {name: y[i] for i, name in enumerate((*held.positions, *(f"{name}'" for name in held.velocities)))}
    known |= {name: jnp.asarray(place, float) for name, place in places.items()}
    names = (*plan.positions, *(f"{name}'" for name in plan.velocities))
    moved = engage(mechanism, time, as_array([known.get(name, 0.0) for name in names]))
    return jnp.concatenate([moved, y[held.v.stop :], as_array(touching_gaps(mechanism, time, moved))])


def drive_frequency(time: Scalar, mechanism: PreparedMechanism) -> Array:
    """The lowest frequency [Hz] of the springs of a deflected mechanism, with pins held; 0 where a gap is unloaded;
    infinite without springs.
    """
    ideal = mechanism.ideal().without_sampling()
    springs = _springs(ideal)
    if not springs:
        return jnp.asarray(jnp.inf)
    state = layout(ideal).split(initial_values(ideal))
    inertia = frames(ideal.at(time), time, state).mass_matrix()
    places, stiff = np.array([part.v.start for part in springs]), []
    gaps = {gap.name: gap for gap in mechanism.gaps if gap.is_play}
    for part in springs:
        c, x = part.coordinate, jnp.asarray(part.coordinate.motion.position, float)
        spring = next(s for s in c.motion.actuators if isinstance(s, DriveSpring))
        firm = -jax.grad(lambda x, s=spring: s(time, x, jnp.zeros(())))(x)
        gap = gaps.get(DRIVE.format(c.name))
        stiff.append(firm if gap is None else jnp.where(jnp.abs(x) > gap.size, firm, 0.0))
    root = jnp.sqrt(jnp.maximum(jnp.stack(stiff), 0.0))

    def accelerations(force: Array) -> Array:
        return as_array(inertia.solve([force[i] for i in range(layout(ideal).free)]))

    unit = jnp.eye(layout(ideal).free)[places]
    inverse = jax.vmap(accelerations)(unit)[:, places]
    squares, _ = small_eigh(root[:, None] * inverse * root[None, :])
    return jnp.sqrt(jnp.maximum(squares[0], 0.0)) / (2 * jnp.pi)


def engage(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Array:
    """The state with every follower with backlash where its coupling has it, and what the state says beyond that."""
    meshes = {c.follower: c for c in mechanism.couplings if c.backlash is not None}
    if not meshes:
        return y
    plan = layout(mechanism)
    places = {part.coordinate.name: (part.q.start, plan.v.start + part.v.start) for part in parts(mechanism)}
    drives = {c.name: c.motion.drive for c in mechanism.coordinates() if c.motion.drive is not None}
    springs, done = {*deflections(mechanism)}, {}

    def leaders(coupling: Coupling) -> list[tuple[str, Scalar]]:
        """The coordinates that a follower follows, the motors of links whose drives give way among them."""
        motors = [(motor_of(leader), ratio) for leader, ratio in coupling.terms if leader in springs]
        return [*coupling.terms, *motors]

    def of(name: str) -> tuple[Term, Term]:
        if name in drives:
            return drives[name](time)[:2]
        if name not in done:
            motion: tuple[Term, Term] = y[places[name][0]], y[places[name][1]]
            if name in meshes:
                place, speed = plus(motion[0], meshes[name].offset), motion[1]
                for leader, factor in leaders(meshes[name]):
                    at, moving = of(leader)
                    place, speed = plus(place, times(factor, at)), plus(speed, times(factor, moving))
                motion = jnp.asarray(place, float), jnp.asarray(speed, float)
            done[name] = motion
        return done[name]

    for name in meshes:
        (q, v), (place, speed) = places[name], of(name)
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
