"""Gradients by the weights of a network in a friction law, beside plain diffrax: `python -m experiments.learning`
writes out/learning.md.

The scene is the slider-crank at 5000 rpm over 6 ms, with a contact law of Hunt and Crossley in the wrist. Its damping
gives an impact at 1 m/s the restitution of the scene's own law. The own law would put plain diffrax at a disadvantage:
an ordinary solver steps over a short part of an impact, even at tight tolerances. The coefficient of friction is a tanh
network of the slip. The loss is the mean square of the slider's velocity at 10 instants. A second scene has a quarter
of the damping. There impacts amplify errors more.

Every method gives the loss and its gradient by all weights. "Adjoint" and "controlled" are `cj.simulate` with these
`derivatives`, by dopri8 at every tolerance. "Plain" means equations of motion that share no code with the library,
integrated by `diffrax.diffeqsolve` with a `PIDController` of the same `rtol` and a `RecursiveCheckpointAdjoint`. They
cap the penetration and its rate at values that only rejected steps reach: without this cap some rejected steps
overflow, and the gradient is NaN.

The error of a gradient is that of its derivatives along 5 random directions of the weights: the largest difference from
the known derivatives, divided by the largest of these. The known derivatives are central differences of the library's
loss at an `rtol` of 1e-13, extrapolated by Richardson's formula. They use no code that differentiates. Their own error
is estimated by the same formula with twice the steps.

The same loss is also differentiated by numbers that are no weights, with the scene's own laws: parameters, and via
points of the drive, 22 angles of the crank.

Then a network is trained: adam finds the weights for which the slider moves as with a known coefficient of friction,
which falls with the slip. The loss is the mean square of what the slider's velocities at 100 instants are off. The
library's adjoint and both plain methods go the same way from the same start. The error of the coefficient is the
largest relative one over the slips in contact, without the slowest and the fastest twentieth of them.

All programs of a network run alternately in one process, and the shortest of several runs counts. Compilation, with
tracing, is timed once without a cache.
"""

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common import output, table
from experiments.forward_dynamics import compiled_anew
from experiments.learning import numbers, training
from experiments.learning.models import MASS, SOLVERS, SPEED, factor, loss_of, network, ours, plain, restitution
from experiments.publish import command, say

WIDTHS = (2, 5, 15, 30, 96)
"""Of the two hidden layers: from 15 to 9697 weights."""
LADDER_WIDTH, LESS = 15, 0.25
"""The network with errors over the tolerance, and the part of the damping in a scene whose impacts amplify more."""
METHODS = ("adjoint", "controlled", *SOLVERS)
NAMES = ("adjoint", "controlled", *(f"plain, {solver}" for solver in SOLVERS))
RTOL, CLOSE, TIGHTEST = 1e-6, 1e-12, 1e-13
RTOLS = tuple(10.0**-k for k in range(5, 11))
LADDER = RTOLS[:4]
MOST_CONTROLLED = 1100
"""Weights up to which controlled derivatives are measured."""
DIRECTIONS, STEP = 5, 0.02
"""Random directions, and the step of the differences, relative to the size of the weights."""
ROUNDS, ENOUGH = 7, 6.0
"""Runs of each program; one that has taken so many seconds is not run again."""

# What is required.
AGREE, MOST_ERROR, MOST_VALUES, MOST_OF_POINTS, LEARNED = 1e-8, 3e-4, 8.0, 12.0, 0.05
"""Relative difference of the two models, error of the adjoint at `RTOL`, its time in values, for via points the time of
any derivatives, and the error of a learned coefficient.
"""


class Key(NamedTuple):
    """A method, its tolerance, and the damping factor."""

    method: str
    rtol: float
    damping: float


class Run(NamedTuple):
    """The shortest time [s], accepted steps, and the error of the gradient (NaN: of the value alone)."""

    seconds: float
    steps: int
    error: float


class Row(NamedTuple):
    """A network: its weights, by damping the error of the known derivatives, the difference of the two models, the
    seconds in which programs are compiled, and all runs.
    """

    weights: int
    known: dict[float, float]
    difference: float
    compiled: dict[str, float]
    runs: dict[Key, Run]

    def at(self, method: str, rtol: float = RTOL) -> Run | None:
        return self.runs.get(Key(method, rtol, factor()))

    def run(self, method: str) -> Run:
        """One that there is for every network."""
        return self.runs[Key(method, RTOL, factor())]

    @property
    def ratio(self) -> float:
        """The adjoint's time in values."""
        return self.run("adjoint").seconds / self.run("value").seconds

    def as_good(self, solver: str) -> tuple[float, Run] | None:
        """Plain diffrax at the loosest tolerance at which its error is no larger than the adjoint's."""
        most = self.run("adjoint").error
        tolerances = sorted((k.rtol for k in self.runs if k.method == solver and k.damping == factor()), reverse=True)
        tried = [(rtol, self.runs[Key(solver, rtol, factor())]) for rtol in tolerances]
        return next(((rtol, run) for rtol, run in tried if run.error <= most), None)


