"""What repeats with the drive and what does not: Poincare sections and Lyapunov exponents of a driven mechanism.

Both look at the last `count` periods before `t1`; all before them is the transient, which costs time but no memory.
Over an axis of a sweep the section is the bifurcation diagram, and the exponent says where motions are chaotic: where
it is positive by more than its uncertainty, as that of regular motions may be zero.
"""

import dataclasses
import math
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.quantities import quantities
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import sampling_periods
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.measure import AbstractMetric, MetricForm, Request
from clearance_jax.parameters import units_of, values_of
from clearance_jax.solve.flow import Inputs, flow
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.tolerances import tolerances

# Part of a period by which the last instant may lie beyond `t1`: round-off of many periods.
ROUNDED = 1e-9
# Fewest periods whose scatter tells an uncertainty.
FEWEST = 4
# Labels along the last axis of an exponent with its uncertainty.
ESTIMATE = ("value", "uncertainty")


def _period():
    return eqx.field(converter=lambda x: x if isinstance(x, str) else jnp.asarray(x, float))


def seconds(period: Any, mechanism: Mechanism) -> Array:
    """A period in seconds, given as such or by the name of a speed. **Raises** `ClearanceError` for another name."""
    if not isinstance(period, str):
        return period
    unit = units_of(mechanism, [period])[period]
    if unit != "rad/s":
        raise ClearanceError(
            "`period` must be a time, or the name of a speed in rad/s of which a turn is a period, but "
            f"`{period}` is in {unit or 'no unit'}."
        ).about("period", period)
    return 2 * jnp.pi / jnp.abs(values_of(mechanism, [period])[period])


def _long_enough(t0: Any, begin: Any, what: str) -> Array:
    """A factor on a result: 1, or NaN if the motion starts at `t0` after the `begin` of what is looked at. **Raises**
    `ClearanceError` in place of NaN, unless times are traced.
    """
    enough = begin >= t0
    if not isinstance(enough, Tracer) and not bool(enough):
        raise ClearanceError(f"The motion is too short for {what}: end it later, or ask for fewer.")
    return jnp.where(enough, 1.0, jnp.nan)


class PoincareSection(AbstractMetric):
    """Quantities once in each period of the drive: at the last `count` instants t0 + phase + k period (k whole) up to
    `t1`.

    A motion that repeats after n periods gives n points, a motion with two frequencies a closed curve, and a chaotic
    one a fractal set. See Guckenheimer and Holmes 1983, "Nonlinear Oscillations, Dynamical Systems, and Bifurcations of
    Vector Fields", section 1.5.

    **Arguments:**

    - `quantities`: the name of a quantity of the solution ("wrist.eccentricity.x"), or several names.
    - `period` [s], or the name of a speed: one turn is then a period ("drive.main.speed").
    - `count`: number of instants; `phase`: time from the beginning of a period to the instant [s].

    **Returns:** shape (count,), for several quantities (count, quantities), each in its SI unit. Derivatives are those
    at fixed times.

    **Raises:** `ClearanceError` if there are fewer than `count` instants between t0 and `t1` (NaN under a
    transformation), and for a quantity that is not a number.
    """

    quantities: str | tuple[str, ...] = eqx.field(
        static=True, converter=lambda n: n if isinstance(n, str) else tuple(n)
    )
    period: Scalar | str = _period()
    count: int = eqx.field(static=True, default=64)
    phase: Scalar = eqx.field(converter=lambda x: jnp.asarray(x, float), default=0.0)

    def times(self, t1: Any, t0: Any = 0.0) -> Float[Array, " count"]:
        """The instants [s], by a period in seconds."""
        last = jnp.floor((t1 - t0 - self.phase) / self.period + ROUNDED)
        # Instants before the start are moved to it: `value` then gives NaN.
        times = t0 + self.phase + (last - jnp.arange(self.count)[::-1]) * self.period
        return jnp.clip(times, t0, t1)

    def request(self, mechanism, t1, options):
        timed = dataclasses.replace(self, period=seconds(self.period, mechanism))
        return Request(times=jax.lax.stop_gradient(timed.times(t1, options.t0)))

    def form(self, mechanism):
        known, single = quantities(mechanism, energy_balance=True), isinstance(self.quantities, str)
        names = (self.quantities,) if single else self.quantities
        axes = (("instant", ()), *(() if single else (("quantity", names),)))
        return MetricForm(", ".join(known[name].unit for name in names), axes)

    def value(self, reply):
        period = seconds(self.period, reply.mechanism)
        periods = jnp.floor((reply.t1 - reply.t0 - self.phase) / period + ROUNDED)
        begin = reply.t0 + (periods - (self.count - 1)) * period + self.phase
        factor = _long_enough(reply.t0, begin, f"{self.count} points of a Poincare section")
        names = [self.quantities] if isinstance(self.quantities, str) else self.quantities
        parts = {name: jnp.asarray(reply.solution[name], float) for name in names}
        for name in (name for name, part in parts.items() if part.ndim != 1):
            text = f"A Poincare section is of numbers, but `{name}` has several: name one, `{name}.x`."
            raise ClearanceError(text).about(name, allowed=f"{name}.x")
        points = jnp.stack([factor * part for part in parts.values()], axis=-1)
        return points[:, 0] if isinstance(self.quantities, str) else points


