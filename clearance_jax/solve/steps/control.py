"""Decision after a try of a step: whether it is good enough, where it must be cut, how long the next one is.

Why steps are cut: an error estimate samples the force at a few points of a step. A contact that begins and ends between
them is missed, whatever the tolerance. Here the relative motion of each clearance joint is interpolated along the step,
the laws' event functions are evaluated along it, and a step across a change is cut there. So every touch, separation
and change of formula, and every break of a drive, is the end of a step.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Each, EachFlag
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import component_axis, each_lane, least, sum_components
from clearance_jax.mechanism._base import breaks_near
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.steps.events import curves, first_event
from clearance_jax.solve.steps.problem import Problem, motion
from clearance_jax.solve.steps.step import Trial
from clearance_jax.solve.steps.tolerances import Tolerances

_EPS = float(np.finfo(np.float64).eps)
# The impacts to come amplify the motion's errors, so these are kept at a tenth of rtol in each step. A derivative grows
# through the same impacts, but its relative error does not: it may be 1 / LENIENCE times larger. A method of high order
# takes few more steps for a smaller error, so REFINED reduces that factor for each order above PLAIN_ORDER.
LENIENCE, PLAIN_ORDER, REFINED = 0.02, 5.0, 5.0 ** (1 / 3)
# The target step size, over the one at which the error would just be allowed; how much it may change at once.
SAFETY, SHRINK, GROW = 0.85, 0.2, 3.0
# Past an event that made a step inaccurate the motion goes on with this part of it: a contact's force rises as a power
# of the depth, so that the first steps there must be short, and their errors are estimated too small. A step whose
# error is SPOILED times the allowed one does not converge any more, and the place of its event is noise.
RESTART, SPOILED = 0.07, 1e5
# If a cut step has not left its event behind, the next goes FURTHER times as far past it, up to FURTHEST.
FURTHER, FURTHEST = 4.0, 4.0**24
# A cut within this part of a step from its start, right after a cut step, is at the same event: the round-off of a
# place may hide an event for longer than that of the time.
NEAR = 0.1
# A step of so many units of round-off of the time is as short as what hides an event; derivatives may err by so many
# times as much in it.
BRIEF, ROOM = 64.0, 100.0


class Control(NamedTuple):
    """Memory from try to try: the step size after the cut (`natural`; 0: not cut), a factor on how far past an event
    a cut step ends (`reach`), because shorter cuts have not left the event behind, whether the last kept step had been
    cut, and how many tries were rejected because they crossed an event (`cuts`).
    """

    natural: Array
    reach: Array
    after_cut: EachFlag
    cuts: Array

    @staticmethod
    def begin(time: Each) -> "Control":
        """Before the first try."""
        shape = jnp.shape(time)
        return Control(jnp.zeros(shape), jnp.ones(shape), jnp.zeros(shape, bool), jnp.zeros(shape, int))


class Verdict(NamedTuple):
    """A try's error over the allowed one; whether an event cuts it; time past that, how far past, and next size [s]."""

    error: Each
    cut: EachFlag
    at: Each
    pad: Each
    natural: Each


class Decision(NamedTuple):
    """Whether to keep a try; start and end of the next; is a break just before; the memory; does the solve end here."""

    keep: EachFlag
    start: Each
    end: Each
    past_break: EachFlag
    control: Control
    collapsed: EachFlag


class Means(NamedTuple):
    """Criteria for tries: tolerances, whether to locate events, the error's order, the observers' longest step [s]."""

    allowed: Tolerances
    locate_events: bool
    order: float
    longest: Any = None