def off(known: np.ndarray, found: np.ndarray) -> float:
    return float(np.max(np.abs(found - known)) / np.max(np.abs(known)))


def derivatives_along(directions: np.ndarray, weights: Any, value: Callable) -> tuple[np.ndarray, float]:
    """Along each direction the derivative by extrapolated differences, and an estimate of their error."""

    def differences(step):
        ends = [[float(value(weights + s * d)) for s in (step, -step)] for d in directions]
        return np.array([(up - down) / (2 * step) for up, down in ends])

    coarse, middle, fine = (differences(STEP / k) for k in (1, 2, 4))
    known = (4 * fine - middle) / 3
    return known, off(known, (4 * middle - coarse) / 3)


def compiled_programs(losses: dict[str, Callable], weights: Any) -> tuple[dict[str, Any], dict[str, float]]:
    """The value and the gradients, ready to run, and the time that each took to trace and compile [s]."""
    programs = {"value": jax.jit(losses["adjoint"])}
    programs |= {name: jax.jit(jax.value_and_grad(loss, has_aux=True)) for name, loss in losses.items()}
    ready, took = {}, {}
    for name, program in programs.items():
        clock = time.perf_counter()
        lowered = program.lower(weights, RTOL, factor())
        traced = time.perf_counter() - clock
        ready[name], compiling = compiled_anew(lowered)
        took[name] = traced + compiling
    return ready, took


def timed(calls: dict[Key, Callable], rounds: int) -> dict[Key, float]:
    """The shortest time of each call, all in turn; those that have taken long are not run again."""
    times = {key: [] for key in calls}
    for _ in range(rounds):
        for key, call in calls.items():
            if sum(times[key]) < ENOUGH:
                clock = time.perf_counter()
                jax.block_until_ready(call())
                times[key].append(time.perf_counter() - clock)
    return {key: min(found) for key, found in times.items()}


def measured(width: int, quick: bool) -> Row:
    """All methods by the weights of one network."""
    weights, made = network(width)
    solves = {"adjoint": ours("adjoint"), "controlled": ours("controlled"), **{name: plain(name) for name in SOLVERS}}
    if weights.size > MOST_CONTROLLED:
        del solves["controlled"]
    losses = {name: loss_of(solve, made) for name, solve in solves.items()}
    ready, compiled = compiled_programs(losses, weights)
    keys = [Key(name, RTOL, factor()) for name in ready]
    keys += [Key(name, rtol, factor()) for name in SOLVERS for rtol in (() if quick else RTOLS) if rtol != RTOL]
    if width == LADDER_WIDTH or quick:
        keys += [Key("adjoint", rtol, factor()) for rtol in LADDER if rtol != RTOL]
        keys += [Key(name, rtol, LESS * factor()) for name in ("adjoint", *SOLVERS) for rtol in LADDER]
    rng = np.random.default_rng(width)
    directions = rng.normal(size=(DIRECTIONS, weights.size)) * float(jnp.sqrt(jnp.mean(weights**2)))
    known, doubt, runs = {}, {}, {}
    for damping in {key.damping: None for key in keys}:
        value = lambda weights, damping=damping: ready["value"](weights, TIGHTEST, damping)[0]  # noqa: E731
        known[damping], doubt[damping] = derivatives_along(directions, weights, value)
    calls = {key: lambda key=key: ready[key.method](weights, key.rtol, key.damping) for key in keys}
    for key, took in timed(calls, 1 if quick else ROUNDS).items():
        answer = calls[key]()
        value, slopes = (answer, None) if key.method == "value" else answer
        error = np.nan if slopes is None else off(known[key.damping], directions @ np.asarray(slopes))
        runs[key] = Run(took, int(value[1][1]), error)
    end, other = ready["value"](weights, TIGHTEST, factor())[1][0], ready["dopri8"](weights, CLOSE, factor())[0][1][0]
    return Row(weights.size, doubt, off(np.asarray(end), np.asarray(other)), compiled, runs)


class Other(NamedTuple):
    """A question about other numbers: its title, their count, the error of the known derivatives, and all runs."""

    title: str
    count: int
    known: float
    runs: dict[Key, Run]

    def run(self, method: str) -> Run:
        return self.runs[Key(method, RTOL, 0.0)]

    def ratio(self, method: str) -> float:
        """The time of a method in values."""
        return self.run(method).seconds / self.run("value").seconds


