"""Observers that find the last or the first time at which a signal falls below a bound."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.roots import bisect
from clearance_jax.solve.steps.interpolate import tops
from clearance_jax.solve.steps.observers import PIECES, AbstractObserver, PeakFinder, Picked

# Bisections for the entry in a part of a step: enough for the last digit.
HALVINGS = 50


class Entry(NamedTuple):
    """The entry found so far: whether there is one (`entered`), its `time` [s] and state `y`, and the signal's `slope`
    there [1/s] (infinite at a jump); `inside`: whether the signal is below the bound at the end of the last step.
    """

    entered: Array
    time: Array
    y: Array
    slope: Array
    inside: Array


class EntryFinder(AbstractObserver):
    """Finds the last time at which a signal falls below `bound`, or the `first` one after `since`. On each part of a
    step the signal is approximated by the cubic through values and slopes at the part's ends; its top shows whether the
    signal may be above the bound. Bisection of the signal itself then finds the time of the entry. Between two steps a
    signal may jump, as a drive's acceleration or a force at an event does.
    """

    signal: Any
    bound: Any
    span: Any = jnp.inf
    """Length of the motion [s]."""
    first: bool = eqx.field(static=True, default=False)
    since: Any = None
    """From when on entries count [s], of the first (`None`: from the start)."""

    longest = PeakFinder.longest

    def start(self, t0, y0, problem):
        # The first step begins as if the signal came from outside: an entry at the start is a settling time of zero.
        # But a first entry needs a signal that has been outside.
        return Entry(jnp.asarray(False), t0, y0, jnp.asarray(-jnp.inf), jnp.asarray(self.first))

    def __call__(self, record, step, problem):
        now, whole, bound = without_derivatives((step, problem, self.bound))
        start, width, rise = now.times[0], now.size, now.of_motion(whole).rise(self.signal, whole)
        t0, t1 = step.times

        def at(x):
            value, slope = rise(x)
            return value - bound, slope

        def along(x):
            return at(x)[0]

        begin = jnp.zeros(())
        if self.since is not None:
            begin = jnp.clip((without_derivatives(self.since) - start) / width, 0.0, 1.0)
        places = begin + (1 - begin) * jnp.linspace(0.0, 1.0, PIECES + 1)
        part = (1 - begin) / PIECES
        value, slope = jax.lax.map(at, places)
        top, _, _ = tops(value, slope, part)
        tallest = places[:-1] + part * top
        over = jax.lax.map(along, tallest) > 0
        # Parts that end below and are above somewhere: at the top or at the begin.
        enters = (over | (value[:-1] > 0)) & (value[1:] <= 0)
        here = jnp.argmax(enters) if self.first else PIECES - 1 - jnp.argmax(enters[::-1])
        # A jump at the start of the step precedes all entries inside it.
        jumps = ~record.inside & (value[0] <= 0)
        crosses = jnp.any(enters) & ~(jumps & self.first)
        low = jnp.where(over[here], tallest[here], places[here])

        # Most steps cross nothing.
        _, x = bisect(lambda x: along(x) > 0, low, places[here + 1], jnp.where(crosses, HALVINGS, 0))
        _, rate = at(x)
        x = jnp.where(crosses, x, 0.0)
        new = crosses | jumps
        if self.first:
            new &= ~record.entered
        return Entry(
            record.entered | new,
            jnp.where(new, t0 + x * step.size, record.time),
            jnp.where(new, step.curve(problem)(x)[0], record.y),
            jnp.where(new, jnp.where(crosses, rate / width, -jnp.inf), record.slope),
            (value[-1] <= 0) if self.since is None else (value[-1] <= 0) | (t1 <= self.since),
        )

    def finish(self, record):
        return record._replace(y=None), Picked(record.time[None], record.y[None], jnp.zeros(1))
