"""Quasi-static motions: a pose at every instant of the ideal motion, instead of a solve of the dynamics.

A motion is a grid of poses, and the poses at the sample times. Observers pick among the grid; integrals over the grid
follow Simpson's rule. Poses are found without derivatives. A derivative is that of Newton steps at the poses that are
read, so the derivative of a peak costs one pose and not the grid.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Code, Flag, Scalar
from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.dynamics.pose import (
    StaticPose,
    check_driven,
    frequencies,
    ideal_states,
    middle_pose,
    poses,
    with_derivatives,
)
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import bounds_hold
from clearance_jax.solve.codes import Result
from clearance_jax.solve.settings import STATIC, Settings, evenly
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.start import are_within, has_left, is_possible, leaves_walls
from clearance_jax.solve.steps.interpolate import hermite
from clearance_jax.solve.steps.observers import AbstractObserver, Picked
from clearance_jax.solve.validity import NOT_VALID, Validity, validity_of

# Intervals of the grid; Simpson's rule wants an even number.
INTERVALS = 200
# Times nearer than this part of them are the same.
SAME = 1e-14
# No pose: more than this part of a load is not borne, or a pin was moved last by more than this part of its play; or
# loops were open by more than this part of the largest length before the last step, which squares the opening.
POSED, CLOSED = 1e-4, 1e-8


class PoseTask(NamedTuple):
    """Inputs of a quasi-static motion, varied numbers first; sample times off the grid; each sample's index in all."""

    mechanism: Mechanism
    integrands: tuple
    t0: Array
    t1: Array
    save_at: Array | None
    between: Array
    places: Int[Array, " samples"]


class Poses(NamedTuple):
    """Poses on the grid, with the lowest `frequency` about each [Hz], and at sample times (empty without samples):
    `times` and the poses then; by observer the indices of the grid that it picks, and its values there; whether all are
    poses (`good`), whether a part has left its walls, and how far the motion can be believed (`None`: pins are in the
    middle of their play).
    """

    grid: Array
    on_grid: StaticPose
    frequency: Array
    times: Array
    at_times: StaticPose
    picked: tuple[tuple[Array, Array] | None, ...]
    good: Flag
    left: Flag
    validity: Validity | None


def quasi_static(
    mechanism: Mechanism, t1: Any, settings: Settings, observers: tuple = (), integrands: tuple = ()
) -> Solution:
    """The quasi-static motion from `t0` to `t1`, without energy balance. **Raises** as `check_poses`."""
    check_poses(mechanism, settings)
    asked = PoseTask(mechanism, integrands, settings.t0, t1, settings.save_at, *_beside_grid(settings, t1))
    return _motion(asked, observers=observers, seats=settings.fidelity != STATIC)


