"""Drives: the motion of a coordinate as a function of time. Here those of robot controllers, and all drives by name.

All but `Constant` are prepared to piecewise polynomials.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.motion.motion_laws import (
    BEGIN,
    OFFSET,
    RISE,
    AbstractDrive,
    ConstantSpeed,
    Harmonic,
    Spline,
    Step5Sum,
    StepSum,
    Values,
)
from clearance_jax.mechanism.motion.pieces import HERMITE, Pieces, least_jerk
from clearance_jax.parameters import physical

__all__ = [
    "AbstractDrive",
    "Constant",
    "ConstantSpeed",
    "Harmonic",
    "Quintic",
    "Spline",
    "Step5Sum",
    "StepSum",
    "Trapezoid",
]


# Default part of a move's duration at constant speed: it minimises the integral of q''^2 over all trapezoids.
THIRD = 1 / 3


class Constant(AbstractDrive):
    """q = value: the coordinate is held."""

    value: Scalar = physical("coordinate", "value at which the coordinate is held", '"30 deg"')

    def __call__(self, time):
        return self.value, 0.0, 0.0


class Ramps(NamedTuple):
    """By move of a `Trapezoid`: the time of speeding up, and of slowing down (`ramp`), and that at its `speed`."""

    ramp: Values
    cruise: Values
    speed: Values


class Trapezoid(AbstractDrive):
    """Moves from point to point. In each move the speed grows evenly, stays constant, and falls evenly to zero. q''
    jumps.

    Each move is as fast as the limits `speed` and `acceleration` allow (a short one never reaches the speed), or takes
    its `duration`. A move waits until the move before it has ended.

    **Arguments:**

    - `begin` [s] and `rise` [rad or m], of shape (n,): when each move begins, and by how much it moves.
    - `speed` [rad/s or m/s], `acceleration` [rad/s^2 or m/s^2]: limits, greater than zero. Instead of them you may give
    - `duration` [s], of shape (n,), of each move, and `cruise`: the share of it at constant speed, a third by default.
      Moves of several coordinates with equal durations begin and end together.
    - `offset` [rad or m]: the value before the moves.

    At two special numbers the derivatives are one-sided: where a move begins just as the one before it ends, and where
    a move only just reaches its speed. Under limits, a move with a rise of zero takes no time.

    **Raises:** `ClearanceError` for lists of different lengths, for neither or both of limits and durations, and for
    limits and durations that are not greater than zero.
    """

    begin: Values = physical("s", **BEGIN)
    rise: Values = physical("coordinate", **RISE)
    speed: Scalar | None = physical(
        "coordinate/s", "limit of the speed", '"180 deg/s"', "moves by `duration`", above=0.0, default=None
    )
    acceleration: Scalar | None = physical(
        "coordinate/s^2", "limit of the acceleration", '"720 deg/s^2"', "moves by `duration`", above=0.0, default=None
    )
    duration: Values | None = physical(
        "s",
        "how long each takes, instead of `speed` and `acceleration`",
        '["0.5 s", "0.25 s"]',
        "as fast as `speed` and `acceleration` allow",
        above=0.0,
        default=None,
    )
    cruise: Scalar | None = physical(
        "", "part of the duration at constant speed", "0.5", "a third", least=0.0, below=1.0, default=None
    )
    offset: Scalar = physical("coordinate", **OFFSET)

    def __check_init__(self):
        lists = [x for x in (self.begin, self.rise, self.duration) if x is not None]
        if any(x.ndim != 1 or x.shape != self.begin.shape for x in lists) or self.begin.size == 0:
            raise ClearanceError("A trapezoid drive needs `begin`, `rise` and any `duration` as lists of one length.")
        limits = [self.speed, self.acceleration]
        given = sum(x is not None for x in limits)
        if given == 1 or (given == 2) == (self.duration is not None):
            raise ClearanceError("A trapezoid drive needs `speed` and `acceleration`, or `duration` instead of both.")
        if self.cruise is not None and self.duration is None:
            raise ClearanceError("`cruise` is a part of a `duration`: a trapezoid drive with limits takes none.")
        for name in ("speed", "acceleration", "duration"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Tracer) and not np.all(value > 0):
                raise ClearanceError(f"`{name}` of a trapezoid drive must be greater than zero.").about(name, value)

    def ramps(self) -> Ramps:
        """The ramps of all moves."""
        if self.duration is not None:
            cruise = self.duration * (THIRD if self.cruise is None else self.cruise)
            ramp = (self.duration - cruise) / 2
            return Ramps(ramp, cruise, self.rise / (ramp + cruise))
        assert self.speed is not None
        assert self.acceleration is not None
        # A move by zero would be 0 / 0: it is computed as a move by one, and its times are set to zero.
        still = self.rise == 0
        size = jnp.where(still, 1.0, jnp.abs(self.rise))
        reached = size * self.acceleration > self.speed**2
        peak = jnp.where(reached, self.speed, jnp.sqrt(jnp.where(reached, 1.0, size * self.acceleration)))
        ramp = peak / self.acceleration
        cruise = jnp.where(reached & ~still, size / peak - ramp, 0.0)
        return Ramps(jnp.where(still, 0.0, ramp), cruise, jnp.sign(self.rise) * peak)

    def begins(self, ramps: Ramps) -> Values:
        """When each move begins [s], after waiting for those before it."""
        span = 2 * ramps.ramp + ramps.cruise
        past = jnp.cumsum(span) - span
        # With the time of the moves before subtracted, waiting means that no move begins before another.
        latest = jax.lax.cummax(self.begin - past)
        return jnp.where(self.begin - past >= latest, self.begin, past + latest)

    @whole
    def prepare(self):
        ramps = self.ramps()
        ramp, cruise, speed = ramps
        begin, after = self.begins(ramps), self.offset + jnp.cumsum(self.rise)
        times = begin[:, None] + jnp.cumsum(jnp.stack([0 * ramp, ramp, cruise, ramp], axis=-1), axis=-1)
        turned = speed * ramp / 2  # by how much it moves while its speed changes
        none, bend = jnp.zeros_like(ramp), speed / jnp.where(ramp > 0, ramp, 1.0) / 2
        pieces = [
            (after - self.rise, none, bend),
            (after - self.rise + turned, speed, none),
            (after - turned, speed, -bend),
            (after, none, none),
        ]
        moves = jnp.stack([jnp.stack(piece, axis=-1) for piece in pieces], axis=1).reshape(-1, 3)
        before = jnp.stack([self.offset, *jnp.zeros(2)])[None]
        return Pieces(jnp.concatenate([before, moves]), times.ravel())

    def __call__(self, time):
        return self.prepare()(time)

    def breaks(self):
        return self.prepare().times


class Quintic(AbstractDrive):
    """Through via points: a polynomial of degree five between each two of them. q'' is continuous, and q''' may jump at
    the points.

    Without `speeds` and `accelerations` it is the smoothest curve through the points that begins and ends at rest: the
    one with the least integral of q'''^2. With `speeds` only, the accelerations are chosen in this way. Before the
    first point and after the last one it goes on with the speed that it has there: from rest it stays where it is.

    **Arguments:**

    - `times` [s], increasing, and `values` [rad or m], of shape (n,) with n >= 2.
    - `speeds` [rad/s or m/s], and with them `accelerations` [rad/s^2 or m/s^2], of shape (n,), if they are prescribed.
    - `jumps`: by how much q'' jumps at each point, if it does (`accelerations` are then the values just after the
      point).
    """

    times: Values = physical("s", "times of the via points, increasing", '["0 s", "1 s", "2 s"]')
    values: Values = physical("coordinate", "the coordinate at these times", '["0 deg", "90 deg", "45 deg"]')
    speeds: Values | None = physical(
        "coordinate/s",
        "its rates at these times",
        '["0 deg/s", "20 deg/s", "0 deg/s"]',
        "those of least jerk, at rest at both ends",
        default=None,
    )
    accelerations: Values | None = physical(
        "coordinate/s^2",
        "its second rates at these times, only with `speeds`",
        '["0 deg/s^2", "-30 deg/s^2", "0 deg/s^2"]',
        "those of least jerk, zero at both ends",
        default=None,
    )
    jumps: Values | None = physical(
        "coordinate/s^2",
        "by how much its second rate jumps at these times (`accelerations` are those just after)",
        '["0 deg/s^2", "50 deg/s^2", "0 deg/s^2"]',
        "it does not jump",
        default=None,
    )

    def __check_init__(self):
        lists = [self.times, self.values, self.speeds, self.accelerations, self.jumps]
        lists = [x for x in lists if x is not None]
        if self.times.ndim != 1 or self.times.size < 2 or any(x.shape != self.times.shape for x in lists):
            raise ClearanceError(
                "A quintic drive needs `times`, `values` and any `speeds`, `accelerations` and `jumps` of one length "
                "of at least 2."
            )
        if self.accelerations is not None and self.speeds is None:
            raise ClearanceError("A quintic drive with `accelerations` needs `speeds` too.").about("speeds")
        if self.jumps is not None and self.accelerations is None:
            raise ClearanceError("A quintic drive with `jumps` needs `accelerations` too.").about("accelerations")
        if not isinstance(self.times, Tracer) and not np.all(np.diff(self.times) > 0):
            raise ClearanceError("The `times` of a quintic drive must increase.").about("times", self.times)

    @whole
    def prepare(self):
        if self.speeds is None or self.accelerations is None:
            speeds, accelerations = least_jerk(self.times, self.values, self.speeds)
        else:
            speeds, accelerations = self.speeds, self.accelerations
        h, rise = jnp.diff(self.times), jnp.diff(self.values)
        left = [h * speeds[:-1], h**2 * accelerations[:-1]]
        before = accelerations if self.jumps is None else accelerations - self.jumps
        right = [h * speeds[1:], h**2 * before[1:]]
        higher = jnp.stack([*left, *right, rise], axis=-1) @ HERMITE.T
        powers = jnp.stack([self.values[:-1], left[0], left[1] / 2, *higher.T], axis=-1)
        inner = powers / h[:, None] ** jnp.arange(6)[None]
        first, last = (jnp.stack([self.values[k], speeds[k], *jnp.zeros(4)])[None] for k in (0, -1))
        return Pieces(jnp.concatenate([first, inner, last]), self.times)

    def __call__(self, time):
        return self.prepare()(time)

    def breaks(self):
        return self.times
