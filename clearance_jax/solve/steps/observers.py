"""Observers, which watch a motion step by step while it is solved: peaks of signals, counts of impacts."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._compile.barriers import with_barriers
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.solve.steps.interpolate import tops
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.step import SolvedStep


class Picked(NamedTuple):
    """States that an observer has picked: at `time` [s], shape (k,); `y`, shape (k, n); `value`, shape (k,): the signal
    there, without derivatives, before states of a mechanism with closures are projected.
    """

    time: Float[Array, " k"]
    y: Float[Array, "k *rows n"]
    value: Float[Array, " k"]


class AbstractObserver(Module):
    """Watches a solve step by step. Its record begins with `start`; every accepted step makes a new record.

    States are stacks where the problem varies (see `variation`), so picked states have their derivatives.
    """

    @property
    def longest(self) -> Any:
        """The longest step in which the observer misses nothing [s]."""
        return jnp.inf

    @abc.abstractmethod
    def start(self, t0: Array, y0: Array, problem: Problem) -> Any:
        """The record before the first step."""

    @abc.abstractmethod
    def __call__(self, record: Any, step: SolvedStep, problem: Problem) -> Any:
        """The record after a step."""

    def finish(self, record: Any) -> tuple[Any, Picked | None]:
        """The record for the solution, without states, and the picked states."""
        return record, None

    def among(self, times: Array, y: Array, mechanism: PreparedMechanism) -> tuple[Array, Array]:
        """Indices and values of the states it picks among separate ones. **Raises** `ClearanceError` if it follows
        steps.
        """
        raise ClearanceError(
            f"{type(self).__name__} follows a motion step by step, and quasi-static poses have none: use "
            '`fidelity = "dynamics"`.'
        ).about(type(self).__name__)


class SignalPeaks(NamedTuple):
    """The highest peaks so far, the highest first: time [s], value (minus infinity: none yet), state."""

    time: Array
    value: Array
    y: Array

    def highest(self, time, value, y) -> "SignalPeaks":
        """The highest of these and more peaks (leading axis); their number stays."""
        time, value, y = (jnp.concatenate([a, b]) for a, b in zip(self, (time, value, y), strict=True))
        count, value = self.value.shape[0], jnp.where(jnp.isnan(value), -jnp.inf, value)
        top = jnp.argmax(value)[None] if count == 1 else _largest(value, count)
        return SignalPeaks(time[top], value[top], y[top])


def _largest(value: Array, count: int) -> Array:
    """Indices of the `count` largest numbers, the largest first; of equals the first. For few numbers, comparing each
    with each is cheaper than a sort, which is a separate call in every step.
    """
    i = jnp.arange(value.shape[0])
    before = (value[None] > value[:, None]) | ((value[None] == value[:, None]) & (i[None] < i[:, None]))
    return jnp.argmax(jnp.sum(before, axis=1)[None] == jnp.arange(count)[:, None], axis=1)


class PeakRecord(NamedTuple):
    """Peaks so far; and the last step's end, which is a peak if the next step begins neither higher nor rising."""

    peaks: SignalPeaks
    time: Array
    value: Array
    slope: Array
    y: Array


# Steps into which a motion is cut at least where peaks are looked for.
STEPS = 100
# Parts of a step on each of which a signal is nearly one cubic.
PIECES = 4


class SignalSearch(NamedTuple):
    """Search for the tops of a signal in a step: number of evaluations (`turn`); value and slope at the first and the
    last place; tops of its parts as in `tops` (only the highest if one peak is wanted): their places in the step,
    heights and second derivatives, the number of evaluations there (`looks`), and their values once known.
    """

    turn: Array
    first: tuple[Array, Array]
    last: tuple[Array, Array]
    place: Array
    height: Array
    bend: Array
    looks: Array
    value: Array


