"""Elements of joints: elementary coordinates in the tree, conditions in loops."""

from typing import NamedTuple

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.body import Motion
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
