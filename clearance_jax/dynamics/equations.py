"""The equations of motion of one state: the joints' wrenches, the accelerations, the forces of ideal closures."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from clearance_jax._basis.symmetric import AbstractConstraint, AbstractFactors
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.alike import each_joint, numbers_of
from clearance_jax._compile.barriers import share
from clearance_jax.dynamics.applied import applied_pairs, exert, exert_on_driven
from clearance_jax.dynamics.conditions import Condition, closing_pairs, closure_conditions, conditions, constraint
from clearance_jax.dynamics.forms.frames import Frames, Pair
from clearance_jax.dynamics.gaps import gap_actions, gap_efforts, teeth_pairs
from clearance_jax.dynamics.kinematics import PinMotion, frames, plays
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Action, PreparedClearance
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.spatial import Term, minus, plus, times


class Balance(NamedTuple):
    """The solved equations of motion: frames, actions of clearance joints and of gaps (by name), wrench pairs of
    clearances, springs and loads, efforts of actuators and controllers, free accelerations, wrenches of the ideal
    closures, and by coordinate the efforts of gaps, and those of actuators on followers of driven coordinates with the
    speeds.
    """

    motion: Frames
    plays: dict[str, PinMotion]
    actions: dict[str, Action]
    pairs: list[Pair]
    efforts: list[Term]
    acceleration: list[Term]
    closing: list[Pair]
    in_gaps: dict[str, Term]
    on_driven: dict[str, tuple[Term, Term]]


def balance(mechanism: PreparedMechanism, time: Scalar, state: State) -> Balance:
    """The equations of motion of a state, solved."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, state).with_motions()
    pins, joints = plays(mechanism, time, state, motion), mechanism.clearance_joints()
    acting = [(joint.clearance, pins[joint.name].relative, state.memory[joint.name]) for joint in joints]
    actions = dict(zip([joint.name for joint in joints], each_joint(PreparedClearance.act, acting), strict=True))
    actions |= gap_actions(mechanism, time, state)
    pairs = contact_pairs(mechanism, pins, actions) + applied_pairs(mechanism, time, motion)
    pairs += teeth_pairs(mechanism, motion, actions)
    efforts, gaps = exert(mechanism, time, state), gap_efforts(mechanism, time, state, actions)
    applied = [plus(a, b) for a, b in zip(efforts, gaps.free, strict=True)]
    acceleration, closing = accelerations(motion, pairs, applied)
    on_driven, acceleration = exert_on_driven(mechanism, time, state), share(acceleration)
    return Balance(motion, pins, actions, pairs, efforts, acceleration, closing, gaps.by_name, on_driven)


def contact_pairs(mechanism: PreparedMechanism, plays: dict[str, PinMotion], actions: dict[str, Action]) -> list[Pair]:
    """Wrench pairs of the clearance joints."""
    pairs = []
    for joint in mechanism.clearance_joints():
        at, now = plays[joint.name], actions[joint.name]
        pairs.append(
            Pair(joint.parent, joint.child, at.rotation.apply(now.force), at.rotation.apply(now.torque), at.pin)
        )
    return pairs


def accelerations(motion: Frames, pairs: list[Pair], efforts: list[Term]) -> tuple[list[Term], list[Pair]]:
    """Accelerations of the free coordinates under wrench pairs and efforts, and the wrenches of the closures."""
    loops = motion.mechanism.closures()
    if loops and not layout(motion.mechanism).free:
        text = f"The ideal loop `{loops[0].name}` joins bodies that are all prescribed: free one of them."
        raise ClearanceError(text)
    if motion.is_solved_implicitly:
        acceleration, multipliers = _solve(motion, pairs, efforts)
    else:
        equations = _equations(motion)
        acceleration, multipliers = equations.solve(*_right_sides(motion, pairs, efforts, equations.conditions))
    by_loop = [conditions(loop, motion) for loop in loops]
    return acceleration, closing_pairs(loops, motion, by_loop, multipliers)


class Equations(NamedTuple):
    """M a - J^T m = load, J a = asked: the factored inertia, the conditions of ideal closures, and their constraint."""

    inertia: AbstractFactors
    conditions: list[Condition]
    closed: AbstractConstraint | None

    def solve(self, load: list[Term], asked: list[Term]) -> tuple[list[Term], list[Term]]:
        """The accelerations and the multipliers of the conditions."""
        free = self.inertia.solve(load)
        if self.closed is None:
            return free, []
        lag = [minus(wanted, now.row.dot(free)) for now, wanted in zip(self.conditions, asked, strict=True)]
        correction, multipliers = self.closed.closure_step(lag)
        return [plus(a, b) for a, b in zip(free, correction, strict=True)], multipliers


def _equations(motion: Frames) -> Equations:
    inertia, every = motion.mass_matrix(), closure_conditions(motion)
    return Equations(inertia, every, constraint(inertia, every, motion.mechanism) if every else None)


def _right_sides(
    motion: Frames, pairs: list[Pair], efforts: list[Term], every: list[Condition], solved: tuple | None = None
) -> tuple[list[Term], list[Term]]:
    """The right-hand sides, less the left-hand sides of the accelerations and multipliers in `solved`."""
    load = motion.load(pairs, None if solved is None else solved[0])
    load = [plus(term, effort) for term, effort in zip(load, efforts, strict=True)]
    asked = [minus(0.0, now.acceleration) for now in every]
    if solved is not None:
        asked = [minus(wanted, now.row.dot(solved[0])) for wanted, now in zip(asked, every, strict=True)]
        for multiplier, now in zip(solved[1], every, strict=True):
            load = [plus(term, times(multiplier, r)) for term, r in zip(load, now.row.terms, strict=True)]
    return load, asked


def _solve(motion: Frames, pairs: list[Pair], efforts: list[Term]) -> tuple[list[Term], list[Term]]:
    """Accelerations and multipliers; their derivative is the residual's, solved by the known factors."""
    numbers, rebuilt = numbers_of((motion, pairs, efforts))

    def flat(answer: tuple[list[Term], list[Term]]) -> tuple[list[Array], list[Array]]:
        first, second = ([jnp.asarray(x, float) for x in part] for part in answer)
        return first, second

    def solution(numbers):
        motion, pairs, efforts = rebuilt(numbers)
        equations = _equations(motion)
        return equations, flat(equations.solve(*_right_sides(motion, pairs, efforts, equations.conditions)))

    @jax.custom_jvp
    def solve(numbers):
        return solution(numbers)[1]

    def differentiate(primals, tangents):
        (numbers,), (rates,) = primals, tangents
        equations, solved = solution(numbers)
        varied = [i for i, rate in enumerate(rates) if not isinstance(rate, SymbolicZero)]

        def residual(some):
            every = list(numbers)
            for i, x in zip(varied, some, strict=True):
                every[i] = x
            motion, pairs, efforts = rebuilt(every)
            return flat(_right_sides(motion, pairs, efforts, closure_conditions(motion), solved))

        _, change = jax.jvp(residual, ([numbers[i] for i in varied],), ([rates[i] for i in varied],))
        return solved, flat(equations.solve(*change))

    solve.defjvp(differentiate, symbolic_zeros=True)
    acceleration, multipliers = solve(numbers)
    return [*acceleration], [*multipliers]
