"""Observers: what watches a motion step by step as it is solved: where a signal peaks, how often surfaces meet."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.interpolate import between, tops
from clearance_jax.solve.problem import Problem, motion


class Picked(NamedTuple):
    """States that an observer has picked: at `time` [s], shape (k,); `y`, shape (k, n)."""

    time: Float[Array, " k"]
    y: Float[Array, "k *rows n"]


class AbstractObserver(eqx.Module):
    """Watches a solve step by step. Its record starts with `start`, and every accepted step makes a new one of it.

    States are stacks where the problem varies (see `variation`): what an observer picks it picks with its derivatives.
    """

    @property
    def longest(self) -> Any:
        """The longest step that it can see through [s]."""
        return jnp.inf

    @abc.abstractmethod
    def start(self, t0: Array, y0: Array, problem: Problem) -> Any:
        """The record before the first step."""

    @abc.abstractmethod
    def __call__(self, record: Any, times: tuple, ends: tuple, problem: Problem) -> Any:
        """The record after a step; `times` (t0, t1), `ends` (y0, y1, slope0, slope1)."""

    def finished(self, record: Any) -> tuple[Any, Picked | None]:
        """What the solution reports of it: no states in the record itself."""
        return record, None


class Peaks(NamedTuple):
    """The highest peaks so far, the highest first: time [s], value (minus infinity: none yet), state."""

    time: Array
    value: Array
    y: Array

    def highest(self, time, value, y) -> "Peaks":
        """Of these and more of them (leading axis), as many as there were of these."""
        time, value, y = (jnp.concatenate([a, b]) for a, b in zip(self, (time, value, y), strict=True))
        count, value = self.value.shape[0], jnp.where(jnp.isnan(value), -jnp.inf, value)
        top = jnp.argmax(value)[None] if count == 1 else _largest(value, count)
        return Peaks(time[top], value[top], y[top])


def _largest(value: Array, count: int) -> Array:
    """Places of the `count` largest numbers, the largest first; of equals the first. For so few numbers comparing each
    with each is far cheaper than a sort, which is a call of its own in every step.
    """
    i = jnp.arange(value.shape[0])
    before = (value[None] > value[:, None]) | ((value[None] == value[:, None]) & (i[None] < i[:, None]))
    return jnp.argmax(jnp.sum(before, axis=1)[None] == jnp.arange(count)[:, None], axis=1)


class PeakRecord(NamedTuple):
    """Peaks so far; and time, value, slope and state at the last step's end, a peak if the next step does not begin
    higher or rising.
    """

    peaks: Peaks
    time: Array
    value: Array
    slope: Array
    y: Array


# Steps into which a motion is cut at least where peaks are looked for.
STEPS = 100
# Parts of a step on each of which a signal is nearly one cubic.
PIECES = 4


class PeakFinder(AbstractObserver):
    """Finds where a signal peaks: within a step, or between two (a kink, a jump at a drive's break), or at either end.

    Contact begins and ends with a step, so within one the signal is smooth: on each part of a step it is the cubic
    through values and slopes at the part's ends (states in between by interpolation), and at the top of the highest the
    signal itself says what is left to go. At a top, that matters: a derivative at a fixed time is off by how far the
    time is from the top, over the duration of an impact.
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
        # As if it had risen from nothing until t0: then a signal that falls from the start peaks there, and the signal
        # need not stand in the program once more.
        return PeakRecord(Peaks(times, none, states), t0, none[0], jnp.asarray(jnp.inf), y0)

    def __call__(self, record, times, ends, problem):
        (t0, t1), h, plan = times, times[1] - times[0], layout(problem.mechanism)
        own = tuple(motion(problem, end) for end in ends)
        skipped = 0.0 if self.since is None else jnp.clip((self.since - t0) / h, 0.0, 1.0)

        def inside(s):
            """Place in the step of a place in the part of it that counts."""
            return s if self.since is None else skipped + (1 - skipped) * s

        def at(s):
            def along(s):
                x = inside(s)
                now = self.signal(t0 + x * h, between(own, h, x, plan), problem.mechanism)
                return jnp.asarray(now, float)

            return jax.jvp(along, (s,), (jnp.ones_like(s),))

        s = jnp.linspace(0.0, 1.0, PIECES + 1)
        value, slope = jax.vmap(at)(s)
        if self.since is not None:
            # As at the start of the motion: a signal that falls from here peaks here.
            opens = (self.since >= t0) & (self.since < t1)
            opened = t0 + skipped * h, value[0], jnp.asarray(jnp.inf), between(ends, h, skipped, plan)
            now = jax.tree.map(lambda a, b: jnp.where(opens, a, b), opened, record[1:])
            record = PeakRecord(record.peaks, *now)
        before, rising = record.value, record.slope > 0
        falls, jump = slope[0] <= 0, 1e-9 * (jnp.abs(before) + jnp.abs(value[0]))
        left = rising & (before >= value[0]) & (falls | (before - value[0] > jump))
        right = falls & (value[0] > before) & (rising | (value[0] - before > jump))  # the higher side of a jump
        counts = True if self.since is None else t1 > self.since
        height = jnp.where(counts & (left | right), jnp.maximum(before, value[0]), -jnp.inf)
        between_steps = jnp.where(right, t0, record.time), height, jnp.where(right, ends[0], record.y)

        place, height, bend = tops(value, slope / PIECES)
        height = jnp.where(counts, height, -jnp.inf)

        def refined(k):
            # One Newton step on the signal's own slope; a jump (no bend) stays where it is.
            here, rate = at((k + place[k]) / PIECES)
            moved = jnp.where(bend[k] < 0, -rate / PIECES / jnp.where(bend[k] < 0, bend[k], -1.0), 0.0)
            moved = jnp.clip(place[k] + moved, 0.0, 1.0) - place[k]
            found = jnp.where(jnp.isfinite(height[k]), here + 0.5 * rate / PIECES * moved, -jnp.inf)
            # Where a peak is has no derivative here: the signal's at a fixed time is the peak's.
            x = jax.lax.stop_gradient(inside((k + place[k] + moved) / PIECES))
            return t0 + x * h, found, between(ends, h, x, plan)

        best = jnp.argmax(height)[None] if self.count == 1 else jnp.arange(PIECES)
        found = record.peaks.highest(*(x[None] for x in between_steps))
        # Most steps hold no top that counts, by far more than the cubic's error.
        lowest = found.value[-1]
        found = jax.lax.cond(
            jnp.any(height > lowest - 1e-2 * jnp.abs(lowest)),
            lambda peaks: peaks.highest(*jax.vmap(refined)(best)),
            lambda peaks: peaks,
            found,
        )
        return PeakRecord(found, t1, value[-1], slope[-1], ends[1])

    def finished(self, record):
        # The end of the motion is a peak where the signal is rising there.
        value = jnp.where(record.slope > 0, record.value, -jnp.inf)
        time, value, y = record.peaks.highest(record.time[None], value[None], record.y[None])
        found = jnp.isfinite(value)
        time = jnp.where(found, time, time[0])
        y = jnp.where(found.reshape(-1, *[1] * (y.ndim - 1)), y, y[:1])
        return None, Picked(time, y)


class Touches(NamedTuple):
    """Of a joint: how often its surfaces have met, the lowest approach speed among these [m/s], and the smallest
    distance at which they have turned back without touching [m] (infinite: none).
    """

    count: Array
    slowest: Array
    nearest_miss: Array


class TouchCounter(AbstractObserver):
    """Counts impacts of a joint (by its place among the clearance joints) and sees how near to grazing they come."""

    joint: int = eqx.field(static=True)
    since: Any = None
    """From when on they count [s] (`None`: from the start)."""

    def start(self, t0, y0, problem):
        return Touches(jnp.zeros((), int), jnp.asarray(jnp.inf), jnp.asarray(jnp.inf))

    def __call__(self, record, times, ends, problem):
        (t0, t1), states = times, [motion(problem, y) for y in ends[:2]]
        clearance = problem.mechanism.clearance_joints()[self.joint].clearance
        here, there = (
            clearance.depths(relative_motions(t, y, problem.mechanism)[self.joint])
            for t, y in zip(times, states, strict=True)
        )
        depth, rate = jnp.stack([here[0], there[0]]), jnp.stack([here[1], there[1]])
        # Of a joint with several points: it touches where the deepest does.
        k = jnp.argmax(jnp.max(depth, axis=0))
        value, slope = depth[:, k], rate[:, k]
        met = jnp.all(depth[0] <= 0) & jnp.any(depth[1] > 0)
        # The cubic through both ends of a step that stays apart has its top where the surfaces come nearest.
        _, height, _ = tops(value, (t1 - t0) * slope)
        missed = jnp.all(depth <= 0) & jnp.isfinite(height[0])
        if self.since is not None:
            met, missed = met & (t1 > self.since), missed & (t1 > self.since)
        return Touches(
            record.count + met,
            jnp.where(met, jnp.minimum(record.slowest, slope[1]), record.slowest),
            jnp.where(missed, jnp.minimum(record.nearest_miss, jnp.abs(height[0])), record.nearest_miss),
        )
