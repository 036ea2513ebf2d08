"""The solve itself: a mechanism's flow from t0 to t1, with its rule of differentiation.

JAX transforms see `flow`. Its derivative is not that of the program, whose steps are chosen for the motion alone, but a
second solve of motion and variations together, whose steps are chosen for both. That solve gives the whole Jacobian S.
A tangent is S times the numbers' tangents, which JAX can also transpose, so one rule serves jvp, grad and jacobians.
"""

import dataclasses
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.lane_axis import from_lanes, to_lanes
from clearance_jax._compile.once import compute_once
from clearance_jax._compile.one_function import one_function
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.closures import StartErrors, project
from clearance_jax.dynamics.field import energy_residual
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.drivers import lanes
from clearance_jax.solve.drivers.driver import integrate
from clearance_jax.solve.drivers.lanes import batch_by
from clearance_jax.solve.first_state import initial
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.start import refusal_of, unresolved, why_stopped
from clearance_jax.solve.steps.attempt import Outcome, SolveTask
from clearance_jax.solve.steps.problem import Problem, basis, field, lift, motion, moves, push, sparsity
from clearance_jax.solve.steps.tolerances import Tolerances, floors, tolerances


class Inputs(NamedTuple):
    """Inputs of a solve; `integrands`: functions of (time, state, mechanism), of any shape, to be integrated along."""

    mechanism: Mechanism
    t0: Array
    t1: Array
    save_at: Array | None
    rtol: Array
    atol: Array | None
    y0: Array | None
    integrands: tuple = ()

    @property
    def varied(self) -> tuple:
        """The inputs other than times by which a solve can be differentiated."""
        return self.mechanism, self.y0, self.integrands


Which: TypeAlias = tuple[bool, ...] | None
"""Which numbers of `Inputs.varied`, as they lie in its tree, a solve is differentiated by."""

# The rule of differentiation -----------------------------------------------------------------------------------------


@eqx.filter_custom_jvp
def flow(inputs: Inputs, *, options: Settings) -> Solution:
    """Solve; differentiable by every number of the mechanism, `y0`, `t1` and `save_at`."""
    return compiled_solve(inputs, options)


def plain_flow(inputs: Inputs, options: Settings) -> Solution:
    """As `flow`, but JAX differentiates the program as it stands: cheaper, and of unknown accuracy."""
    refuse_jumps(inputs.mechanism)
    return _plain(inputs, options)


@flow.def_jvp
def _flow_jvp(primals, tangents, *, options: Settings):
    (inputs,), (rates,) = primals, tangents
    rates = jax.tree.map(jnp.asarray, rates)  # a tangent may come as a Python number
    if rates.t0 is not None:
        raise ClearanceError("A solve cannot be differentiated by its start time `t0`: shift the drives' times.")
    refuse_jumps(inputs.mechanism)
    leaves = jax.tree.leaves(rates.varied)
    if leaves:
        amounts = jnp.concatenate([jnp.ravel(leaf) for leaf in leaves])
        which = tuple(rate is not None for rate in jax.tree.leaves(rates.varied, is_leaf=lambda x: x is None))
        value, slopes = variations(inputs, which, options)
        moved = [jnp.tensordot(amounts, slope, 1) for slope in slopes]
    else:
        value = _stack(inputs, None, options=options)
        moved = [jnp.zeros_like(x) for x in states_of(value)]
    if rates.t1 is not None or rates.save_at is not None:
        moved = later(inputs, rates, value, moved, options)
    time = rates.save_at
    if inputs.save_at is None and rates.t1 is not None:
        time = rates.t1[None]
    start, final, y, *picks = moved
    chosen = [i for i, pick in enumerate(value.picked) if pick is not None]
    at = [None if rates.t1 is None else jnp.where(pick.time == inputs.t1, rates.t1, 0.0) for pick in value.found]

    def varied(s):
        picks = [s.picked[i] for i in chosen]
        return [s.time, s.end_time, s.initial, s.final, s.y, *(p.y for p in picks), *(p.time for p in picks)]

    nothing = jax.tree.map(lambda _: None, value)
    new = [time, rates.t1, start, final, y, *picks, *at]
    return value, eqx.tree_at(varied, nothing, new, is_leaf=lambda x: x is None)


def states_of(solution: Solution) -> list[Array]:
    """The states of a solution, which have derivatives."""
    return [solution.initial, solution.final, solution.y, *(pick.y for pick in solution.found)]


