"""Drives: a joint coordinate as a function of time, with its first two derivatives and its break points.

A drive of a rotation is in rad, of a slide in m; its fields carry the unit "coordinate", resolved by the joint.
"""

import abc
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.lax.linalg import tridiagonal_solve
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import lesser, sincos, within
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.parameters import describe, flatten, physical
from clearance_jax.spatial import Term, total

Values = Float[Array, " n"]
Motion3 = tuple[Term, Term, Term]


class AbstractMotionLaw(Module):
    """A coordinate as a function of time."""

    @abc.abstractmethod
    def __call__(self, time: Scalar) -> Motion3:
        """`(q, q', q'')`; one that vanishes identically is the constant 0.0."""

    def breaks(self) -> Values:
        """Times at which a derivative jumps: integration steps end there. None by default."""
        return jnp.zeros(0)

    def prepare(self) -> "AbstractMotionLaw":
        """The same motion with what depends only on its numbers computed (once a solve); by default nothing does."""
        return self


class AbstractTable(AbstractMotionLaw):
    """A motion law with rows of numbers, of which a time sees few."""

    @abc.abstractmethod
    def window(self, time: Scalar) -> tuple[Array, tuple[int, ...]] | None:
        """The first row that counts at a time, and how many rows of each array say all about the motion there; `None`:
        all of them.
        """


class AbstractDrive(AbstractMotionLaw):
    """A drive: a coordinate as a function of time."""


BEGIN = {"help": "when each step begins, or at the earliest each move", "example": '["0 s", "1 s"]'}
RISE = {"help": "by how much each step or move changes it", "example": '["90 deg", "-30 deg"]'}
OFFSET = {"help": "value before steps and moves, about which it swings", "example": '"10 deg"', "default": 0.0}


class ConstantSpeed(AbstractDrive):
    """q = start + speed t."""

    speed: Scalar = physical("coordinate/s", "rate of the coordinate", '"5000 rpm"')
    start: Scalar = physical("coordinate", "value at t = 0", '"90 deg"', default=0.0)

    def __call__(self, time):
        return self.start + self.speed * time, self.speed, 0.0


class AbstractSteps(AbstractDrive):
    """A sum of steps, which may overlap."""

    begin: Values = physical("s", **BEGIN)
    end: Values = physical("s", "when each step ends", '["0.5 s", "1.5 s"]')
    rise: Values = physical("coordinate", **RISE)
    offset: Scalar = physical("coordinate", **OFFSET)

    def __check_init__(self):
        shapes = {self.begin.shape, self.end.shape, self.rise.shape}
        if len(shapes) > 1 or self.begin.ndim != 1:
            raise ClearanceError("A step drive needs `begin`, `end` and `rise` as lists of one length.")
        if not isinstance(self.begin - self.end, Tracer) and not np.all(self.end > self.begin):
            raise ClearanceError("Every step of a drive must end after it begins.")

    def breaks(self):
        return jnp.concatenate([self.begin, self.end])


class StepSum(AbstractSteps):
    """q = offset + sum of rise_i STEP(t, begin_i, 0, end_i, 1), with the cubic STEP of ADAMS. q'' jumps at both ends of
    each step.

    **Arguments:** `begin`, `end` [s] and `rise` [rad or m], all of shape (n,); `offset` [rad or m].
    """

    @whole
    def __call__(self, time):
        span = self.end - self.begin
        s = (time - self.begin) / span
        inside = (s >= 0) & (s < 1)
        s = within(s, 0.0, 1.0)
        q = self.offset + jnp.sum(self.rise * s * s * (3 - 2 * s))
        v = jnp.sum(jnp.where(inside, self.rise * 6 * s * (1 - s) / span, 0.0))
        return q, v, jnp.sum(jnp.where(inside, self.rise * (6 - 12 * s) / span**2, 0.0))


