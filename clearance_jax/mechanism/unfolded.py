"""Coordinates that follow others are no states: they are unfolded where the equations of motion need them."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.followers import relations_of
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, parts
from clearance_jax.spatial import Term, plus, times, total


class Unfolded(NamedTuple):
    """A mechanism whose followers are states of their own, its state, and the accelerations of its velocities without
    those of the free ones: what driven leaders give to followers that have free leaders too.

    `weights`: by velocity there, the free velocities that it follows, each with its factor.
    """

    mechanism: PreparedMechanism
    state: State
    accelerations: tuple[Term, ...]
    weights: tuple[dict[int, Term], ...]


def unfold(mechanism: PreparedMechanism, time: Scalar, state: State) -> Unfolded:
    """The mechanism and its state with followers as states. Where none moves freely they stay as they are, and there
    are no weights.
    """
    free = parts(mechanism)
    if len(free) == len(mechanism.moved_coordinates()):
        return Unfolded(mechanism, state, (0.0,) * len(state.v), ())
    known = {c.name: (state.q[q], state.v[v], range(v.start, v.stop)) for c, q, v in free}
    driven = {c.name: c.motion.drive for c in mechanism.coordinates() if c.motion.drive is not None}
    every, places, rates, accelerations, weights = relations_of(mechanism), [], [], [], []
    for c in mechanism.moved_coordinates():
        if c.name in known:
            at, moving, columns = known[c.name]
            places, rates = [*places, *at], [*rates, *moving]
            accelerations, weights = [*accelerations, *[0.0] * len(columns)], [*weights, *({i: 1.0} for i in columns)]
            continue
        terms, offset = every[c.name]
        whole: list[Term] = [offset, 0.0, 0.0]
        for name, factor in terms.items():
            now = driven[name](time) if name in driven else (known[name][0][0], known[name][1][0], 0.0)
            whole = [plus(term, times(factor, part)) for term, part in zip(whole, now, strict=True)]
        for values, term in zip((places, rates, accelerations), whole, strict=True):
            values.append(term)
        weights.append({known[name][2][0]: factor for name, factor in terms.items() if name in known})
    whole_state = State(tuple(places), tuple(rates), state.memory)
    plain = dataclasses.replace(mechanism, couplings=())
    return Unfolded(plain, whole_state, tuple(accelerations), tuple(weights))


def fold(weights: Sequence[dict[int, Term]], efforts: Sequence[Term], free: int) -> list[Term]:
    """Efforts on the velocities of an unfolded mechanism as efforts on the free velocities, `free` in number."""
    out: list[Term] = [0.0] * free
    for each, effort in zip(weights, efforts, strict=True):
        for i, factor in each.items():
            out[i] = plus(out[i], times(factor, effort))
    return out


def spread(weights: Sequence[dict[int, Term]], rates: Sequence[Term]) -> list[Term]:
    """Rates of the free velocities as rates of all velocities of an unfolded mechanism."""
    return [total(times(factor, rates[i]) for i, factor in each.items()) for each in weights]
