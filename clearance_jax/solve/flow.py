"""The solve itself: a mechanism's flow from t0 to t1, with its rule of differentiation.

`flow` is what jit, vmap and differentiation see. Its derivative is not that of the program (whose steps are chosen for
the motion alone): it is a second solve of motion and variations together, whose steps are chosen for both. That solve
gives the whole Jacobian S; a tangent is then S times the numbers' tangents, which JAX can also transpose: so the one
rule serves jvp, grad and jacobians.
"""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from clearance_jax._types import Scalar
from clearance_jax.dynamics.energy import energies, opened_books, read_books
from clearance_jax.dynamics.equations import openings, projected
from clearance_jax.dynamics.field import rate
from clearance_jax.errors import BOUNDS, ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism, drive_breaks, layout, parameters
from clearance_jax.solve.control import ContactController
from clearance_jax.solve.problem import Problem, basis, lift, motion, moves, pushed
from clearance_jax.solve.step import Stepper
from clearance_jax.solve.tolerances import Tolerances, floors, largest_length, tolerances


# Traced once and called from every stage (a step asks for it a dozen times); XLA inlines the calls.
@jax.jit
def field(time, y, problem: Problem):
    """The rate of a state, or of a stack: the mechanism's, then the integrands."""
    added = problem.integrands

    def augmented(mechanism, y):
        state = y[: y.shape[0] - len(added)]
        extra = [jnp.reshape(integrand(time, state, mechanism), (1,)) for integrand in added]
        return jnp.concatenate([rate(time, state, mechanism), *extra])

    return lift(augmented, problem, y)


class Picked(NamedTuple):
    """States that an observer has picked: at `time` [s], shape (k,); `y`, shape (k, n)."""

    time: Float[Array, " k"]
    y: Float[Array, "k *rows n"]


class Solution(eqx.Module):
    """A solved motion.

    - `time`: sample times [s], shape (samples,); `y`: states `[q, v, memory, books]` there, shape (samples, n).
    - `final`: the state at the end; `initial`: at the start.
    - `result`: diffrax's code; `succeeded` where the solve reached t1, `message` in words; `steps`, `rejected`: counts.
    - `record`: what an observer recorded, `picked`: the states that it picked (metrics use one).
    - `energy_residual`: |energy gained - work of drives + losses| / energy exchanged, a measure of the solve's quality.
    """

    time: Float[Array, " samples"]
    y: Float[Array, "samples *rows n"]
    initial: Float[Array, "*rows n"]
    final: Float[Array, "*rows n"]
    result: Any
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    energy_residual: Float[Array, ""]
    record: Any = None
    picked: Picked | None = None

    @property
    def succeeded(self) -> Array:
        """Whether the solve reached t1."""
        return self.result == diffrax.RESULTS.successful

    @property
    def message(self) -> str:
        """Why a single solve stopped; empty where it reached t1."""
        return "" if bool(self.succeeded) else meaning(self.result)


def meaning(result: Any) -> str:
    """A failed solve's code in words."""
    if bool(result == diffrax.RESULTS.dt_min_reached):
        return "the step size collapsed: a state that is not finite, or a force that jumps"
    if bool(result == diffrax.RESULTS.nonlinear_divergence):
        return "a number is out of its bounds, or the mechanism cannot be assembled"
    return diffrax.RESULTS[result].rstrip(".")


class Inputs(NamedTuple):
    """What a solve depends on: `simulate`'s numbers."""

    mechanism: Mechanism
    t0: Array
    t1: Array
    save_at: Array | None
    rtol: Array
    atol: Array | None
    y0: Array | None


class Options(NamedTuple):
    """What a solve is compiled for: `simulate`'s choices."""

    solver: Any
    watch: bool
    books: bool
    max_steps: int
    derivatives: str = "controlled"
    observer: Any = None
    integrands: tuple = ()
    """Functions of (time, state, mechanism) to be integrated along with the motion."""


# The solve -----------------------------------------------------------------------------------------------------------


@eqx.filter_custom_jvp
def flow(inputs: Inputs, *, options: Options) -> Solution:
    """Solve; differentiable by every number of the mechanism, `y0`, `t1` and `save_at`."""
    return solved(inputs, options)


