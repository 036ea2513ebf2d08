"""Single solves driven by diffrax: its solver is the first half of an attempt, its controller the second.

The try passes from one to the other in place of a bare error estimate, diffrax's only channel between them.

The controller samples the motion, because it has the try. Diffrax would check sample times by calling Python from
within the program, and such a program cannot be kept between processes. (They are checked before the solve.)
"""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Flag, Scalar
from clearance_jax.solve.codes import code_of
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps.attempt import Outcome, SolveTask, decide, means_of, start_records
from clearance_jax.solve.steps.control import Control, Means, first_end
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.step import Trial, dense, dense_info, try_step


class Stepper(diffrax.AbstractAdaptiveSolver):
    """Tries a step (`try_step`) of a mechanism's flat state, or of a stack."""

    options: Settings
    moving_breaks: bool = eqx.field(static=True, default=False)
    """Whether the times of the drives' breaks are varied."""
    term_structure: ClassVar = diffrax.AbstractTerm

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.options.solver.interpolation_cls

    def order(self, terms):
        return self.options.solver.order(terms)

    def error_order(self, terms):
        return self.options.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        return jnp.zeros_like(y0), jnp.asarray(True)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        slope, fresh = solver_state
        past_break = made_jump if self.moving_breaks else False
        trial = try_step(args, self.options.solver, (t0, t1), y0, slope, fresh | jnp.asarray(made_jump), past_break)
        info = dense_info(self.options.solver, trial, (t0, t1))
        return trial.end, trial, info, (trial.slope1, jnp.asarray(False)), diffrax.RESULTS.successful


class StepSamples(NamedTuple):
    """The states at sample times so far: the first `count` of them, infinite for the others."""

    count: Array
    y: Array

    @classmethod
    def none(cls, at: Array, t0: Scalar, t1: Scalar, y0: Array) -> "StepSamples":
        """Before the first step. A motion of no duration has no step, and its start as all samples."""
        y = jnp.broadcast_to(jnp.where(t0 == t1, y0, jnp.inf), (at.size, *y0.shape))
        return cls(jnp.where(t0 == t1, at.size, 0), y)

    def more(self, at: Array, step: Any, keep: Flag) -> "StepSamples":
        """With the samples in a step (its interpolation), if it is kept."""

        def goes_on(now):
            return keep & (now.count < at.size) & (at[jnp.minimum(now.count, at.size - 1)] <= step.t1)

        def once(now):
            y = jax.lax.dynamic_update_index_in_dim(now.y, step.evaluate(at[now.count]), now.count, 0)
            return StepSamples(now.count + 1, y)

        return jax.lax.while_loop(goes_on, once, self)


class DriverState(NamedTuple):
    """State of the controller: memory of the control, records of the observers, samples if any."""

    control: Control
    record: tuple
    samples: StepSamples | None


class Controller(diffrax.AbstractAdaptiveStepSizeController):
    """Judges a try and decides (`attempt.decide`)."""

    options: Settings
    means: Means
    at: Array | None = None
    """Sample times."""

    # diffrax's protocol; the error here is scaled by our own tolerances.
    @property
    def rtol(self):
        return 0.0

    @property
    def atol(self):
        return 1.0

    @property
    def norm(self):  # pyright: ignore[reportIncompatibleMethodOverride]
        return jnp.abs

    def wrap(self, direction):
        return self

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        samples = None if self.at is None else StepSamples.none(self.at, t0, t1, y0)
        state = DriverState(Control.begin(t0), start_records(self.options, t0, y0, args), samples)
        return first_end(args, t0, t1, y0, self.means), state

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        problem: Problem = args
        assert isinstance(y_error, Trial)  # this controller goes with `Stepper`
        control, record, samples = controller_state
        decision, record = decide(problem, y_error, (t0, t1), self.means, control, self.options, record)
        result = diffrax.RESULTS.where(decision.collapsed, diffrax.RESULTS.dt_min_reached, diffrax.RESULTS.successful)
        if samples is not None:
            samples = samples.more(self.at, dense(self.options.solver, y_error, (t0, t1)), decision.keep)
        state = DriverState(decision.control, record, samples)
        return decision.keep, decision.start, decision.end, decision.past_break, state, result


def _own_field(t, y, args):
    """Never called: `try_step` evaluates the field, and diffrax only asks for its shape."""
    return y


def integrate(task: SolveTask, options: Settings, moving_breaks: bool = False, mapped: bool = False) -> Outcome:
    """One motion (or stack) to its end. `mapped`: `jax.vmap` may batch it; diffrax samples then, with fewer copies."""
    at = task.save_at
    by_diffrax = mapped and at is not None
    out = _by_diffrax(task, options, moving_breaks, [diffrax.SubSaveAt(ts=at)] if by_diffrax else [], not by_diffrax)
    assert out.ts is not None
    assert out.ys is not None
    state: Any = out.controller_state
    record = state.record if options.observers else ()
    counts = out.stats["num_accepted_steps"], out.stats["num_rejected_steps"], state.control.cuts
    sampled = (out.ts[1], out.ys[1]) if by_diffrax else None
    if at is not None and not by_diffrax:
        sampled = jnp.where(jnp.arange(at.size) < state.samples.count, at, jnp.inf), state.samples.y
    return Outcome(out.ys[0][-1], out.ts[0][-1], sampled, record, code_of(out.result), *counts)


def _by_diffrax(task: SolveTask, options: Settings, moving_breaks: bool, subs: list, samples: bool) -> diffrax.Solution:
    """Diffrax's solution: the end, and what `subs` save; `samples`: the controller takes the task's samples."""
    at = task.save_at if samples else None
    # To pyright the abstract rtol, atol and norm are fields, not properties.
    controller = Controller(options, means_of(options, task.allowed), at)  # pyright: ignore[reportCallIssue]
    return diffrax.diffeqsolve(
        diffrax.ODETerm(_own_field),
        Stepper(options, moving_breaks),
        task.t0,
        task.t1,
        None,
        task.start,
        args=task.problem,
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(t1=True), *subs], controller_state=True),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=options.max_steps,
        throw=False,
    )