def judge(problem: Problem, trial: Trial, times: tuple, means: Means, control: Control) -> Verdict:
    """The verdict on a try."""
    t0, t1 = times
    error, unremembered, of_motion = scaled_error(problem, trial, means, t1)
    if not (means.locate_events and problem.mechanism.contacts()):
        return Verdict(error, jnp.zeros(jnp.shape(t1), bool), t1, jnp.zeros_like(t1), t1 - t0)
    ends = tuple(motion(problem, x) for x in (trial.start, trial.end, trial.slope0, trial.slope1))
    joint_curves, misfit = curves(times, ends, problem.mechanism)
    # Round-off is no misfit: in free flight, where it would be all the error there is, it would choose the next step.
    off = jnp.maximum(misfit - means.allowed.noise, 0.0) / means.allowed.fit
    off = jnp.where(jnp.isfinite(off), off, jnp.inf)
    error, unremembered, of_motion = (jnp.maximum(each, off) for each in (error, unremembered, of_motion))
    # Past an event by enough for round-off not to hide it, by too little for the kink to matter.
    h, known = t1 - t0, of_motion <= 1
    natural = jnp.where(control.natural > 0, control.natural, jnp.where(known, h, RESTART * h))
    pad = jnp.maximum(4 * _EPS * jnp.abs(t1), means.allowed.margin * natural)
    pad = pad * control.reach
    if problem.varies:
        # Round-off may have put a touch just behind a cut that should have passed it. A step across it, however short,
        # changes derivatives by what their slope jumps. A motion's may err by ROOM times as much there: beyond, its
        # digits are lost. A memory's grows from nothing, by more than is allowed beside a motion's that loops or other
        # impacts have made large; beside what it becomes in the contact this is nothing.
        excused = jnp.maximum(of_motion, unremembered / ROOM)
        error = jnp.where(h <= BRIEF * _EPS * jnp.abs(t1), excused, error)
    crossed, s = first_event(joint_curves, ends[1], problem.mechanism, jnp.minimum(pad / h, 0.5))
    at = t0 + s * h + pad
    # The event is located even if the derivatives are not accurate, whose slope jumps there: shrinking the step towards
    # the jump would end at a step of a round-off. If the motion is not accurate either, that is nearly always the
    # event's fault. Its place is then good enough to end the next try, which is judged anew; but that must be shorter.
    last = jnp.where(known, t1 - pad, jnp.where(of_motion <= SPOILED, t0 + SAFETY * h, t0))
    return Verdict(error, crossed & (at < last), at, pad, natural)


def scaled_error(problem: Problem, trial: Trial, means: Means, time: Each) -> tuple[Each, Each, Each]:
    """The error of a step over the allowed one: of motion and derivatives, without those of memories, of the motion.

    A derivative's error counts relative to the derivative itself (impacts make it grow by orders of magnitude) from the
    size `floor` on. The laws' memory is compared separately: its derivatives would hide the others.
    """
    y0, y1, error, axis = trial.start, trial.end, trial.error, component_axis(time)
    allowed = means.allowed
    controlled = jnp.isfinite(allowed.absolute)
    scale = jnp.where(controlled, allowed.absolute, 1.0)

    def rms(x, which=controlled):
        wanted = jnp.where(jnp.broadcast_to(which, x.shape), x, 0.0)
        return jnp.sqrt(sum_components(wanted * wanted, time) / jnp.maximum(jnp.sum(which, axis=axis), 1))

    size = jnp.maximum(jnp.abs(motion(problem, y0)), jnp.abs(motion(problem, y1)))
    of_motion = rms(motion(problem, error) / (scale + allowed.relative * size))
    errors = [of_motion]
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
        columns = allowed.floor
        # The weight of the derivatives' errors beside the motion's.
        lenience = LENIENCE * REFINED ** max(means.order - PLAIN_ORDER, 0.0)
        for kind in kinds:
            columns += jnp.maximum(rms(begin, kind), rms(end, kind))
            # Shared: the reduction that follows goes through them lane by lane.
            worst = jnp.max(share(rms(off, kind) / columns), axis=0)
            errors.append(jnp.maximum(errors[-1], lenience * worst))
    fine = jnp.all(jnp.isfinite(y1), axis=tuple(range(y1.ndim - jnp.ndim(time)))) & jnp.isfinite(errors[-1])
    errors = [jnp.where(fine, each, jnp.inf) for each in errors]
    return errors[-1], errors[min(1, len(errors) - 1)], errors[0]