def _search(at: Any, count: int, lowest: Any) -> SignalSearch:
    """Evaluates values and slopes (`at`) at the ends of a step's parts. Where a top is higher than the `lowest` that
    counts, it evaluates the kept tops twice: one Newton step on the signal's own slope, and the value there.

    It is one loop, so that the signal stands in the program once: signals may take long to compile.
    """
    width = 1 if count == 1 else PIECES
    slots, none = jnp.arange(width), jnp.full(width, -jnp.inf)
    zero, zeros = jnp.asarray(0.0), jnp.zeros(width)
    begin = SignalSearch(jnp.asarray(0), (zero, zero), (zero, zero), zeros, none, zeros, jnp.zeros(width, int), none)

    def tops_left(now):
        """Tops that are still to be evaluated."""
        return (now.looks < 2) & (now.height > lowest(*now.first))

    def goes_on(now):
        return (now.turn <= PIECES) | jnp.any(tops_left(now))

    def turn(now):
        k, looks = now.turn, now.turn <= PIECES
        here = (slots == jnp.argmax(tops_left(now))) & ~looks
        again = now.looks == 1
        chosen = jnp.sum(jnp.where(here, now.place, 0.0))
        value, slope = with_barriers(at(jnp.where(looks, k / PIECES, chosen)))
        # The part that ends here.
        pair = tuple(jnp.stack([a, b]) for a, b in zip(now.last, (value, slope), strict=True))
        place, height, bend = (x[0] for x in tops(pair[0], pair[1] / PIECES))
        fresh = (looks & (k > 0)) & ((height > now.height) if count == 1 else (slots == k - 1))
        curve = jnp.where(now.bend < 0, now.bend, -1.0)
        # One Newton step, within the part; a jump (no bend) stays where it is.
        part = jnp.floor(jnp.minimum(now.place * PIECES, PIECES - 0.5))
        moved = jnp.clip(now.place * PIECES - slope / PIECES / curve, part, part + 1) / PIECES
        moved = jnp.where(here & ~again & (now.bend < 0), moved, now.place)
        ends = tuple(jnp.where(looks, a, b) for a, b in zip((value, slope), now.last, strict=True))
        first = tuple(jnp.where(k == 0, a, b) for a, b in zip((value, slope), now.first, strict=True))
        return SignalSearch(
            k + 1,
            first,
            ends,
            jnp.where(fresh, (k - 1 + place) / PIECES, moved),
            jnp.where(fresh, height, now.height),
            jnp.where(fresh, bend, now.bend),
            now.looks + here,
            jnp.where(here & again, value, now.value),
        )

    return jax.lax.while_loop(goes_on, turn, begin)


class PeakFinder(AbstractObserver):
    """Finds the peaks of a signal: inside a step, between two steps (a kink, or a jump at a drive's break), or at an
    end.

    Contact begins and ends with a step, so within one the signal is smooth. On each part of a step the cubic through
    values and slopes at its ends approximates it; a Newton step on the signal itself improves the highest tops. The
    place matters for derivatives: at a fixed time their error is its distance from the top over the impact's duration.
    """

    signal: Any
    count: int = eqx.field(static=True)
    span: Any = jnp.inf
    """Length of the motion [s]."""
    since: Any = None
    """From when on peaks count [s] (`None`: from the start)."""

    @property
    def longest(self):
        # A signal may follow a drive, of which the state, and so the step size, knows nothing.
        return self.span / STEPS

    def start(self, t0, y0, problem):
        none = jnp.full(self.count, -jnp.inf)
        times, states = jnp.broadcast_to(t0, none.shape), jnp.broadcast_to(y0, (self.count, *y0.shape))
        # As if it had risen until t0: then a signal that falls from the start peaks there, and the program needs no
        # further copy of the signal.
        return PeakRecord(SignalPeaks(times, none, states), t0, none[0], jnp.asarray(jnp.inf), y0)

    def __call__(self, record, step, problem):
        (t0, t1), h = step.times, step.size
        skipped = 0.0 if self.since is None else jnp.clip((self.since - t0) / h, 0.0, 1.0)
        # The place of a peak needs no derivative: that of the signal at a fixed time is the peak's.
        part, whole, now = without_derivatives((skipped, problem, step))
        rise, states = now.of_motion(whole).rise(self.signal, whole), step.curve(problem)

        def inside(s, skipped):
            """Place in the step for a place in the part of it that counts."""
            return s if self.since is None else skipped + (1 - skipped) * s

        def at(s):
            value, slope = rise(inside(s, part))
            return value, (1 - part) * slope

        opens = counts = None
        if self.since is not None:
            opens, counts = (self.since >= t0) & (self.since < t1), t1 > self.since

        def before(first):
            """The last step's end. At the opening, as at the start, a signal that falls from here peaks here."""
            if opens is None:
                return record.value, record.slope
            return jnp.where(opens, first, record.value), jnp.where(opens, jnp.inf, record.slope)

        def meeting(first, slope):
            """The height of a peak between the steps (minus infinity: none), and whether it is at this step's start."""
            last, rate = before(first)
            rising, falls, jump = rate > 0, slope <= 0, 1e-9 * (jnp.abs(last) + jnp.abs(first))
            left = rising & (last >= first) & (falls | (last - first > jump))
            right = falls & (first > last) & (rising | (first - last > jump))  # the higher side of a jump
            here = (left | right) if counts is None else counts & (left | right)
            return jnp.where(here, jnp.maximum(last, first), -jnp.inf), right

        def lowest(first, slope):
            """The bound that a top must exceed. Most steps have none, by far more than the error of the cubic."""
            best = record.peaks.value
            height, _ = meeting(first, slope)
            bound = jnp.maximum(best[-1], height if self.count == 1 else jnp.minimum(height, best[-2]))
            bound = bound - 1e-2 * jnp.abs(bound)
            return bound if counts is None else jnp.where(counts, bound, jnp.inf)

        seen = _search(at, self.count, lowest)
        peak, right = meeting(*seen.first)
        last_time, last_y = record.time, record.y
        if opens is not None:
            last_time = jnp.where(opens, t0 + skipped * h, last_time)
            last_y = jnp.where(opens, states(skipped)[0], last_y)
        time, y = jnp.where(right, t0, last_time), jnp.where(right, step.trial.start, last_y)
        x = inside(seen.place, skipped)
        picked = t0 + x * h, seen.value, jax.vmap(lambda x: states(x)[0])(x)
        peaks = record.peaks.highest(time[None], peak[None], y[None]).highest(*picked)
        return PeakRecord(peaks, t1, *seen.last, step.trial.end)

    def among(self, times, y, mechanism):
        value = jax.vmap(lambda t, y: jnp.asarray(self.signal(t, y, mechanism), float))(times, y)
        if self.since is not None:
            value = jnp.where(times >= self.since, value, -jnp.inf)
        before, after = jnp.concatenate([-jnp.ones(1) * jnp.inf, value[:-1]]), jnp.append(value[1:], -jnp.inf)
        tops = jnp.where((value > before) & (value >= after), value, -jnp.inf)
        places = _largest(tops, self.count)
        places = jnp.where(jnp.isfinite(tops[places]), places, jnp.argmax(value))
        return places, value[places]

    def finish(self, record):
        # The end of the motion is a peak where the signal is rising there.
        value = jnp.where(record.slope > 0, record.value, -jnp.inf)
        time, value, y = record.peaks.highest(record.time[None], value[None], record.y[None])
        is_peak = jnp.isfinite(value)
        time = jnp.where(is_peak, time, time[0])
        y = jnp.where(is_peak.reshape(-1, *[1] * (y.ndim - 1)), y, y[:1])
        value = jnp.where(is_peak, value, jnp.where(is_peak[0], value[0], jnp.nan))
        return None, Picked(time, y, value)


