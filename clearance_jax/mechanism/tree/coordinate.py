"""What kinds of joints share: elementary coordinates in the tree, conditions in loops, keys of scene files."""

from typing import NamedTuple

import equinox as eqx

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.placement import Axis, as_axis
from clearance_jax.parameters import describe
from clearance_jax.spatial import Vector


class Coordinate(NamedTuple):
    """One elementary coordinate of a joint: its name, its motion, the axis that it slides along or turns about
    (neither: a ball, with a quaternion and three rates); for a play coordinate its magnitude, and whether it is one of
    the two tilts of a swing.
    """

    name: str
    motion: Motion
    slides: Vector | None = None
    turns: Vector | None = None
    play: Scalar | None = None
    swings: bool = False

    @property
    def is_ball(self) -> bool:
        """Whether it is an orientation."""
        return self.slides is None and self.turns is None

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of its positions."""
        return tuple(f"{self.name}.{k}" for k in "wxyz") if self.is_ball else (self.name,)

    @property
    def velocities(self) -> tuple[str, ...]:
        """Names of its velocities."""
        return tuple(f"{self.name}.{k}" for k in "xyz") if self.is_ball else (self.name,)


class JointConstraint(NamedTuple):
    """The conditions of an ideal joint, between its frame A on the parent and its frame B on the child.

    - `along`: the directions in A along which B's origin may not leave A's; `None`: all of them.
    - `square`: pairs of an axis of A and one of B that stay perpendicular.
    - `parallel`: axes of A and of B that are one line and point the same way.
    """

    along: tuple[Vector, ...] | None
    square: tuple[tuple[Vector, Vector], ...]
    parallel: tuple[tuple[Vector, Vector], ...] = ()

    @property
    def count(self) -> int:
        """The number of conditions in space."""
        return (3 if self.along is None else len(self.along)) + len(self.square)


AXIS = (
    "what it turns about or slides along, of a planar joint the normal of its plane: an axis of its frame, by its "
    "letter or by three numbers"
)


def orientation_key(help: str = "roll, pitch and yaw of the joint's frame in the parent's, instead of `angle`"):
    """The field of the orientation of a joint's frame on its parent."""
    return describe(help, '["90 deg", "0 deg", "0 deg"]', "not turned", default=None)


def child_axes_key():
    """The field of the orientation of a joint's frame on its child."""
    return orientation_key("roll, pitch and yaw of the joint's frame in the child's")


def axis_key(default: str):
    """A field that is an axis of the joint's frame."""
    about = {"help": AXIS, "example": '"z"', "absent": default}
    return eqx.field(metadata=about, converter=as_axis, default=Axis(default))