def plain_flow(inputs: Inputs, options: Options) -> Solution:
    """As `flow`, differentiated as the program it is: cheaper, and of unknown accuracy."""
    refuse_jumps(inputs.mechanism)
    return solved(inputs, options)


@flow.def_jvp
def _flow_jvp(primals, tangents, *, options: Options):
    (inputs,), (rates,) = primals, tangents
    varied = (rates.mechanism, rates.y0)
    if rates.t0 is not None:
        raise ClearanceError("A solve cannot be differentiated by its start time `t0`: shift the drives' times.")
    refuse_jumps(inputs.mechanism)
    if jax.tree.leaves(varied):
        amounts = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(varied)])
        value, slopes = variations(inputs, basis(varied), options)
        moved = [jnp.tensordot(amounts, slope, 1) for slope in slopes]
    else:
        value = _stacked(inputs, None, options=options)
        moved = [jnp.zeros_like(x) for x in _states(value)]
    if rates.t1 is not None or rates.save_at is not None:
        moved = _later(inputs, rates, value, moved, options)
    time = rates.save_at
    if inputs.save_at is None and rates.t1 is not None:
        time = rates.t1[None]
    nothing = jax.tree.map(lambda _: None, value)
    start, final, y, *picked = moved
    changed = (time, y, start, final)
    out = eqx.tree_at(lambda s: (s.time, s.y, s.initial, s.final), nothing, changed, is_leaf=lambda x: x is None)
    if value.picked is not None:
        later = None if rates.t1 is None else jnp.where(value.picked.time == inputs.t1, rates.t1, 0.0)
        kept = Picked(later, *picked)
        out = eqx.tree_at(lambda s: s.picked, out, kept, is_leaf=lambda x: isinstance(x, Picked))
    return value, out


def _states(solution: Solution) -> list:
    """Its states, which have derivatives."""
    picked = [] if solution.picked is None else [solution.picked.y]
    return [solution.initial, solution.final, solution.y, *picked]


def _later(inputs: Inputs, rates: Inputs, value: Solution, moved: list[Array], options: Options) -> list[Array]:
    """The tangents with what moving the end or the sample times adds: the rate of the motion there."""
    problem = Problem(inputs.mechanism.prepared(), None, options.integrands)
    start, final, y, *picked = moved
    if rates.t1 is not None:
        last = field(inputs.t1, value.final, problem) * rates.t1
        final = final + last
        if value.picked is not None:
            picked = [picked[0] + jnp.where((value.picked.time == inputs.t1)[:, None], last[None], 0.0)]
    shift = rates.save_at
    if inputs.save_at is None and rates.t1 is not None:
        shift = jnp.broadcast_to(rates.t1, value.time.shape)
    if shift is not None:
        y = y + jax.vmap(field, in_axes=(0, 0, None))(value.time, value.y, problem) * shift[:, None]
    return [start, final, y, *picked]


def variations(inputs: Inputs, directions: Any, options: Options) -> tuple[Solution, list[Array]]:
    """The solution, and the derivatives of its states along each direction (leading axis)."""
    stacked = _stacked(inputs, directions, options=options)
    stacks = [jnp.moveaxis(stack, -2, 0) for stack in _states(stacked)]
    value = eqx.tree_at(_states, stacked, [stack[0] for stack in stacks])
    return value, [stack[1:] for stack in stacks]


@eqx.filter_custom_jvp
def _stacked(inputs, directions, *, options):
    return solved(inputs, options, directions)


@_stacked.def_jvp
def _stacked_jvp(primals, tangents, *, options):
    # A second derivative of the program would miss what moving a switch adds to it, and nothing would bound its error.
    raise ClearanceError("`simulate` has first derivatives only. For second ones use `clearance_jax.hessian`.")


