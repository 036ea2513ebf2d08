"""The times at which a signal crosses a value, and from which it stays within a band."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, quote, wrong_value
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import signal_at, since_field
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.steps.band import EntryFinder

DIRECTIONS = RISING, FALLING = "rising", "falling"


class CrossingTime(AbstractMetric):
    """The first time at which a signal crosses a `level` in a direction [s]: a touch, a point that arrives somewhere, a
    crank that passes an angle. It is not a number if the signal does not.

        cj.metrics.CrossingTime(cj.metrics.Quantity("wrist.penetration"))       # the first touch
        cj.metrics.CrossingTime(cj.metrics.Quantity("crank.position"), 1.0)     # the crank passes 1 rad

    A signal that begins beyond the level has to come back before it can cross it. At the crossing s(t; p) = level, so
    the derivative is (d level - ds/dp) / (ds/dt) (implicit function theorem). It is zero where the signal jumps across
    the level, whose instant counts as fixed; and it does not exist where an earlier swing just touches the level.

    **Arguments:** `signal`; `level`, in the signal's unit; `direction`: "rising" (from below the level to above it) or
    "falling"; `since`: only crossings after this time count [s], `None`: all.

    **Raises:** `ClearanceError` for another direction.
    """

    word: ClassVar[str] = "crossing-time"
    unit: ClassVar[str] = "s"
    signal: AbstractSignal
    level: Scalar = eqx.field(converter=lambda x: jnp.asarray(x, float), default=0.0)
    direction: str = eqx.field(static=True, default=RISING)
    since: Scalar | None = since_field()

    def __check_init__(self):
        if self.direction not in DIRECTIONS:
            raise wrong_value("`direction`", " or ".join(map(quote, DIRECTIONS)), self.direction)

    @property
    def _sign(self) -> float:
        return 1.0 if self.direction == FALLING else -1.0

    def request(self, mechanism, t1, options):
        fixed, end, others, level, since = without_derivatives((mechanism, t1, options, self.level, self.since))
        signal = Signed(self.signal.bind(fixed, end, others), self._sign)
        return Request((EntryFinder(signal, self._sign * level, end - others.t0, first=True, since=since),))

    def value(self, reply):
        (record,), (picked,) = reply.solution.records, reply.picked
        assert picked is not None
        above = self._sign * (signal_at(self.signal, reply, picked.time, picked.y)[0] - self.level)
        # One step of Newton's method, for its derivative. The step is zero, except where closures move the state.
        moved = above / jnp.where(record.slope < 0, record.slope, -jnp.inf)
        return jnp.where(record.entered, 1.0, jnp.nan) * (jax.lax.stop_gradient(picked.time[0]) - moved)


class Signed(Module):
    """A signal times a sign."""

    signal: Any
    sign: float = eqx.field(static=True)

    def __call__(self, time, y, mechanism):
        return self.sign * self.signal(time, y, mechanism)


class SettlingTime(AbstractMetric):
    """The time from `since` on until a signal stays at most `band` until the end of the motion [s].

    It is zero if the signal is within the band from `since` on, and infinite if it is outside at the end: then the
    motion is too short to tell, or the signal never settles. Let the motion last well beyond the settling: what comes
    after its end is not seen.

    At the last entry into the band e(t; p) = band, so the derivative is (d band - de/dp) / (de/dt) (implicit function
    theorem). It is zero where the settling time is zero or infinite, and where the signal jumps into the band, whose
    instant counts as fixed. It does not exist where an earlier or a later swing just touches the band: there the
    settling time jumps by as much as a swing lasts. A limit that is smooth there says the same of a given time T:
    `Peak(signal, since=since + T)` must not exceed the band.

    **Arguments:** `signal`, not negative; `band`, in the signal's unit; `since`: when the move ends [s], `None`: at the
    last time at which a drive, a load or a payload changes its course.

    **Raises:** `ClearanceError` without `since` where no drive has such a time, as one of constant speed.
    """

    word: ClassVar[str] = "settling-time"
    unit: ClassVar[str] = "s"
    signal: AbstractSignal
    band: Scalar = eqx.field(converter=lambda b: jnp.asarray(b, float))
    since: Scalar | None = since_field()

    def request(self, mechanism, t1, options):
        since = self.since
        if since is None:
            breaks = drive_breaks(mechanism)
            if not breaks.shape[0]:
                raise ClearanceError(
                    "A settling time begins where the move ends, which no drive here says: give `since`."
                )
            since = jnp.max(breaks)
        fixed, end, others, band = without_derivatives((mechanism, t1, options, self.band))
        return Request((EntryFinder(self.signal.bind(fixed, end, others), band, end - others.t0),), since=since)

    def value(self, reply):
        (record,), (picked,) = reply.solution.records, reply.picked
        assert picked is not None
        value = signal_at(self.signal, reply, picked.time, picked.y)[0] - self.band
        # The time is as the observer found it; it has the derivative of a step of Newton's method.
        moved = (value - jax.lax.stop_gradient(value)) / jnp.where(record.slope < 0, record.slope, -jnp.inf)
        passed = jax.lax.stop_gradient(picked.time[0]) - moved - reply.begin
        passed = jnp.where(record.entered & (passed > 0), passed, 0.0)
        return jnp.where(record.inside, passed, jnp.inf)