def later(inputs: Inputs, rates: Inputs, value: Solution, moved: list[Array], options: Settings) -> list[Array]:
    """The tangents plus the effect of moving the end or the sample times: the rate of the motion there."""
    problem = Problem(inputs.mechanism.prepare(), inputs.integrands, energy_balance=options.energy_balance)
    start, final, y, *picks = moved

    def rate(time, y):
        return field(time, y[: problem.size], problem)

    if rates.t1 is not None:
        last = rate(inputs.t1, value.final) * rates.t1
        final = final + last
        picks = [
            state + jnp.where((pick.time == inputs.t1)[:, None], last[None], 0.0)
            for state, pick in zip(picks, value.found, strict=True)
        ]
    shift = rates.save_at
    if inputs.save_at is None and rates.t1 is not None:
        shift = jnp.broadcast_to(rates.t1, value.time.shape)
    if shift is not None:
        y = y + jax.vmap(rate)(value.time, value.y) * shift[:, None]
    return [start, final, y, *picks]


def variations(inputs: Inputs, which: Which, options: Settings) -> tuple[Solution, list[Array]]:
    """The solution, and the derivatives of its states by each varied number (leading axis)."""
    return unstacked(_stack(inputs, which, options=options))


def unstacked(solution: Solution) -> tuple[Solution, list[Array]]:
    """A solution whose states are stacks: that of the motion, and the derivatives of its states (leading axis)."""
    stacks = [jnp.moveaxis(stack, -2, 0) for stack in states_of(solution)]
    start, final, y, *picks = (stack[0] for stack in stacks)
    rest = iter(picks)
    picked = tuple(None if pick is None else pick._replace(y=next(rest)) for pick in solution.picked)
    value = dataclasses.replace(solution, initial=start, final=final, y=y, picked=picked)
    return value, [stack[1:] for stack in stacks]


@eqx.filter_custom_jvp
def _stack(inputs, which, *, options):
    return compiled_solve(inputs, options, which)


@_stack.def_jvp
def _stack_jvp(primals, tangents, *, options):
    # A second derivative of the program would miss the motion of events, and nothing would bound its error.
    raise ClearanceError("`simulate` has first derivatives only. For second ones use `clearance_jax.hessian`.")


def refuse_jumps(mechanism: Mechanism) -> None:
    """Raise for a law whose force jumps at first touch: no tolerance removes the bias of its derivative."""
    for joint in mechanism.contacts():
        for law in joint.laws:
            if law.smoothness == "C-1":
                raise ClearanceError(
                    f"The law {type(law).__name__} of joint `{joint.name}` jumps (class C-1): its derivatives are "
                    f"wrong at every tolerance. Use {law.smooth_alternative} where derivatives are wanted."
                ).about(joint.name, type(law).__name__)


# The solve -----------------------------------------------------------------------------------------------------------


def task_of(inputs: Inputs, options: Settings, directions: Any = None) -> SolveTask:
    """The task of a solve; with directions (a tree like `inputs.varied`) its states are stacks. A motion that cannot
    begin (see `refusal_of`) ends where it begins, with a code of its own.
    """
    t0, t1, save_at = inputs.t0, inputs.t1, inputs.save_at
    problem, start, allowed, errors = problem_of(inputs, options, directions)
    refused = refusal_of(inputs.mechanism, (t0, t1), motion(problem, start), errors, save_at)
    refused = unresolved(refused, inputs.rtol, inputs.atol, allowed)
    possible = refused == 0
    save_at = None if save_at is None else jnp.where(possible, save_at, t0)
    return SolveTask(problem, t0, jnp.where(possible, t1, t0), start, save_at, allowed, refused, errors.seated)


def solution_of(task: SolveTask, out: Outcome, t1: Array, options: Settings) -> Solution:
    """The solution of a task that was to end at `t1`, from its outcome."""
    problem, start, final = task.problem, task.start, out.final
    time, y = out.end_time[None], final[None]
    if out.samples is not None:
        time, y = out.samples
        y = project_samples(problem, time, y)
    residual = jnp.asarray(jnp.nan)
    if options.energy_balance:
        residual = energy_residual(problem.mechanism, (task.t0, t1), (motion(problem, start), motion(problem, final)))
    seen = [observer.finish(record) for observer, record in zip(options.observers, out.record, strict=True)]
    records = tuple(record for record, _ in seen)
    picked = tuple(
        None if pick is None else pick._replace(y=project_samples(problem, pick.time, pick.y)) for _, pick in seen
    )
    code = why_stopped(out.code, problem.mechanism, out.end_time, motion(problem, final))
    code = jnp.where(task.refused > 0, task.refused, code)
    ended = code, out.accepted, out.rejected, out.cuts, residual, out.end_time
    asked = {"sampled": out.samples is not None, "energy_balance": options.energy_balance}
    return Solution(time, y, start, final, *ended, records, picked, task.seated, **asked)


