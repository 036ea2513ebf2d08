"""The form of a mechanism's equations of motion: written out number by number, or a loop over a table."""

from collections.abc import Callable
from typing import NamedTuple

from clearance_jax._compile.once import compute_once

# A mechanism in space becomes a table if its free velocities and conditions of ideal closures are more than UNROLLED
# (with play: PLAYED), because the mass matrix grows with their square; or if its coordinates in all are more than
# FRAMED, because the frames grow with them. Written out it runs several times faster, as a table it compiles several
# times faster. Play makes so many steps that the time of an attempt decides; without play the time of compiling does.
UNROLLED, PLAYED, FRAMED = 16, 24, 40


class EquationForm(NamedTuple):
    """What decides the form: free velocities, conditions in space, all coordinates, play, and whether it is plane."""

    free: int
    conditions: int
    coordinates: int
    has_play: bool
    is_plane: bool

    @property
    def most(self) -> int:
        """The largest number of free velocities and conditions that is written out."""
        return PLAYED if self.has_play else UNROLLED

    @property
    def is_table(self) -> bool:
        """Whether it is a loop over a table of links."""
        many = self.free + self.conditions > self.most or self.coordinates > FRAMED
        return many and not self.is_plane

    def once(self, program: Callable) -> Callable:
        """A program that computes each number once. (That of a table does so anyway, by products of arrays.)"""
        return program if self.is_table else compute_once(program)

    def __str__(self) -> str:
        if self.is_plane:
            return "written out number by number, as every mechanism in a plane"
        closed = f" and {self.conditions} conditions of ideal closures" if self.conditions else ""
        size = f"{self.free} free velocities{closed}"
        if self.is_table:
            why = (
                f"more than {self.most}{' with play' if self.has_play else ''}"
                if self.free + self.conditions > self.most
                else f"{self.coordinates} coordinates in all, more than {FRAMED}"
            )
            return f"a loop over a table of its links ({size}: {why}; it compiles sooner and runs slower)"
        return f"written out number by number ({size}; a table from {self.most + 1} on)"
