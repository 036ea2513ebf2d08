"""Signals: what of a motion is looked at as a function of time; and observers that watch one step by step."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._checks import ClearanceError, suggest
from clearance_jax._numerics import safe_norm
from clearance_jax._types import Scalar
from clearance_jax.dynamics import observe, rate
from clearance_jax.equations import projected, signals
from clearance_jax.flow import Picked, Solution
from clearance_jax.interpolate import between, hermite
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.solve import solve
from clearance_jax.spatial import minus
from clearance_jax.tolerances import largest_length
from clearance_jax.variation import Problem, motion

# Newton steps from a pin's place in its sleeve to the ideal mechanism: each squares the error, some 1e-3 at first.
_ASSEMBLE = 4


class AbstractSignal(eqx.Module):
    """A scalar function of time, state and mechanism; names are static."""

    needs_ideal: ClassVar[bool] = False

    @abc.abstractmethod
    def value(self, time: Scalar, y: Array, mechanism: Mechanism, reference: Array | None) -> Scalar:
        """The signal of one state; `reference` is the ideal mechanism's state."""

    def along(self, mechanism: Mechanism, t1: Any, times: Float[Array, " times"], **options: Any) -> Array:
        """The signal at the given times [s], shape (times,)."""
        solution = solve(mechanism, t1, save_at=times, **options)
        return self.of(solution, times, solution.y, mechanism, t1, **options)

    def of(self, solution: Solution, times: Array, y: Array, mechanism: Mechanism, t1: Any, **options: Any) -> Array:
        """The signal of a solution's states at increasing times, shape (times,)."""
        # Signals forgive a NaN (a norm of NaN is 0): a failed lane is marked once more, on the signal itself.
        factor = jnp.where(solution.succeeded, 1.0, jnp.nan)
        ready = mechanism.prepared()
        if self.needs_ideal and freedom(mechanism.ideal()) > 0:
            reference = self._freely(mechanism, t1, times, options)
            return factor * jax.vmap(lambda t, y, r: self.value(t, y, ready, r))(times, y, reference)
        return factor * jax.vmap(lambda t, y: self.value(t, y, ready, self._reference(t, y, ready)))(times, y)

    def scale(self, mechanism: Mechanism) -> Scalar:
        """Magnitude of the signal, where an integral of it must itself be watched; infinite (the default): its kinks,
        if any, are the laws' switches, at which steps end anyway.
        """
        return jnp.asarray(jnp.inf)

    def _reference(self, time, y, mechanism):
        return ideal_state(time, y, mechanism) if self.needs_ideal else None

    def _freely(self, mechanism, t1, times, options):
        """States of an ideal mechanism that moves freely; from its own initial state, for it has no other."""
        if options.get("y0") is not None:
            raise ClearanceError(
                "An error against an ideal mechanism that moves freely cannot start from `y0`: where the ideal one "
                "starts is not known. Set the initial values of the mechanism's coordinates instead."
            )
        return solve(mechanism.ideal(), t1, save_at=times, **options).y

    def bound(self, mechanism: Mechanism, t1: Any, **options: Any) -> Callable:
        """The signal as a function of (time, state, mechanism) alone, for an observer."""
        if not self.needs_ideal or freedom(mechanism.ideal()) == 0:
            return Instant(self)
        t0 = options.get("t0", 0.0)
        times = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, TABLE)
        y = self._freely(mechanism, t1, times, options)
        ready = mechanism.ideal().prepared()
        return Tabulated(self, times, y, jax.vmap(lambda t, y: rate(t, y, ready))(times, y))

    def integral(self, mechanism: Mechanism, t1: Any, power: int, **options: Any) -> Scalar:
        """The time integral of a power of the signal."""
        if self.needs_ideal and freedom(mechanism.ideal()) > 0:
            raise ClearanceError(
                "An average of an error against an ideal mechanism that moves freely is not integrated along. Drive "
                "its joints, or average samples: `At(signal, times)`."
            )
        return solve(mechanism, t1, integrands=(Integrand(self, power),), **options).final[-1]


# Samples of an ideal mechanism's free motion, to find peaks of an error with; their values are solved for exactly.
TABLE = 1001


class Instant(eqx.Module):
    """A signal whose ideal reference, if any, follows from the state itself."""

    signal: AbstractSignal

    def __call__(self, time, y, mechanism):
        return self.signal.value(time, y, mechanism, self.signal._reference(time, y, mechanism))


class Tabulated(eqx.Module):
    """A signal whose ideal reference is interpolated (cubic Hermite)."""

    signal: AbstractSignal
    times: Array
    y: Array
    slope: Array

    def __call__(self, time, y, mechanism):
        i = jnp.clip(jnp.searchsorted(self.times, time) - 1, 0, self.times.shape[0] - 2)
        h = self.times[i + 1] - self.times[i]
        reference = hermite(
            self.y[i], h * self.slope[i], self.y[i + 1], h * self.slope[i + 1], (time - self.times[i]) / h
        )
        return self.signal.value(time, y, mechanism, reference)