class LyapunovExponent(AbstractMetric):
    """How fast neighbouring motions part: the largest Lyapunov exponent over the last `count` periods before `t1`
    [1/s].

    A positive exponent means chaos. A negative one means a stable motion, in which a disturbance decays at this rate.
    It is zero at the limit between the two, as at a bifurcation.

    The solver integrates the variational equations with the motion, with controlled error, and makes them orthonormal
    again after every period (Benettin et al. 1980, doi 10.1007/BF02128236, and 10.1007/BF02128237). Lengths are
    measured in the scene's own scales. The result is a finite-time estimate. For a chaotic motion its scatter falls as
    one over the root of `count`, for any other its error falls as one over `count`.

    What a law remembers of its last touch belongs to the state. Memory that no touch rewrites has the exponent zero, so
    a positive estimate alone does not prove chaos. The `uncertainty` has two parts: the standard error of the mean
    growth, from the scatter of the means of blocks (with as many periods in a block as there are blocks), and what a
    regular motion would show whose neighbours part in proportion to time: ln(count) / (count period).

    **Arguments:**

    - `period` [s], or the name of a speed: one turn is then a period ("drive.main.speed").
    - `count`: number of periods.
    - `exponents`: how many of the largest ones.
    - `running`: give the estimates after every period, instead of those after the last one.
    - `uncertainty`: give the uncertainty beside each estimate; this needs at least 4 periods.

    **Returns:** a number; for several exponents shape (exponents,), the largest first; with `running` a first axis of
    `count`, with `uncertainty` a last axis of two. It has no derivative.

    **Raises:** `ClearanceError` for a motion shorter than `count` periods (NaN under a transformation), a law of class
    C-1, which has no true derivative, more exponents than states, and a mechanism whose state alone does not determine
    how it goes on (digital servos, controllers, payloads that come and go).
    """

    unit: ClassVar[str] = "1/s"
    period: Scalar | str = _period()
    count: int = eqx.field(static=True, default=50)
    exponents: int = eqx.field(static=True, default=1)
    running: bool = eqx.field(static=True, default=False)
    uncertainty: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        if self.uncertainty and (self.running or self.count < FEWEST):
            raise ClearanceError(
                f"`uncertainty` is that of the last estimate, of at least {FEWEST} periods: ask without `running`, for "
                "more of them."
            )

    def form(self, mechanism):
        axes = [("period", ())] * self.running + [("exponent", ())] * (self.exponents > 1)
        return MetricForm(self.unit, (*axes, *((("estimate", ESTIMATE),) if self.uncertainty else ())))

    def request(self, mechanism, t1, options):
        size = layout(mechanism).size
        if not 1 <= self.exponents <= size:
            text = f"There are {size} Lyapunov exponents, as many as states, but not {self.exponents}."
            raise ClearanceError(text).about("exponents", self.exponents, size)
        if mechanism.controllers or mechanism.has_payloads or sampling_periods(mechanism):
            raise ClearanceError(
                "Lyapunov exponents are not computed with controllers, digital servos or payloads that come and go. "
                "Take them away."
            )
        begin = t1 - self.count * seconds(self.period, mechanism)
        return Request(times=jax.lax.stop_gradient(jnp.clip(begin, options.t0, t1)[None]))

    def value(self, reply):
        period = seconds(self.period, reply.mechanism)
        metric = dataclasses.replace(self, period=period)
        begin = reply.t1 - self.count * period
        factor = _long_enough(reply.t0, begin + ROUNDED * period, f"{self.count} periods of a Lyapunov exponent")
        grown = factor * _constant(metric, (reply.mechanism, begin, reply.solution.y[0], reply.options))
        rates = grown if self.exponents > 1 else grown[:, 0]
        counted = jnp.arange(1, self.count + 1).reshape(-1, *(1,) * (rates.ndim - 1))
        estimates = jnp.cumsum(rates, axis=0) / (period * counted)
        if self.uncertainty:
            return jnp.stack([estimates[-1], uncertainty(rates, period)], axis=-1)
        return estimates if self.running else estimates[-1]


