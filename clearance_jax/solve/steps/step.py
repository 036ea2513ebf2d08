"""One try of a step: the Runge-Kutta step, and what happens at its two ends."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Each, EachFlag, Scalar
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import component_axis, components, each_lane, sharing_lanes
from clearance_jax._compile.one_function import LONG
from clearance_jax.dynamics.applied import renew
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.conditions import choice
from clearance_jax.dynamics.field import hand_over
from clearance_jax.dynamics.kinematics import relative_accelerations
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.steps.interpolate import between, polynomial
from clearance_jax.solve.steps.problem import Problem, field, lift, motion, split, with_model


class Tableau(NamedTuple):
    """Stage i is at `nodes[i]` and starts from the slopes before it by `lower[i]`; the last stage is the step's end.
    `weights`: of the end; `errors`: of its estimated error; `stages`: those of the method itself, without a last one
    added here.
    """

    lower: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    errors: np.ndarray
    stages: int


def tableau_of(solver: Any) -> Tableau:
    """The tableau of a diffrax solver."""
    given = solver.tableau
    stages = len(given.a_lower) + 1
    count = stages if given.fsal else stages + 1
    lower, nodes = np.zeros((count, count)), np.zeros(count)
    for i, row in enumerate(given.a_lower):
        lower[i + 1, : len(row)] = row
    nodes[1:stages] = given.c
    lower[-1, :stages], nodes[-1] = given.b_sol, 1.0
    lower[-1, -1] = 0.0
    weights, errors = np.zeros(count), np.zeros(count)
    weights[:stages], errors[:stages] = given.b_sol, given.b_error
    return Tableau(lower, nodes, weights, errors, stages)


_EPS = float(np.finfo(np.float64).eps)
STAGE_BEFORE_END = 4 * _EPS
"""Part of the time of a step's end by which stages there are earlier: at the end a drive may have jumped already."""
# Slopes of so many numbers are added one by one, which compilers vectorise; fewer by a reduction (measured). So are
# those of states longer than these: for an arm with three sleeves and 8 derivatives a compiler took over 10 GB.
LONG_STACK, LONG_STATE = 200, 16


class Trial(NamedTuple):
    """A try of a step: start (laws latched), end, error; slopes at its ends and stages (stages, ..., n, *lanes)."""

    start: Array
    end: Array
    error: Array
    slope0: Array
    slope1: Array
    slopes: Array


def dense_info(solver: Any, trial: Trial, times: tuple) -> dict[str, Array]:
    """The data of the solver's own interpolation of a step."""
    count = tableau_of(solver).stages
    return {"y0": trial.start, "y1": trial.end, "k": (times[1] - times[0]) * trial.slopes[:count]}


class DenseStep(NamedTuple):
    """The solver's own interpolation of a step between its times, of a long stack."""

    t0: Scalar
    t1: Scalar
    trial: Trial
    solver: Any

    def evaluate(self, time: Scalar) -> Array:
        """The state or stack at a time."""
        stages = tableau_of(self.solver).stages
        # The weights one by one: of all of them at once, the product would be a long one again.
        y0, y1, *k = (list(units) for units in np.eye(2 + stages))
        units = [jnp.asarray(unit) for unit in zip(*k, strict=True)]
        step = self.solver.interpolation_cls(t0=self.t0, t1=self.t1, y0=y0, y1=y1, k=units)
        start, end, *weights = step.evaluate(time)
        inside = _weighted_sum(jnp.stack(weights), self.trial.slopes[:stages], time)
        return start * self.trial.start + end * self.trial.end + (self.t1 - self.t0) * inside


def dense(solver: Any, trial: Trial, times: tuple, lanes: int = 1) -> Any:
    """The solver's own interpolation of a step, of one of so many lanes: diffrax's, a product of matrices. A long one
    would be a library's call, for which a compiled loop is cut in pieces: it is a sum instead.
    """
    if lanes * trial.slopes.size >= LONG:
        return DenseStep(times[0], times[1], trial, solver)
    return solver.interpolation_cls(t0=times[0], t1=times[1], **dense_info(solver, trial, times))


