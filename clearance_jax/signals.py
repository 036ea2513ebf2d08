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
from clearance_jax.interpolate import hermite
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.solve import solve
from clearance_jax.spatial import minus
from clearance_jax.tolerances import largest_length

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
        # Signals forgive a NaN (a norm of NaN is 0): a failed lane is marked once more, on the signal itself.
        factor = jnp.where(solution.succeeded, 1.0, jnp.nan)
        y, ready = solution.y, mechanism.prepared()
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
    return layout(mechanism).free - 2 * len(mechanism.closures())


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


class Peaks(NamedTuple):
    """The highest peaks so far, the highest first: time [s] and value (minus infinity: none yet); and time, value and
    slope of the signal at the last step's end, a peak if the next step does not begin higher or rising.
    """

    time: Array
    value: Array
    end: Array

    def finished(self) -> "Peaks":
        """With the end of the motion, where the signal is rising there."""
        return self.with_candidate(self.end[0], self.end[1], self.end[2] > 0)

    def with_candidate(self, time, value, wanted) -> "Peaks":
        """With one more peak, if wanted."""
        return self.with_candidates(time[None], jnp.where(wanted, value, -jnp.inf)[None])

    def with_candidates(self, times, values) -> "Peaks":
        """The highest of these and the new ones."""
        time, value = jnp.concatenate([self.time, times]), jnp.concatenate([self.value, values])
        top = jnp.argsort(-value)[: self.value.shape[0]]
        return Peaks(time[top], value[top], self.end)


# Parts of a step on each of which a signal is one cubic.
PIECES = 4


class PeakFinder(eqx.Module):
    """Finds where a signal peaks: within a step, or between two (a kink, a jump at a drive's break), or at either end.

    Contact begins and ends with a step, so within one the signal is smooth: on each part of a step (states in between
    by cubic interpolation) it is the cubic through values and slopes at the part's ends.
    """

    signal: Any
    count: int = eqx.field(static=True)

    def start(self, t0, y0, mechanism):
        value = jnp.asarray(self.signal(t0, y0, mechanism), float)
        none = jnp.full(self.count, -jnp.inf)
        # As if it had been rising until t0: then a signal that falls from the start peaks there.
        return Peaks(jnp.broadcast_to(jnp.asarray(t0, float), none.shape), none, jnp.stack([t0, value, jnp.inf]))

    def __call__(self, record, times, ends, mechanism):
        (t0, t1), (y0, y1, slope0, slope1) = times, ends
        h = t1 - t0

        def at(s):
            def along(s):
                state = hermite(y0, h * slope0, y1, h * slope1, s)
                return jnp.asarray(self.signal(t0 + s * h, state, mechanism), float)

            return jax.jvp(along, (s,), (jnp.ones_like(s),))

        s = jnp.linspace(0.0, 1.0, PIECES + 1)
        value, slope = jax.vmap(at)(s)
        before, rising = record.end[1], record.end[2] > 0
        falls, jump = slope[0] <= 0, 1e-9 * (jnp.abs(before) + jnp.abs(value[0]))
        left = rising & (before >= value[0]) & (falls | (before - value[0] > jump))
        right = falls & (value[0] > before) & (rising | (value[0] - before > jump))
        time = jnp.where(right, t0, record.end[0])  # on the higher side of a jump
        record = record.with_candidate(time, jnp.maximum(before, value[0]), left | right)
        place, height = tops(value, slope / PIECES)
        record = record.with_candidates(t0 + (s[:-1] + place / PIECES) * h, height)
        return record._replace(end=jnp.stack([t1, value[-1], slope[-1]]))


def tops(value, slope):
    """Place in [0, 1] and height of the top of the cubic on each part; minus infinity where there is none.

    A part that rises though its slopes at both ends fall holds a jump: its top is its end.
    """
    a, b, rise = slope[:-1], slope[1:], value[1:] - value[:-1]
    inside = (a > 0) & (b <= 0)
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    root = jnp.sqrt(jnp.where(inside, square * square - 3 * cubic * a, 1.0))
    x = jnp.where(inside, a / jnp.where(inside, root - square, 1.0), 0.0)
    jumps = (a <= 0) & (b <= 0) & (rise > 1e-9 * jnp.abs(value[1:]))
    inner = value[:-1] + x * (a + x * (square + x * cubic))
    return jnp.where(jumps, 1.0, x), jnp.where(inside, inner, jnp.where(jumps, value[1:], -jnp.inf))


class Touches(NamedTuple):
    """Of a joint: how often its surfaces have met, the lowest approach speed among these [m/s], and the smallest
    distance at which they have turned back without touching [m] (infinite: none).
    """

    count: Array
    slowest: Array
    nearest_miss: Array


class TouchCounter(eqx.Module):
    """Counts impacts of a joint (by its place among the clearance joints) and sees how near to grazing they come."""

    joint: int = eqx.field(static=True)

    def start(self, t0, y0, mechanism):
        return Touches(jnp.zeros((), int), jnp.asarray(jnp.inf), jnp.asarray(jnp.inf))

    def __call__(self, record, times, ends, mechanism):
        (t0, t1), (y0, y1, *_) = times, ends
        here, there = (signals(t, y, mechanism)[self.joint] for t, y in ((t0, y0), (t1, y1)))
        met = (here.overlap <= 0) & (there.overlap > 0)
        # The cubic through both ends of a step that stays apart has its top where the surfaces come nearest.
        h = t1 - t0
        value, slope = jnp.stack([here.overlap, there.overlap]), h * jnp.stack([here.overlap_rate, there.overlap_rate])
        _, height = tops(value, slope)
        missed = (here.overlap <= 0) & (there.overlap <= 0) & jnp.isfinite(height[0])
        return Touches(
            record.count + met,
            jnp.where(met, jnp.minimum(record.slowest, there.overlap_rate), record.slowest),
            jnp.where(missed, jnp.minimum(record.nearest_miss, jnp.abs(height[0])), record.nearest_miss),
        )
