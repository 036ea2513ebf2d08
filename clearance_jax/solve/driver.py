"""diffrax drives a single solve: our solver is the first half of an attempt, our controller the second.

The try goes from one to the other in the place of a bare error estimate, diffrax's only channel between them.
"""

from typing import ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax.solve.attempt import Options, decide, dense_info, means_of, started
from clearance_jax.solve.codes import code_of
from clearance_jax.solve.control import Control, Means, first_end
from clearance_jax.solve.outcome import Outcome, Task
from clearance_jax.solve.problem import Problem
from clearance_jax.solve.step import Trial, try_step


class Stepper(diffrax.AbstractAdaptiveSolver):
    """Tries a step (`try_step`) of a mechanism's flat state, or of a stack."""

    options: Options
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
        return (
            trial.end,
            trial,
            dense_info(self.options, trial, (t0, t1)),
            (trial.slope1, jnp.asarray(False)),
            diffrax.RESULTS.successful,
        )


class Watched(NamedTuple):
    """State of the controller: what the control remembers, what the observer has recorded."""

    control: Control
    record: tuple


class Controller(diffrax.AbstractAdaptiveStepSizeController):
    """Judges a try and decides (`attempt.decide`)."""

    options: Options
    means: Means

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
        return first_end(args, t0, t1, y0, self.means), Watched(Control.begin(t0), started(self.options, t0, y0, args))

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        problem: Problem = args
        assert isinstance(y_error, Trial)  # this controller goes with `Stepper`
        control, record = controller_state
        decision, record = decide(problem, y_error, (t0, t1), self.means, control, self.options.observers, record)
        result = diffrax.RESULTS.where(decision.collapsed, diffrax.RESULTS.dt_min_reached, diffrax.RESULTS.successful)
        state = Watched(decision.control, record)
        return decision.keep, decision.start, decision.end, decision.past_break, state, result


def _own_field(t, y, args):
    """Never called: `try_step` evaluates the field; diffrax asks for its shape."""
    return y


def integrate(task: Task, options: Options, moving_breaks: bool = False) -> Outcome:
    """One motion (or stack) to its end."""
    samples = [] if task.save_at is None else [diffrax.SubSaveAt(ts=task.save_at)]
    out = _by_diffrax(task, options, moving_breaks, samples)
    assert out.ts is not None
    assert out.ys is not None
    record = out.controller_state.record if options.observers else ()  # pyright: ignore[reportOptionalMemberAccess]
    counts = out.stats["num_accepted_steps"], out.stats["num_rejected_steps"]
    sampled = (out.ts[1], out.ys[1]) if samples else None
    return Outcome(out.ys[0][-1], out.ts[0][-1], sampled, record, code_of(out.result), *counts)


def step_ends(task: Task, options: Options) -> tuple[Array, Array]:
    """Every step's end, the start first, then infinite; and the code with which the solve ends."""
    out = _by_diffrax(task, options, False, [diffrax.SubSaveAt(t0=True, steps=True)])
    assert out.ts is not None
    return out.ts[1], code_of(out.result)


def _by_diffrax(task: Task, options: Options, moving_breaks: bool, subs: list) -> diffrax.Solution:
    """Diffrax's solution: the end, and whatever else is to be saved."""
    # To pyright the abstract rtol, atol and norm are fields, not properties.
    controller = Controller(options, means_of(options, task.allowed))  # pyright: ignore[reportCallIssue]
    return diffrax.diffeqsolve(
        diffrax.ODETerm(_own_field),
        Stepper(options, moving_breaks),
        task.t0,
        task.t1,
        None,
        task.start,
        args=task.problem,
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(t1=True), *subs], controller_state=bool(options.observers)),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=options.max_steps,
        throw=False,
    )
