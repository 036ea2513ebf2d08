"""What a flat state vector means: `[q, v, memory]`, which quadratures (books, integrals) may follow.

Positions and velocities are counted apart: an orientation in space has four numbers and three rates.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._types import Rows
from clearance_jax.mechanism.mechanism import Mechanism


class State(NamedTuple):
    """One state by its parts: positions, velocities, and the memory of each clearance joint by its name."""

    q: Rows
    v: Rows
    memory: dict[str, Rows]


class Layout(NamedTuple):
    """Where each quantity lives in a state (static): names of the positions, of the velocities, and of the memory of
    each clearance joint.
    """

    positions: tuple[str, ...]
    velocities: tuple[str, ...]
    memories: tuple[tuple[str, tuple[str, ...]], ...]

    @property
    def free(self) -> int:
        """Number of free velocities."""
        return len(self.velocities)

    @property
    def q(self) -> slice:
        """The positions."""
        return slice(0, len(self.positions))

    @property
    def v(self) -> slice:
        """The velocities."""
        return slice(len(self.positions), len(self.positions) + len(self.velocities))

    @property
    def memory(self) -> slice:
        """The laws' memory."""
        return slice(self.v.stop, self.size)

    @property
    def remembered(self) -> int:
        """Number of memory variables."""
        return sum(len(names) for _, names in self.memories)

    @property
    def size(self) -> int:
        """Length of a state without quadratures."""
        return len(self.positions) + len(self.velocities) + self.remembered

    def split(self, y: Array | Rows) -> State:
        """A state, as a vector or as rows, by its parts."""
        rows = tuple(y[i] for i in range(self.size))
        memory, start = {}, self.v.stop
        for name, names in self.memories:
            memory[name] = rows[start : start + len(names)]
            start += len(names)
        return State(rows[self.q], rows[self.v], memory)

    def index(self, joint: str, memory: str) -> int:
        """The place of a named memory variable of a joint."""
        start = self.v.stop
        for name, names in self.memories:
            if name == joint:
                return start + names.index(memory)
            start += len(names)
        raise KeyError(f"{joint}.{memory}")


def layout(mechanism: Mechanism) -> Layout:
    """The state layout of a mechanism."""
    memories = tuple((j.name, j.clearance.remembers) for j in mechanism.clearance_joints())
    names = tuple(c.name for c in mechanism.free_coordinates())
    return Layout(names, names, memories)


def vector(state: Rows) -> Array:
    """A state, or its rate, as one flat vector."""
    return jnp.stack([jnp.asarray(row, float) for row in state]) if state else jnp.zeros(0)