def solved(inputs: Inputs, options: Options, directions: Any = None) -> Solution:
    """Solve motion and variations: with directions (a tree like `(mechanism, y0)`), states are stacks."""
    t0, t1, rtol, save_at = inputs.t0, inputs.t1, inputs.rtol, inputs.save_at
    problem, start, allowed = posed(inputs, options, directions)
    first = motion(problem, start)
    # A lane of a batch with impossible numbers, or a mechanism that is not closed, ends at once with a code of its own.
    possible = (
        jnp.all(jnp.isfinite(first))
        & jnp.isfinite(t1)
        & (t1 > t0)
        & (rtol > 0)
        & (rtol < 1)
        & bounds_hold(problem.mechanism)
    )
    if inputs.y0 is None:
        possible &= is_assembled(problem.mechanism, t0, first)
    end = jnp.where(possible, t1, t0)
    save_at = None if save_at is None else jnp.where(possible, save_at, t0)
    out = integrate(problem, t0, end, start, save_at, allowed, options)
    result = diffrax.RESULTS.where(possible, out.result, diffrax.RESULTS.nonlinear_divergence)
    final = out.ys[0][-1]
    time = out.ts[0] if save_at is None else out.ts[1]
    y = out.ys[0] if save_at is None else projected_samples(problem, time, out.ys[1])
    residual = jnp.asarray(jnp.nan)
    if options.books:
        residual = energy_residual(problem.mechanism, t0, t1, first, motion(problem, final))
    accepted, rejected = out.stats["num_accepted_steps"], out.stats["num_rejected_steps"]
    record, picked = None, None
    if out.controller_state is not None:
        record, picked = options.observer.finished(out.controller_state.record)
        if picked is not None:
            picked = Picked(picked.time, projected_samples(problem, picked.time, picked.y))
    return Solution(time, y, start, final, result, accepted, rejected, residual, record, picked)


def posed(inputs: Inputs, options: Options, directions: Any = None) -> tuple[Problem, Array, Tolerances]:
    """What to integrate, from which state (or stack), and how accurately."""

    def begin(tree):
        mechanism = tree[0].prepared()
        start = initial(mechanism, inputs.t0, options.books, tree[1])
        return mechanism, jnp.concatenate([start, jnp.zeros(len(options.integrands))])

    tree = inputs.mechanism, inputs.y0
    if directions is None:
        mechanism, start = begin(tree)
        problem = Problem(mechanism, None, options.integrands)
        return problem, start, tolerances_of(problem, inputs.t0, inputs.t1, start, inputs.rtol, inputs.atol)
    (mechanism, first), (slopes, moved) = pushed(begin, tree, directions)
    problem = Problem(mechanism, slopes, options.integrands)
    count = jax.tree.leaves(directions)[0].shape[0]
    start = jnp.concatenate([first[None], jnp.zeros((count, *first.shape)) if moved is None else moved])
    allowed = tolerances_of(problem, inputs.t0, inputs.t1, first, inputs.rtol, inputs.atol)
    return problem, start, allowed._replace(floor=floors(tree, directions, allowed.unit))


def initial(mechanism, t0, books, y0):
    """The state at t0, with books if wanted."""
    if y0 is not None and y0.shape[0] > layout(mechanism).size:
        return jnp.asarray(y0, float)
    start = initial_state(mechanism, t0) if y0 is None else jnp.asarray(y0, float)
    return opened_books(t0, start, mechanism) if books else start


def projected_samples(problem: Problem, time, y):
    """Dense output interpolates between projected states: project the samples of a mechanism with closures too."""
    if not problem.mechanism.closures():
        return y
    return jax.vmap(lambda t, y: lift(lambda m, y: projected(t, y, m, m.closures(), 1), problem, y))(time, y)


def tolerances_of(problem: Problem, t0, t1, first, rtol, atol) -> Tolerances:
    """The tolerances of a solve that starts with the state `first`; integrals by their signals' scales."""
    mechanism, size, added = problem.mechanism, layout(problem.mechanism).size, len(problem.integrands)
    out = tolerances(mechanism, first[:size], t0, t1, rtol, atol, first.shape[0] - size - added, problem.varies)
    if not added:
        return out
    unit = (t1 - t0) * jnp.stack([integrand.scale(mechanism) for integrand in problem.integrands])
    return out._replace(
        absolute=jnp.concatenate([out.absolute, rtol * unit]),
        relative=jnp.concatenate([out.relative, jnp.zeros(added)]),
        unit=jnp.concatenate([out.unit, unit]),
    )


