"""How long a signal takes after a move until it stays within a band."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import signal_at
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.band import EntryFinder
from clearance_jax.solve.observers import without_derivatives


class SettlingTime(AbstractMetric):
    """The time from `since` on until a signal stays at most `band` until the end of the motion [s].

    It is zero if the signal is within the band from `since` on, and infinite if it is outside at the end: then the
    motion is too short to tell, or the signal never settles. Let the motion last well beyond the settling: what comes
    after its end is not seen.

    At the last entry into the band e(t; p) = band, so the derivative is (d band - de/dp) / (de/dt) (implicit function
    theorem). It is zero where the settling time is zero or infinite, and where the signal jumps into the band, whose
    instant counts as fixed. It does not exist where an earlier or a later
    swing just touches the band: there the settling time jumps by as much as a swing lasts. A limit that is smooth there
    says the same of a given time T: `Peak(signal, since=since + T)` must not exceed the band.

    **Arguments:** `signal`, not negative; `band`, in the signal's unit; `since`: when the move ends [s], `None`: at the
    last time at which a drive, a load or a payload changes its course.

    **Raises:** `ClearanceError` without `since` where no drive has such a time, as one of constant speed.
    """

    word: ClassVar[str] = "settling-time"
    unit: ClassVar[str] = "s"
    signal: AbstractSignal
    band: Scalar = eqx.field(converter=lambda b: jnp.asarray(b, float))
    since: Scalar | None = eqx.field(converter=lambda t: None if t is None else jnp.asarray(t, float), default=None)

    def request(self, mechanism, t1, options):
        since = _end_of_move(mechanism) if self.since is None else self.since
        fixed, end, others, band = without_derivatives((mechanism, t1, options, self.band))
        return Request((EntryFinder(self.signal.bind(fixed, end, others), band, end - others.t0),), since=since)

    def value(self, reply):
        (record,), (picked,) = reply.solution.records, reply.picked
        assert picked is not None
        value = signal_at(self.signal, reply, picked.time, picked.y)[0] - self.band
        # The time of the entry moves with the signal and with the band; it itself is as the observer found it.
        moved = (value - jax.lax.stop_gradient(value)) / jnp.where(record.slope < 0, record.slope, -jnp.inf)
        passed = jax.lax.stop_gradient(picked.time[0]) - moved - reply.begin
        passed = jnp.where(record.entered & (passed > 0), passed, 0.0)
        return jnp.where(record.inside, passed, jnp.inf)


def _end_of_move(mechanism: Mechanism) -> Scalar:
    """The last time at which anything about a mechanism's motion changes its course [s]."""
    breaks = drive_breaks(mechanism)
    if not breaks.shape[0]:
        raise ClearanceError("A settling time begins where the move ends, which no drive here says: give `since`.")
    return jnp.max(breaks)