class Step5Sum(AbstractSteps):
    """The same as `StepSum`, with the quintic STEP5: q'' is continuous, and q''' jumps at both ends of each step."""

    @whole
    def __call__(self, time):
        span = self.end - self.begin
        s = within((time - self.begin) / span, 0.0, 1.0)
        q = self.offset + jnp.sum(self.rise * s**3 * (10 + s * (6 * s - 15)))
        v = jnp.sum(self.rise * 30 * s * s * (1 - s) ** 2 / span)
        return q, v, jnp.sum(self.rise * 60 * s * (1 - s) * (1 - 2 * s) / span**2)


class Harmonic(AbstractDrive):
    """q = offset + amplitude sin(angular_frequency t + phase), angular_frequency in rad/s."""

    amplitude: Scalar = physical("coordinate", "amplitude", '"20 deg"')
    angular_frequency: Scalar = physical("rad/s", "angular frequency", '"10 rad/s"')
    phase: Scalar = physical("rad", "phase at t = 0", '"90 deg"', default=0.0)
    offset: Scalar = physical("coordinate", **OFFSET)

    def __call__(self, time):
        w = self.angular_frequency
        sine, cosine = sincos(w * time + self.phase)
        swing = self.amplitude * sine
        return self.offset + swing, self.amplitude * w * cosine, -w * w * swing


class Spline(AbstractDrive):
    """A cubic spline through a table of times and values. Its third derivative jumps at the knots. Outside the table
    its first and its last piece go on.

    **Arguments:** `times` [s] (increasing), `values` [rad or m], both of shape (n,) with n >= 4; `ends`: "not-a-knot",
    "natural" (q'' = 0) or "clamped" (q' = 0).
    """

    times: Values = physical("s", "times of the table, increasing, at least 4", '["0 s", "1 s", "2 s", "3 s"]')
    values: Values = physical("coordinate", "the coordinate at these times", '["0 deg", "20 deg", "5 deg", "0 deg"]')
    ends: Literal["not-a-knot", "natural", "clamped"] = describe(
        "what holds at both ends: `natural` (q'' = 0), `clamped` (q' = 0)",
        '"clamped"',
        static=True,
        default="not-a-knot",
    )

    def __check_init__(self):
        if self.times.shape[0] < 4 or self.times.shape != self.values.shape:
            raise ClearanceError("A spline drive needs `times` and `values` of one length of at least 4.")
        if not isinstance(self.times, Tracer) and not np.all(np.diff(self.times) > 0):
            raise ClearanceError("The `times` of a spline drive must increase.")
        if self.ends not in ("not-a-knot", "natural", "clamped"):
            raise wrong_value("`ends`", "not-a-knot, natural or clamped", self.ends, shown=repr(self.ends))

    @whole
    def prepare(self):
        return PreparedSpline(self.times, self.values, spline_curvature(self.times, self.values, self.ends))

    @whole
    def __call__(self, time):
        return self.prepare()(time)

    def breaks(self):
        return self.times


class PreparedSpline(AbstractTable):
    """A cubic spline whose q'' at the knots is known: a `Spline` in a solve, or a `HeldSpline` with its `end_speed`."""

    times: Values = physical("s")
    values: Values = physical("coordinate")
    curvature: Values = physical("coordinate/s^2")
    end_speed: Scalar | None = physical("coordinate/s", default=None)

    def __call__(self, time):
        time = jnp.asarray(time, float)
        if self.end_speed is None:
            return self._within(time)
        last = self.times[-1]
        # A table that does not end at rest ends with the motion: it still moves at its last instant.
        moves = self.end_speed != 0
        q, v, a = self._within(jnp.where(moves, time, lesser(time, last)))
        before = (time < last) | moves
        return jnp.where(before, q, self.values[-1]), jnp.where(before, v, 0.0), jnp.where(before, a, 0.0)

    def window(self, time):
        return None if self.end_speed is not None else (jnp.asarray(self._before(time)), (2, 2, 2, 0))

    def _before(self, time: Scalar) -> Array | int:
        if len(self.times) == 2:
            return 0
        return jnp.clip(jnp.searchsorted(self.times, time, side="right") - 1, 0, self.times.shape[0] - 2)

    def _within(self, time: Scalar) -> Motion3:
        """The motion by the table alone."""
        i = self._before(time)
        h, u = self.times[i + 1] - self.times[i], time - self.times[i]
        ya, yb, ma, mb = self.values[i], self.values[i + 1], self.curvature[i], self.curvature[i + 1]
        slope = (yb - ya) / h - h * (2 * ma + mb) / 6
        third = (mb - ma) / h
        return (ya + u * (slope + u * (ma / 2 + u * third / 6)), slope + u * (ma + u * third / 2), ma + u * third)

    def breaks(self):
        return self.times


