"""Quasi-static poses: every pin rests under the load that it bears at an instant of the ideal motion.

In a pose the accelerations of the play coordinates are zero while only the ideal mechanism moves: each joint exerts on
its pin what the ideal joint would, with all pins where they are. Rounds of "reactions with the pins held, then seats of
the pins" find it; each round reduces the error by the ratio of clearance to length. Friction of a joint that turns or
slides shifts the load of a seat (`dynamics/reactions`). Newton steps of the whole end the search.

A pose depends on its instant only. The motion differs where pins swing about it or slide to it slowly: see
`frequencies`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax._compile.alike import side_by_side
from clearance_jax.dynamics.closures import StartErrors, project
from clearance_jax.dynamics.deflected import deflect, deflections, drive_frequency, has_drives, hold_drives, released
from clearance_jax.dynamics.reactions import by_joint, determinate, pin_loads
from clearance_jax.dynamics.seated import lowest_frequency
from clearance_jax.dynamics.settled import Seats, is_searched, middle, seats_of, whole_state
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import PreparedClearance
from clearance_jax.joints.seating import FreeMotion, Near, Seating, SeatLoad, held_stiffness, size_of
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, place_rates
from clearance_jax.spatial import as_array

# Rounds that seat pins, from the middle of a sleeve and from between two poses. Each reduces the error by the ratio of
# clearance to length, with friction by its coefficient.
SMOOTH, RUBBED = (2, 1), (6, 3)
# Instant STRIDE i + k is at row i, column k. Columns are searched in this ORDER: the first from the middle of the
# sleeves, the others from between the poses of two known columns, AWAY columns to the left and right.
STRIDE, ORDER, AWAY = 8, (0, 4, 2, 6, 1, 3, 5, 7), (8, 4, 2, 2, 1, 1, 1, 1)
# Newton steps on all joints together: until the part of a load that is not borne is below this, or this many; and those
# of a derivative.
BORNE, STEPS, DIFFERENTIATED = 1e-9, 20, 6
# Newton steps that close the loops of an ideal mechanism from one instant to the next.
CLOSING = 6


class StaticPose(NamedTuple):
    """The pose at an instant: the state `y` with all play at rest, by joint the values of its `play` [m or rad], the
    `ideal` mechanism's state, how far it is from a pose (`errors`), and by joint the stiffness with which it is held
    (`stiffness`, [J] for play in units of its size); `firm`: the state with drives held.
    """

    y: Array
    play: tuple[Array, ...]
    ideal: Array
    errors: StartErrors
    stiffness: tuple[Array, ...]
    firm: Array


def check_driven(mechanism: AbstractMechanism) -> None:
    """**Raises** `ClearanceError` for a mechanism whose poses do not follow from drives, places and slips."""
    if not mechanism.clearance_joints() and not has_drives(mechanism):
        raise ClearanceError(
            "A mechanism without play is where its drives put it, whatever the load. Give a joint clearance, or use "
            '`fidelity = "dynamics"`.'
        ).about("clearance")
    if any(gap.what == "teeth" for gap in mechanism.gaps):
        text = "A quasi-static pose is not known of gears whose teeth load their bearings. Leave out `module` or"
        raise ClearanceError(f'{text} `base_radius`, or use `fidelity = "dynamics"`.').about("fidelity")
    for joint in mechanism.clearance_joints():
        for part in (*joint.clearance.laws, joint.clearance.element):
            if part is not None and not part.has_static_force:
                raise ClearanceError(
                    f"A quasi-static pose needs forces that follow from places and slips, but those of "
                    f"`{type(part).__name__}` in the joint `{joint.name}` depend on what was before, or on how the pin "
                    'moves in its play. Use another one, or `fidelity = "dynamics"`.'
                ).about(joint.name, type(part).__name__)
    for name, _ in layout(mechanism).integrals:
        text = f"A quasi-static pose has no past, but `{name}` is a servo with `integral`. Leave it out, or use "
        raise ClearanceError(text + '`fidelity = "dynamics"`.').about(name)
    ideal = mechanism.intended()
    free, loops = ideal.free_coordinates(), ideal.closures()
    if mechanism.loops and has_drives(mechanism):
        raise ClearanceError(
            "A quasi-static pose of a closed loop is not known where drives give way or couplings have backlash. Use "
            '`fidelity = "dynamics"`.'
        ).about("fidelity")
    bound = 2 * len(loops) if ideal.is_plane else sum(loop.joint_constraint().count for loop in loops)
    if len([name for coordinate in free for name in coordinate.velocities]) > bound:
        raise ClearanceError(
            f"A quasi-static pose follows from drives, but without its play `{free[0].name}` moves freely. Drive it, "
            'or use `fidelity = "dynamics"`.'
        ).about(free[0].name)


def ideal_states(mechanism: PreparedMechanism, times: Float[Array, " times"]) -> Array:
    """The ideal mechanism's states `[q, v]` at increasing times, each found from the one before, shape (times, n)."""
    ideal = determinate(mechanism.intended().without_sampling())
    plan, first = layout(ideal), initial_values(ideal)
    if not ideal.closures():
        return jnp.broadcast_to(first, (times.shape[0], first.shape[0]))

    def next_one(carry, time):
        before, y = carry
        y = project(time, y.at[plan.q].add((time - before) * place_rates(ideal, y)), ideal, CLOSING)
        return (time, y), y

    return jax.lax.scan(next_one, (times[0], project(times[0], first, ideal, CLOSING)), times)[1]


