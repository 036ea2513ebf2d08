"""The equations of motion of one state: what the joints exert, the accelerations, the forces of ideal closures."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from clearance_jax._alike import numbers_of
from clearance_jax._sharing import share
from clearance_jax._types import Scalar
from clearance_jax.dynamics.applied import applied_pairs
from clearance_jax.dynamics.conditions import Condition, conditions
from clearance_jax.dynamics.constraint import closing_pairs, constraint
from clearance_jax.dynamics.control import exert
from clearance_jax.dynamics.frames import Frames, Pair
from clearance_jax.dynamics.kinematics import Play, frames, plays
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Action, PreparedClearance
from clearance_jax.joints._base import each_joint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.spatial import Term, minus, plus, times
from clearance_jax.symmetric import AbstractConstraint, AbstractFactors


class Balance(NamedTuple):
    """The equations of motion, solved: where everything is, what each clearance joint does (by name), the wrench pairs
    of clearances, springs and loads, the efforts of actuators and controllers, the accelerations of the free
    coordinates, and the wrenches of the ideal closures.
    """

    motion: Frames
    plays: dict[str, Play]
    actions: dict[str, Action]
    pairs: list[Pair]
    efforts: list[Term]
    acceleration: list[Term]
    closing: list[Pair]


def balance(mechanism: PreparedMechanism, time: Scalar, state: State) -> Balance:
    """Where everything is, what the joints exert, the equations of motion."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, state)
    found, joints = plays(mechanism, time, state, motion), mechanism.clearance_joints()
    acting = [(joint.clearance, found[joint.name].relative, state.memory[joint.name]) for joint in joints]
    actions = dict(zip([joint.name for joint in joints], each_joint(PreparedClearance.act, acting), strict=True))
    pairs = contact_pairs(mechanism, found, actions) + applied_pairs(mechanism, time, motion)
    efforts = exert(mechanism, time, state)
    acceleration, closing = accelerations(motion, pairs, efforts)
    return Balance(motion, found, actions, pairs, efforts, share(acceleration), closing)


def contact_pairs(mechanism: PreparedMechanism, plays: dict[str, Play], actions: dict[str, Action]) -> list[Pair]:
    """Wrench pairs of the clearance joints."""
    pairs = []
    for joint in mechanism.clearance_joints():
        at, now = plays[joint.name], actions[joint.name]
        pairs.append(
            Pair(joint.parent, joint.child, at.rotation.apply(now.force), at.rotation.apply(now.torque), at.pin)
        )
    return pairs


def accelerations(motion: Frames, pairs: list[Pair], efforts: list[Term]) -> tuple[list[Term], list[Pair]]:
    """Accelerations of the free coordinates under wrenches between bodies and efforts of actuators, and the closures'
    wrenches.
    """
    loops = motion.mechanism.closures()
    if loops and not layout(motion.mechanism).free:
        raise ClearanceError(
            f"The ideal loop `{loops[0].name}` joins bodies that are all prescribed: free one of them."
        )
    if motion.is_solved_implicitly:
        acceleration, multipliers = _solve(motion, pairs, efforts)
    else:
        equations = _equations(motion)
        acceleration, multipliers = equations.solve(*_right_sides(motion, pairs, efforts, equations.held))
    held = [conditions(loop, motion) for loop in loops]
    return acceleration, closing_pairs(loops, motion, held, multipliers)


class Equations(NamedTuple):
    """M a - J^T m = load, J a = asked: the inertia, factored, and of ideal closures their conditions and what these
    ask of it.
    """

    inertia: AbstractFactors
    held: list[Condition]
    closed: AbstractConstraint | None

    def solve(self, load: list[Term], asked: list[Term]) -> tuple[list[Term], list[Term]]:
        """The accelerations and the multipliers of the conditions."""
        free = self.inertia.solve(load)
        if self.closed is None:
            return free, []
        lag = [minus(wanted, now.row.dot(free)) for now, wanted in zip(self.held, asked, strict=True)]
        correction, multipliers = self.closed.closure_step(lag)
        return [plus(a, b) for a, b in zip(free, correction, strict=True)], multipliers


def _held_conditions(motion: Frames) -> list[Condition]:
    return [condition for loop in motion.mechanism.closures() for condition in conditions(loop, motion)]


def _equations(motion: Frames) -> Equations:
    inertia, held = motion.mass_matrix(), _held_conditions(motion)
    return Equations(inertia, held, constraint(inertia, held, motion.mechanism) if held else None)


def _right_sides(
    motion: Frames, pairs: list[Pair], efforts: list[Term], held: list[Condition], found: tuple | None = None
) -> tuple[list[Term], list[Term]]:
    """The right-hand sides; less the left-hand sides of the accelerations and multipliers that are `found`."""
    load = motion.load(pairs, None if found is None else found[0])
    load = [plus(own, effort) for own, effort in zip(load, efforts, strict=True)]
    asked = [minus(0.0, now.acceleration) for now in held]
    if found is not None:
        asked = [minus(wanted, now.row.dot(found[0])) for wanted, now in zip(asked, held, strict=True)]
        for multiplier, now in zip(found[1], held, strict=True):
            load = [plus(own, times(multiplier, r)) for own, r in zip(load, now.row.terms, strict=True)]
    return load, asked


def _solve(motion: Frames, pairs: list[Pair], efforts: list[Term]) -> tuple[list[Term], list[Term]]:
    """The equations of motion, solved. Their derivative is that of what they leave over at the accelerations that are
    found, solved by the factors that are known: neither the mass matrix nor its factors are differentiated.
    """
    numbers, rebuilt = numbers_of((motion, pairs, efforts))

    def flat(answer: tuple[list[Term], list[Term]]) -> tuple[list[Array], list[Array]]:
        first, second = ([jnp.asarray(x, float) for x in part] for part in answer)
        return first, second

    def solution(numbers):
        motion, pairs, efforts = rebuilt(numbers)
        equations = _equations(motion)
        return equations, flat(equations.solve(*_right_sides(motion, pairs, efforts, equations.held)))

    @jax.custom_jvp
    def solve(numbers):
        return solution(numbers)[1]

    def differentiate(primals, tangents):
        (numbers,), (rates,) = primals, tangents
        equations, found = solution(numbers)
        varied = [i for i, rate in enumerate(rates) if not isinstance(rate, SymbolicZero)]

        def residual(some):
            every = list(numbers)
            for i, x in zip(varied, some, strict=True):
                every[i] = x
            motion, pairs, efforts = rebuilt(every)
            return flat(_right_sides(motion, pairs, efforts, _held_conditions(motion), found))

        _, change = jax.jvp(residual, ([numbers[i] for i in varied],), ([rates[i] for i in varied],))
        return found, flat(equations.solve(*change))

    solve.defjvp(differentiate, symbolic_zeros=True)
    acceleration, multipliers = solve(numbers)
    return [*acceleration], [*multipliers]