def next_step(problem: Problem, verdict: Verdict, times: tuple, means: Means, control: Control) -> Decision:
    """The decision after a verdict."""
    t0, t1 = times
    h, cut, error = t1 - t0, verdict.cut, verdict.error
    accurate = error < 1
    keep = share(accurate & ~cut)
    # A cut step says nothing about the step size (its tiny error is round-off): what may follow it is known.
    step = jnp.where(keep & (control.natural > 0), control.natural, h * factor(error, accurate, means.order))
    start = jnp.where(keep, t1, t0)
    end = jnp.where(cut, verdict.at, start + on_grid(step))
    stuck = cut & (verdict.at - t0 <= jnp.maximum(8 * verdict.pad, jnp.where(control.after_cut, NEAR * h, 0.0)))
    free = keep & (control.natural == 0)
    further = jnp.minimum(FURTHER * control.reach, FURTHEST)
    reach = jnp.where(stuck, further, jnp.where(free, 1.0, control.reach))
    # An inaccurate cut may have ended before its event: it is not shorter than what follows.
    after_cut = jnp.where(keep, control.natural >= h, control.after_cut)
    natural = jnp.where(cut, verdict.natural, jnp.where(keep | ~accurate, 0.0, control.natural))
    breaks = each_lane(breaks_near, t0)(problem.mechanism, start)
    start, past = past_break(breaks, keep, start)
    end = jnp.maximum(end, start + 2 * _EPS * jnp.abs(start))
    clipped = before_break(breaks, start, end)
    if means.longest is not None:
        clipped = jnp.minimum(clipped, start + means.longest)
    natural = jnp.where(clipped < end, jnp.maximum(natural, end - start), natural)
    collapsed = ~accurate & (h <= 3 * _EPS * jnp.abs(t1))
    return Decision(keep, start, clipped, past, Control(natural, reach, after_cut, control.cuts + cut), collapsed)


def factor(error: Each, accurate: EachFlag, order: float) -> Each:
    """Factor on the step size after an error (an integrating controller)."""
    wanted = SAFETY * jnp.exp(-jnp.log(jnp.maximum(error, 1e-30)) / order)
    return jnp.clip(wanted, jnp.where(accurate, 1.0, SHRINK), GROW)


def first_end(problem: Problem, t0: Each, t1: Each, y0: Array, means: Means) -> Each:
    """End of the first try, a ten thousandth of the state's own time: a small start costs little, misses no impact."""

    def first_step(problem, t0, t1, y0, means):
        first, unit = motion(problem, y0), means.allowed.unit
        places = first[problem.places]
        moved = problem.place_rates(first)
        pace = jnp.max(jnp.abs(moved) / (unit[problem.places] + jnp.abs(places)), initial=0.0)
        rate = jnp.maximum(pace, means.allowed.rate)
        # `fmin`: of a state that is no number too a try has an end, and so its step size can collapse.
        return jnp.fmin(1e-4 / jnp.maximum(rate, 1e-300), 1e-3 * (t1 - t0))

    step = each_lane(first_step, t0)(problem, t0, t1, y0, means)
    breaks = each_lane(breaks_near, t0)(problem.mechanism, t0)
    return before_break(breaks, t0, t0 + on_grid(step))


def before_break(breaks: Array, t0: Each, t1: Each) -> Each:
    """`t1`, or the time just before the next break if that comes first."""
    if breaks.shape[0] == 0:
        return t1
    margin = 4 * _EPS * jnp.abs(breaks)
    return jnp.minimum(t1, least(jnp.where(breaks - 2 * margin > t0, breaks - margin, jnp.inf)))


def past_break(breaks: Array, keep: EachFlag, t0: Each) -> tuple[Each, EachFlag]:
    """`t0`, or the time just past the break right ahead of it, and whether there is such a break."""
    if breaks.shape[0] == 0:
        return t0, jnp.zeros(jnp.shape(t0), bool)
    margin = 4 * _EPS * jnp.abs(breaks)
    here = keep & (jnp.abs(breaks - t0) <= 2 * margin) & (breaks > t0)
    past = -least(jnp.where(here, -breaks - margin, jnp.inf))
    at_break = past > -jnp.inf
    return jnp.where(at_break, past, t0), at_break


def on_grid(step: Each) -> Each:
    """The step size rounded down to a power of 2^(1/8).

    A step size from an error estimate has rounding errors magnified by 1/rtol, and the next choice magnifies them
    again. So two programs for one solve (alone, or in a batch) would take different steps, and through the impacts
    their results would differ by the whole error of the solve. On a grid they take the same steps.
    """
    # A little off the grid's own points: a step on the grid stays there whatever its last digits.
    return jnp.exp2(jnp.floor(8 * jnp.log2(step) + 1e-4) / 8)