def solve(inputs: Inputs, options: Settings, which: Which = None, mapped: bool = True) -> Solution:
    """One motion (or stack), by diffrax; `mapped`: `jax.vmap` may batch it."""
    task = task_of(inputs, options, _directions(inputs, which))
    moved = one_function(integrate)(task, options, _breaks_move(task), mapped)
    return solution_of(task, moved, inputs.t1, options)


def _directions(inputs: Inputs, which: Which) -> Any:
    """A direction for each number that varies; `None` for the others."""
    if which is None:
        return None
    leaves, tree = jax.tree.flatten(inputs.varied, is_leaf=lambda x: x is None)
    numbers = [leaf if varies else None for leaf, varies in zip(leaves, which, strict=True)]
    return basis(jax.tree.unflatten(tree, numbers))


def _breaks_move(task: SolveTask) -> bool:
    """Whether a direction moves a time at which a drive breaks."""
    return task.problem.varies and moves(drive_breaks, task.problem)


def solve_lanes(inputs: Inputs, options: Settings, which: Which = None) -> Solution:
    """A batch of motions (or stacks) along the first axis of every array, solved as lanes."""

    def begin(inputs, options):
        return task_of(inputs, options, _directions(inputs, which))

    task = eqx.filter_vmap(begin, out_axes=eqx.if_array(0))(inputs, options)
    out = from_lanes(lanes.integrate(to_lanes(task), to_lanes(options)))
    return eqx.filter_vmap(solution_of, out_axes=eqx.if_array(0))(task, out, inputs.t1, options)


# Inside the rule of differentiation: outside, a derivative would trace the motion's own solve in vain, and a rule of
# batching has no reverse derivative.
@kept_jit
def compiled_solve(inputs: Inputs, options: Settings, which: Which = None) -> Solution:
    """A motion, or a stack of it and its derivatives by `which` numbers: alone, or under `jax.vmap` in chunks."""
    numbers, rest = eqx.partition((inputs, options), eqx.is_array)

    def single(numbers):
        inputs, options = eqx.combine(numbers, rest)
        return solve(inputs, options, which, mapped=False)

    def mapped(numbers):
        inputs, options = eqx.combine(numbers, rest)
        return solve(inputs, options, which)

    def together(batch):
        inputs, options = eqx.combine(jax.tree.map(lambda x: x[0], batch), rest)
        if which is not None and _breaks_move(task_of(inputs, options, _directions(inputs, which))):
            return jax.vmap(mapped)(batch)
        inputs, options = eqx.combine(batch, rest)
        return solve_lanes(inputs, options, which)

    return batch_by(compute_once(single), compute_once(together))(numbers)


# JAX differentiates this one, so it has no rule of batching.
_plain = solo_jit(solve)


def problem_of(
    inputs: Inputs, options: Settings, directions: Any = None
) -> tuple[Problem, Array, Tolerances, StartErrors]:
    """The problem, its initial state (or stack), its tolerances, and the errors of the start."""

    def begin(varied):
        mechanism, y0, integrands = varied
        problem = Problem(mechanism.prepare(), integrands, energy_balance=options.energy_balance)
        start, errors = initial(problem, inputs.t0, y0, options.start)
        return problem.model, start, errors

    if directions is None:
        model, first, errors = begin(inputs.varied)
        problem = Problem(model[0], model[1], energy_balance=options.energy_balance)
        start = first
    else:
        (model, first, errors), (slopes, moved, _), (movers, *_) = push(begin, inputs.varied, directions)
        problem = Problem(model[0], model[1], slopes, options.energy_balance, sparsity(movers, directions))
        count = jax.tree.leaves(directions)[0].shape[0]
        start = jnp.concatenate([first[None], jnp.zeros((count, *first.shape)) if moved is None else moved])
    allowed = tolerances(problem, first, inputs.t0, inputs.t1, inputs.rtol, inputs.atol)
    if directions is not None:
        floor = floors(_numbers(inputs.varied), _numbers(directions), allowed.unit)
        allowed = allowed._replace(floor=floor)
    return problem, start, allowed, errors


def _numbers(varied: tuple) -> tuple[tuple, Any]:
    """The varied inputs as parameters and initial state."""
    mechanism, y0, integrands = varied
    return (mechanism, integrands), y0


def project_samples(problem: Problem, time: Array, y: Array) -> Array:
    """Samples projected on closed loops: dense output interpolates between projected states, and leaves loops open."""
    if not problem.mechanism.has_manifold:
        return y
    # A sample's loops are further open than a step end's: its velocity needs the Jacobian at the projected place.
    return jax.vmap(lambda t, y: lift(lambda m, y: project(t, y, m[0], 2), problem, y))(time, y)
