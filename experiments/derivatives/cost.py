"""The time of a value with its Jacobian, divided by the time of the value alone, for a single solve and for a batch of
256 lanes (motions): `python -m experiments.derivatives cost` writes out/derivatives_cost.md.

The tolerance is the loosest at which, in the ladder, every column's error is below 1e-6. Each set-up is measured in a
process of its own, as `clearance_jax.configure` sets JAX up. Programs are timed alternately, and the shortest of
several runs counts. So other work of the machine affects both equally. Compilation is timed at the first call, without
the cache of compiled programs.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from experiments.common import output, table
from experiments.derivatives.ladder import NAMES, REVOLUTION, Rung, crank

ERROR = 1e-6
COUNTS = (3, 8, 32)
LANES = 256
CLEARANCES = (3.5e-4, 6.5e-4)
WEAK, LENGTH = 1.0, 0.1
"""Stiffness [N/m] and damping [N s/m], and length [m], of springs that the slider hardly feels."""
LIMITS = {"batch": (5.0, 9.0, 25.0), "single": (4.0, 7.0, 16.0)}
"""Most time of value and Jacobian over that of the value, for 3, 8 and 32 numbers."""
COMPILE_RATIO, COMPILE_SECONDS = 2.0, 15.0
REPEATS = {"batch": 2, "single": 7}
DEFAULT = {"tsit5": 1e-7, "dopri8": 1e-7}


class Cost(NamedTuple):
    """One set-up: seconds of the value and of value and Jacobian, of their compilations, and their attempted steps
    (in a batch those of the slowest lane, for which all others wait).
    """

    setup: str
    solver: str
    rtol: float
    numbers: int
    value: float
    both: float
    steps: int
    steps_both: int
    compile_value: float
    compile_both: float

    @property
    def ratio(self) -> float:
        return self.both / self.value

    @property
    def per_step(self) -> float:
        return self.ratio * self.steps / self.steps_both


def tolerances(rungs: Sequence[Rung]) -> dict[str, float]:
    """Per solver the loosest rtol from which on every column of ours is below `ERROR`, at both clearances."""
    out = dict(DEFAULT)
    for solver in out:
        mine = [r for r in rungs if r.tool == f"ours, {solver}"]
        enough = []
        for rtol in sorted({r.rtol for r in mine}):
            if max(r.worst for r in mine if r.rtol == rtol) > ERROR:
                break
            enough.append(rtol)
        out[solver] = max(enough, default=out[solver])
    return out


def numbers(count: int) -> tuple[cj.Mechanism, list[str]]:
    """The slider-crank and `count` of its numbers: those of the ladder first, then whatever else acts on the motion;
    where these are too few, weak springs on the slider bring more.
    """
    mechanism = crank()
    if count > len(acting(mechanism)):
        springs = [
            cj.Spring(
                f"spring{i}",
                "ground",
                "slider",
                WEAK,
                WEAK,
                LENGTH,
                cj.Position(LENGTH, i * LENGTH),
                cj.Position(0.0, 0.0),
            )
            for i in (1, 2, 3)
        ]
        mechanism = cj.Mechanism(mechanism.bodies, mechanism.joints, mechanism.loops, tuple(springs), mechanism.points)
    return mechanism, acting(mechanism)[:count]


def acting(mechanism: cj.Mechanism) -> list[str]:
    """Names of the numbers on which the motion depends: not those of the driven crank, of points, or first guesses."""
    names = [n for n in cj.parameters(mechanism) if not n.startswith(("crank.", "piston."))]
    return [*NAMES, *(n for n in names if not n.endswith((".position", ".velocity")) and n not in NAMES)]


def programs(solver: str, count: int, lanes: int) -> tuple[Callable, Callable, Any]:
    """Value, value and Jacobian (both compiled at the first call), and the numbers."""
    mechanism, names = numbers(count)
    known = cj.parameters(mechanism)

    def end(values, rtol):
        moved = cj.replace(mechanism, dict(zip(names, values, strict=True)))
        s = cj.simulate(moved, REVOLUTION, rtol=rtol, solver=solver, energy_balance=False, throw=False)
        return s.final, s.steps + s.rejected

    def both(values, rtol):
        def twice(values, rtol):
            final, steps = end(values, rtol)
            return final, (final, steps)

        slopes, (final, steps) = jax.jacfwd(twice, has_aux=True)(values, rtol)
        return (final, slopes), steps

    values = jnp.stack([jnp.asarray(known[name].value) for name in names])
    if lanes == 1:
        return jax.jit(end), jax.jit(both), values
    clearances = jnp.linspace(*CLEARANCES, lanes)
    values = jnp.broadcast_to(values, (lanes, count)).at[:, 0].set(clearances)
    batched = (0, None)
    return jax.jit(jax.vmap(end, batched)), jax.jit(jax.vmap(both, batched)), values


def clocked(run: Callable, *arguments) -> tuple[float, Any]:
    clock = time.perf_counter()
    result = jax.block_until_ready(run(*arguments))
    return time.perf_counter() - clock, result


def measure(setup: str, solver: str, rtol: float, count: int, lanes: int, repeats: int) -> Cost:
    """Both programs in turn; the first call of each compiles it."""
    end, both, values = programs(solver, count, lanes)
    arguments = values, jnp.asarray(rtol)
    first, (_, steps) = clocked(end, *arguments)
    first_both, (_, steps_both) = clocked(both, *arguments)
    times = np.array([[clocked(run, *arguments)[0] for run in (end, both)] for _ in range(repeats)]).min(0)
    attempts = int(np.max(steps)), int(np.max(steps_both))
    compiles = max(first - times[0], 0.0), max(first_both - times[1], 0.0)
    return Cost(setup, solver, rtol, count, float(times[0]), float(times[1]), *attempts, *compiles)


def in_process(setup: str, solver: str, rtol: float, count: int) -> Cost:
    """`measure` in a fresh process without a cache of compiled programs."""
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    task = json.dumps([setup, solver, rtol, count])
    command = [sys.executable, "-m", "experiments.derivatives", "--measure", task]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return Cost(*json.loads(answer.stdout.splitlines()[-1]))


def limits(cost: Cost) -> str:
    """Whether the required ratios hold."""
    most = LIMITS[cost.setup][COUNTS.index(cost.numbers)]
    held = "yes" if cost.ratio <= most else "NO"
    quick = cost.compile_both <= min(COMPILE_SECONDS, COMPILE_RATIO * cost.compile_value)
    return f"<= {most:g}: {held}; compiling: {'yes' if quick else 'NO'}"


def main(quick: bool = False, rtols: dict[str, float] | None = None) -> list[Cost]:
    rtols = rtols or DEFAULT
    if quick:
        costs = [measure("single", "tsit5", 1e-5, COUNTS[0], 1, 1)]
    else:
        costs = []
        for setup in LIMITS:
            for solver, rtol in rtols.items():
                for count in COUNTS:
                    costs.append(in_process(setup, solver, rtol, count))
                    print(costs[-1], flush=True)
    table(
        (
            "set-up",
            "solver",
            "rtol",
            "numbers",
            "value, ms a lane",
            "time ratio",
            "step ratio",
            "time per step ratio",
            "compile value, s",
            "compile both, s",
            "within limits",
        ),
        [
            (
                c.setup,
                c.solver,
                f"{c.rtol:.0e}",
                c.numbers,
                f"{c.value * 1e3 / (LANES if c.setup == 'batch' else 1):.2f}",
                f"{c.ratio:.1f}",
                f"{c.steps_both / c.steps:.2f}",
                f"{c.per_step:.1f}",
                f"{c.compile_value:.1f}",
                f"{c.compile_both:.1f}",
                limits(c),
            )
            for c in costs
        ],
        output(f"derivatives_cost{'_quick' if quick else ''}.md"),
    )
    return costs


def measured(task: str) -> str:
    """What `in_process` asks of the fresh process."""
    setup, *rest = json.loads(task)
    cj.configure()
    return json.dumps(measure(setup, *rest, LANES if setup == "batch" else 1, REPEATS[setup]))
