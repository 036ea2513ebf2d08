"""The step-size controller: error control, and every switch of the contact laws and break of a drive a step's end.

Why: an error estimate samples the force at a few points of a step. A contact that begins and ends between them is not
sampled, so the step is accepted and the contact is lost; no tolerance repairs it. Here each candidate step is
interpolated (quintic for the gap, cubic for the slip), the laws' regimes are read along it, and a step across a change
is cut there.
"""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.mechanism.mechanism import layout
from clearance_jax.solve.problem import Problem, motion
from clearance_jax.solve.step import StepEnds
from clearance_jax.solve.switches import first_switch, misfit, watched

_EPS = float(np.finfo(np.float64).eps)
# The motion's errors are amplified by the impacts to come, and so are kept at a tenth of rtol in each step; a
# derivative grows through the same impacts, and its relative error does not. With this much leave, derivatives come out
# about as accurate as the states that they belong to (`experiments/derivatives`).
LENIENCE = 0.02


class WatchState(NamedTuple):
    """State of the controller.

    The wrapped one's; the step size it would have taken had it not been cut (0: not cut); and how often in a row a cut
    has failed to get clear of its switch; what the observer has recorded.
    """

    inner: Any
    natural: Array
    stalls: Array
    record: Any


class ContactController(diffrax.AbstractAdaptiveStepSizeController):
    """Wraps a PID controller; cuts steps at the switches of the contact laws and at the breaks of the drives.

    **Arguments:**

    - `scale`: per component of the state, the absolute tolerance; infinite where the component is not controlled.
    - `relative`: per component, the tolerance relative to its present size.
    - `breaks`: times at which a drive's derivatives jump.
    - `fit`: how far the overlaps may be from the curves on which switches are looked for, over the clearance.
    - `margin`: how far past a switch a cut step ends, as a fraction of the uncut step.
    - `unit`: per component, its magnitude (of derivatives only).
    - `floor`: per direction, the size (in units) from which on a derivative's error is relative to its size.
    - `observer`: sees every accepted step, see `observers.AbstractObserver`.
    - `watch`: whether to watch the contacts (off: a plain PID controller with break points).
    """

    scale: Array
    relative: Array
    breaks: Array
    margin: Array
    fit: Array
    unit: Array | None = None
    floor: Array | None = None
    observer: Any = None
    watch: bool = eqx.field(static=True, default=True)
    points: int = eqx.field(static=True, default=10)
    controller: diffrax.PIDController = diffrax.PIDController(rtol=0.0, atol=1.0)

    @property
    def rtol(self):
        return self.controller.rtol

    @property
    def atol(self):
        return self.controller.atol

    @property
    def norm(self):  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.controller.norm

    def wrap(self, direction):
        return self

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        if dt0 is None:
            slope = func(terms, t0, y0, args)
            dt0 = self._first_step(t0, t1, motion(args, y0), motion(args, slope))
        end = self._before_break(t0, t0 + on_grid(dt0))
        _, inner = self.controller.init(terms, t0, t1, y0, end - t0, args, func, error_order)
        record = None if self.observer is None else self.observer.start(t0, y0, args)
        return end, WatchState(inner, jnp.zeros_like(end), jnp.zeros((), int), record)

    def _first_step(self, t0, t1, y0, slope):
        # A thousandth of the time in which the state changes by its own tolerance-free scale; the error control grows
        # it tenfold a step, so a small start costs little and an impact just after t0 is not jumped over.
        weight = self.scale / jnp.max(jnp.where(jnp.isfinite(self.scale), self.scale, 0.0))
        speed = jnp.max(jnp.where(jnp.isfinite(self.scale), jnp.abs(slope) / (weight + jnp.abs(y0)), 0.0))
        return jnp.minimum(1e-4 / jnp.maximum(speed, 1e-300), 1e-3 * (t1 - t0))

    def scaled_error(self, problem: Problem, y0, y1, error):
        """The error of a step over what is allowed, of motion and derivatives, and of the motion alone.

        A derivative is an error once it is wrong by a fraction of itself (impacts make it grow by orders of magnitude),
        not of the motion; `floor` says from which size on.
        """
        controlled = jnp.isfinite(self.scale)
        scale = jnp.where(controlled, self.scale, 1.0)
        count = jnp.maximum(jnp.sum(controlled), 1)

        def rms(x):
            wanted = jnp.where(jnp.broadcast_to(controlled, x.shape), x, 0.0)
            return jnp.sqrt(jnp.sum(wanted * wanted, axis=-1) / count)

        size = jnp.maximum(jnp.abs(motion(problem, y0)), jnp.abs(motion(problem, y1)))
        of_motion = scaled = rms(motion(problem, error) / (scale + self.relative * size))
        if problem.varies:
            assert self.unit is not None
            assert self.floor is not None
            unit = jnp.where(controlled, self.unit, 1.0)
            columns = jnp.maximum(rms(y0[1:] / unit[None]), rms(y1[1:] / unit[None]))
            derivatives = rms(error[1:] / scale[None]) / (self.floor + columns)
            scaled = jnp.maximum(scaled, LENIENCE * jnp.max(derivatives))
        fine = jnp.isfinite(scaled) & jnp.all(jnp.isfinite(y1))
        return jnp.where(fine, scaled, jnp.inf), jnp.where(fine, of_motion, jnp.inf)

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        problem: Problem = args
        assert isinstance(y_error, StepEnds)  # this controller goes with `Stepper`
        h = t1 - t0
        scaled, of_motion = self.scaled_error(problem, y0, y1_candidate, y_error.error)
        stacks = y_error.start, y1_candidate, y_error.slope0, y_error.slope1
        ends = tuple(motion(problem, x) for x in stacks)
        watching = self.watch and bool(problem.mechanism.clearance_joints())
        curves = watched((t0, t1), ends, problem.mechanism) if watching else []
        if watching:
            off = misfit((t0, t1), ends, curves, problem.mechanism) / self.fit
            off = jnp.where(jnp.isfinite(off), off, jnp.inf)
            scaled, of_motion = jnp.maximum(scaled, off), jnp.maximum(of_motion, off)
        collapsed = (scaled > 1) & (h <= 8 * _EPS * jnp.abs(t1))
        accurate, _, proposal, _, inner, result = self.controller.adapt_step_size(
            t0, t1, jnp.zeros(()), jnp.zeros(()), args, scaled, error_order, controller_state.inner
        )
        if watching:
            # Past a switch by enough for round-off not to hide it, by too little for the kink to matter; four times
            # more wherever that was not enough to get clear.
            pad = jnp.maximum(4 * _EPS * jnp.abs(t1), self.margin * jnp.maximum(h, controller_state.natural))
            pad = pad * 4.0 ** jnp.minimum(controller_state.stalls, 24)
            memory = layout(problem.mechanism).memory_of(ends[1])
            cut, at = first_switch((t0, t1), curves, memory, problem.mechanism, pad, self.points)
            # Where the motion is accurate the switch is located, also where the derivatives, whose slope jumps there,
            # are not: shrinking the step towards the jump would end at a step of a round-off.
            cut = cut & (of_motion <= 1)
        else:
            pad, cut, at = jnp.zeros_like(t1), jnp.zeros((), bool), t1
        keep = accurate & ~cut
        next_t0 = jnp.where(keep, t1, t0)
        natural = controller_state.natural
        # A cut step says nothing about the step size: go back to the one that was cut.
        step = jnp.maximum(proposal - jnp.where(accurate, t1, t0), jnp.where(keep, natural, 0.0))
        next_t1 = jnp.where(cut, at, next_t0 + on_grid(step))
        stuck = cut & (at - t0 <= 8 * pad)
        free = keep & (natural == 0)
        stalls = jnp.where(stuck, controller_state.stalls + 1, jnp.where(free, 0, controller_state.stalls))
        natural = jnp.where(cut, jnp.maximum(natural, h), jnp.where(keep, 0.0, jnp.where(accurate, natural, 0.0)))
        inner = jax.tree.map(lambda new, old: jnp.where(cut, old, new), inner, controller_state.inner)
        next_t0, made_jump = self._past_break(keep, next_t0)
        next_t1 = jnp.maximum(next_t1, next_t0 + 2 * _EPS * jnp.abs(next_t0))
        clipped = self._before_break(next_t0, next_t1)
        if self.observer is not None:
            clipped = jnp.minimum(clipped, next_t0 + self.observer.longest)
        natural = jnp.where(clipped < next_t1, jnp.maximum(natural, next_t1 - next_t0), natural)
        result = diffrax.RESULTS.where(collapsed, diffrax.RESULTS.dt_min_reached, result)
        record = controller_state.record
        if self.observer is not None:
            seen = self.observer(record, (t0, t1), stacks, problem)
            record = jax.tree.map(lambda new, old: jnp.where(keep, new, old), seen, record)
        return keep, next_t0, clipped, made_jump, WatchState(inner, natural, stalls, record), result

    def _before_break(self, t0, t1):
        """`t1`, or just before the next break where that comes first."""
        if self.breaks.shape[0] == 0:
            return t1
        margin = 4 * _EPS * jnp.abs(self.breaks)
        ahead = jnp.where(self.breaks - 2 * margin > t0, self.breaks - margin, jnp.inf)
        return jnp.minimum(t1, jnp.min(ahead))

    def _past_break(self, keep, t0):
        """`t0`, or just past the break that it stands before."""
        if self.breaks.shape[0] == 0:
            return t0, False
        margin = 4 * _EPS * jnp.abs(self.breaks)
        here = keep & (jnp.abs(self.breaks - t0) <= 2 * margin) & (self.breaks > t0)
        return jnp.where(jnp.any(here), jnp.max(jnp.where(here, self.breaks + margin, -jnp.inf)), t0), jnp.any(here)


def on_grid(step):
    """The step size rounded down to a power of 2^(1/8).

    A step size computed from an error estimate carries rounding errors magnified by 1/rtol, and choosing the next step
    magnifies them again: two programs for the same solve (alone, or in a batch) would drift to different steps, and
    through the impacts to results that differ by the whole error of the solve. On a grid they take the same steps.
    """
    # Off the grid's own points by a hair: a step that is on the grid stays there whatever its last digits.
    return jnp.exp2(jnp.floor(8 * jnp.log2(step) + 1e-4) / 8)
