"""When a signal peaks, beside how high: what a peak is, and whether it belongs to the start."""

from typing import NamedTuple

from jaxtyping import Array, Float

from clearance_jax.metrics.measure import AbstractMetric
from clearance_jax.metrics.reductions import Peak


class Instants(NamedTuple):
    """Peaks, the highest first: `values` in the signal's unit, `times` [s]."""

    values: Float[Array, " count"]
    times: Float[Array, " count"]


class PeakInstants(AbstractMetric):
    """A peak's values and when they are, from the solve that the peak itself takes; times have no derivative."""

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
