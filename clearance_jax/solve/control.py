"""What follows from a try of a step: whether it is good enough, where it must be cut, how long the next one is.

Why steps are cut: an error estimate samples the force at a few points of a step. A contact that begins and ends between
them is not sampled, so the step is accepted and the contact is lost; no tolerance repairs it. Here the relative motion
of each clearance joint is interpolated along each candidate step, the laws' event functions are read along it, and a
step across a change is cut there. So every touch, separation and change of formula, and every break of a drive, is a
step's end.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._sharing import share
from clearance_jax._types import Each, EachFlag, Scalar
from clearance_jax.mechanism.breaks import breaks_near
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.events import curves, first_event
from clearance_jax.solve.lane_axis import component_axis, each_lane, sum_components
from clearance_jax.solve.problem import Problem, motion
from clearance_jax.solve.step import Trial
from clearance_jax.solve.tolerances import Tolerances

_EPS = float(np.finfo(np.float64).eps)
# The motion's errors are amplified by the impacts to come, and so are kept at a tenth of rtol in each step; a
# derivative grows through the same impacts, and its relative error does not: it may be 1 / LENIENCE times larger. A
# solve has the error of a few such steps, and which ones is chance: over tolerances that differ by parts, the Jacobian
# of the slider-crank scatters by a factor of ten. At 0.02 Dopri8 gave 3 to 27 rtol. A method of high order takes few
# more steps for a smaller error, and so its leave is smaller, by REFINED for each order above PLAIN_ORDER: Dopri8's is
# a fifth of Tsit5's, which costs it a fifth more steps (and would cost Tsit5 a third), and gives 1 to 6 rtol.
LENIENCE, PLAIN_ORDER, REFINED = 0.02, 5.0, 5.0 ** (1 / 3)
# The step size aimed at, over the one at which the error would be what is allowed; how much it may change at once.
SAFETY, SHRINK, GROW = 0.85, 0.2, 2.0
# Wherever a cut has not been enough to get clear of its event, the next goes so many times further past it; at most.
FURTHER, FURTHEST = 4.0, 4.0**24
# Cut within this part of a step from its start, right after a step that was cut, is not clear of that event: the
# round-off of a place may hide one for longer than that of the time.
NEAR = 0.1


class Control(NamedTuple):
    """What is remembered from try to try: the step size that would have been taken had it not been cut (0: not cut),
    how much further than usual past an event a cut step ends, because cuts have failed to get clear of it, and whether
    the last step that was kept had been cut.
    """

    natural: Array
    reach: Array
    after_cut: EachFlag

    @staticmethod
    def begin(time: Each) -> "Control":
        """Before the first try."""
        shape = jnp.shape(time)
        return Control(jnp.zeros(shape), jnp.ones(shape), jnp.zeros(shape, bool))


class Verdict(NamedTuple):
    """On one try: its error over what is allowed; whether it crosses an event, and the time just past it, to which the
    next try goes; how far past an event that is [s].
    """

    error: Each
    cut: EachFlag
    at: Each
    pad: Each


class Decision(NamedTuple):
    """Whether a try is kept; start and end of the next one; whether that starts just past a break; what to remember;
    whether the solve ends here: the step size has collapsed, or a part has left its walls.
    """

    keep: EachFlag
    start: Each
    end: Each
    past_break: EachFlag
    control: Control
    collapsed: EachFlag


class Means(NamedTuple):
    """What a solve is judged by: tolerances, whether to locate events, order of the error estimate, and the
    longest step that an observer can see through [s].
    """

    allowed: Tolerances
    locate_events: bool
    order: float
    longest: Any = None


def judge(problem: Problem, trial: Trial, times: tuple, means: Means, control: Control) -> Verdict:
    """The verdict on a try."""
    t0, t1 = times
    error, of_motion = scaled_error(problem, trial, means, t1)
    if not (means.locate_events and problem.mechanism.clearance_joints()):
        return Verdict(error, jnp.zeros(jnp.shape(t1), bool), t1, jnp.zeros_like(t1))
    ends = tuple(motion(problem, x) for x in (trial.start, trial.end, trial.slope0, trial.slope1))
    found, misfit = curves(times, ends, problem.mechanism)
    # Round-off is no misfit: in free flight, where it would be all the error there is, it would choose the next step.
    off = jnp.maximum(misfit - means.allowed.noise, 0.0) / means.allowed.fit
    off = jnp.where(jnp.isfinite(off), off, jnp.inf)
    error, of_motion = jnp.maximum(error, off), jnp.maximum(of_motion, off)
    # Past an event by enough for round-off not to hide it, by too little for the kink to matter.
    h = t1 - t0
    pad = jnp.maximum(4 * _EPS * jnp.abs(t1), means.allowed.margin * jnp.maximum(h, control.natural))
    pad = pad * control.reach
    crossed, s = first_event(found, ends[1], problem.mechanism, jnp.minimum(pad / h, 0.5))
    at = t0 + s * h + pad
    # Where the motion is accurate the event is located, also where the derivatives, whose slope jumps there, are not:
    # shrinking the step towards the jump would end at a step of a round-off.
    return Verdict(error, crossed & (at < t1 - pad) & (of_motion <= 1), at, pad)


def lenience(order: float) -> float:
    """The weight of the derivatives' errors beside the motion's, by a method whose error has this order."""
    return LENIENCE * REFINED ** max(order - PLAIN_ORDER, 0.0)


def scaled_error(problem: Problem, trial: Trial, means: Means, time: Each) -> tuple[Each, Each]:
    """The error of a step over what is allowed, of motion and derivatives, and of the motion alone.

    A derivative is an error once it is wrong by a fraction of itself (impacts make it grow by orders of magnitude), not
    of the motion; `floor` says from which size on. What laws remember is a kind of its own: it is measured by itself
    and all else, and nothing else is measured by it.
    """
    y0, y1, error, axis = trial.start, trial.end, trial.error, component_axis(time)
    allowed = means.allowed
    controlled = jnp.isfinite(allowed.absolute)
    scale = jnp.where(controlled, allowed.absolute, 1.0)

    def rms(x, which=controlled):
        wanted = jnp.where(jnp.broadcast_to(which, x.shape), x, 0.0)
        return jnp.sqrt(sum_components(wanted * wanted, time) / jnp.maximum(jnp.sum(which, axis=axis), 1))

    size = jnp.maximum(jnp.abs(motion(problem, y0)), jnp.abs(motion(problem, y1)))
    of_motion = scaled = rms(motion(problem, error) / (scale + allowed.relative * size))
    if problem.varies:
        assert allowed.floor is not None
        unit = jnp.where(controlled, allowed.unit, 1.0)
        begin, end, off = y0[1:] / unit[None], y1[1:] / unit[None], error[1:] / scale[None]
        plan, kinds = layout(problem.mechanism), [controlled]
        if plan.remembered:
            # A bristle is a thousandth of a play long, so that its own derivative would hide all the others.
            places = np.arange(y1.shape[axis]).reshape(-1, *[1] * jnp.ndim(time))
            memory = (plan.v.stop <= places) & (places < plan.size)
            kinds = [controlled & ~memory, controlled & memory]
        columns, worst = allowed.floor, jnp.zeros_like(scaled)
        for kind in kinds:
            columns += jnp.maximum(rms(begin, kind), rms(end, kind))
            # Shared: the reduction that follows goes through them lane by lane.
            worst = jnp.maximum(worst, jnp.max(share(rms(off, kind) / columns), axis=0))
        scaled = jnp.maximum(scaled, lenience(means.order) * worst)
    fine = jnp.isfinite(scaled) & jnp.all(jnp.isfinite(y1), axis=tuple(range(y1.ndim - jnp.ndim(time))))
    return jnp.where(fine, scaled, jnp.inf), jnp.where(fine, of_motion, jnp.inf)


def next_step(problem: Problem, verdict: Verdict, times: tuple, means: Means, control: Control) -> Decision:
    """What to do after a verdict."""
    t0, t1 = times
    h, cut, error = t1 - t0, verdict.cut, verdict.error
    accurate = error < 1
    keep = share(accurate & ~cut)
    # A cut step says nothing about the step size (its tiny error is round-off): go back to the one that was cut.
    step = jnp.where(keep & (control.natural > 0), control.natural, h * factor(error, accurate, means.order))
    start = jnp.where(keep, t1, t0)
    end = jnp.where(cut, verdict.at, start + on_grid(step))
    stuck = cut & (verdict.at - t0 <= jnp.maximum(8 * verdict.pad, jnp.where(control.after_cut, NEAR * h, 0.0)))
    free = keep & (control.natural == 0)
    further = jnp.minimum(FURTHER * control.reach, FURTHEST)
    reach = jnp.where(stuck, further, jnp.where(free, 1.0, control.reach))
    after_cut = jnp.where(keep, control.natural > 0, control.after_cut)
    natural = jnp.where(cut, jnp.maximum(control.natural, h), jnp.where(keep | ~accurate, 0.0, control.natural))
    breaks = each_lane(breaks_near, t0)(problem.mechanism, start)
    start, past = past_break(breaks, keep, start)
    end = jnp.maximum(end, start + 2 * _EPS * jnp.abs(start))
    clipped = before_break(breaks, start, end)
    if means.longest is not None:
        clipped = jnp.minimum(clipped, start + means.longest)
    natural = jnp.where(clipped < end, jnp.maximum(natural, end - start), natural)
    collapsed = ~accurate & (h <= 8 * _EPS * jnp.abs(t1))
    return Decision(keep, start, clipped, past, Control(natural, reach, after_cut), collapsed)


def factor(error: Each, accurate: EachFlag, order: float) -> Each:
    """By how much the step size changes after an error (an integrating controller)."""
    wanted = SAFETY * jnp.exp(-jnp.log(jnp.maximum(error, 1e-30)) / order)
    return jnp.clip(wanted, jnp.where(accurate, 1.0, SHRINK), GROW)


def first_end(problem: Problem, t0: Scalar, t1: Scalar, y0: Array, means: Means) -> Scalar:
    """Where the first try ends: a ten thousandth of the time in which the state moves by its own scale. The error
    control grows it tenfold a step, so a small start costs little and an impact just after t0 is not jumped over.
    """
    first, unit = motion(problem, y0), means.allowed.unit
    places = first[problem.places]
    moved = problem.place_rates(first)
    pace = jnp.max(jnp.abs(moved) / (unit[problem.places] + jnp.abs(places)), initial=0.0)
    rate = jnp.maximum(pace, means.allowed.rate)
    # `fmin`: of a state that is no number too a try has an end, and so its step size can collapse.
    step = jnp.fmin(1e-4 / jnp.maximum(rate, 1e-300), 1e-3 * (t1 - t0))
    return before_break(breaks_near(problem.mechanism, t0), t0, t0 + on_grid(step))


def before_break(breaks: Array, t0: Each, t1: Each) -> Each:
    """`t1`, or just before the next break where that comes first."""
    if breaks.shape[0] == 0:
        return t1
    margin = 4 * _EPS * jnp.abs(breaks)
    ahead = jnp.where(breaks - 2 * margin > t0, breaks - margin, jnp.inf)
    return jnp.minimum(t1, jnp.min(ahead, axis=0))


def past_break(breaks: Array, keep: EachFlag, t0: Each) -> tuple[Each, EachFlag]:
    """`t0`, or just past the break that it stands before, and whether it stood before one."""
    if breaks.shape[0] == 0:
        return t0, jnp.zeros(jnp.shape(t0), bool)
    margin = 4 * _EPS * jnp.abs(breaks)
    here = keep & (jnp.abs(breaks - t0) <= 2 * margin) & (breaks > t0)
    found = jnp.any(here, axis=0)
    return jnp.where(found, jnp.max(jnp.where(here, breaks + margin, -jnp.inf), axis=0), t0), found


def on_grid(step: Each) -> Each:
    """The step size rounded down to a power of 2^(1/8).

    A step size computed from an error estimate carries rounding errors magnified by 1/rtol, and choosing the next step
    magnifies them again: two programs for the same solve (alone, or in a batch) would drift to different steps, and
    through the impacts to results that differ by the whole error of the solve. On a grid they take the same steps.
    """
    # Off the grid's own points by a hair: a step that is on the grid stays there whatever its last digits.
    return jnp.exp2(jnp.floor(8 * jnp.log2(step) + 1e-4) / 8)
