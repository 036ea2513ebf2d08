"""The tools a user would reach for, on the same right-hand sides: speed and error to compare with.

None of them knows of the switchings. `atol` is `rtol * scale` in each component (`PROBLEMS[kind].scale(p)`).
"""

import time
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import odeint, solve_ivp

from experiments.reference.located import dop853, dop853_step
from experiments.reference.problems import LAW, PROBLEMS, Array, mode_of, slider_crank_parameters


class Baseline(NamedTuple):
    """States at the output times, evaluations of the right-hand side, and the shortest of several wall times [s]."""

    y: Array
    nfev: int
    seconds: float


def best(solve: Callable[[], tuple[Array, int]], repeats: int) -> Baseline:
    """Run once to compile, then time `repeats` runs and keep the shortest."""
    y, nfev = solve()
    times = []
    for _ in range(repeats):
        clock = time.perf_counter()
        solve()
        times.append(time.perf_counter() - clock)
    return Baseline(y, nfev, min(times))


def run_odeint(
    kind: str, p: Array, t: Array, rtol: float, scale: Array, hmax: float = 0.0, direct: bool = True, repeats: int = 3
) -> Baseline:
    """LSODA. `direct` hands odeint the compiled function itself, the least overhead that odeint allows (it takes no
    LowLevelCallable); otherwise a Python function with odeint's own argument order calls it, as most users write it.
    """
    problem, y0 = PROBLEMS[kind], PROBLEMS[kind].start(p)
    rhs = problem.rhs if direct else lambda y, t, p: problem.rhs(t, y, p)

    def solve() -> tuple[Array, int]:
        y, info = odeint(
            rhs, y0, t, (p,), tfirst=direct, rtol=rtol, atol=rtol * scale, hmax=hmax, mxstep=10**7, full_output=True
        )
        return y, int(info["nfe"][-1])

    return best(solve, repeats)


def run_solve_ivp(
    kind: str, p: Array, t: Array, rtol: float, scale: Array, hmax: float = np.inf, method="DOP853", repeats: int = 3
) -> Baseline:
    """Scipy's solve_ivp with the compiled right-hand side."""
    problem, y0 = PROBLEMS[kind], PROBLEMS[kind].start(p)

    def solve() -> tuple[Array, int]:
        result = solve_ivp(
            problem.rhs, (t[0], t[-1]), y0, method, t, args=(p,), rtol=rtol, atol=rtol * scale, max_step=hmax
        )
        return result.y.T, result.nfev

    return best(solve, repeats)


def run_compiled(
    kind: str, p: Array, t: Array, rtol: float, scale: Array, hmax: float = np.inf, repeats: int = 3
) -> Baseline:
    """DOP853 with loop and right-hand side in one compiled function: what is left when Python's overhead is gone.

    It has no interpolant and ends a step at every output, so give it few output times.
    """
    field, y0 = branching(kind), PROBLEMS[kind].start(p)

    def solve() -> tuple[Array, int]:
        return compiled_loop(field, y0, t, p, rtol, rtol * scale, hmax)

    return best(solve, repeats)


@cache
def branching(kind: str):
    """The field with the modes chosen at every evaluation, in the form that `dop853_step` expects."""
    field, signals = PROBLEMS[kind].field, PROBLEMS[kind].signals

    @njit
    def chosen(mode, inside, t, y, p):
        return field(mode_of(signals(t, y, p), p), t, t, y, p)

    return chosen


@njit
def compiled_loop(field, y, stops, p, rtol, atol, hmax):
    """The textbook controller: h <- h * clip(0.9 err^(-1/8), 0.2, 10)."""
    out = np.empty((len(stops), len(y)))
    t, out[0], h, nfev = stops[0], y, 1e-9, 0
    for k in range(1, len(stops)):
        while t < stops[k]:
            trial = min(h, hmax, stops[k] - t)
            last = trial == stops[k] - t
            new, error = dop853_step(field, (0, 0, 0), t, t, y, trial, p, atol + rtol * np.abs(y))
            nfev += 12
            factor = min(10.0, max(0.2, 0.9 * max(error, 1e-12) ** -0.125))
            if error > 1:
                h = trial * factor
                continue
            y, t = new, stops[k] if last else t + trial
            h = max(h, trial * factor) if last else trial * factor
        out[k] = y
    return out, nfev


def slider_crank_end(integrator: str, rtol: float, clearance: float) -> float:
    """Where the slider is after one revolution [m], by one of scipy's integrators ("odeint", or a method of solve_ivp)
    with the compiled right-hand side.
    """
    problem, p = PROBLEMS["slider_crank"], slider_crank_parameters(clearance)
    y0, atol, end = problem.start(p), rtol * problem.scale(p), 2 * np.pi / p[LAW]
    if integrator == "odeint":
        y = odeint(problem.rhs, y0, [0.0, end], (p,), tfirst=True, rtol=rtol, atol=atol, mxstep=10**7)
        return float(y[-1, 1])
    found = solve_ivp(problem.rhs, (0.0, end), y0, integrator, [end], args=(p,), rtol=rtol, atol=atol)
    return float(found.y[1, -1])


def slider_crank_truth(clearance: float) -> float:
    """The same by steps that end at every switching (`located`)."""
    p = slider_crank_parameters(clearance)
    return float(dop853(PROBLEMS["slider_crank"], np.array([0.0, 2 * np.pi / p[LAW]]), p, rtol=1e-13).y[-1, 1])