class HeldSpline(AbstractMotionLaw):
    """A spline that keeps its last value after its table.

    **Arguments:** `table`, whose `ends` hold at the beginning; `end_speed` [rad/s or m/s]: q' at its end. Where a
    motion goes beyond the table it must be zero, or q' jumps.
    """

    table: Spline = flatten()
    end_speed: Scalar = physical("coordinate/s", default=0.0)

    @whole
    def __call__(self, time):
        return self.prepare()(time)

    def breaks(self):
        return self.table.breaks()

    @whole
    def prepare(self):
        table = self.table
        curvature = spline_curvature(table.times, table.values, table.ends, self.end_speed)
        return PreparedSpline(table.times, table.values, curvature, self.end_speed)


class DriveSum(AbstractDrive):
    """The sum of several motion laws: drives, as a user gives it; what they are prepared to, once it is prepared."""

    terms: tuple[AbstractMotionLaw, ...]

    def __call__(self, time):
        parts = [drive(time) for drive in self.terms]
        return total(p[0] for p in parts), total(p[1] for p in parts), total(p[2] for p in parts)

    def breaks(self):
        return jnp.concatenate([drive.breaks() for drive in self.terms])

    def prepare(self):
        return DriveSum(tuple(drive.prepare() for drive in self.terms))


def spline_curvature(times: Values, values: Values, ends: str, end_speed: Scalar | None = None) -> Values:
    """Q'' at the knots of a cubic spline, differentiable by times and values.

    At an inner knot h_a m_a + 2 (h_a + h_b) m + h_b m_b = 6 (slope_b - slope_a), for the intervals before and after.
    The two end values are eliminated: three bands are left, whatever the ends. `end_speed`: q' at the last knot, in
    place of what `ends` says there.
    """
    h = jnp.diff(times)
    slope = jnp.diff(values) / h
    begin, end = _end(ends, h[0], h[1], slope[0]), _end(ends, h[-1], h[-2], -slope[-1])
    if end_speed is not None:
        end = _end("clamped", h[-1], h[-2], end_speed - slope[-1])
    below = h[:-1].at[0].set(0.0).at[-1].add(h[-1] * end.second)
    middle = (2 * (h[:-1] + h[1:])).at[0].add(h[0] * begin.first).at[-1].add(h[-1] * end.first)
    above = h[1:].at[-1].set(0.0).at[0].add(h[0] * begin.second)
    right = (6 * jnp.diff(slope)).at[0].add(-h[0] * begin.constant).at[-1].add(-h[-1] * end.constant)
    m = tridiagonal_solve(below, middle, above, right[:, None])[:, 0]
    return jnp.concatenate([begin.value(m[0], m[1])[None], m, end.value(m[-1], m[-2])[None]])


class _End(NamedTuple):
    """Q'' at an end of a spline: `constant`, and factors of q'' at the `first` and the `second` knot from that end."""

    constant: Scalar | float
    first: Scalar | float
    second: Scalar | float

    def value(self, first: Scalar, second: Scalar) -> Scalar:
        return self.constant + self.first * first + self.second * second


def _end(ends: str, near: Scalar, far: Scalar, slope: Scalar) -> _End:
    """For the lengths of the two intervals at the end, and the table's slope in the nearer one, away from the end."""
    if ends == "natural":
        return _End(0.0, 0.0, 0.0)
    if ends == "clamped":
        return _End(3 * slope / near, -0.5, 0.0)
    return _End(0.0, (near + far) / far, -near / far)
