"""The gaps of coordinates in a state: their places with rates, and the efforts of their contacts."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Rows, Scalar
from clearance_jax._compile.alike import each_joint
from clearance_jax._compile.barriers import share
from clearance_jax.dynamics.forms.frames import Frames, Pair
from clearance_jax.dynamics.relative_motion import RelativeMotion, coordinate_values
from clearance_jax.joints import Action, PreparedClearance, Relative
from clearance_jax.mechanism.actuators import Wave
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout, moved_parts
from clearance_jax.mechanism.tree.moved import Moved, motion_of
from clearance_jax.mechanism.unfolded import fold, unfold
from clearance_jax.spatial import ZERO, Term, minus, plus, scale, times


class GapEfforts(NamedTuple):
    """Efforts of gaps: on the free velocities, and on every coordinate with a gap by its name."""

    free: list[Term]
    by_name: dict[str, Term]


def gap_motions(
    mechanism: PreparedMechanism, time: Scalar, state: State, accelerations: Rows | None = None
) -> list[RelativeMotion]:
    """The place in every gap, and its rate for accelerations of the free velocities (default: none)."""
    if not mechanism.gaps:
        return []
    values = coordinate_values(mechanism, time, state, accelerations)
    coordinates = {c.name: c for c in mechanism.coordinates()}
    known = {
        name: motion_of(coordinates[name], time, values)
        for name in {name: None for gap in mechanism.gaps for name in (*gap.coordinates, gap.motor) if name}
    }
    return [_motion(gap, known) for gap in mechanism.gaps]


def terms_of(gap: CoordinateGap) -> list[tuple[str, Term]]:
    """The coordinates of a gap with their factors."""
    return [(name, 1.0 if k is None else k) for name, k in zip(gap.coordinates, gap.factors, strict=True)]


def _motion(gap: CoordinateGap, known: Mapping) -> RelativeMotion:
    place: Term = 0.0 if gap.offset is None else minus(0.0, gap.offset)
    speed: Term = 0.0
    rise: Term = 0.0
    for name, factor in terms_of(gap):
        now = known[name]
        place, speed = plus(place, times(factor, now.q[0])), plus(speed, times(factor, now.v[0]))
        rise = plus(rise, times(factor, now.a[0]))
    if gap.wave is not None:
        error = _error(gap.wave, known[gap.motor])
        place, speed, rise = minus(place, error.value), minus(speed, error.rate), minus(rise, error.rise)
    x, v, a = share(tuple(jnp.asarray(term, float) for term in (place, speed, rise)))
    slid: tuple[Term, ...] = (0.0, 0.0, 0.0)
    if gap.teeth is not None and gap.teeth.sliding is not None:
        turns = ((known[name].q[0], known[name].v[0], known[name].a[0]) for name in gap.coordinates[:2])
        both = zip(*turns, strict=True)
        slid = share(tuple(jnp.asarray(times(gap.teeth.sliding, minus(*each)), float) for each in both))
    here = Relative((x, slid[0], 0.0), 0.0, (v, slid[1], 0.0), ZERO)
    return RelativeMotion(here, Relative((v, slid[1], 0.0), 0.0, (a, slid[2], 0.0), ZERO))


def _error(wave: Wave, motor: Moved) -> "TransmissionError":
    return wave_of(wave, motor.q[0], motor.v[0], motor.a[0])


class TransmissionError(NamedTuple):
    """A transmission error, its rates, and its slope by the motor's coordinate."""

    value: Array
    rate: Array
    rise: Array
    slope: Array


def wave_of(wave: Wave, place: Term, speed: Term, rise: Term) -> TransmissionError:
    """The transmission error where its motor is [rad or m], with its speed and acceleration."""
    n, angle = wave.error_order, wave.error_order * place + wave.error_phase
    value, slope = wave.error * jnp.sin(angle), n * wave.error * jnp.cos(angle)
    return TransmissionError(value, slope * speed, slope * rise - n**2 * value * speed**2, slope)