class Integrand(eqx.Module):
    """A power of a signal."""

    signal: AbstractSignal
    power: int = eqx.field(static=True)

    def __call__(self, time, y, mechanism):
        return Instant(self.signal)(time, y, mechanism) ** self.power

    def scale(self, mechanism):
        return self.signal.scale(mechanism) ** self.power


def freedom(mechanism: Mechanism) -> int:
    """How many coordinates drives and closures leave free."""
    left = layout(mechanism).free - 2 * len(mechanism.closures())
    if left < 0:
        raise ClearanceError(
            "Without its clearances this mechanism is over-constrained: its loops demand more than its joints can "
            "give. For an error against the ideal mechanism free more coordinates."
        )
    return left


def ideal_state(time: Scalar, y: Array, mechanism: Mechanism) -> Array:
    """The state of the ideal mechanism, where drives and closures determine it: the actual one's, loops closed."""
    ideal = mechanism.ideal()
    plan, own = layout(mechanism), layout(ideal)
    if own.free == 0:
        return jnp.zeros(0)
    where = [plan.names.index(name) for name in own.names]
    guess = jnp.stack([*(y[i] for i in where), *(y[plan.free + i] for i in where)])
    return projected(time, guess, ideal, ideal.closures(), _ASSEMBLE)


# Signals -------------------------------------------------------------------------------------------------------------


def play_size(mechanism: Mechanism) -> Scalar:
    """The largest clearance [m]."""
    sizes = [joint.clearance.radial_clearance for joint in mechanism.clearance_joints() if joint.clearance]
    return jnp.max(jnp.stack(sizes)) if sizes else jnp.asarray(jnp.inf)


def _point(mechanism: Mechanism, name: str) -> int:
    names = [point.name for point in mechanism.points]
    if name not in names:
        raise ClearanceError(f"There is no point `{name}`. " + suggest(name, names))
    return names.index(name)


def _deviation(signal, time, y, mechanism, reference):
    """Actual minus ideal place of a point, and the ideal velocity."""
    i = _point(mechanism, signal.point)
    here = observe(time, y, mechanism)["position"][i]
    ideal = observe(time, reference, mechanism.ideal())
    return here - ideal["position"][i], ideal["velocity"][i]


class PositionError(AbstractSignal):
    """Distance of a named point from where the ideal mechanism has it at the same time [m]."""

    point: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism)  # a distance has a kink at zero

    def value(self, time, y, mechanism, reference):
        off, _ = _deviation(self, time, y, mechanism, reference)
        return safe_norm(off[0], off[1])


class PathDeviation(AbstractSignal):
    """Distance of a named point from its ideal path, measured normal to it at the ideal place [m]; the distance itself
    where the ideal point stands still.
    """

    point: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism)

    def value(self, time, y, mechanism, reference):
        off, velocity = _deviation(self, time, y, mechanism, reference)
        speed = safe_norm(velocity[0], velocity[1])
        normal = (off[1] * velocity[0] - off[0] * velocity[1]) / jnp.where(speed > 0, speed, 1.0)
        return jnp.where(speed > 0, jnp.abs(normal), safe_norm(off[0], off[1]))


class OrientationError(AbstractSignal):
    """Angle between a body and the ideal mechanism's [rad], not negative."""

    body: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism) / largest_length(mechanism)

    def value(self, time, y, mechanism, reference):
        names = [body.name for body in mechanism.bodies]
        if self.body not in names:
            raise ClearanceError(f"There is no body `{self.body}`. " + suggest(self.body, names))
        here = frames(mechanism, time, y)[self.body].angle
        return jnp.abs(jnp.asarray(minus(here, frames(mechanism.ideal(), time, reference)[self.body].angle), float))


class ContactForce(AbstractSignal):
    """Normal contact force in a clearance joint [N]."""

    joint: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        names = [joint.name for joint in mechanism.clearance_joints()]
        if self.joint not in names:
            raise ClearanceError(f"There is no clearance joint `{self.joint}`. " + suggest(self.joint, names))
        return observe(time, y, mechanism)["contact_force"][names.index(self.joint)]


class Acceleration(AbstractSignal):
    """Magnitude of a named point's acceleration [m/s^2]."""

    point: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        a = observe(time, y, mechanism)["acceleration"][_point(mechanism, self.point)]
        return safe_norm(a[0], a[1])