class SolvedStep(NamedTuple):
    """A step as one sees it who looks inside: its times, its try, and the solver."""

    times: tuple[Scalar, Scalar]
    trial: Trial
    solver: Any

    @property
    def size(self) -> Scalar:
        return self.times[1] - self.times[0]

    def curve(self, problem: Problem) -> Callable[[Any], tuple[Array, Array]]:
        """The state or stack inside the step, and its rate, as a function of the fraction of the step: by the solver's
        own interpolation if that is a polynomial of stages, as of `Dopri8`; else by the quintic, which is more accurate
        than those of solvers of order 5.
        """
        trial, h = self.trial, self.size
        powers = getattr(self.solver.interpolation_cls, "eval_coeffs", None)
        if powers is None:
            ends, plan = (trial.start, trial.end, trial.slope0, trial.slope1), layout(problem.mechanism)
            return lambda x: jax.jvp(lambda x: between(ends, h, x, plan), (x,), (jnp.ones_like(x),))
        # (Diffrax's product of matrices is a library's call, for which a compiled loop is cut in pieces.)
        stages = trial.slopes[: len(powers)]
        coefficients = [trial.start, *(h * _weighted_sum(column, stages, h) for column in jnp.asarray(powers.T[::-1]))]
        if problem.mechanism.has_manifold:
            # They know nothing of the projection at the step's end, where a signal must not jump.
            off = trial.end - functools.reduce(jnp.add, coefficients)
            coefficients[2], coefficients[3] = coefficients[2] + 3 * off, coefficients[3] - 2 * off
        return lambda x: polynomial(coefficients, x)

    def rise(self, signal: Callable, problem: Problem) -> Callable[[Any], tuple[Array, Array]]:
        """A signal of (time, state, mechanism), and its rate, as a function of the fraction of a step `of_motion`.
        Places have the rate of their speeds, more accurate than that of the interpolated places.
        """
        h, places, curve = self.size, problem.places, self.curve(problem)

        def value(time, y):
            return jnp.asarray(signal(time, y, problem.mechanism), float)

        def at(x):
            y, rate = curve(x)
            rate = jnp.concatenate([h * problem.place_rates(y), rate[places.stop :]])
            return jax.jvp(value, (self.times[0] + x * h, y), (h, rate))

        return at

    def of_motion(self, problem: Problem) -> "SolvedStep":
        """The step of the motion alone."""
        *ends, slopes = self.trial
        ends = [motion(problem, y) for y in ends]
        return self._replace(trial=Trial._make([*ends, jax.vmap(lambda slope: motion(problem, slope))(slopes)]))


