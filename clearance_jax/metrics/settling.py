"""How long a signal takes after a move until it stays within a band."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax._types import Scalar
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import signal_at
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.band import LastEntry
from clearance_jax.solve.observers import without_derivatives


class SettlingTime(AbstractMetric):
    """The time from `since` on until a signal stays at most `band` until the end of the motion [s].

    It is zero if the signal is within the band from `since` on, and infinite if it is outside at the end: then the
    motion is too short to tell, or the signal never settles. Let the motion last well beyond the settling: what comes
    after its end is not seen.

    At the last entry into the band e(t; p) = band, so the derivative is (d band - de/dp) / (de/dt) (implicit function
    theorem). It is zero where the settling time is zero or infinite. It does not exist where an earlier or a later
    swing just touches the band: there the settling time jumps by as much as a swing lasts. A limit that is smooth there
    says the same of a given time T: `Peak(signal, since=since + T)` must not exceed the band.

    **Arguments:** `signal`, not negative; `band`, in the signal's unit; `since`: when the move ends [s].
    """

    unit: ClassVar[str] = "s"
    signal: AbstractSignal
    band: Scalar = eqx.field(converter=lambda b: jnp.asarray(b, float))
    since: Scalar = eqx.field(converter=lambda t: jnp.asarray(t, float))

    def request(self, mechanism, t1, options):
        fixed, end, others, band = without_derivatives((mechanism, t1, options, self.band))
        return Request((LastEntry(self.signal.bind(fixed, end, others), band, end - others.t0),), since=self.since)

    def value(self, reply):
        (record,), (picked,) = reply.solution.records, reply.picked
        entered = record.slope < 0
        value = signal_at(self.signal, reply, picked.time, picked.y)[0] - self.band
        # The time of the entry moves with the signal and with the band; it itself is as the observer found it.
        moved = (value - jax.lax.stop_gradient(value)) / jnp.where(entered, record.slope, -1.0)
        passed = jax.lax.stop_gradient(picked.time[0]) - moved - self.since
        passed = jnp.where(entered & (passed > 0), passed, 0.0)
        # A lane that failed is not a number, and not infinite.
        found = jnp.where(record.inside, passed, jnp.inf)
        return jnp.where(reply.solution.succeeded, found, jnp.nan)
