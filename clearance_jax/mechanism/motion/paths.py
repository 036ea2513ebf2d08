"""Paths of a frame in space: segments, and the speed along them (see `segments`)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.roots import bisect
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.motion.drives import Quintic, Trapezoid
from clearance_jax.mechanism.motion.motion_laws import Values
from clearance_jax.mechanism.motion.pieces import Pieces
from clearance_jax.mechanism.motion.segments import (
    AbstractSegment,
    Arc,
    Corner,
    Curve,
    Line,
    Pose,
    Quadruple,
    Stretch,
    Triple,
)
from clearance_jax.parameters import physical
from clearance_jax.spatial import as_array, hamilton, matrix, of_quaternion

__all__ = ["AbstractSegment", "Arc", "CartesianPath", "Curve", "Line", "Waypoint"]

# Bisections of a path's duration for the instants of its via points: enough for the last digit.
HALVINGS = 60


class Waypoint(NamedTuple):
    """Where a path is at a time, and how it moves, in the ground's axes.

    - `position` [m], `velocity` [m/s], `acceleration` [m/s^2] of the frame, of shape (3,).
    - `rotation`: its rotation matrix, of shape (3, 3); `spin` [rad/s] and `spin_rate` [rad/s^2], of shape (3,).
    """

    position: Triple
    velocity: Triple
    acceleration: Triple
    rotation: Float[Array, "3 3"]
    spin: Triple
    spin_rate: Triple


class CartesianPath(Module):
    """A path of a frame, segment after segment, each from rest to rest. Before the path begins, the frame is at its
    start; after the path ends, at its end.

    **Arguments:**

    - `start`: the pose at which it begins. If it has no orientation, the path prescribes places only. If it has one, a
      later pose without an orientation keeps that of the pose before.
    - `segments`: any of `Line`, `Arc`, `Curve`.
    - `durations` [s], of shape (segments,): how long each segment takes. The distance is then a quintic polynomial of
      time (the acceleration has no jump). Instead of durations you may give
    - `speed` [m/s], `acceleration` [m/s^2]: limits, with which the speed is a trapezoid over time (the acceleration
      jumps).
    - `begin` [s]: when the path begins.

    **Raises:** `ClearanceError` for a segment of another kind, for an orientation where the start has none, and for
    neither or both of durations and limits.
    """

    start: Pose
    segments: tuple[AbstractSegment, ...] = eqx.field(converter=tuple)
    durations: Values | None = physical("s", above=0.0, default=None)
    speed: Scalar | None = physical("m/s", above=0.0, default=None)
    acceleration: Scalar | None = physical("m/s^2", above=0.0, default=None)
    begin: Scalar = physical("s", default=0.0)

    def __check_init__(self):
        if not self.segments or not all(isinstance(segment, AbstractSegment) for segment in self.segments):
            raise ClearanceError("`segments` of a path must be one or more of `Line`, `Arc` and `Curve`.")
        given = [x is not None for x in (self.speed, self.acceleration)]
        if any(given) != all(given) or all(given) == (self.durations is not None):
            raise ClearanceError("A path needs `durations`, or `speed` and `acceleration` instead of them.")
        if self.durations is not None and self.durations.shape != (len(self.segments),):
            raise ClearanceError(
                f"`durations` of a path must have one number for each of its {len(self.segments)} segments, but their "
                f"shape is {self.durations.shape}."
            )
        later = [pose for segment in self.segments for pose in segment.poses]
        if not self.oriented and any(pose.orientation is not None for pose in later):
            raise ClearanceError("A pose of the path has an orientation, but its `start` has none: give it one too.")
        if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            self._check_numbers()

    def _check_numbers(self):
        for name in ("durations", "speed", "acceleration"):
            value = getattr(self, name)
            if value is not None and not np.all(np.asarray(value) > 0):
                raise ClearanceError(f"`{name}` of a path must be greater than zero.")
        for i, (segment, corners) in enumerate(zip(self.segments, self.corners(), strict=True), start=1):
            kind = f"Segment {i} of the path, {type(segment).__name__}"
            if not all(np.all(np.isfinite(np.asarray(corner.place))) for corner in corners):
                raise ClearanceError(f"{kind}: its places must be finite.")
            why = segment.refusal(corners)
            if why:
                raise ClearanceError(f"{kind}: {why}.")
            on_spot = np.ptp([np.asarray(corner.place) for corner in corners], axis=0).max() == 0
            if self.durations is None and on_spot:
                raise ClearanceError(f"{kind}, stays at its place: a speed says nothing of it. Give `durations`.")

    @property
    def oriented(self) -> bool:
        """Whether it prescribes the orientation."""
        return self.start.orientation is not None

    def corners(self) -> list[list[Corner]]:
        """By segment: its start and the poses that it leads to."""
        at, out = Corner(self.start.place, self.start.quaternion), []
        for segment in self.segments:
            ends = [at]
            for pose in segment.poses:
                turned = ends[-1].quaternion if pose.orientation is None else pose.quaternion
                ends.append(Corner(pose.place, turned))
            out.append(ends)
            at = ends[-1]
        return out

    @whole
    def prepare(self) -> "PreparedPath":
        """The path with what depends only on its numbers computed."""
        made = [segment.stretches(ends) for segment, ends in zip(self.segments, self.corners(), strict=True)]
        lengths = jnp.stack([jnp.sum(jnp.stack([stretch.length for stretch in stretches])) for stretches in made])
        if self.durations is not None:
            times = self.begin + jnp.concatenate([jnp.zeros(1), jnp.cumsum(self.durations)])
            still = jnp.zeros_like(times)
            law = Quintic(times, jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)]), still, still).prepare()
        else:
            begin = jnp.broadcast_to(self.begin, lengths.shape)  # a move waits until the one before it has ended
            law = Trapezoid(begin, lengths, self.speed, self.acceleration).prepare()
        every = [stretch for stretches in made for stretch in stretches]
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *every)
        lasts = np.cumsum([len(stretches) for stretches in made]) - 1
        inner = tuple(i for i in range(len(every)) if i not in lasts)
        return PreparedPath(stacked, jnp.cumsum(stacked.length), law, self.oriented, inner)

    def __call__(self, time: Scalar | float) -> Waypoint:
        """Where it is at a time [s], and how it moves."""
        return self.prepare()(time)

    def breaks(self) -> Values:
        """Times at which a derivative jumps [s], increasing: ends of segments, ramps, poses of curves."""
        return self.prepare().breaks()

    @property
    def end(self) -> Scalar:
        """When it ends [s]."""
        return self.prepare().law.times[-1]


class PreparedPath(Module):
    """A path as a program evaluates it: `stretches`; the path's parameter at their `ends`, of which `inner` are the
    indices of those within a segment; `law`: the parameter as a function of time.
    """

    stretches: Stretch
    ends: Values
    law: Pieces
    oriented: bool = eqx.field(static=True)
    inner: tuple[int, ...] = eqx.field(static=True)

    def pose(self, time: Scalar, beside: Scalar) -> tuple[Triple, Quadruple]:
        """Place and quaternion at a time, on the smooth piece that holds at the time `beside`."""
        here, _, _ = self.law.within(time, beside)
        index = jnp.sum(self.law.within(beside, beside)[0] >= self.ends[:-1])
        stretch = jax.tree.map(lambda leaf: leaf[index], self.stretches)
        return stretch.at((here - self.ends[index] + stretch.length) / stretch.length)

    def motion(self, time: Scalar, beside: Scalar) -> tuple[Triple, Quadruple, Triple, Triple]:
        """Place, quaternion, velocity and spin at a time, on the piece at the time `beside`."""
        (place, q), (velocity, change) = jax.jvp(lambda t: self.pose(t, beside), (time,), (jnp.ones_like(time),))
        _, x, y, z = hamilton(tuple(change), (q[0], -q[1], -q[2], -q[3]))
        return place, q, velocity, 2 * as_array((x, y, z)) / jnp.sum(q**2)

    @whole
    def __call__(self, time: Scalar | float) -> Waypoint:
        at = jnp.asarray(time, float)
        (place, q, velocity, spin), (_, _, acceleration, spin_rate) = jax.jvp(
            lambda t: self.motion(t, at), (at,), (jnp.ones_like(at),)
        )
        return Waypoint(place, velocity, acceleration, matrix_of(q), spin, spin_rate)

    @whole
    def breaks(self) -> Values:
        if not self.inner:
            return self.law.times
        ends = self.ends[np.array(self.inner)]
        # The parameter grows monotonically: where it passes them.
        span = jnp.full_like(ends, self.law.times[0]), jnp.full_like(ends, self.law.times[-1])
        _, passed = bisect(lambda time: jax.vmap(lambda t: self.law(t)[0])(time) < ends, *span, HALVINGS)
        return jnp.sort(jnp.concatenate([self.law.times, passed]))


def matrix_of(quaternion: Quadruple) -> Float[Array, "3 3"]:
    """The rotation matrix of a quaternion of any length."""
    return matrix(of_quaternion(*quaternion))
