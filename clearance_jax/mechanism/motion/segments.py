"""Segments of a path: lines, arcs and curves through poses.

All segments consist of stretches of one form, so that a path of any number of segments is one small program. For the
stretch's parameter 0 <= s <= 1 the place is a cubic and a turn of an arm about an axis; the orientation is a turn that
grows evenly after a cubic of quaternions.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import safe_sqrt, sincos
from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.motion.motion_laws import spline_curvature
from clearance_jax.mechanism.placement import Orientation, Position, PreparedOrientation
from clearance_jax.spatial import about, as_array, hamilton, matrix, quaternion_of_matrix, rotation_vector

Triple = Float[Array, "3"]
Quadruple = Float[Array, "4"]
# Places closer than this part of the path's size are the same.
SAME = 1e-9


def as_place(value: Any) -> Any:
    """A `Position` from two or three lengths [m]."""
    return Position(*value) if isinstance(value, (tuple, list, np.ndarray, jax.Array)) else value


class Pose(Module):
    """The place and the orientation of a frame, in the ground's axes.

    **Arguments:** `at`: its place [m], a `Position` or its numbers; `orientation`; `None`: any orientation.
    """

    at: Position = eqx.field(converter=as_place)
    orientation: Orientation | PreparedOrientation | None = None

    @property
    def place(self) -> Triple:
        """The place as an array."""
        return as_array(self.at.vector)

    @property
    def quaternion(self) -> Quadruple:
        """The orientation; without one that of the ground."""
        if self.orientation is None:
            return jnp.asarray([1.0, 0.0, 0.0, 0.0])
        q = as_array(quaternion_of_matrix(self.orientation.rotation.rows))
        return q / jnp.linalg.norm(q)


class Stretch(Module):
    """The numbers of stretches (see the module), many along the first axis: `length`, the growth of the path's
    parameter; powers of `place` and `quaternion`, lowest first; the turn of `arm` about `axis` by `sweep`; the rotation
    vector `turn`.
    """

    length: Float[Array, "*n"]
    place: Float[Array, "*n 4 3"]
    quaternion: Float[Array, "*n 4 4"]
    turn: Float[Array, "*n 3"]
    arm: Float[Array, "*n 3"]
    axis: Float[Array, "*n 3"]
    sweep: Float[Array, "*n"]

    def at(self, s: Scalar) -> tuple[Triple, Quadruple]:
        """Place and orientation (a quaternion of any length)."""
        powers = jnp.stack([jnp.ones_like(s), s, s * s, s * s * s])
        angle = safe_sqrt(jnp.sum(self.turn**2))
        sine, cosine = sincos(angle * s / 2)
        part = jnp.where(angle > 0, sine / jnp.where(angle > 0, angle, 1.0), s / 2)
        turned = hamilton((cosine, *(part * self.turn)), tuple(powers @ self.quaternion))
        rows = about((self.axis[0], self.axis[1], self.axis[2]), self.sweep * s)
        swung = matrix(rows) @ self.arm
        return powers @ self.place + swung, as_array(turned)


class Corner(NamedTuple):
    """Place and quaternion where a segment begins or ends."""

    place: Triple
    quaternion: Quadruple


def _turning(a: Quadruple, b: Quadruple) -> Triple:
    """The rotation vector from one orientation to another, the shorter way."""
    w, x, y, z = hamilton(tuple(b), (a[0], -a[1], -a[2], -a[3]))
    return as_array(rotation_vector((w, x, y, z)))


def _even(begin: Corner, end: Corner, length: Scalar) -> Stretch:
    """A straight stretch with a turn that grows evenly. A turn on the spot has its angle as length."""
    turn = _turning(begin.quaternion, end.quaternion)
    angle, none = safe_sqrt(jnp.sum(turn**2)), jnp.zeros(3)
    length = jnp.where(length > 0, length, jnp.where(angle > 0, angle, 1.0))
    place = jnp.stack([begin.place, end.place - begin.place, none, none])
    quaternion = jnp.stack([begin.quaternion, *jnp.zeros((3, 4))])
    return Stretch(length, place, quaternion, turn, none, jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(()))


class AbstractSegment(Module):
    """A part of a path, from where the one before it ends."""

    @property
    @abc.abstractmethod
    def poses(self) -> tuple[Pose, ...]:
        """The poses that it leads to, in their order."""

    @abc.abstractmethod
    def stretches(self, corners: list[Corner]) -> list[Stretch]:
        """Its stretches, from the corner where it begins and those of its poses."""

    def refusal(self, corners: list[Corner]) -> str:
        """Why there is no such segment, in words; empty if there is one."""
        del corners
        return ""


class Line(AbstractSegment):
    """A straight segment of a path, to a pose. The frame turns about one axis, the shorter way.

    **Arguments:** `to`: the pose at its end.
    """

    to: Pose

    @property
    def poses(self):
        return (self.to,)

    def stretches(self, corners):
        begin, end = corners
        return [_even(begin, end, safe_sqrt(jnp.sum((end.place - begin.place) ** 2)))]


class Arc(AbstractSegment):
    """A circular segment of a path, through a place to a pose. The frame turns about one axis, the shorter way.

    **Arguments:** `via`: a place on the way [m], a `Position` or three numbers; `to`: the pose at its end.
    """

    via: Position = eqx.field(converter=as_place)
    to: Pose

    @property
    def poses(self):
        return (self.to,)

    def stretches(self, corners):
        begin, end = corners
        # The centre of the circle through three points, by two sides of their triangle.
        p, q = as_array(self.via.vector) - begin.place, end.place - begin.place
        normal = jnp.cross(p, q)
        square = jnp.sum(normal**2)
        centre = jnp.cross((p @ p) * q - (q @ q) * p, normal) / (2 * square)
        axis, arm = normal / jnp.sqrt(square), -centre
        x, y = arm / jnp.linalg.norm(arm), jnp.cross(axis, arm) / jnp.linalg.norm(arm)
        # Seen along p x q, the via point comes before the end in the positive sense of rotation.
        sweep = jnp.arctan2((q - centre) @ y, (q - centre) @ x) % (2 * jnp.pi)
        even = _even(begin, end, sweep * jnp.linalg.norm(arm))
        place = jnp.stack([begin.place + centre, *jnp.zeros((3, 3))])
        return [Stretch(even.length, place, even.quaternion, even.turn, arm, axis, sweep)]

    def refusal(self, corners):
        begin, end = (np.asarray(corner.place) for corner in corners)
        p, q = np.asarray(as_array(self.via.vector)) - begin, end - begin
        reason = "its begin, `via` and end lie on a line, or two of them at one place, through which there is no circle"
        return reason if np.linalg.norm(np.cross(p, q)) <= SAME * max(p @ p, q @ q) else ""


class Curve(AbstractSegment):
    """A smooth segment of a path, through two poses or more: a cubic spline of place and quaternion, over the length of
    the chords between the poses. Velocity and acceleration have no jump at the poses, and neither has the turning.

    The speed along the curve differs from the prescribed one by the ratio of arc and chord.

    **Arguments:** `through`: the poses, in their order.
    """

    through: tuple[Pose, ...] = eqx.field(converter=tuple)

    @property
    def poses(self):
        return self.through

    def stretches(self, corners):
        places, turned = jnp.stack([c.place for c in corners]), [corners[0].quaternion]
        for corner in corners[1:]:
            # The nearer of the two quaternions of an orientation.
            turned.append(jnp.where(turned[-1] @ corner.quaternion < 0, -1.0, 1.0) * corner.quaternion)
        values = jnp.concatenate([places, jnp.stack(turned)], axis=1)
        chords = jnp.linalg.norm(jnp.diff(places, axis=0), axis=1)
        knots = jnp.concatenate([jnp.zeros(1), jnp.cumsum(chords)])
        bend = jax.vmap(lambda column: spline_curvature(knots, column, "natural"), 1, 1)(values)
        h = chords[:, None]
        first = jnp.diff(values, axis=0) - h**2 * (2 * bend[:-1] + bend[1:]) / 6
        powers = jnp.stack([values[:-1], first, h**2 * bend[:-1] / 2, h**2 * jnp.diff(bend, axis=0) / 6], axis=1)
        none, axis = jnp.zeros(3), jnp.asarray([0.0, 0.0, 1.0])
        return [
            Stretch(chord, power[:, :3], power[:, 3:], none, none, axis, jnp.zeros(()))
            for chord, power in zip(chords, powers, strict=True)
        ]

    def refusal(self, corners):
        if len(corners) < 3:
            return "it needs two poses or more to go through; for one take a `Line`"
        places = np.stack([np.asarray(c.place) for c in corners])
        if np.min(np.linalg.norm(np.diff(places, axis=0), axis=1)) <= SAME * np.max(np.ptp(places, axis=0)):
            return "two poses that follow each other are at one place"
        return ""
