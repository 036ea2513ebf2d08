"""Batches: `python -m experiments.batches` writes out/batches.md.

The problem is a batch of slider-cranks with clearances from 0.1 to 0.5 mm, one revolution each, with Tsit5 at rtol
1e-7. A lane is one motion of a batch. Three programs are timed, per lane: a batch, a single solve, and a minimal loop.
The minimal loop has the same vector field and tableau, a textbook step-size controller, no contact event location, no
output, and the batch axis last. It shows what the other parts of the library cost. An attempt is one try of a step, six
evaluations of the vector field. All lanes of a batch run until the slowest one ends, so each lane has as many attempts
as the batch.

Everything is measured twice, each time in a process of its own: with the JAX settings of `clearance_jax.configure`, and
with the default settings of JAX.
"""

import json
import os
import subprocess
import sys
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax._compile.one_function import one_function
from clearance_jax.dynamics.field import slope
from clearance_jax.solve.first_state import initial_state
from experiments.common import CRANK_SPEED, output, seconds, slider_crank, table
from experiments.publish import command, say

RTOL = 1e-7
END = 2 * np.pi / CRANK_SPEED


class Run(NamedTuple):
    """One measured program: lanes, most attempts of a lane, and wall time per lane [s]."""

    program: str
    lanes: int
    attempts: int
    seconds: float


def with_clearance(clearance):
    return cj.replace(slider_crank(), {"wrist.radial_clearance": clearance})


def solved(clearance, samples=None):
    return cj.simulate(with_clearance(clearance), END, save_at=samples, rtol=RTOL, energy_balance=False)


@one_function
def minimal_loop(clearances):
    """Final states (4, lanes) and attempts of each lane, by the shortest adaptive Tsit5 that gives an answer."""
    tableau = diffrax.Tsit5().tableau
    mechanism = jax.vmap(lambda c: with_clearance(c).prepare())(clearances)
    field = jax.vmap(slope, (0, 1, 0), 1)
    start = jax.vmap(lambda m: initial_state(m, jnp.zeros(())), 0, 1)(mechanism)
    scale = RTOL * jnp.array([1.0, 0.1, CRANK_SPEED, 0.1 * CRANK_SPEED])[:, None]

    def attempt(carry):
        t, h, y, slope, attempts = carry
        going = t < END
        h = jnp.minimum(h, END - t)
        slopes, new = [slope], y
        for weights, node in zip(tableau.a_lower, tableau.c, strict=True):
            new = y + h[None] * sum(float(w) * k for w, k in zip(weights, slopes, strict=False) if w != 0)
            slopes.append(field(t + float(node) * h, new, mechanism))
        error = h[None] * sum(float(w) * k for w, k in zip(tableau.b_error, slopes, strict=True))
        size = jnp.sqrt(jnp.mean((error / (scale + RTOL * jnp.abs(y))) ** 2, axis=0))
        keep = going & (size <= 1)
        factor = jnp.clip(0.9 * jnp.maximum(size, 1e-10) ** -0.2, 0.2, 10.0)
        return (
            jnp.where(keep, t + h, t),
            jnp.where(going, h * factor, h),
            jnp.where(keep[None], new, y),
            jnp.where(keep[None], slopes[-1], slope),
            attempts + going,
        )

    t, h = jnp.zeros(clearances.shape), jnp.full(clearances.shape, 1e-7)
    first = (t, h, start, field(t, start, mechanism), jnp.zeros(clearances.shape, int))
    done = jax.lax.while_loop(lambda carry: jnp.any(carry[0] < END), attempt, first)
    return done[2], done[4]


def measure(quick: bool) -> list[Run]:
    """Batches of several sizes, a solve alone, and the minimal loop, in this process as it is set up."""
    repeats = 1 if quick else 3
    runs = []
    programs: dict[str, Any] = {
        "batch": jax.jit(jax.vmap(lambda c: (lambda s: (s.final, s.steps + s.rejected))(solved(c)))),
        "batch, 200 samples": jax.jit(jax.vmap(lambda c: (lambda s: (s.y, s.steps + s.rejected))(solved(c, 200)))),
        "minimal loop": jax.jit(minimal_loop),
    }
    for program, run in programs.items():
        for lanes in (4,) if quick else (1, 16, 64, 256):
            clearances = jnp.linspace(1e-4, 5e-4, lanes)
            _, attempts = run(clearances)
            took = seconds(lambda run=run, c=clearances: run(c), repeats)
            runs.append(Run(program, lanes, int(attempts.max()), took / lanes))
    alone = jax.jit(lambda c: (lambda s: (s.final, s.steps + s.rejected))(solved(c)))
    clearances = jnp.linspace(1e-4, 5e-4, 4 if quick else 16)
    attempts = np.mean([alone(c)[1] for c in clearances])
    took = np.mean([seconds(lambda c=c: alone(c), repeats) for c in clearances])
    runs.append(Run("alone (mean of 16)", 1, int(attempts), float(took)))
    return runs


def difference(lanes: int) -> float:
    """Largest difference between a batch and a loop of solves alone, in every state at 200 times, over its largest
    magnitude and over rtol.
    """
    clearances = jnp.linspace(1e-4, 5e-4, lanes)
    batch = np.asarray(jax.jit(jax.vmap(lambda c: solved(c, 200).y))(clearances))
    alone = jax.jit(lambda c: solved(c, 200).y)
    loop = np.stack([np.asarray(alone(c)) for c in clearances])
    return float(np.max(np.abs(batch - loop) / np.abs(loop).max((0, 1))) / RTOL)


def main(quick: bool = False) -> float:
    """Write the table; returns the difference between batch and loop in units of rtol."""
    runs = [("as configured", run) for run in measure(quick)]
    if not quick:
        environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"} | {"JAX_ENABLE_X64": "1"}
        command = [sys.executable, "-m", "experiments.batches", "--measure"]
        answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        runs += [("as JAX is", Run(*run)) for run in json.loads(answer.stdout.splitlines()[-1])]
    table(
        ("set-up", "program", "lanes", "attempts", "ms per lane", "us per lane and attempt"),
        [
            (setup, *run[:3], f"{run.seconds * 1e3:.2f}", f"{run.seconds / run.attempts * 1e6:.2f}")
            for setup, run in runs
        ],
        output(f"batches{'_quick' if quick else ''}.md"),
    )
    lanes = 4 if quick else 256
    apart = difference(lanes)
    say(f"{lanes} clearances, batch against loop: largest difference {apart:.2g} rtol")
    return apart


if __name__ == "__main__":
    if "--measure" in sys.argv:
        print(json.dumps(measure(False)))
    else:
        command(main, __doc__)