def gap_actions(mechanism: PreparedMechanism, time: Scalar, state: State) -> dict[str, Action]:
    """What the contacts of the gaps do, by name."""
    seen = gap_motions(mechanism, time, state)
    acting = [
        (gap.clearance, at.now, state.memory.get(gap.name, ())) for gap, at in zip(mechanism.gaps, seen, strict=True)
    ]
    out = dict(zip((gap.name for gap in mechanism.gaps), each_joint(PreparedClearance.act, acting), strict=True))
    lossy = [gap for gap in mechanism.gaps if gap.loss is not None]
    motors = _motors(mechanism, time, state, lossy)
    for gap in lossy:
        effort, speed = _loss(gap, out, motors)
        before = out[gap.name].friction_power
        out[gap.name] = out[gap.name]._replace(friction_power=before + effort * speed)
    return out


def _motors(
    mechanism: PreparedMechanism, time: Scalar, state: State, gaps: Sequence[CoordinateGap]
) -> dict[str, Moved]:
    """The motions of the motors of gaps, by name."""
    values = coordinate_values(mechanism, time, state) if gaps else {}
    coordinates = {c.name: c for c in mechanism.coordinates()}
    return {gap.motor: motion_of(coordinates[gap.motor], time, values) for gap in gaps}


def _loss(gap: CoordinateGap, actions: Mapping[str, Action], motors: Mapping[str, Moved]) -> tuple[Array, Array]:
    """The friction on a gap's motor, and the motor's speed, which it is against."""
    assert gap.loss is not None
    passed, speed = (jnp.asarray(x, float) for x in (actions[gap.name].force[0], motors[gap.motor].v[0]))
    return gap.loss.effort(passed, speed), speed


def gap_efforts(mechanism: PreparedMechanism, time: Scalar, state: State, actions: Mapping[str, Action]) -> GapEfforts:
    """The efforts of the gaps' contacts."""
    by_name: dict[str, Term] = {}
    motors = _motors(mechanism, time, state, [gap for gap in mechanism.gaps if gap.wave or gap.loss])
    for gap in mechanism.gaps:
        if gap.teeth is not None:
            continue
        terms = terms_of(gap)
        if gap.wave is not None:
            terms.append((gap.motor, minus(0.0, _error(gap.wave, motors[gap.motor]).slope)))
        if gap.loss is not None:
            by_name[gap.motor] = minus(by_name.get(gap.motor, 0.0), _loss(gap, actions, motors)[0])
        for name, factor in terms:
            by_name[name] = plus(by_name.get(name, 0.0), times(factor, actions[gap.name].force[0]))
    if not by_name:
        return GapEfforts([0.0] * layout(mechanism).free, by_name)
    whole = unfold(mechanism, time, state)
    every: list[Term] = [0.0] * len(whole.state.v)
    for part in moved_parts(mechanism):
        every[part.v.start] = by_name.get(part.coordinate.name, 0.0)
    efforts = fold(whole.weights, every, layout(mechanism).free) if whole.weights else every
    return GapEfforts(efforts, by_name)


def teeth_pairs(mechanism: PreparedMechanism, motion: Frames, actions: Mapping[str, Action]) -> list[Pair]:
    """The wrench pairs of gears whose teeth load their bearings."""
    pairs = []
    for gap in mechanism.gaps:
        if gap.teeth is not None:
            carrier, (nx, ny) = motion[gap.teeth.carrier], gap.teeth.normal
            # The flank's effort pulls the depth down: on the wheel it pushes along the normal.
            force = carrier.rotation.apply(scale(minus(0.0, actions[gap.name].force[0]), (nx, ny, 0.0)))
            place, lever = carrier.point((*gap.teeth.at, 0.0)), gap.teeth.sliding
            torque = ZERO if lever is None else (0.0, 0.0, times(lever, actions[gap.name].force[1]))
            pairs.append(Pair(gap.teeth.pinion, gap.teeth.wheel, force, torque, place))
    return pairs