# Observers -----------------------------------------------------------------------------------------------------------


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
        top = jnp.argmax(value)[None] if count == 1 else jnp.argsort(-value)[:count]
        return Peaks(time[top], value[top], y[top])


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

    @property
    def longest(self):
        # A signal may follow a drive, of which the state, and so the step size, knows nothing.
        return self.span / STEPS

    def start(self, t0, y0, problem):
        value = jnp.asarray(self.signal(t0, motion(problem, y0), problem.mechanism), float)
        none = jnp.full(self.count, -jnp.inf)
        times, states = jnp.broadcast_to(t0, none.shape), jnp.broadcast_to(y0, (self.count, *y0.shape))
        # As if it had been rising until t0: then a signal that falls from the start peaks there.
        return PeakRecord(Peaks(times, none, states), t0, value, jnp.asarray(jnp.inf), y0)

    def __call__(self, record, times, ends, problem):
        (t0, t1), h, free = times, times[1] - times[0], layout(problem.mechanism).free
        own = tuple(motion(problem, end) for end in ends)

        def at(s):
            def along(s):
                now = self.signal(t0 + s * h, between(own, h, s, free), problem.mechanism)
                return jnp.asarray(now, float)

            return jax.jvp(along, (s,), (jnp.ones_like(s),))

        s = jnp.linspace(0.0, 1.0, PIECES + 1)
        value, slope = jax.vmap(at)(s)
        before, rising = record.value, record.slope > 0
        falls, jump = slope[0] <= 0, 1e-9 * (jnp.abs(before) + jnp.abs(value[0]))
        left = rising & (before >= value[0]) & (falls | (before - value[0] > jump))
        right = falls & (value[0] > before) & (rising | (value[0] - before > jump))  # the higher side of a jump
        height = jnp.where(left | right, jnp.maximum(before, value[0]), -jnp.inf)
        between_steps = jnp.where(right, t0, record.time), height, jnp.where(right, ends[0], record.y)

        place, height, bend = tops(value, slope / PIECES)

        def refined(k):
            # One Newton step on the signal's own slope; a jump (no bend) stays where it is.
            here, rate = at((k + place[k]) / PIECES)
            moved = jnp.where(bend[k] < 0, -rate / PIECES / jnp.where(bend[k] < 0, bend[k], -1.0), 0.0)
            moved = jnp.clip(place[k] + moved, 0.0, 1.0) - place[k]
            found = jnp.where(jnp.isfinite(height[k]), here + 0.5 * rate / PIECES * moved, -jnp.inf)
            # Where a peak is has no derivative here: the signal's at a fixed time is the peak's.
            x = jax.lax.stop_gradient((k + place[k] + moved) / PIECES)
            return t0 + x * h, found, between(ends, h, x, free)

        best = jnp.argmax(height)[None] if self.count == 1 else jnp.arange(PIECES)
        inside = jax.vmap(refined)(best)
        found = record.peaks.highest(
            *(jnp.concatenate([a[None], b]) for a, b in zip(between_steps, inside, strict=True))
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


def tops(value, slope):
    """Place in [0, 1], height (minus infinity: none) and second derivative of the top of the cubic on each part.

    A part that rises though its slopes at both ends fall holds a jump: its top is its end, without a second derivative.
    """
    a, b, rise = slope[:-1], slope[1:], value[1:] - value[:-1]
    smooth = (a > 0) & (b <= 0)
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    root = jnp.sqrt(jnp.where(smooth, square * square - 3 * cubic * a, 1.0))
    x = jnp.where(smooth, a / jnp.where(smooth, root - square, 1.0), 1.0)
    jumps = (a <= 0) & (b <= 0) & (rise > 1e-9 * jnp.abs(value[1:]))
    height = jnp.where(jumps, value[1:], value[:-1] + x * (a + x * (square + x * cubic)))
    return x, jnp.where(smooth | jumps, height, -jnp.inf), jnp.where(smooth, -2 * root, 0.0)


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

    def start(self, t0, y0, problem):
        return Touches(jnp.zeros((), int), jnp.asarray(jnp.inf), jnp.asarray(jnp.inf))

    def __call__(self, record, times, ends, problem):
        (t0, t1), states = times, [motion(problem, y) for y in ends[:2]]
        here, there = (signals(t, y, problem.mechanism)[self.joint] for t, y in zip(times, states, strict=True))
        met = (here.overlap <= 0) & (there.overlap > 0)
        # The cubic through both ends of a step that stays apart has its top where the surfaces come nearest.
        h = t1 - t0
        value, slope = jnp.stack([here.overlap, there.overlap]), h * jnp.stack([here.overlap_rate, there.overlap_rate])
        _, height, _ = tops(value, slope)
        missed = (here.overlap <= 0) & (there.overlap <= 0) & jnp.isfinite(height[0])
        return Touches(
            record.count + met,
            jnp.where(met, jnp.minimum(record.slowest, there.overlap_rate), record.slowest),
            jnp.where(missed, jnp.minimum(record.nearest_miss, jnp.abs(height[0])), record.nearest_miss),
        )
