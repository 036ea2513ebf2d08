"""What joints are made of: elementary coordinates where they are in the tree, conditions where they close loops."""

from typing import NamedTuple

from clearance_jax._types import Scalar
from clearance_jax.mechanism.body import Motion
from clearance_jax.spatial import Vector


class Coordinate(NamedTuple):
    """One elementary coordinate of a joint: its name, how it moves, the axis it slides along or turns about (neither:
    it is a ball, an orientation by a quaternion with three rates), and of a play coordinate its magnitude, and whether
    it is one of the two tilts of a swing.
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
    """What an ideal joint forbids, between the joint's frame A on the parent and its frame B on the child.

    - `along`: the directions in A along which B's origin may not leave A's; `None`: none at all.
    - `square`: pairs of an axis of A and one of B that stay perpendicular.
    - `parallel`: axes of A and of B that are one line, pointing the same way.
    """

    along: tuple[Vector, ...] | None
    square: tuple[tuple[Vector, Vector], ...]
    parallel: tuple[tuple[Vector, Vector], ...] = ()

    @property
    def count(self) -> int:
        """How many conditions it makes in space."""
        return (3 if self.along is None else len(self.along)) + len(self.square)