@eqx.filter_jit
def try_step(
    problem: Problem,
    solver: Any,
    times: tuple[Each, Each],
    y0: Array,
    slope: Array,
    fresh: EachFlag | bool,
    past_break: EachFlag | bool = False,
) -> Trial:
    """One explicit Runge-Kutta step of a state or a stack with its quadratures, or of lanes of them.

    Laws with memory are latched at its start, and ideal loops are projected at its end. Stages are a loop, so that the
    field stands in the program once. Quadratures have rates at the stages and no values there.

    **Arguments:** `solver`: has the tableau; `slope` at the start, unless `fresh` (it is not known); `past_break`:
    whether the step starts just past a break of a drive whose time is varied.
    """
    t0, t1 = times
    tableau, plan = tableau_of(solver), layout(problem.mechanism)
    h, last = t1 - t0, len(tableau.nodes) - 1
    lower, nodes = jnp.asarray(tableau.lower), jnp.asarray(tableau.nodes)
    y0, slope, fresh = begun(problem, t0, y0, slope, fresh)
    if past_break is not False:
        moved = past_moving_break(t0, y0, problem)
        y0, fresh = jnp.where(past_break, moved, y0), fresh | past_break
    if problem.mechanism.may_repeat:
        # Once a step, at its start, where loops are closed and repeated conditions can be recognised.
        chosen = each_lane(lambda t, y, p: choice(t, motion(p, y), p.mechanism), t0)(t0, y0, problem)
        problem = eqx.tree_at(lambda p: p.mechanism.chosen, problem, chosen, is_leaf=lambda x: x is None)

    def combine(weights, slopes, part=slice(None)):
        return components(y0, part, t0) + h * _weighted_sum(weights, components(slopes, part, t0), t0)

    idle = (tableau.weights == 0) & (tableau.errors == 0)
    # The end is the next step's first stage.
    idle[-1] = False

    def counts(i):
        return ~jnp.asarray(idle)[i] if np.any(idle) else None

    def stage(i, carry):
        slopes, _ = carry
        y = combine(lower[i], slopes, slice(plan.size))
        now = jnp.where(nodes[i] == 1, t1 - STAGE_BEFORE_END * jnp.abs(t1), t0 + nodes[i] * h)
        if problem.mechanism.has_manifold:
            y = jax.lax.cond(i == last, lambda y: _in_every_row(project, t1, y, problem), lambda y: y, y)
        with sharing_lanes(t0):
            new = share(field(now, y, problem, counts(i)))
            if jnp.ndim(t0):
                # Lanes that know their slope keep it. (Shared: with a condition common to all lanes a compiler would
                # make two loops, and copy number by number in one.)
                new = jnp.where(share(fresh | (i > 0)), new, slope)
        return jax.lax.dynamic_update_index_in_dim(slopes, new, i, 0), y

    first = 0 if fresh is True else 1 if fresh is False else jnp.where(jnp.any(fresh), 0, 1)
    # At an index unknown to the compiler, which would otherwise write all rows anew, number by number.
    slopes = jax.lax.dynamic_update_index_in_dim(jnp.zeros((last + 1, *y0.shape)), slope, jnp.minimum(first, 0), 0)
    begin = slopes, components(y0, slice(plan.size), t0)
    slopes, end = jax.lax.fori_loop(first, last + 1, stage, begin)
    whole = combine(jnp.asarray(tableau.weights), slopes)
    error = h * _weighted_sum(jnp.asarray(tableau.errors), slopes, t0)
    return Trial(y0, _with_state(whole, end, t0), error, slopes[0], slopes[last], slopes)


def begun(
    problem: Problem, t0: Each, y0: Array, slope: Array, fresh: EachFlag | bool
) -> tuple[Array, Array, EachFlag | bool]:
    """The state with its laws latched and its payloads handed over, the slope before, and whether it is fresh now."""
    mechanism, plan = problem.mechanism, layout(problem.mechanism)
    if plan.is_latched:
        slope = _known_slope(problem, t0, y0, slope, fresh)
        now = each_lane(lambda t, y, f, p: lift(lambda m, y, f: latch(t, y, f, m[0]), p, y, f), t0)
        latched = _with_state(y0, now(t0, y0, slope, problem), t0)
        # The motion decides whether the slope is fresh. But a new command may have another derivative and the same
        # value, as for a servo at rest at its target.
        before, after = (y if plan.held else motion(problem, y) for y in (y0, latched))
        fresh = jnp.any(after != before, axis=tuple(range(after.ndim - jnp.ndim(t0))))
        y0 = latched
    if problem.energy_balance and mechanism.has_payloads:
        y0 = _in_every_row(hand_over, t0, y0, problem)
    return y0, slope, fresh


def _in_every_row(function: Callable, time: Each, y: Array, problem: Problem) -> Array:
    """A function of (time, state, mechanism) of a stack, and of every lane."""
    return each_lane(lambda t, y, p: lift(lambda m, y: function(t, y, m[0]), p, y), time)(time, y, problem)


def _weighted_sum(weights: Array, slopes: Array, time: Each) -> Array:
    """The weighted sum of the stages' slopes (first axis)."""
    if not jnp.ndim(time) and (slopes.size < LONG_STACK or slopes.shape[-1] > LONG_STATE):
        return jnp.sum(weights.reshape(-1, *[1] * (slopes.ndim - 1)) * slopes, axis=0)
    with sharing_lanes(time):
        return share(functools.reduce(jnp.add, [w * slope for w, slope in zip(weights, slopes, strict=True)]))


