"""The form of a mechanism's equations of motion: written out number by number, with the mass matrix factored whole or
joint by joint, or a loop over a table.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from clearance_jax._compile.once import compute_once
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.tree.tree import AbstractJoint

# A mechanism in space becomes a table if its free velocities and conditions of ideal closures are more than UNROLLED
# (with play: PLAYED, and those of joints that take up all forces do not count), or if it has no play and more than
# FRAMED coordinates. Written out it runs many times faster, as a table it compiles sooner. Play makes so many steps
# that the time of an attempt decides; without play the time of compiling does.
UNROLLED, PLAYED, FRAMED = 16, 40, 40


class EquationForm(NamedTuple):
    """What decides the form: free velocities (`loose` ones of joints that slide freely along all axes), conditions in
    space, all coordinates, play, whether it is plane, and whether factors `by_blocks` cost fewer operations.
    """

    free: int
    conditions: int
    coordinates: int
    has_play: bool
    is_plane: bool
    loose: int = 0
    by_blocks: bool = False

    @property
    def most(self) -> int:
        """The largest number of free velocities and conditions that is written out."""
        return PLAYED if self.has_play else UNROLLED

    @property
    def size(self) -> int:
        """The number of free velocities and conditions that counts."""
        return self.free + self.conditions - (self.loose if self.has_play else 0)

    @property
    def is_table(self) -> bool:
        """Whether it is a loop over a table of links."""
        many = self.size > self.most or (self.coordinates > FRAMED and not self.has_play)
        return many and not self.is_plane

    def once(self, program: Callable) -> Callable:
        """A program that computes each number once. (That of a table does so anyway, by products of arrays.)"""
        return program if self.is_table else compute_once(program)

    def __str__(self) -> str:
        how = ", joint by joint" if self.by_blocks else ""
        if self.is_plane:
            return f"written out number by number{how}, as every mechanism in a plane"
        closed = f" and {self.conditions} conditions of ideal closures" if self.conditions else ""
        size = f"{self.free} free velocities{closed}"
        if self.is_table:
            why = (
                f"more than {self.most}{' with play' if self.has_play else ''}"
                if self.size > self.most
                else f"{self.coordinates} coordinates in all, more than {FRAMED}"
            )
            return f"a loop over a table of its links ({size}: {why}; it compiles sooner and runs slower)"
        rest = f", {self.loose} of them in joints that take up all forces" if self.has_play and self.loose else ""
        return f"written out number by number{how} ({size}{rest}; a table from {self.most + 1} on)"


class Columns(NamedTuple):
    """The free coordinates of a joint: how many, how many before them, and whether they take up all forces."""

    own: int
    before: int
    is_loose: bool


def columns_of(joints: Sequence[AbstractJoint], is_plane: bool) -> list[Columns]:
    """The free coordinates of a tree's joints, parents first."""
    before, out = {GROUND: 0}, []
    for joint in joints:
        free = [c for c in joint.own_coordinates() if c.motion.is_free]
        own, slides = sum(len(c.velocities) for c in free), sum(c.slides is not None for c in free)
        before[joint.child] = before[joint.parent] + own
        if own:
            out.append(Columns(own, before[joint.parent], slides == (2 if is_plane else 3)))
    return out


# Operations of the mass matrix and its factors, counted in programs of chains: by column, by column and column before
# it; by joint that takes up all forces, and by column of another one.
_SPACE, _PLANE = (75, 14, 414, 160), (10, 2, 24, 37)


def is_less_by_blocks(every: Sequence[Columns], is_plane: bool) -> bool:
    """Whether factors joint by joint cost fewer operations than those of the whole matrix."""
    alone, pair, loose, other = _PLANE if is_plane else _SPACE
    depths = [k for columns in every for k in range(columns.before + 1, columns.before + columns.own + 1)]
    whole = sum(alone + pair * depth + depth**2 for depth in depths)
    blocks = sum(loose if columns.is_loose else other * columns.own for columns in every)
    return blocks < whole
