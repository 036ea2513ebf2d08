"""What a designer asks of a motion, as one number (or a few) with a correct derivative.

A metric is a reduction over time (`Peak`, `Rms`, `Mean`, `At`, `SoftPeak`, ...) of a signal (`PositionError`,
`ContactForce`, ...). Calling it, `metric(mechanism, t1)`, solves; jit, vmap and differentiation go through:

    peak = cj.metrics.Peak(cj.metrics.PositionError("piston"))
    jax.grad(lambda c: peak(cj.replace(mechanism, {"wrist.radial_clearance": c}), 0.012))(1e-4)
"""

import dataclasses
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.field import BALANCE_TERMS, energies, read_balance
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.functions import contact_index
from clearance_jax.metrics.measure import AbstractMetric, Reply, Request
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.settings import SolveOptions, evenly, settings_of
from clearance_jax.solve.simulate import run
from clearance_jax.solve.steps.observers import PeakFinder, Picked, TouchCounter


def since_field(**field):
    """A field: the time from which a metric counts [s]."""
    return eqx.field(converter=lambda t: None if t is None else jnp.asarray(t, float), default=None, **field)


class Peak(AbstractMetric):
    """The largest value of a signal over time.

    With a `count` it is the highest peaks, so many (if there are fewer, the same one again). The solve finds the peaks
    on its way, between its steps too, and keeps their states with their derivatives. Two peaks that are closer together
    than a 400th of the motion may be taken as one, if nothing in the state moves as fast.

    The derivative is that of the signal at a fixed time. This is exact at a smooth peak, where the derivative by time
    is zero (envelope theorem), at the start, whose time is fixed, and at the end, which goes along with `t1`. It is not
    the whole derivative if the peak is a kink or a jump whose time depends on the parameter, such as an acceleration at
    a drive's break and the time of this break. If two peaks are equal, the maximum has a kink: ask for both
    (`count=2`).

    **Arguments:** `signal`; `count`; `since`: only times after it count [s], `None`: all. It must lie before the end.
    """

    word: ClassVar[str] = "peak"
    each: ClassVar[str] = "peak"
    ranked: ClassVar[bool] = True
    signal: AbstractSignal
    count: int = eqx.field(static=True, default=1)
    since: Scalar | None = since_field()

    @property
    def reduction(self):
        return ""

    def several(self, count):
        return dataclasses.replace(self, count=count) if self.count == 1 else self

    def request(self, mechanism, t1, options):
        # The search for the peaks needs no derivatives.
        fixed, end, others = without_derivatives((mechanism, t1, options))
        signal, since = self.signal.bind(fixed, end, others), without_derivatives(self.since)
        return Request((PeakFinder(signal, self.count, end - others.t0, since),), since=self.since)

    def value(self, reply):
        (picked,) = reply.picked
        assert picked is not None
        if reply.mechanism.has_manifold or self.signal.against_free(reply.mechanism):
            # The observer saw unprojected states, or an interpolated ideal.
            peaks = _at_peaks(self.signal, reply, picked)
        else:
            peaks = _as_seen(picked.value, (self.signal, reply, picked))
        return peaks[0] if self.count == 1 else peaks

    def times(self, mechanism: Mechanism, t1: Any, **options: Unpack[SolveOptions]) -> Float[Array, " count"]:
        """When the peaks are [s], the highest first."""
        settings = settings_of(mechanism, t1, options)
        solution = run(mechanism, t1, settings, observers=self.request(mechanism, t1, settings).observers)
        (picked,) = solution.picked
        assert picked is not None
        return picked.time


def _at_peaks(signal: AbstractSignal, reply: Reply, picked: Picked) -> Array:
    """The signal at the peaks that were picked."""
    # In the order of time, for an ideal mechanism that moves freely; and back.
    order = jnp.argsort(picked.time)
    return signal_at(signal, reply, picked.time[order], picked.y[order])[jnp.argsort(order)]


@eqx.filter_custom_jvp
def _as_seen(value, given):
    """The value that the observer saw. Only its derivative needs the signal in the program once more."""
    return value


@_as_seen.def_jvp
def _as_seen_jvp(primals, tangents):
    (value, given), (_, rates) = primals, tangents
    _, rate = eqx.filter_jvp(lambda given: _at_peaks(*given), (given,), (rates,))
    return value, rate


def signal_at(signal: AbstractSignal, reply: Reply, times: Array, y: Array) -> Array:
    """A signal of states at increasing times [s], shape (times,)."""
    return signal.of(times, y, reply.mechanism, reply.t1, reply.options)


class Rms(AbstractMetric):
    """The root of the time average of a signal's square. The solver integrates it along with the motion.

    **Arguments:** `signal`; `since`: only times after it count [s], `None`: all.
    """

    word: ClassVar[str] = "rms"
    signal: AbstractSignal
    since: Scalar | None = since_field()

    @property
    def reduction(self):
        return "RMS"

    def request(self, mechanism, t1, options):
        return Request(integrands=(self.signal.integrand(mechanism, t1, options, 2),), since=self.since)

    def value(self, reply):
        # The root has no derivative at zero: a signal that is zero throughout gets the derivative zero.
        square = reply.integrals[0] / reply.span
        return jnp.where(square == 0, 0.0, jnp.sqrt(jnp.where(square == 0, 1.0, square)))


