"""How a solve steps: an explicit Runge-Kutta step that hands the controller both end slopes, and a step-size controller
that makes every switch of the contact laws and every break of a drive the end of a step.

Why: an error estimate samples the force at a few points of a step. A contact that begins and ends between them is not
sampled, so the step is accepted and the contact is lost; no tolerance repairs it. Here each candidate step is
interpolated (quintic for the gap, cubic for the slip), the laws' regimes are read along it, and a step across a change
is cut there.
"""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.equations import projected, signals
from clearance_jax.mechanism.mechanism import Mechanism, layout

_EPS = float(np.finfo(np.float64).eps)


class StepEnds(NamedTuple):
    """What a step tells the controller in place of a bare error estimate."""

    error: Array
    slope0: Array
    slope1: Array


class Stepper(diffrax.AbstractAdaptiveSolver):
    """One explicit Runge-Kutta step of a mechanism's flat state.

    The tableau is diffrax's. The stages are unrolled and the slopes kept as separate rows: XLA then keeps a whole stage
    in one kernel (measured 2 to 3 times faster than a loop over stages, single and batched). Around the step, laws
    with memory are latched at its start and ideal loops are projected at its end.
    """

    solver: Any
    term_structure: ClassVar = diffrax.AbstractTerm

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.interpolation_cls

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        return terms.vf(t0, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        mechanism: Mechanism = args
        tableau, h = self.solver.tableau, t1 - t0
        latched = latch(t0, y0, mechanism)
        if latched is not None or mechanism.closures():
            # The slope kept from the last step belongs to another memory, or to the state before its projection.
            y0 = y0 if latched is None else latched
            slope = terms.vf(t0, y0, args)
        elif made_jump is False:
            slope = solver_state
        else:
            slope = jax.lax.cond(made_jump, lambda: terms.vf(t0, y0, args), lambda: solver_state)
        slopes, y = [slope], y0
        for weights, node in zip(tableau.a_lower, tableau.c, strict=True):
            y = y0 + h * _weighted(weights, slopes)
            slopes.append(terms.vf(t1 if node == 1 else t0 + float(node) * h, y, args))
        y1 = y if tableau.ssal else y0 + h * _weighted(tableau.b_sol, slopes)
        last = slopes[-1] if tableau.fsal else terms.vf(t1, y1, args)
        error = StepEnds(h * _weighted(tableau.b_error, slopes), slopes[0], last)
        if mechanism.closures():
            y1 = projected(t1, y1, mechanism, mechanism.closures(), 1)
        dense = {"y0": y0, "y1": y1, "k": h * jnp.stack(slopes)}
        return y1, error, dense, last, diffrax.RESULTS.successful


def _weighted(weights, slopes) -> Array:
    terms = [float(w) * slope for w, slope in zip(weights, slopes, strict=False) if w != 0]
    return sum(terms[1:], terms[0])


def latch(time: Array, y: Array, mechanism: Mechanism) -> Array | None:
    """The state with every law's memory brought up to date; `None` where no law has one."""
    plan = layout(mechanism)
    if plan.remembered == 0:
        return None
    memory = plan.memory_of(y)
    parts = []
    for joint, signal in zip(mechanism.clearance_joints(), signals(time, y, mechanism), strict=True):
        if joint.clearance is not None and joint.clearance.remembers:
            parts.append(joint.clearance.latch(memory[joint.name], signal.overlap, signal.overlap_rate))
    start = 2 * plan.free
    return jnp.concatenate([y[:start], *parts, y[start + plan.remembered :]])


# The controller ----------------------------------------------------------------------------------------------------


class WatchState(NamedTuple):
    """State of the controller.

    The wrapped one's; the step size it would have taken had it not been cut (0: not cut); and how often in a row a cut
    has failed to get clear of its switch.
    """

    inner: Any
    natural: Array
    stalls: Array


class ContactController(diffrax.AbstractAdaptiveStepSizeController):
    """Wraps a PID controller; cuts steps at the switches of the contact laws and at the breaks of the drives.

    **Arguments:**

    - `scale`: per component of the state, the absolute tolerance; infinite where the component is not controlled.
    - `relative`: per component, the tolerance relative to its present size.
    - `breaks`: times at which a drive's derivatives jump.
    - `margin`: how far past a switch a cut step ends, as a fraction of the uncut step.
    - `watch`: whether to watch the contacts (off: a plain PID controller with break points).
    """

    scale: Array
    relative: Array
    breaks: Array
    margin: Array
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
            dt0 = self._first_step(t0, t1, y0, slope)
        end = self._before_break(t0, t0 + on_grid(dt0))
        _, inner = self.controller.init(terms, t0, t1, y0, end - t0, args, func, error_order)
        return end, WatchState(inner, jnp.zeros_like(end), jnp.zeros((), int))

    def _first_step(self, t0, t1, y0, slope):
        # A thousandth of the time in which the state changes by its own tolerance-free scale; the error control grows
        # it tenfold a step, so a small start costs little and an impact just after t0 is not jumped over.
        weight = self.scale / jnp.max(jnp.where(jnp.isfinite(self.scale), self.scale, 0.0))
        speed = jnp.max(jnp.where(jnp.isfinite(self.scale), jnp.abs(slope) / (weight + jnp.abs(y0)), 0.0))
        return jnp.minimum(1e-4 / jnp.maximum(speed, 1e-300), 1e-3 * (t1 - t0))

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        y1, h = y1_candidate, t1 - t0
        assert isinstance(y_error, StepEnds)  # this controller goes with `Stepper`
        size = jnp.maximum(jnp.abs(y0), jnp.abs(y1))
        controlled = jnp.isfinite(self.scale)
        ratio = jnp.where(
            controlled, y_error.error / (jnp.where(controlled, self.scale, 1.0) + self.relative * size), 0.0
        )
        scaled = jnp.sqrt(jnp.sum(ratio * ratio) / jnp.maximum(jnp.sum(controlled), 1))
        scaled = jnp.where(jnp.isfinite(scaled) & jnp.all(jnp.isfinite(y1)), scaled, jnp.inf)
        collapsed = (scaled > 1) & (h <= 8 * _EPS * jnp.abs(t1))
        accurate, _, proposal, _, inner, result = self.controller.adapt_step_size(
            t0, t1, jnp.zeros(()), jnp.zeros(()), args, scaled, error_order, controller_state.inner
        )
        if self.watch and args.clearance_joints():
            # Past a switch by enough for round-off not to hide it, by too little for the kink to matter; four times
            # more wherever that was not enough to get clear.
            pad = jnp.maximum(4 * _EPS * jnp.abs(t1), self.margin * jnp.maximum(h, controller_state.natural))
            pad = pad * 4.0 ** jnp.minimum(controller_state.stalls, 24)
            cut, at = first_switch(t0, t1, y0, y1, y_error, args, pad, self.points)
            cut = cut & accurate
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
        natural = jnp.where(clipped < next_t1, jnp.maximum(natural, next_t1 - next_t0), natural)
        result = diffrax.RESULTS.where(collapsed, diffrax.RESULTS.dt_min_reached, result)
        return keep, next_t0, clipped, made_jump, WatchState(inner, natural, stalls), result

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


class Samples(NamedTuple):
    """The watched signals of one joint along a step."""

    overlap: Array
    overlap_rate: Array
    slip_velocity: Array


def first_switch(t0, t1, y0, y1, ends: StepEnds, mechanism: Mechanism, pad, points: int):
    """Whether any law changes regime inside the step, and when to end the step so that it ends just past the change."""
    h = t1 - t0
    memory = layout(mechanism).memory_of(y1)
    curves = watched(t0, t1, y0, y1, ends, mechanism)
    joints = [j.clearance for j in mechanism.clearance_joints() if j.clearance is not None]
    memories = [memory[j.name] for j in mechanism.clearance_joints()]

    def regimes(s):
        return [
            joint.regime(*along(curve, h, s), kept) for joint, curve, kept in zip(joints, curves, memories, strict=True)
        ]

    # The regime at the start is read just after it: the start itself is the last switch.
    begin = jnp.minimum(pad / h, 0.5)
    grid = np.arange(1, points + 1) / points
    s = jnp.concatenate([begin[None], jnp.asarray(grid), *(extremum(curve, h, grid)[None] for curve in curves)])
    sampled = regimes(s)
    started = [regime[0] for regime in sampled]

    def changed(now):
        return jnp.any(jnp.stack([regime != start for regime, start in zip(now, started, strict=True)]), axis=0)

    # The first sample past a change; no sort (XLA then compiles the whole solve as one function, see `configure`).
    high = jnp.min(jnp.where(changed(sampled) & (s > begin), s, jnp.inf))
    found = high <= 1
    high = jnp.where(found, high, 1.0)
    low = jnp.maximum(begin, (jnp.ceil(high * points) - 1) / points)

    def wide(bracket):
        low, high = bracket
        return found & (high - low > 0.25 * begin)

    def halve(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        beyond = changed(regimes(middle))
        return jnp.where(beyond, low, middle), jnp.where(beyond, middle, high)

    _, high = jax.lax.while_loop(wide, halve, (low, high))
    at = t0 + high * h + pad
    return found & (at < t1 - pad), at


def watched(t0, t1, y0, y1, ends: StepEnds, mechanism: Mechanism):
    """Signals and their rates at both ends of a step, per joint."""
    here, here_rate = _signals_and_rates(t0, y0, ends.slope0, mechanism)
    there, there_rate = _signals_and_rates(t1, y1, ends.slope1, mechanism)
    return list(zip(here, here_rate, there, there_rate, strict=True))


@jax.jit
def _signals_and_rates(t, y, slope, mechanism):
    return jax.jvp(lambda t, y: signals(t, y, mechanism), (t, y), (jnp.ones_like(t), slope))


def along(curve, h, s) -> Samples:
    """The signals at fractions `s` of the step: quintic Hermite for the overlap, cubic for the slip."""
    a, a_rate, b, b_rate = curve
    p0, v0, c0 = a.overlap, a.overlap_rate * h, a_rate.overlap_rate * h * h
    p1, v1, c1 = b.overlap, b.overlap_rate * h, b_rate.overlap_rate * h * h
    d, e, f = p1 - p0 - v0 - 0.5 * c0, v1 - v0 - c0, c1 - c0
    k3, k4, k5 = 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f
    overlap = p0 + s * (v0 + s * (0.5 * c0 + s * (k3 + s * (k4 + s * k5))))
    rate = (v0 + s * (c0 + s * (3 * k3 + s * (4 * k4 + s * 5 * k5)))) / h
    q0, w0, q1, w1 = a.slip_velocity, a_rate.slip_velocity * h, b.slip_velocity, b_rate.slip_velocity * h
    d, e = q1 - q0 - w0, w1 - w0
    slip = q0 + s * (w0 + s * ((3 * d - e) + s * (e - 2 * d)))
    return Samples(overlap, rate, slip)


def extremum(curve, h, grid) -> Array:
    """The fraction of the step at which the gap comes closest to a change of sign (a graze begins and ends there)."""
    samples = along(curve, h, jnp.asarray(grid))
    apart = curve[0].overlap <= 0
    closeness = jnp.where(apart, samples.overlap, -samples.overlap)
    k = jnp.argmax(closeness)
    n = len(grid)
    # Secant on the rate over the neighbouring samples; where it has no root there the sample itself serves.
    low, high = jnp.maximum(k - 1, 0), jnp.minimum(k + 1, n - 1)
    ra, rb = samples.overlap_rate[low], samples.overlap_rate[high]
    sa, sb = jnp.asarray(grid)[low], jnp.asarray(grid)[high]
    crosses = ra * rb < 0
    s = jnp.where(crosses, sa - ra * (sb - sa) / jnp.where(crosses, rb - ra, 1.0), jnp.asarray(grid)[k])
    for _ in range(2):
        here = along(curve, h, s)
        step = 1e-4
        slope = (along(curve, h, s + step).overlap_rate - here.overlap_rate) / step
        moved = s - here.overlap_rate / jnp.where(slope != 0, slope, 1.0)
        s = jnp.where(crosses & (moved > sa) & (moved < sb), moved, s)
    return s