def _with_state(y: Array, state: Array, time: Each) -> Array:
    """`y` with its first components replaced."""
    axis = component_axis(time)
    return jnp.concatenate([state, components(y, slice(state.shape[axis], None), time)], axis=axis)


def _known_slope(problem: Problem, time: Each, y: Array, slope: Array, fresh: EachFlag | bool) -> Array:
    """The slope at a step's start, computed if it is not known."""
    if fresh is False:
        return slope

    def now():
        return field(time, components(y, slice(problem.size), time), problem)

    if fresh is True:
        return now()
    return jax.lax.cond(jnp.any(fresh), lambda: jnp.where(fresh, now(), slope), lambda: slope)


def latch(time: Scalar, y: Array, slope: Array, mechanism: Any) -> Array:
    """The state with every law's memory, and every held effort, brought up to date, shape (size,).

    A touch or a separation lies a little before `time`. The joints are told how long ago, as a function of the state.
    So what they latch held at the touch, and its derivative includes that a parameter moves the touch.
    """
    plan = layout(mechanism)
    memory, parts = plan.split(y).memory, []
    seen = relative_accelerations(time, y, slope, mechanism)
    for joint, (at, rate) in zip(mechanism.contacts(), seen, strict=True):
        if joint.clearance.remembers:
            parts += joint.clearance.latch(memory[joint.name], at, rate)
    parts += [integral for name, _ in plan.integrals for integral in memory[name]]
    if plan.held:
        parts += renew(mechanism, time, plan.split(y))
    return jnp.concatenate([y[: plan.v.stop], jnp.stack(parts)])


def past_moving_break(time: Scalar, stack: Array, problem: Problem) -> Array:
    """The state just past breaks whose times t_b are varied.

    At a break the slope jumps from f- to f+. A direction that delays it by dt_b leaves the state on f- for that long,
    so its derivative jumps by (f- - f+) dt_b. (The smooth pieces of a drive do not show this: a parameter that acts
    only through a switching time would have derivative zero.) If several breaks lie at this time, a direction moves one
    of them: f- is then the slope of the mechanism moved along the direction until only that break lies just ahead. If a
    payload is handed over there, its energy counts at the moved moment: until then it goes on changing along f-.
    """
    times = lift(lambda model: drive_breaks(model[0]), problem)
    ahead = 32 * _EPS * jnp.abs(time)  # a step starts 4 eps past a break, see `control.past_break`
    here = jnp.abs(times[0] - time) <= 0.5 * ahead
    delays = jnp.where(here[None], times[1:], 0.0)
    delay = jnp.take_along_axis(delays, jnp.argmax(jnp.abs(delays), axis=1)[:, None], axis=1)[:, 0]
    varied, fixed = split(problem.model, problem.directions)
    state = stack[0, : problem.size]

    def payload_power(slope, mechanism):
        along = jnp.ones_like(time), slope
        return jax.jvp(lambda time, y: hand_over(time, y, mechanism), (time, stack[0]), along)[1]

    def before(direction, delay):
        by = jnp.where(delay == 0, 0.0, ahead / jnp.where(delay == 0, 1.0, delay))
        moved = with_model(problem, eqx.combine(jax.tree.map(lambda x, d: x + by * d, varied, direction), fixed))
        slope = field(time, state, moved)
        if not (problem.energy_balance and problem.mechanism.has_payloads):
            return slope
        # The moved payload is handed over in one mechanism and not yet in the other.
        return slope + payload_power(slope, problem.mechanism) - payload_power(slope, moved.mechanism)

    after = field(time, state, with_model(problem, problem.model))
    jumps = jax.vmap(before)(problem.directions, delay) - after[None]
    return jnp.concatenate([stack[:1], stack[1:] + delay[:, None] * jumps])