class Touches(NamedTuple):
    """How often surfaces have met, their lowest approach speed [m/s], the nearest miss [m] (infinite: none)."""

    count: Array
    slowest: Array
    nearest_miss: Array


class TouchCounter(AbstractObserver):
    """Counts impacts of a joint or gap (by its index among the contacts) and records how near to grazing they come."""

    joint: int = eqx.field(static=True)
    since: Any = None
    """From when on they count [s] (`None`: from the start)."""

    def start(self, t0, y0, problem):
        return Touches(jnp.zeros((), int), jnp.asarray(jnp.inf), jnp.asarray(jnp.inf))

    def __call__(self, record, step, problem):
        (t0, t1), now = step.times, step.of_motion(problem)
        clearance = problem.mechanism.contacts()[self.joint].clearance
        # The ends as they are: a step that ends with a touch ends a round-off behind it.
        inner = jnp.arange(1, PIECES) / PIECES
        curve = now.curve(problem)
        states = jax.vmap(lambda x: curve(x)[0])(inner)
        states = jnp.concatenate([now.trial.start[None], states, now.trial.end[None]])
        places = jnp.concatenate([t0[None], t0 + inner * step.size, t1[None]])

        def depths(place):
            time, y = place
            return clearance.depths(relative_motions(time, y, problem.mechanism)[self.joint])

        depth, rate = jax.lax.map(depths, (places, states))
        # A joint with several points touches where the deepest one does.
        k = jnp.argmax(jnp.max(depth, axis=0))
        value, slope = depth[:, k], step.size / PIECES * rate[:, k]
        met = jnp.all(depth[0] <= 0) & jnp.any(depth[-1] > 0)
        # The step ends just behind the touch.
        bend = 2 * slope[-2] + 4 * slope[-1] - 6 * (value[-1] - value[-2])
        speed = (slope[-1] - bend * value[-1] / jnp.where(met, slope[-1], 1.0)) * PIECES / step.size
        # On each part of a step that stays apart the cubic through both ends has its top where the surfaces come
        # nearest.
        _, height, _ = tops(value, slope)
        nearest = jnp.max(height)
        missed = jnp.all(depth <= 0) & jnp.isfinite(nearest)
        if self.since is not None:
            met, missed = met & (t1 > self.since), missed & (t1 > self.since)
        return Touches(
            record.count + met,
            jnp.where(met, jnp.minimum(record.slowest, speed), record.slowest),
            jnp.where(missed, jnp.minimum(record.nearest_miss, jnp.abs(nearest)), record.nearest_miss),
        )
