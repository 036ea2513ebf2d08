"""Peaks of a signal with their times."""

from typing import NamedTuple

from jaxtyping import Array, Float

from clearance_jax.metrics.measure import AbstractMetric
from clearance_jax.metrics.reductions import Peak


class Instants(NamedTuple):
    """Peaks, the highest first: `values` in the signal's unit, `times` [s]."""

    values: Float[Array, " count"]
    times: Float[Array, " count"]


class PeakInstants(AbstractMetric):
    """The values and times of a peak, from the solve of the peak itself. Times have no derivative."""

    peak: Peak

    @property
    def unit(self):
        return self.peak.unit

    def static_bound(self):
        return PeakInstants(self.peak.static_bound())

    def request(self, mechanism, t1, options):
        return self.peak.request(mechanism, t1, options)

    def value(self, reply):
        (picked,) = reply.picked
        assert picked is not None
        return Instants(self.peak.value(reply).reshape(-1), picked.time)
