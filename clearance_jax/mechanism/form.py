"""The form of a mechanism's equations of motion: written out number by number, with the mass matrix factored whole or
joint by joint, or in loops over a table.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.tree.tree import AbstractJoint

# A mechanism in space becomes a table if its free velocities and conditions of ideal closures are more than UNROLLED
# (with play: PLAYED), or if its coordinates are more than FRAMED. With play, free velocities of joints that take up all
# forces do not count, up to WHOLE coordinates (ten sleeves in a chain have 60). Written out it runs several times
# faster, as a table it compiles sooner. Play makes so many steps that the time of an attempt decides; without play the
# time of compiling does.
UNROLLED, PLAYED, FRAMED, WHOLE = 16, 40, 40, 64


class EquationForm(NamedTuple):
    """What decides the form: free velocities (`loose` ones of joints that take up all forces), conditions in space, all
    coordinates, play, whether it is plane, and whether factors `by_blocks` cost fewer operations.
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
    def spared(self) -> int:
        """The number of free velocities that does not count."""
        return self.loose if self.has_play and self.coordinates <= WHOLE else 0

    @property
    def size(self) -> int:
        """The number of free velocities and conditions that counts."""
        return self.free + self.conditions - self.spared

    @property
    def is_table(self) -> bool:
        """Whether it is loops over a table of links."""
        many = self.size > self.most or self.coordinates - self.spared > FRAMED
        return many and not self.is_plane

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
            return f"loops over a table of its links ({size}: {why}; it compiles sooner and runs slower)"
        rest = f", {self.spared} of them in joints that take up all forces" if self.spared else ""
        return f"written out number by number{how} ({size}{rest}; a table from {self.most + 1} on)"


class Columns(NamedTuple):
    """The free coordinates of a joint: how many, how many before them, and whether they take up all forces."""

    count: int
    before: int
    is_loose: bool


def columns_of(joints: Sequence[AbstractJoint], is_plane: bool) -> dict[str, Columns]:
    """The free coordinates of a tree's joints, by joint, parents first.

    A joint takes up all forces if it slides freely along all axes before it turns, has no rotor, and carries nothing
    that passes a force on.
    """
    pushed, loose = set(), set()
    for joint in reversed(joints):
        free = [c for c in joint.own_coordinates() if c.motion.is_free]
        axes = [c.slides for c in free if c.slides is not None]
        first = all(c.slides is not None for c in free[: len(axes)])
        all_ways = len(set(axes)) == len(axes) == (2 if is_plane else 3)
        if (
            joint.child not in pushed
            and all_ways
            and first
            and not any(c.motion.rotor_inertia is not None for c in free)
        ):
            loose.add(joint.name)
        elif free or joint.child in pushed:
            pushed.add(joint.parent)
    before, out = {GROUND: 0}, {}
    for joint in joints:
        count = sum(len(c.velocities) for c in joint.own_coordinates() if c.motion.is_free)
        before[joint.child] = before[joint.parent] + count
        out[joint.name] = Columns(count, before[joint.parent], joint.name in loose)
    return out


# Operations of the mass matrix and its factors, counted in programs of chains: by column, by column and column before
# it; by joint that takes up all forces, and by column of another one.
_SPACE, _PLANE = (75, 14, 414, 160), (10, 2, 24, 37)


def is_less_by_blocks(every: Iterable[Columns], is_plane: bool) -> bool:
    """Whether factors joint by joint cost fewer operations than those of the whole matrix."""
    alone, pair, loose, other = _PLANE if is_plane else _SPACE
    whole = blocks = 0
    for count, before, is_loose in every:
        whole += sum(alone + pair * depth + depth**2 for depth in range(before + 1, before + count + 1))
        blocks += loose if is_loose else other * count
    return blocks < whole
