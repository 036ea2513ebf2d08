"""What a designer asks of a motion, as one number (or a few) with a correct derivative.

A metric is a reduction over time (`Peak`, `Rms`, `Mean`, `At`, `SoftPeak`, ...) of a signal (`PositionError`,
`ContactForce`, ...). Calling it, `metric(mechanism, t1)`, solves; jit, vmap and differentiation go through:

    peak = cj.metrics.Peak(cj.metrics.PositionError("piston"))
    jax.grad(lambda c: peak(cj.replace(mechanism, {"wrist.radial_clearance": c}), 0.012))(1e-4)
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.analysis.signals import (
    AbstractSignal,
    Acceleration,
    ContactForce,
    OrientationError,
    PathDeviation,
    PositionError,
)
from clearance_jax.dynamics.energy import read_books
from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.observers import PeakFinder, TouchCounter
from clearance_jax.solve.simulate import solve


class AbstractMetric(eqx.Module):
    """A number, or a few, of a motion."""

    @property
    def unit(self) -> str:
        """The unit of its values."""
        return getattr(getattr(self, "signal", None), "unit", "")

    @abc.abstractmethod
    def __call__(self, mechanism: Mechanism, t1: Any, **options: Any) -> Array:
        """The metric of the motion from `t0` to `t1`; `options` are `simulate`'s `t0`, `rtol`, `solver`, `y0`."""


class Peak(AbstractMetric):
    """The largest value of a signal over time, or its `count` highest peaks (the same one again where there are fewer).

    The solve finds them on its way, between its steps too, and keeps their states with their derivatives; peaks closer
    together than a 400th of the motion may be missed where nothing in the state moves as fast. The derivative is the
    signal's at a fixed time: at a smooth peak its time derivative is zero (envelope theorem), at the start the time is
    fixed, and at the end it goes along with `t1`. Where the peak is a kink or a jump whose time moves with a parameter
    (an acceleration at a drive's break, by the break's time) that is not the whole derivative. Where two peaks tie the
    maximum has a kink: ask for both (`count=2`).
    """

    signal: AbstractSignal
    count: int = eqx.field(static=True, default=1)

    def __call__(self, mechanism, t1, **options):
        solution, picked = self._solved(mechanism, t1, options)
        # In the order of time, for an ideal mechanism that moves freely; and back.
        order = jnp.argsort(picked.time)
        found = self.signal.of(solution, picked.time[order], picked.y[order], mechanism, t1, **options)
        found = found[jnp.argsort(order)]
        return found[0] if self.count == 1 else found

    def times(self, mechanism: Mechanism, t1: Any, **options: Any) -> Float[Array, " count"]:
        """When the peaks are [s], the highest first."""
        return self._solved(mechanism, t1, options)[1].time

    def _solved(self, mechanism, t1, options):
        # Where the peaks are is looked for without derivatives.
        fixed, end, others = _fixed((mechanism, t1, options))
        finder = PeakFinder(self.signal.bound(fixed, end, **others), self.count, end - others.get("t0", 0.0))
        solution = solve(mechanism, t1, observer=finder, **options)
        assert solution.picked is not None
        return solution, solution.picked


def _fixed(tree):
    """The same numbers, without derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


class Rms(AbstractMetric):
    """Root of the time average of a signal's square; integrated along with the motion, by the solver."""

    signal: AbstractSignal

    def __call__(self, mechanism, t1, **options):
        span = t1 - options.get("t0", 0.0)
        # Away from zero by nothing that counts: a signal that is zero throughout has no derivative to give.
        square = self.signal.integral(mechanism, t1, 2, **options) / span
        # Not `square > 0`: a failed lane is NaN and must stay so.
        return jnp.where(square == 0, 0.0, jnp.sqrt(jnp.where(square == 0, 1.0, square)))


class Mean(AbstractMetric):
    """Time average of a signal."""

    signal: AbstractSignal

    def __call__(self, mechanism, t1, **options):
        return self.signal.integral(mechanism, t1, 1, **options) / (t1 - options.get("t0", 0.0))


class At(AbstractMetric):
    """A signal at given times [s], in increasing order."""

    signal: AbstractSignal
    times: Float[Array, " times"] = eqx.field(converter=lambda t: jnp.atleast_1d(jnp.asarray(t, float)))

    def __call__(self, mechanism, t1, **options):
        return self.signal.along(mechanism, t1, self.times, **options)


