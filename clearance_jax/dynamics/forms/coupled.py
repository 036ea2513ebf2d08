"""The equations of motion with couplings: those of the tree in which followers move by themselves, under the conditions
that they follow.

With v = G v_free of all velocities, the mass matrix of the free ones is G^T M G. It is not formed: M keeps the factors
of its tree, and a solution is corrected by the forces of the couplings, as those of closed loops.
"""

import dataclasses
from typing import Any

import equinox as eqx

from clearance_jax._basis.module import Module
from clearance_jax._basis.symmetric import AbstractConstraint, AbstractFactors, Row
from clearance_jax.dynamics.forms.frames import Extra, Frames, Moves, rotors
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.unfolded import Unfolded, fold, spread
from clearance_jax.spatial import ZERO, Term, Vector, add, as_array, minus, plus, scale, times


class CoupledFrames(Module, Frames):
    """Frames of a mechanism with couplings; `tree`: those of its tree, where followers move by themselves; `weights`:
    by velocity of the tree, the free velocities that it follows, each with its factor; `known`: by velocity of it,
    its acceleration without those of the free ones; `count`: of free velocities.
    """

    mechanism: PreparedMechanism
    tree: Any
    weights: tuple[dict[int, Term], ...]
    known: tuple[Term, ...]
    count: int = eqx.field(static=True)

    @property
    def is_solved_implicitly(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.tree.is_solved_implicitly

    @property
    def followers(self) -> list[int]:
        """The velocities of the tree that follow others."""
        leaders = set(self.leaders)
        return [i for i in range(len(self.weights)) if i not in leaders]

    @property
    def leaders(self) -> list[int]:
        """By free velocity, its index in the tree."""
        names = [c.name for c in self.mechanism.free_coordinates() for _ in c.velocities]
        every = [c.name for c in self.mechanism.moved_coordinates() for _ in c.velocities]
        return [i for i, name in enumerate(every) if name in names]

    def __getitem__(self, body):
        return self.tree[body]

    def with_motions(self):
        return dataclasses.replace(self, tree=self.tree.with_motions())

    def velocities(self, body, point, base=None, beside=ZERO):
        return self._gathered(self.tree.velocities(body, point, base, beside))

    def spins(self, body, base=None):
        return self._gathered(self.tree.spins(body, base))

    def _gathered(self, moves: Moves) -> Moves:
        if not isinstance(moves.every, list):
            return Moves(self.matrix.T @ moves.every)
        out: list[Vector] = [ZERO] * self.count
        for each, move in zip(self.weights, moves.every, strict=True):
            for i, factor in each.items():
                out[i] = add(out[i], scale(factor, move))
        return Moves(out)

    @property
    def matrix(self):
        """G as an array."""
        rows = [as_array([each.get(i, 0.0) for i in range(self.count)]) for each in self.weights]
        return as_array(rows)

    def extra(self, acceleration) -> Extra:
        return self.tree.extra(spread(self.weights, acceleration))

    def mass_matrix(self, firm=None):
        leaders = self.leaders
        inertia = self.tree.mass_matrix(firm and {leaders[i]: much for i, much in firm.items()})
        rows = []
        for k in self.followers:
            row: list[Term] = [0.0] * len(self.weights)
            row[k] = 1.0
            for i, factor in self.weights[k].items():
                row[leaders[i]] = minus(row[leaders[i]], factor)
            rows.append(Row(row))
        return CoupledFactors(inertia, inertia.constraint(rows, lambda _: None), rows, tuple(leaders))

    def wrenches(self, acceleration):
        return self.tree.wrenches(spread(self.weights, acceleration))

    def load(self, pairs, acceleration=None):
        return fold(self.weights, self.whole_load(pairs, acceleration), self.count)

    def load_without_rotors(self, pairs, acceleration):
        rates = None if acceleration is None else spread(self.weights, acceleration)
        return fold(self.weights, self.tree.load_without_rotors(pairs, rates), self.count)

    def whole_load(self, pairs, acceleration=None) -> list[Term]:
        """The load on every velocity of the tree."""
        load = self.tree.load(pairs, None if acceleration is None else spread(self.weights, acceleration))
        for i, inertia in rotors(self.tree.mechanism).items():
            load[i] = minus(load[i], times(inertia, self.known[i]))
        return load

    def drive_forces(self, pairs, acceleration):
        return self.tree.drive_forces(pairs, spread(self.weights, acceleration))

    def kinetic_exchange(self, acceleration):
        return self.tree.kinetic_exchange(spread(self.weights, acceleration))

    def energies(self):
        return self.tree.energies()


class CoupledFactors(AbstractFactors):
    """G^T M G by the factors of M and the `rows` of the conditions that followers follow; `leaders`: the indices of the
    free velocities.
    """

    inertia: AbstractFactors
    coupled: AbstractConstraint
    rows: list[Row]
    leaders: tuple[int, ...] = eqx.field(static=True)

    @property
    def inverse_diagonal(self):
        return [self.inertia.inverse_diagonal[i] for i in self.leaders]

    def solve(self, right):
        whole: list[Term] = [0.0] * len(self.rows[0].numbers)
        for i, term in zip(self.leaders, right, strict=True):
            whole[i] = term
        free = self.inertia.solve(whole)
        change, _ = self.coupled.closure_step([minus(0.0, row.dot(free)) for row in self.rows])
        return [plus(free[i], change[i]) for i in self.leaders]


def coupled(mechanism: PreparedMechanism, whole: Unfolded, tree: Frames) -> CoupledFrames:
    """The frames of a mechanism by those of its tree."""
    count = sum(len(c.velocities) for c in mechanism.free_coordinates())
    return CoupledFrames(mechanism, tree, whole.weights, whole.accelerations, count)