def _beside_grid(settings: Settings, t1: Any) -> tuple[Array, Array]:
    """The sample times outside the grid, and the index of each sample. Only equally spaced samples are matched with the
    grid: their number alone decides it, so that another end is not another program.
    """
    times = jnp.zeros(0) if settings.save_at is None else settings.save_at
    count, number = INTERVALS + 1, times.shape[0]
    apart = times, count + jnp.arange(number)
    if number < 2 or any(isinstance(t, Tracer) for t in (settings.t0, t1, times)):
        return apart
    known, even = np.asarray(times), np.asarray(evenly(settings.t0, t1, number))
    if np.any(np.abs(known - even) > SAME * np.max(np.abs(even))):
        return apart
    k = INTERVALS * np.arange(number)
    new = k % (number - 1) != 0
    return jnp.asarray(known[new]), jnp.asarray(np.where(new, count + np.cumsum(new) - 1, k // (number - 1)))


@eqx.filter_custom_jvp
def _motion(asked: PoseTask, *, observers: tuple[AbstractObserver, ...], seats: bool) -> Solution:
    return _valued(asked, observers, seats)[0]


@_motion.def_jvp
def _motion_jvp(primals, tangents, *, observers, seats):
    (asked,), (rates,) = primals, tangents
    return _differentiated(asked, rates, _valued(asked, observers, seats)[1], seats)


@solo_jit
def _differentiated(asked: PoseTask, rates: PoseTask, posed: Poses, seats: bool):
    def middle(time, mechanism, pose):
        return middle_pose(time, mechanism, pose.ideal).y

    def motion(asked):
        return _solution(asked, posed, _states(asked, posed, with_derivatives if seats else middle))

    return eqx.filter_jvp(motion, (asked,), (rates,))


@kept_jit
def _valued(asked: PoseTask, observers: tuple[AbstractObserver, ...], seats: bool) -> tuple[Solution, Poses]:
    posed = _pose_all(asked, observers, seats)
    return _solution(asked, posed, _states(asked, posed)), posed


def _pose_all(asked: PoseTask, observers: tuple, seats: bool) -> Poses:
    asked = without_derivatives(asked)
    ready = asked.mechanism.prepare()
    grid = evenly(asked.t0, asked.t1, INTERVALS + 1)
    count = grid.shape[0]
    times = jnp.concatenate([grid, asked.between])
    order = jnp.argsort(times)
    back, times = jnp.argsort(order), times[order]
    ideal = ideal_states(ready, times)
    at_places = poses if seats else jax.vmap(middle_pose, (0, None, 0))
    every = jax.tree.map(lambda x: x[back], at_places(times, ready, ideal))
    on_grid, at_times = (jax.tree.map(lambda x, part=part: x[part], every) for part in (slice(count), asked.places))
    picked = tuple(observer.among(grid, on_grid.y, ready) for observer in observers)
    good = are_poses(asked.mechanism, every.errors) & bounds_hold(asked.mechanism) & jnp.all(jnp.isfinite(every.y))
    left = jnp.asarray(False)
    if leaves_walls(ready):
        left = jnp.any(jax.vmap(lambda t, y: has_left(ready, t, y))(times[back], every.y))
    frequency = frequencies(grid, ready, on_grid) if seats else jnp.full(count, jnp.nan)
    validity = validity_of(grid, on_grid, frequency, ideal[back][:count], ready) if seats else None
    if validity is not None:
        validity = dataclasses.replace(validity, level=jnp.where(good, validity.level, NOT_VALID))
    return Poses(grid, on_grid, frequency, times[back][asked.places], at_times, picked, good, left, validity)


def are_poses(mechanism: Mechanism, errors: StartErrors) -> Flag:
    """Whether pins rest under their loads, and loops are closed."""
    return is_possible(errors, mechanism, CLOSED, POSED)


class Read(NamedTuple):
    """States read from poses: at both ends, at sample times, and picked; and quadratures at the end and samples."""

    first: Array
    last: Array
    samples: Array
    picks: tuple[Array, ...]
    whole: Float[Array, " quadratures"]
    until: Float[Array, "samples quadratures"]


def _states(asked: PoseTask, posed: Poses, state: Callable[..., Array] | None = None) -> Read:
    """The states that are read from poses; `state`: gives the state of a pose with its derivatives."""
    ready = asked.mechanism.prepare()
    grid = evenly(asked.t0, asked.t1, INTERVALS + 1)
    times = jnp.zeros(0) if asked.save_at is None else asked.save_at

    def at(places):
        return grid[places], jax.tree.map(lambda x: x[places], posed.on_grid)

    # Everything at once, so that what gives a state with its derivatives stands once in the program.
    parts = [at(jnp.array([0, INTERVALS])), *(at(pick[0]) for pick in posed.picked if pick is not None)]
    parts += [(times, posed.at_times)] if times.size else []
    parts += [(grid, posed.on_grid)] if asked.integrands else []
    when, which = jax.tree.map(lambda *each: jnp.concatenate(each), *parts)
    states = which.y if state is None else jax.vmap(state, (0, None, 0))(when, ready, which)
    ends, *states = jnp.split(states, np.cumsum([len(each) for each, _ in parts])[:-1])
    count = len(posed.picked) - posed.picked.count(None)
    picks, samples = tuple(states[:count]), states[count] if times.size else posed.at_times.y
    if not asked.integrands:
        return Read(ends[0], ends[1], samples, picks, jnp.zeros(0), jnp.zeros((times.shape[0], 0)))

    def integrands(time, y):
        return jnp.concatenate([jnp.ravel(f(time, y, ready)) for f in asked.integrands])

    values = jax.vmap(integrands)(grid, states[-1])
    sums = _cumulative(values, (asked.t1 - asked.t0) / INTERVALS)
    return Read(ends[0], ends[1], samples, picks, sums[-1], _between(grid, sums, values, times))


def _cumulative(values: Float[Array, "times k"], h: Scalar) -> Float[Array, "times k"]:
    """Integrals from the first of equally spaced times to each, by the cubic through four values about an interval."""
    inner = (13 * (values[1:-2] + values[2:-1]) - values[:-3] - values[3:]) / 24
    first = (9 * values[0] + 19 * values[1] - 5 * values[2] + values[3]) / 24
    last = (9 * values[-1] + 19 * values[-2] - 5 * values[-3] + values[-4]) / 24
    parts = h * jnp.concatenate([first[None], inner, last[None]])
    return jnp.concatenate([jnp.zeros((1, values.shape[1])), jnp.cumsum(parts, axis=0)])


def _between(grid: Array, sums: Array, values: Array, times: Array) -> Array:
    """Integrals up to times between those of the grid."""
    h = grid[1] - grid[0]
    k = jnp.clip(jnp.searchsorted(grid, times) - 1, 0, INTERVALS - 1)
    part = ((times - grid[k]) / h)[:, None]
    return hermite(sums[k], h * values[k], sums[k + 1], h * values[k + 1], part)


def _solution(asked: PoseTask, posed: Poses, read: Read) -> Solution:
    sampled = asked.save_at is not None
    final = jnp.concatenate([read.last, read.whole])
    y = jnp.concatenate([read.samples, read.until], axis=1) if sampled else final[None]
    picks, picked = iter(read.picks), []
    for pick in posed.picked:
        places, value = (None, None) if pick is None else pick
        picked.append(None if pick is None else Picked(posed.grid[places], next(picks), value))
    return Solution(
        time=asked.save_at if sampled else asked.t1[None],
        y=y,
        initial=jnp.concatenate([read.first, jnp.zeros_like(read.whole)]),
        final=final,
        code=_code(asked, posed),
        steps=jnp.asarray(INTERVALS),
        rejected=jnp.asarray(0),
        cuts=jnp.asarray(0),
        energy_residual=jnp.asarray(jnp.nan),
        end_time=asked.t1,
        records=tuple(None for _ in posed.picked),
        picked=tuple(picked),
        frequencies=posed.frequency,
        validity=posed.validity,
        sampled=sampled,
        energy_balance=False,
    )


def _code(asked: PoseTask, posed: Poses) -> Code:
    code = jnp.where((asked.t1 > asked.t0) & posed.good, int(Result.REACHED_END), int(Result.NO_POSE))
    code = jnp.where(posed.left & (code == 0), int(Result.LEFT), code)
    if asked.save_at is None:
        return code
    return jnp.where(are_within(asked.save_at, (asked.t0, asked.t1)), code, int(Result.SAMPLE_TIMES))


def check_poses(mechanism: Mechanism, settings: Settings) -> None:
    """**Raises** `ClearanceError` for options and mechanisms without a quasi-static motion."""
    if settings.y0 is not None:
        message = 'A quasi-static motion has no initial state: leave `y0` out, or use `fidelity = "dynamics"`.'
        raise ClearanceError(message).about("y0")
    if settings.energy_balance:
        text = 'A quasi-static motion has no energy balance: leave what needs it out, or use `fidelity = "dynamics"`.'
        raise ClearanceError(text).about("energy_balance", True)
    check_driven(mechanism)