def poses(times: Float[Array, " times"], mechanism: PreparedMechanism, ideal: Float[Array, "times n"]) -> StaticPose:
    """The poses at increasing times, without derivatives, stacked; `ideal`: the ideal mechanism's states then."""
    times, mechanism, ideal = without_derivatives((times, mechanism.without_sampling(), ideal))
    if any(map(is_searched, mechanism.clearance_joints())):
        return _searched(times, mechanism, ideal)
    cold, middles = jnp.asarray(False), tuple(map(middle, mechanism.clearance_joints()))
    return jax.vmap(lambda time, y: _pose(mechanism, cold, time, y, middles))(times, ideal)


def _searched(times: Array, mechanism: PreparedMechanism, ideal: Array) -> StaticPose:
    """`poses` one after another, as a search takes different numbers of steps."""
    count, rows = len(times), -(-len(times) // STRIDE)
    places = jnp.minimum(jnp.arange(rows * STRIDE), count - 1).reshape(rows, STRIDE)
    times, ideal = times[places], ideal[places]
    begin = tuple(jnp.broadcast_to(at, (rows, STRIDE, len(at))) for at in map(middle, mechanism.clearance_joints()))

    def column(play, k_and_away):
        k, away = k_and_away
        known = away < STRIDE  # in all columns but the first
        near = tuple(jnp.where(known, _between(times, values, k, away), values[:, k]) for values in play)
        seated = jax.lax.map(lambda start: _pose(mechanism, known, *start), (times[:, k], ideal[:, k], near))
        both = zip(play, seated.play, strict=True)
        return tuple(jax.lax.dynamic_update_index_in_dim(values, new, k, 1) for values, new in both), seated

    columns = jax.lax.scan(column, begin, (jnp.array(ORDER), jnp.array(AWAY)))[1]
    back = np.argsort(ORDER)
    return jax.tree.map(lambda x: jnp.swapaxes(x[back], 0, 1).reshape(rows * STRIDE, *x.shape[2:])[:count], columns)


def _between(times: Array, play: Array, k: Array, away: Array) -> Array:
    """The play in column k of every row, interpolated between the columns `away` from it. After the last column comes
    the first one of the next row (the last row takes its own).
    """
    next_row = jnp.append(jnp.arange(1, len(times)), len(times) - 1)
    after, play_after = (jnp.concatenate([x, x[next_row][:, :1]], axis=1)[:, k + away] for x in (times, play))
    before, play_before = times[:, k - away], play[:, k - away]
    span = after - before
    part = jnp.where(span > 0, (times[:, k] - before) / jnp.where(span > 0, span, 1.0), 0.0)
    return play_before + part[:, None] * (play_after - play_before)


def _pose(mechanism: PreparedMechanism, known: Flag, time: Scalar, ideal: Array, near: tuple[Array, ...]) -> StaticPose:
    """The pose at a time, searched from play near it if that is known, else from the middle of the sleeves. Drives give
    way to the loads of the ideal mechanism, whose pins are in the middle.
    """
    joints = mechanism.clearance_joints()
    if has_drives(mechanism):
        moved = deflect(time, mechanism)
        pose = _pose(moved.held(), known, time, ideal, near)
        return pose._replace(y=released(moved.mechanism, time, pose.y, moved.places))
    if not joints:
        return StaticPose(ideal, (), ideal, StartErrors.nothing(), (), ideal)
    play, y, loads = _seated(mechanism, known, time, near, ideal)
    step = _stepped(mechanism, time, play, y)
    state = step.state(mechanism, time)
    pressed = [
        (joint.clearance, at, SeatLoad(tuple(force), tuple(moment)))
        for joint, at, (force, moment) in zip(joints, step.play, loads, strict=True)
    ]
    stiffnesses = side_by_side(held_stiffness, pressed)
    stiff = [jnp.where(presses, stiffness, 0.0) for stiffness, presses in zip(stiffnesses, step.pressed, strict=True)]
    errors = StartErrors(step.opened, step.unborne, step.moved)
    return StaticPose(state, step.play, step.y, errors, tuple(stiff), state)


def _seated(
    mechanism: PreparedMechanism, known: Flag, time: Scalar, near: tuple[Array, ...], ideal: Array
) -> tuple[tuple[Array, ...], Array, list[tuple[Array, Array]]]:
    """The play after rounds that seat pins, the ideal state, and the loads of the pins."""
    joints = mechanism.clearance_joints()
    begin = tuple(middle(joint) for joint in joints)
    cold, warm = RUBBED if any(joint.clearance.friction is not None for joint in joints) else SMOOTH

    def once(k, carry):
        play, y, _ = carry
        now = pin_loads(time, mechanism, play, y)
        loads = [load.less(rub) for load, rub in zip(now.loads, now.friction, strict=True)]
        # Otherwise the compiler computes the reactions anew at every use.
        flat = jax.lax.optimization_barrier([(as_array(load.force), as_array(load.moment)) for load in loads])
        seats = seats_of(joints, flat, begin, tuple(Near(at, known | (k > 0)) for at in play))
        return tuple(seat.play for seat in seats), now.y, flat

    nothing = [(jnp.zeros(3), jnp.zeros(3)) for _ in joints]
    return jax.lax.fori_loop(0, jnp.where(known, warm, cold), once, (near, ideal, nothing))


def _stepped(mechanism: PreparedMechanism, time: Scalar, play: tuple[Array, ...], y: Array) -> "NewtonStep":
    """Newton steps of all joints together, until they bear their loads."""

    def goes_on(carry):
        count, step = carry
        return (count < STEPS) & ((count == 0) | (jnp.max(step.unborne) > BORNE))

    def once(carry):
        return carry[0] + 1, newton(time, mechanism, carry[1].play, carry[1].y)

    return jax.lax.while_loop(goes_on, once, (jnp.asarray(0), _unstepped(mechanism, play, y)))[1]


def frequencies(times: Float[Array, " times"], mechanism: PreparedMechanism, at: StaticPose) -> Float[Array, " times"]:
    """The lowest frequencies about poses [Hz], infinite where nothing swings."""
    mechanism = mechanism.without_sampling()
    sizes = [size_of(joint.joint.play()) for joint in mechanism.clearance_joints()]

    def lowest(time, pose):
        moved = deflect(time, mechanism) if has_drives(mechanism) else None
        firm = mechanism if moved is None else moved.held()
        pins = lowest_frequency(firm, time, pose.firm, pose.stiffness, sizes) if sizes else jnp.asarray(jnp.inf)
        if moved is None:
            return pins
        # Dunkerley's bound of the lowest frequency of both together.
        several = jnp.stack([pins, drive_frequency(time, moved)])
        return jnp.where(jnp.all(several > 0), jnp.sum(several**-2.0) ** -0.5, 0.0)

    return jax.vmap(lowest)(*jax.lax.stop_gradient((times, at)))


def displaced(time: Scalar, mechanism: PreparedMechanism, play: tuple[Array, ...], ideal: Array) -> Array:
    """The state `[q, v, memory]` with pins held at values of their play, and drives that do not give way; `ideal`: a
    state near the ideal one.
    """
    if has_drives(mechanism):
        places = dict.fromkeys(deflections(mechanism), 0.0)
        return released(mechanism, time, displaced(time, hold_drives(mechanism, places), play, ideal), places)
    if not play:
        return ideal
    fixed = mechanism.hold_pins(by_joint(mechanism, play))
    ideal = project(time, ideal, fixed, CLOSING) if mechanism.loops else ideal
    still, free = tuple(map(jnp.zeros_like, play)), tuple(jnp.asarray(False) for _ in play)
    return whole_state(mechanism, time, Seats(ideal, play), Seats(place_rates(fixed, ideal), still), free)


def middle_pose(time: Scalar, mechanism: PreparedMechanism, ideal: Array) -> StaticPose:
    """The state of the ideal motion with pins in the middle of their play, for joints that no load presses."""
    play = tuple(jnp.zeros(len(joint.joint.play())) for joint in mechanism.clearance_joints())
    y = displaced(time, mechanism, play, ideal)
    return StaticPose(y, play, ideal, StartErrors.nothing(), (), y)


def with_derivatives(time: Scalar, mechanism: PreparedMechanism, pose: StaticPose) -> Array:
    """The state of a pose with its derivatives, those of further Newton steps: each reduces their error."""
    mechanism = mechanism.without_sampling()
    if has_drives(mechanism):
        moved = deflect(time, mechanism)
        return released(moved.mechanism, time, with_derivatives(time, moved.held(), pose), moved.places)
    if not mechanism.clearance_joints():
        return pose.ideal
    play, ideal = jax.lax.stop_gradient((pose.play, pose.ideal))
    begin = _unstepped(mechanism, play, ideal)
    step = jax.lax.fori_loop(0, DIFFERENTIATED, lambda _, now: newton(time, mechanism, now.play, now.y), begin)
    return step.state(mechanism, time)


def _unstepped(mechanism: PreparedMechanism, play: tuple[Array, ...], y: Array) -> "NewtonStep":
    """A step to begin with, before the first Newton step."""
    each, rates = jnp.zeros(len(play)), jnp.zeros(layout(mechanism.ideal()).q.stop)
    pressed = tuple(jnp.asarray(False) for _ in play)
    return NewtonStep(play, y, rates, jnp.zeros(len(mechanism.loops)), pressed, each, each)


class NewtonStep(NamedTuple):
    """After a Newton step: the play, the ideal state and its rates, how far loops are open [m]; by joint, whether a
    load presses it, the part of the load that it did not bear before, and the part of its play by which it was moved.
    """

    play: tuple[Array, ...]
    y: Array
    rates: Array
    opened: Array
    pressed: tuple[Array, ...]
    unborne: Array
    moved: Array

    def state(self, mechanism: PreparedMechanism, time: Scalar) -> Array:
        """The state `[q, v, memory]` with all play at rest."""
        still = tuple(map(jnp.zeros_like, self.play))
        return whole_state(mechanism, time, Seats(self.y, self.play), Seats(self.rates, still), self.pressed)


def newton(time: Scalar, mechanism: PreparedMechanism, play: tuple[Array, ...], y: Array) -> NewtonStep:
    """One Newton step towards the pose. Its Jacobian (each joint by its own play) is not differentiated."""
    now, joints = pin_loads(time, mechanism, play, y), mechanism.clearance_joints()
    asked = [
        (joint.clearance, middle(joint), load, free, at)
        for joint, load, free, at in zip(joints, now.loads, now.free, play, strict=True)
    ]
    new, pressed, unborne, moved = zip(*side_by_side(_joint_step, asked), strict=True)
    return NewtonStep(tuple(new), now.y, now.rates, now.opened, tuple(pressed), as_array(unborne), as_array(moved))


def _joint_step(clearance: PreparedClearance, start: Array, load: SeatLoad, free: FreeMotion, play: Array) -> tuple:
    """A Newton step of a joint: its play, whether a load presses it, the unborne part, and the part of play moved."""
    size = size_of(clearance.joint.play())
    whole = Seating(clearance, load, size, jnp.ones(len(size), bool), start / size, free)
    x, fixed = play / jax.lax.stop_gradient(size), without_derivatives(whole)
    fixed = fixed._replace(counts=fixed.more_than_round_off())
    left = whole._replace(counts=fixed.counts, size=fixed.size).residual(x)
    change = fixed.inverse(jax.lax.stop_gradient(x)) @ left
    asked = jnp.linalg.norm(jnp.where(fixed.counts, fixed.asked, 0.0))
    missing = jnp.linalg.norm(jax.lax.stop_gradient(jnp.where(fixed.counts, left, 0.0)))
    moved = jnp.linalg.norm(jax.lax.stop_gradient(change))
    unborne = jnp.where(asked > 0, missing / jnp.where(asked > 0, asked, 1.0), 0.0)
    return play - fixed.size * change, jnp.any(fixed.counts), unborne, moved