def integrate(problem: Problem, t0, t1, start, save_at, allowed: Tolerances, options: Options, steps=False):
    """Diffrax's solution: the end, then (if wanted) the samples, then (if wanted) every step end."""
    controller = ContactController(  # pyright: ignore[reportCallIssue]  # the abstract rtol, atol, norm are properties
        scale=allowed.absolute,
        relative=allowed.relative,
        unit=allowed.unit,
        floor=allowed.floor,
        breaks=drive_breaks(problem.mechanism),
        margin=allowed.margin,
        fit=allowed.fit,
        observer=options.observer,
        watch=options.watch,
    )
    subs = [diffrax.SubSaveAt(t1=True)]
    subs += [] if save_at is None else [diffrax.SubSaveAt(ts=save_at)]
    subs += [diffrax.SubSaveAt(t0=True, steps=True)] if steps else []
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        Stepper(options.solver, moving_breaks=problem.varies and moves(drive_breaks, problem)),
        t0,
        t1,
        None,
        start,
        args=problem,
        saveat=diffrax.SaveAt(subs=subs, controller_state=options.observer is not None),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=options.max_steps,
        throw=False,
    )


def refuse_jumps(mechanism: Mechanism) -> None:
    """Raise for a law whose force jumps at first touch: no tolerance removes the bias of its derivative."""
    for joint in mechanism.clearance_joints():
        assert joint.clearance is not None
        for law in (joint.clearance.normal, joint.clearance.friction):
            if law is not None and law.smoothness == "C-1":
                raise ClearanceError(
                    f"The law {type(law).__name__} of joint `{joint.name}` jumps (class C-1): its derivatives are "
                    f"wrong at every tolerance. Use {law.smooth_alternative} where derivatives are wanted."
                )


def energy_residual(mechanism, t0, t1, start, final):
    """|energy gained - work of drives + losses| / energy exchanged between two states with books."""
    before, after = energies(t0, start, mechanism), energies(t1, final, mechanism)
    gained = sum(after.values()) - sum(before.values())
    opened = read_books(t0, start, mechanism)
    books = {name: value - opened[name] for name, value in read_books(t1, final, mechanism).items()}
    lost, exchanged = books["damping_loss"] + books["friction_loss"], books["exchanged"]
    return jnp.abs(gained - books["drive_work"] + lost) / jnp.where(exchanged > 0, exchanged, 1.0)


def initial_state(mechanism: Mechanism, t0: Scalar) -> Array:
    """The state at t0: the given initial values, then the nearest ones at which every loop is assembled.

    Every joint with clearance starts with its pin at `eccentricity` in the sleeve and at rest relative to it, that is,
    with the positions and velocities of the ideal mechanism.
    """
    plan = layout(mechanism)
    free = mechanism.free_coordinates()
    q = [jnp.asarray(c.motion.position, dtype=float) for c in free]
    v = [jnp.asarray(c.motion.velocity, dtype=float) for c in free]
    y = jnp.concatenate([jnp.stack([*q, *v]) if free else jnp.zeros(0), jnp.zeros(plan.remembered)])
    if not mechanism.loops or not mechanism.assemble:
        return y
    # What is left, where only play can close a loop that is a little too long, play takes.
    y = projected(t0, y, mechanism, mechanism.loops, 8, firm_play=True)
    return projected(t0, y, mechanism, mechanism.loops, 4)


def is_assembled(mechanism: Mechanism, t0: Scalar, y: Array) -> Array:
    """Whether every loop is closed at the start (true where the mechanism is not to be assembled)."""
    if not mechanism.loops or not mechanism.assemble:
        return jnp.asarray(True)
    gaps = jnp.stack(list(openings(t0, y, mechanism).values()))
    return jnp.all(gaps <= 1e-10 * largest_length(mechanism))


def bounds_hold(mechanism: Mechanism) -> Array:
    """Whether every number is finite and inside its bounds (a flag, also for tracers)."""
    flags = []
    for leaf in parameters(mechanism).values():
        flags.append(jnp.all(jnp.isfinite(leaf.value)))
        flags += [jnp.all(f(leaf.value, leaf.metadata[b])) for b, f, _ in BOUNDS if leaf.metadata.get(b) is not None]
    return jnp.all(jnp.stack(flags)) if flags else jnp.asarray(True)