def other(title: str, quick: bool) -> Other:
    """Both methods by other numbers than weights."""
    loss, at, size = numbers.questions()[title]
    ready, _ = compiled_programs({name: loss(name) for name in METHODS[:2]}, at)
    directions = np.random.default_rng(at.size).normal(size=(DIRECTIONS, at.size)) * size
    known, doubt = derivatives_along(directions, at, lambda x: ready["value"](x, TIGHTEST, 0.0)[0])
    calls = {Key(name, RTOL, 0.0): lambda name=name: ready[name](at, RTOL, 0.0) for name in ready}
    runs = {}
    for key, took in timed(calls, 1 if quick else ROUNDS).items():
        answer = calls[key]()
        value, slopes = (answer, None) if key.method == "value" else answer
        runs[key] = Run(took, int(value[1][1]), np.nan if slopes is None else off(known, directions @ slopes))
    return Other(title, at.size, doubt, runs)


# Shown ---------------------------------------------------------------------------------------------------------------


def broken(rows: list[Row]) -> list[str]:
    """What is required and not held."""
    out = []
    for row in rows:
        which, error = f"{row.weights} weights: ", row.run("adjoint").error
        if not row.difference <= AGREE:
            out.append(which + f"the two models differ by {row.difference:.1e}, more than {AGREE:.0e}")
        if not error <= MOST_ERROR:
            out.append(which + f"the adjoint's error is {error:.1e}, more than {MOST_ERROR:.0e}")
        if not row.ratio <= MOST_VALUES:
            out.append(which + f"the adjoint takes {row.ratio:.1f} values, more than {MOST_VALUES:g}")
        for solver in SOLVERS:
            good = row.as_good(solver)
            if good and not good[1].seconds >= row.run("adjoint").seconds:
                out.append(which + f"plain diffrax by {solver} is as accurate in less time")
        for damping, known in row.known.items():
            errors = [run.error for rtol in LADDER if (run := row.runs.get(Key("adjoint", rtol, damping)))]
            # Below the error of what is known nothing can be seen.
            if not all(after < max(before, known) for before, after in pairwise(errors)):
                out.append(which + f"with a damping of {damping:.2f} s/m the adjoint's error does not fall with rtol")
    return out


def broken_by(row: Other) -> list[str]:
    """The same for other numbers."""
    out = [
        f"{row.title}: the error of {method} derivatives is {row.run(method).error:.1e}, more than {MOST_ERROR:.0e}"
        for method in METHODS[:2]
        if not row.run(method).error <= MOST_ERROR
    ]
    if "via" in row.title:
        slow = [method for method in METHODS[:2] if not row.ratio(method) <= MOST_OF_POINTS]
        out += [f"{row.title}: {method} derivatives take {row.ratio(method):.1f} values" for method in slow]
    return out


def cell(run: Run | None, of: str, form: str, scale: int = 1) -> str:
    return "" if run is None else format(getattr(run, of) * scale, form)


def page(part: str, text: str, head: tuple, lines: list, quick: bool) -> None:
    """A table, and what it is about."""
    say(text)
    table(head, lines, output(f"learning{part}{'_quick' if quick else ''}.md"))


def show(rows: list[Row], quick: bool) -> None:
    """All tables of networks."""
    heads = "weights", "value", *NAMES, "adjoint, in values"
    lines = [
        (row.weights, *(cell(row.at(m), "seconds", ".3g", 1e3) for m in ("value", *METHODS)), f"{row.ratio:.1f}")
        for row in rows
    ]
    page("", f"Time of a value, and of a value with its gradient, at rtol {RTOL:.0e} [ms].", heads, lines, quick)
    lines = [(row.weights, *(cell(row.at(m), "steps", "d") for m in ("value", *METHODS))) for row in rows]
    page("_steps", f"Accepted steps at rtol {RTOL:.0e}.", heads[:-1], lines, quick)
    lines = [
        (
            row.weights,
            *(cell(row.at(m), "error", ".1e") for m in METHODS),
            f"{row.known[factor()]:.0e}",
            f"{row.difference:.0e}",
        )
        for row in rows
    ]
    text = f"Error of the gradient at rtol {RTOL:.0e}, of the known derivatives, and difference of the two models."
    page("_errors", text, ("weights", *NAMES, "known", "models"), lines, quick)
    lines = [line for row in rows for line in equals(row)]
    heads = "weights", "adjoint, error", "adjoint, ms", "plain", "rtol", "error", "ms", "plain / adjoint"
    text = "Plain diffrax at the loosest rtol at which its error is no larger than the adjoint's."
    page("_equal", text, heads, lines, quick)
    lines = [line for row in rows if len(row.known) > 1 for line in ladder(row)]
    heads = "weights", "damping [s/m]", "rtol", "adjoint", *NAMES[2:], "known"
    page("_ladder", "Error of the gradient over the tolerance, and with less damping.", heads, lines, quick)
    every = "value", *METHODS
    lines = [(r.weights, *(f"{r.compiled[m]:.1f}" if m in r.compiled else "" for m in every)) for r in rows]
    page("_compiled", "Compilation, with tracing [s].", ("weights", "value", *NAMES), lines, quick)