class SoftPeak(AbstractMetric):
    """A smooth bound of the largest of N samples of a signal (Kreisselmeier and Steinhauser 1979):

        KS = max + (1/rho) ln sum exp(rho (g_i - max)),   max <= KS <= max + ln(N) / rho.

    Between samples h apart the signal may be higher than `max` by h^2 |g''| / 8. **Arguments:** `signal`; `rho` > 0, in
    one over the signal's unit; `samples` N.
    """

    signal: AbstractSignal
    rho: Scalar = eqx.field(converter=lambda r: jnp.asarray(r, float))
    samples: int = eqx.field(static=True, default=1001)

    def __call__(self, mechanism, t1, **options):
        values = self._values(mechanism, t1, **options)
        return jax.nn.logsumexp(self.rho * values) / self.rho

    def bounds(self, mechanism: Mechanism, t1: Any, **options: Any) -> tuple[Array, Array]:
        """Between which the largest sample is: (KS - ln(N) / rho, KS)."""
        value = self(mechanism, t1, **options)
        return value - jnp.log(self.samples) / self.rho, value

    def _values(self, mechanism, t1, **options):
        t0 = options.get("t0", 0.0)
        return self.signal.along(mechanism, t1, t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, self.samples), **options)


class PNorm(AbstractMetric):
    """A smooth bound of the largest of N samples of a signal that is not negative: (sum g_i^p)^(1/p), p >= 1, between
    max and N^(1/p) max.
    """

    signal: AbstractSignal
    p: Scalar = eqx.field(converter=lambda p: jnp.asarray(p, float))
    samples: int = eqx.field(static=True, default=1001)

    def __call__(self, mechanism, t1, **options):
        t0 = options.get("t0", 0.0)
        times = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, self.samples)
        values = jnp.abs(self.signal.along(mechanism, t1, times, **options))
        top = jax.lax.stop_gradient(jnp.max(values))
        top = jnp.where(top == 0, 1.0, top)
        total = jnp.sum((values / top) ** self.p)
        return jnp.where(total == 0, 0.0, top * jnp.where(total == 0, 1.0, total) ** (1 / self.p))

    def bounds(self, mechanism: Mechanism, t1: Any, **options: Any) -> tuple[Array, Array]:
        """Between which the largest sample is: (norm / N^(1/p), norm)."""
        value = self(mechanism, t1, **options)
        return value / self.samples ** (1 / self.p), value


class EnergyLost(AbstractMetric):
    """Energy lost in damping and friction [J]."""

    unit: ClassVar[str] = "J"

    def __call__(self, mechanism, t1, **options):
        solution, ready = solve(mechanism, t1, books=True, **options), mechanism.prepared()
        # `y0` may come with books that are not empty.
        before = read_books(jnp.asarray(options.get("t0", 0.0), float), solution.initial, ready)
        after = read_books(jnp.asarray(t1, float), solution.final, ready)
        return sum(after[name] - before[name] for name in ("damping_loss", "friction_loss"))


class Impacts(AbstractMetric):
    """Number of times a joint's surfaces meet (NaN for a failed lane of a batch). It has no derivative: asking for one
    is an error.
    """

    joint: str = eqx.field(static=True)

    def __call__(self, mechanism, t1, **options):
        names = [joint.name for joint in mechanism.clearance_joints()]
        if self.joint not in names:
            raise ClearanceError(f"There is no clearance joint `{self.joint}`. " + suggest(self.joint, names))
        counted = solve(mechanism, t1, observer=TouchCounter(names.index(self.joint)), **options)
        return _counted(jnp.where(counted.succeeded, counted.record.count, jnp.nan), (mechanism, t1, options))


@eqx.filter_custom_jvp
def _counted(count, given):
    return count


@_counted.def_jvp
def _counted_jvp(primals, tangents):
    raise ClearanceError(
        "The number of impacts is a whole number: it has no derivative (zero almost everywhere, infinite where an "
        "impact appears). Use the energy lost or a peak force, or a gradient-free method."
    )


__all__ = [
    "AbstractMetric",
    "AbstractSignal",
    "Acceleration",
    "At",
    "ContactForce",
    "EnergyLost",
    "Impacts",
    "Mean",
    "OrientationError",
    "PNorm",
    "PathDeviation",
    "Peak",
    "PositionError",
    "Rms",
    "SoftPeak",
]
