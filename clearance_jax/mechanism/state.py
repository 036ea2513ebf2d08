"""Layout of a flat state vector `[q, v, memory]`; quadratures (energy balance, integrals) may follow.

Positions and velocities are counted apart: an orientation in space has four numbers and three rates.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Rows
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.actuators import AbstractActuator
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.variants import acting
from clearance_jax.spatial import Term, add, as_array, dot, plus, quaternion_rate, scale


class State(NamedTuple):
    """A state by its parts: positions, velocities, and `memory`: by the name of a clearance joint the memory of its
    laws, by the name of a sampled actuator or controller the efforts that it holds, of a servo its integral.
    """

    q: Rows
    v: Rows
    memory: dict[str, Rows]


class Acting(NamedTuple):
    """An actuator or a controller: its name, the coordinates that it acts on, and its sampling period."""

    name: str
    coordinates: tuple[str, ...]
    part: AbstractActuator | AbstractController

    @property
    def period(self) -> float | None:
        """The period at which it is sampled [s]; `None`: it acts all the time."""
        return self.part.sampling_period() if isinstance(self.part, AbstractActuator) else self.part.period

    @property
    def integrates(self) -> bool:
        """Whether it is an actuator that integrates its error."""
        return isinstance(self.part, AbstractActuator) and self.part.integrates


def effort_sources(mechanism: AbstractMechanism) -> tuple[Acting, ...]:
    """Everything that exerts efforts."""
    out = [
        Acting(f"{c.name}.actuator{i}", (c.name,), actuator)
        for c in mechanism.moved_coordinates()
        for i, actuator in (acting(c.motion) if isinstance(c.motion, Motion) else ())
    ]
    controlled = [Acting(c.name, tuple(r.name for r in c.references), c) for c in mechanism.controllers]
    return (*out, *controlled)


def actuated_coordinates(mechanism: AbstractMechanism) -> "tuple[StateSlices, ...]":
    """The coordinates on which something exerts efforts, with their slices among all that no drive prescribes."""
    names = {name for source in effort_sources(mechanism) for name in source.coordinates}
    return tuple(part for part in moved_parts(mechanism) if part.coordinate.name in names)


class Layout(NamedTuple):
    """Places in a state (static): names of positions, velocities, memory of each joint, integrals of servos, and held
    efforts, in this order.

    `q`, `v` and `memory` are the slices of the positions, of the velocities, and of the rest; `free`, `remembered`,
    `held` and `integrated` the numbers of velocities, of memory variables (all of them), of held efforts, and of
    integrals. Laws and sampled sources renew their memory where a step starts (`is_latched`); integrals are only rates.
    """

    positions: tuple[str, ...]
    velocities: tuple[str, ...]
    memories: tuple[tuple[str, tuple[str, ...]], ...]
    efforts: tuple[tuple[str, tuple[str, ...]], ...] = ()
    integrals: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def free(self) -> int:
        return len(self.velocities)

    @property
    def q(self) -> slice:
        return slice(0, len(self.positions))

    @property
    def v(self) -> slice:
        return slice(len(self.positions), len(self.positions) + len(self.velocities))

    @property
    def memory(self) -> slice:
        return slice(self.v.stop, self.size)

    @property
    def remembered(self) -> int:
        return sum(len(names) for _, names in self.every_memory)

    @property
    def every_memory(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """All memory variables with their holders, in their order."""
        return (*self.memories, *self.integrals, *self.efforts)

    @property
    def integrated(self) -> int:
        return len(self.integrals)

    @property
    def is_latched(self) -> bool:
        return self.remembered > self.integrated

    @property
    def held(self) -> int:
        return sum(len(names) for _, names in self.efforts)

    @property
    def size(self) -> int:
        """Length of a state without quadratures."""
        return len(self.positions) + len(self.velocities) + self.remembered

    def split(self, y: Array | Rows) -> State:
        """A state, as a vector or as rows, by its parts."""
        rows = tuple(y[i] for i in range(self.size))
        memory, start = {}, self.v.stop
        for name, names in self.every_memory:
            memory[name] = rows[start : start + len(names)]
            start += len(names)
        return State(rows[self.q], rows[self.v], memory)

    def index(self, joint: str, memory: str) -> int:
        """The place of a named memory variable of a joint."""
        names = [(name, variable) for name, variables in self.every_memory for variable in variables]
        return self.v.stop + names.index((joint, memory))


def layout(mechanism: AbstractMechanism) -> Layout:
    """The state layout of a mechanism."""
    memories = tuple((j.name, j.clearance.remembers) for j in mechanism.contacts())
    free = mechanism.free_coordinates()
    positions = tuple(name for c in free for name in c.positions)
    every = effort_sources(mechanism)
    efforts = tuple((s.name, s.coordinates) for s in every if s.period is not None)
    integrals = tuple((s.name, ("integral",)) for s in every if s.integrates)
    return Layout(positions, tuple(name for c in free for name in c.velocities), memories, efforts, integrals)


def initial_values(mechanism: AbstractMechanism) -> Array:
    """The given initial positions and velocities of the free coordinates."""
    starts = [c.motion.initial() for c in mechanism.free_coordinates()]
    return as_array([x for q, _ in starts for x in q] + [x for _, v in starts for x in v])


class StateSlices(NamedTuple):
    """The slices of a free coordinate among the positions and among the velocities."""

    coordinate: Coordinate
    q: slice
    v: slice


def parts(mechanism: AbstractMechanism) -> tuple[StateSlices, ...]:
    """Every free coordinate with its slices."""
    return _slices(mechanism.free_coordinates())


def moved_parts(mechanism: AbstractMechanism) -> tuple[StateSlices, ...]:
    """Every coordinate that no drive prescribes, with its slices in an unfolded state (see `unfold`)."""
    return _slices(mechanism.moved_coordinates())


def _slices(coordinates: Iterable[Coordinate]) -> tuple[StateSlices, ...]:
    out, q, v = [], 0, 0
    for c in coordinates:
        out.append(StateSlices(c, slice(q, q + len(c.positions)), slice(v, v + len(c.velocities))))
        q, v = out[-1].q.stop, out[-1].v.stop
    return tuple(out)


def position_rates(mechanism: AbstractMechanism, q: Rows, v: Rows) -> Rows:
    """Rates of the positions: the velocities, except for an orientation."""
    if len(q) == len(v):
        return tuple(v)
    rates = []
    for part in parts(mechanism):
        speeds = v[part.v]
        rates += quaternion_rate(q[part.q], (speeds[0], speeds[1], speeds[2])) if part.coordinate.is_ball else speeds
    return tuple(jnp.asarray(rate, float) for rate in rates)


def place_rates(mechanism: AbstractMechanism, y: Array) -> Array:
    """Rates of the positions in a state `[q, v, ...]`."""
    plan = layout(mechanism)
    return as_array(position_rates(mechanism, tuple(y[plan.q]), tuple(y[plan.v])))


def move(mechanism: AbstractMechanism, q: Rows, change: Sequence[Term]) -> tuple[Term, ...]:
    """Positions after a small change, given like velocities; orientations of unit length."""
    out = []
    for part in parts(mechanism):
        at, by = q[part.q], change[part.v]
        if not part.coordinate.is_ball:
            out.append(plus(at[0], by[0]))
            continue
        turned = add(at, quaternion_rate(at, (by[0], by[1], by[2])))
        out += scale(1.0 / jnp.sqrt(jnp.asarray(dot(turned, turned))), turned)
    return tuple(out)


def vector(state: Rows) -> Array:
    """A state, or its rate, as one flat vector."""
    return jnp.stack([jnp.asarray(row, float) for row in state]) if state else jnp.zeros(0)