class Mean(AbstractMetric):
    """The time average of a signal.

    **Arguments:** `signal`; `since`: only times after it count [s], `None`: all.
    """

    word: ClassVar[str] = "mean"
    signal: AbstractSignal
    since: Scalar | None = since_field()

    def request(self, mechanism, t1, options):
        return Request(integrands=(self.signal.integrand(mechanism, t1, options, 1),), since=self.since)

    def value(self, reply):
        return reply.integrals[0] / reply.span


class At(AbstractMetric):
    """A signal at given times.

    **Arguments:** `signal`; `times` [s], shape (times,).

    **Returns:** the values, shape (times,).
    """

    word: ClassVar[str] = "at"
    signal: AbstractSignal
    times: Float[Array, " times"] = eqx.field(converter=lambda t: jnp.atleast_1d(jnp.asarray(t, float)))

    @property
    def reduction(self):
        return ""

    def components(self, count):
        return tuple(f"at {1e3 * float(time):.6g} ms" for time in self.times)

    def request(self, mechanism, t1, options):
        return Request(times=self.times)

    def value(self, reply):
        return signal_at(self.signal, reply, self.times, reply.solution.y)


class SoftPeak(AbstractMetric):
    """A smooth upper bound of the largest of N samples g_i of a signal (Kreisselmeier and Steinhauser 1979):

        KS = max + (1/rho) ln sum exp(rho (g_i - max)),   max <= KS <= max + ln(N) / rho.

    Between samples at a distance h the signal may be higher than the largest sample, by h^2 |g''| / 8.

    **Arguments:** `signal`; `rho` > 0, in one over the signal's unit; `samples`: their number N, at equal distances in
    time.
    """

    signal: AbstractSignal
    rho: Scalar = eqx.field(converter=lambda r: jnp.asarray(r, float))
    samples: int = eqx.field(static=True, default=1001)

    def request(self, mechanism, t1, options):
        return Request(times=evenly(options.t0, t1, self.samples))

    def value(self, reply):
        values = signal_at(self.signal, reply, reply.solution.time, reply.solution.y)
        return jax.nn.logsumexp(self.rho * values) / self.rho

    def bounds(self, mechanism: Mechanism, t1: Any, **options: Unpack[SolveOptions]) -> tuple[Array, Array]:
        """Between which the largest sample is: (KS - ln(N) / rho, KS)."""
        value = self(mechanism, t1, **options)
        return value - jnp.log(self.samples) / self.rho, value


class PNorm(AbstractMetric):
    """A smooth upper bound of the largest of N samples g_i of a signal that is not negative: (sum g_i^p)^(1/p). It lies
    between max and N^(1/p) max.

    **Arguments:** `signal`; `p` >= 1; `samples`: their number N, at equal distances in time.
    """

    signal: AbstractSignal
    p: Scalar = eqx.field(converter=lambda p: jnp.asarray(p, float))
    samples: int = eqx.field(static=True, default=1001)

    def request(self, mechanism, t1, options):
        return Request(times=evenly(options.t0, t1, self.samples))

    def value(self, reply):
        values = jnp.abs(signal_at(self.signal, reply, reply.solution.time, reply.solution.y))
        top = jax.lax.stop_gradient(jnp.max(values))
        top = jnp.where(top == 0, 1.0, top)
        total = jnp.sum((values / top) ** self.p)
        return jnp.where(total == 0, 0.0, top * jnp.where(total == 0, 1.0, total) ** (1 / self.p))

    def bounds(self, mechanism: Mechanism, t1: Any, **options: Unpack[SolveOptions]) -> tuple[Array, Array]:
        """Between which the largest sample is: (norm / N^(1/p), norm)."""
        value = self(mechanism, t1, **options)
        return value / self.samples ** (1 / self.p), value


class EnergyLost(AbstractMetric):
    """The energy lost in damping and friction [J].

    **Arguments:** `since`: only losses after this time count [s], `None`: all.
    """

    word: ClassVar[str] = "energy-lost"
    unit: ClassVar[str] = "J"
    since: Scalar | None = since_field()

    def request(self, mechanism, t1, options):
        return Request(energy_balance=True, since=self.since)

    def value(self, reply):
        ready, size = reply.mechanism.prepare(), layout(reply.mechanism).size

        def loss(time, y):
            contacts = energies(jnp.asarray(time, float), y, ready).contacts
            energy_balance = read_balance(y[size : size + len(BALANCE_TERMS)], contacts)
            return energy_balance["damping_loss"] + energy_balance["friction_loss"]

        # `y0` may come with an energy balance that is not empty.
        return loss(reply.t1, reply.solution.final) - loss(reply.begin, reply.first)


class Impacts(AbstractMetric):
    """The number of times that the surfaces of a joint, or the flanks of a gap, meet (NaN for a failed motion of a
    batch). It has no derivative: to ask for one is an error.

    **Arguments:** `joint`: its name, or a gap's (`axis_drive`); `since`: only times after it count [s], `None`: all.
    """

    word: ClassVar[str] = "impacts"
    joint: str = eqx.field(static=True)
    since: Scalar | None = since_field()

    def request(self, mechanism, t1, options):
        counter = TouchCounter(contact_index(mechanism, self.joint), without_derivatives(self.since))
        return Request((counter,), since=self.since)

    def value(self, reply):
        count = jnp.asarray(reply.solution.records[0].count, float)
        return _count(count, (reply.mechanism, reply.t1, reply.options))


@eqx.filter_custom_jvp
def _count(count, given):
    return count


@_count.def_jvp
def _count_jvp(primals, tangents):
    raise ClearanceError(
        "The number of impacts is a whole number: it has no derivative (zero almost everywhere, infinite where an "
        "impact appears). Use the energy lost or a peak force, or a gradient-free method."
    )
