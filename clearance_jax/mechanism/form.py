"""Which form the equations of motion of a mechanism have: written out number by number, or a loop over a table."""

from collections.abc import Callable
from typing import NamedTuple

from clearance_jax._once import compute_once

# A mechanism in space with more free velocities and conditions of ideal closures than these, without play and with it,
# or with more coordinates in all than the third, becomes a table: the mass matrix grows with the square of the free
# ones, the frames with all. Play makes so many steps that the time of an attempt decides; without it the time of
# compiling does. (An arm of 12 free coordinates takes 15 us an attempt written out, as a table 109. With a sleeve in
# each of six axes, 24 free ones, it takes 42 and 453 us, and its gradient over 3 ms 0.04 and 1.2 s; written out it
# compiles in 24 s, as a table in 8, its gradient in 80 and 14. A Delta robot of 15, closed by 15 conditions, takes 33
# and 255 us, but 27 attempts for a second, and compiles in 33 and 11 s.)
UNROLLED, PLAYED, FRAMED = 16, 24, 40


class EquationForm(NamedTuple):
    """What decides the form: free velocities, conditions of ideal closures (in space), coordinates in all, whether it
    has play, whether it stays in its plane.
    """

    free: int
    conditions: int
    coordinates: int
    has_play: bool
    is_plane: bool

    @property
    def most(self) -> int:
        """So many free velocities and conditions are written out."""
        return PLAYED if self.has_play else UNROLLED

    @property
    def is_table(self) -> bool:
        """Whether it is a loop over a table of links."""
        many = self.free + self.conditions > self.most or self.coordinates > FRAMED
        return many and not self.is_plane

    def once(self, program: Callable) -> Callable:
        """A program of it that computes each number once. (A table is computed in products of arrays, which nothing
        repeats: barriers would only keep them apart.)
        """
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