def uncertainty(grown: Array, period: Any) -> Array:
    """The uncertainty of the mean rate [1/s], from logarithms of the growth in each period, shape (count, ...)."""
    count = len(grown)
    blocks = math.isqrt(count)
    length = count // blocks
    means = grown[count - blocks * length :].reshape(blocks, length, *grown.shape[1:]).mean(axis=1)
    scatter = means.std(axis=0, ddof=1) / math.sqrt(blocks)
    return jnp.hypot(scatter, math.log(count) / count) / period


@eqx.filter_custom_jvp
def _constant(metric, given):
    return growth(metric, *given)


@_constant.def_jvp
def _constant_jvp(primals, tangents):
    raise ClearanceError(
        "A Lyapunov exponent has no derivative here: it would need second derivatives of the motion, and of a chaotic "
        "one it is not even continuous."
    )


@eqx.filter_jit
def growth(metric: LyapunovExponent, mechanism: Mechanism, begin: Any, y: Array, options: Any) -> Array:
    """Logarithms of how the largest axes of a ball of states grow in every period, shape (count, exponents)."""
    size, settings = layout(mechanism).size, options._replace(energy_balance=False).compiled_in()
    y = y[:size]
    problem = Problem(mechanism.prepare())
    unit = tolerances(problem, y, begin, begin + metric.period, options.rtol).unit
    unit = jnp.where(jnp.isfinite(unit), unit, 1.0)

    def advance(y, t0):
        if mechanism.closures():
            y = project(t0, y, problem.mechanism, 2)
        inputs = Inputs(mechanism, t0, t0 + metric.period, None, options.rtol, options.atol, y)
        solution = flow(inputs, options=settings)
        # NaN as a factor: if `where` selected it, its slopes would be zero.
        end = solution.final[:size] * jnp.where(solution.succeeded, 1.0, jnp.nan)
        return end, end

    def period(carry, begin):
        y, axes = carry
        slopes, end = jax.jacfwd(advance, has_aux=True)(y, begin)
        axes, lengths = jnp.linalg.qr((slopes * unit[None, :] / unit[:, None]) @ axes)
        return (end, axes), jnp.log(jnp.abs(jnp.diagonal(lengths)))

    # Random directions: one along a coordinate may stay there for ever, and would hide the others.
    start = jax.random.normal(jax.random.key(0), (size, metric.exponents))
    # Without components of memory, which no touch may rewrite.
    axes, _ = jnp.linalg.qr(jnp.where((jnp.arange(size) < layout(mechanism).memory.start)[:, None], start, 0.0))
    # Numbers from outside the loop: computed inside, each of their uses might be rounded in its own way, and a lane
    # that is to end where it begins would find that it begins before its end.
    begins = begin + metric.period * jnp.arange(metric.count)
    _, logs = jax.lax.scan(period, (y, axes), begins)
    return logs