def show_others(rows: list[Other], quick: bool) -> None:
    """The table of other numbers."""
    heads = "numbers", "value", *(f"{m}{x}" for m in METHODS[:2] for x in ("", ", in values", ", steps", ", error"))
    lines = []
    for row in rows:
        cells = [f"{row.run('value').seconds * 1e3:.3g}"]
        for method in METHODS[:2]:
            run = row.run(method)
            cells += [f"{run.seconds * 1e3:.3g}", f"{row.ratio(method):.1f}", f"{run.steps}", f"{run.error:.1e}"]
        lines.append((row.title, *cells, f"{row.known:.0e}"))
    text = f"Time of a value, and of a value with its gradient by other numbers, at rtol {RTOL:.0e} [ms]."
    page("_others", text, (*heads, "known"), lines, quick)


def show_trained(results: dict[str, training.Trained], quick: bool) -> list[str]:
    """The table of the training, and what does not hold."""
    lines, steps = [], len(next(iter(results.values())).losses)
    for name, result in results.items():
        there = result.reached()
        each = f"{result.seconds[-1] / steps * 1e3:.3g}"
        lines.append(
            (name, each, f"{result.losses[-1]:.1e}", "" if there is None else f"{there:.2f}", f"{result.error:.1%}")
        )
    heads = "method", "a step [ms]", "loss", f"at {training.GOAL:.0e} after [s]", "error of the coefficient"
    text = f"Training of {training.network(training.WIDTH)[0].size} weights, {steps} steps; the loss over the first."
    page("_training", text, heads, lines, quick)
    out = [f"{n}: the coefficient is off by {r.error:.1%}" for n, r in results.items() if not r.error <= LEARNED]
    adjoint, *others = (result.reached() or np.inf for result in results.values())
    return out + ["the adjoint is not the first at the goal"] * (not adjoint < min(others))


def equals(row: Row) -> list[tuple]:
    """Lines of plain diffrax at an error as small as the adjoint's."""
    adjoint, lines = row.run("adjoint"), []
    for solver in SOLVERS:
        good = row.as_good(solver)
        shown = "none", "", "", ""
        if good:
            rtol, run = good
            shown = (
                f"{rtol:.0e}",
                f"{run.error:.1e}",
                f"{run.seconds * 1e3:.3g}",
                f"{run.seconds / adjoint.seconds:.1f}",
            )
        lines.append((row.weights, f"{adjoint.error:.1e}", f"{adjoint.seconds * 1e3:.3g}", solver, *shown))
    return lines


def ladder(row: Row) -> list[tuple]:
    """Lines of errors over the tolerance, by damping."""
    lines = []
    for damping, known in row.known.items():
        for rtol in LADDER:
            errors = (cell(row.runs.get(Key(m, rtol, damping)), "error", ".1e") for m in ("adjoint", *SOLVERS))
            lines.append((row.weights, f"{damping:.2f}", f"{rtol:.0e}", *errors, f"{known:.0e}"))
    return lines


def main(quick: bool = False) -> list[Row]:
    say(f"Impact at {SPEED:g} m/s of {MASS:g} kg: restitution {restitution():.2f}, damping factor {factor():.2f} s/m.")
    rows = []
    for width in WIDTHS[:1] if quick else WIDTHS:
        rows.append(measured(width, quick))
        print(rows[-1], flush=True)
    show(rows, quick)
    others = [other(title, quick) for title in list(numbers.questions())[:: 3 if quick else 1]]
    show_others(others, quick)
    missed = broken(rows) + [text for row in others for text in broken_by(row)]
    learned = show_trained(training.all_trained(quick), quick)
    missed += [] if quick else learned
    limits = f"models within {AGREE:.0e}; adjoint at rtol {RTOL:.0e} within {MOST_ERROR:.0e} and {MOST_VALUES:g} values"
    verdict = [f"NOT HELD: {text}." for text in missed] or ["All hold."]
    limits += ", its error falling with rtol; no slower than plain diffrax at equal error"
    limits += (
        f"; via points within {MOST_OF_POINTS:g} values; a learned coefficient within {LEARNED:.0%}, soonest by it"
    )
    say(f"Required: {limits}.", *verdict)
    for row in rows:
        less = row.runs.get(Key("adjoint", RTOL, LESS * factor()))
        if less and not less.error <= MOST_ERROR:
            say(f"With a quarter of the damping, for which this is not required, the error is {less.error:.1e}.")
    return rows


if __name__ == "__main__":
    command(main, __doc__, "one small network, one run of each program")
