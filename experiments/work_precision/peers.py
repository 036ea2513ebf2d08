"""Other tools on the same equations: scipy, SUNDIALS, CasADi, diffrax.

Where a scene is written by hand in numba too, scipy and SUNDIALS have that right-hand side. In all other scenes they
are handed the library's compiled field, called through numpy. diffrax has the library's field in every scene. CasADi
has the slider-cranks of one clearance, in its own expressions. `atol` is rtol times the unit of each state, for all.
"""

import importlib.util
import time
import warnings
from collections.abc import Callable, Iterable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import odeint, solve_ivp

import clearance_jax as cj
from clearance_jax.dynamics.field import slope as rate_of
from experiments.work_precision.points import GaveUp, Point, Run, best, ladder
from experiments.work_precision.scenes import CRANKS, SPACE, Case

PACKAGES = {
    "numba": "numba",
    "CVODE": "sksundae",
    "CasADi": "casadi",
    "Exudyn": "exudyn",
    "MuJoCo": "mujoco",
}
"""Optional packages by what needs them."""
PATIENCE = 8.0
"""Seconds after which a solve is broken off."""
FIRST_STEP = 1e-6
"""diffrax's first step, as a part of the motion: its own choice finds none where a pin starts in the middle."""
MOST_STEPS = {"Tsit5": 300_000, "Kvaerno5": 20_000}
LSODA, CVODE, CASADI = "LSODA (odeint)", "CVODE", "CVODES (CasADi)"


def installed(tool: str) -> bool:
    """Whether the package of an optional tool is here."""
    return importlib.util.find_spec(PACKAGES[tool]) is not None


class Field:
    """The right-hand side as a peer has it, f(t, y) in numpy, and what surrounds it.

    - `start` (n,), `unit` (n,): the first state and the states' units; `back`: from a peer's states to the library's.
    - `by_hand`: whether it is the hand-written one, compiled by numba; `compiled` with `arguments` is that itself.
    """

    def __init__(self, case: Case):
        self.by_hand = bool(case.scene.twin) and installed("numba")
        self.arguments: tuple = ()
        if self.by_hand:
            from experiments.reference.problems import PROBLEMS

            problem, p = PROBLEMS[case.scene.twin], case.stored["params"]
            self.start, self.unit, self.arguments, self.compiled = problem.start(p), problem.scale(p), (p,), problem.rhs
            self.turned = case.turned
        else:
            prepared = case.mechanism.prepare()
            field = jax.jit(lambda t, y: rate_of(t, y, prepared))
            self.start, self.unit, self.turned = case.y0, case.unit, np.zeros_like(case.turned)
            self.compiled = lambda t, y: np.asarray(field(t, y))
        self.compiled(0.0, self.start, *self.arguments)

    def back(self, y: np.ndarray) -> np.ndarray:
        return y - self.turned

    def watched(self) -> Callable[[float, np.ndarray], np.ndarray]:
        """The field, which gives up after `PATIENCE`."""
        end, compiled, arguments = time.perf_counter() + PATIENCE, self.compiled, self.arguments

        def rate(t, y):
            if time.perf_counter() > end:
                raise GaveUp
            return compiled(t, y, *arguments)

        return rate


def by_odeint(case: Case, field: Field, rtol: float) -> Run:
    """LSODA: numba's function itself where there is one, the least overhead that odeint allows."""

    def solve():
        rhs, arguments = (field.compiled, field.arguments) if field.by_hand else (field.watched(), ())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            options = {"rtol": rtol, "atol": rtol * field.unit, "mxstep": 10**6, "full_output": True}
            y, info = odeint(rhs, field.start, case.times, arguments, tfirst=True, **options)
        return y, int(info["nfe"][-1])

    (y, count), took = best(solve)
    return Run(field.back(y), count, took)


def by_solve_ivp(case: Case, field: Field, rtol: float, method: str) -> Run:
    """DOP853 and Radau of scipy."""

    def solve():
        span, options = (case.times[0], case.times[-1]), {"rtol": rtol, "atol": rtol * field.unit}
        found = solve_ivp(field.watched(), span, field.start, method, case.times, **options)
        if not found.success:
            raise GaveUp
        return found.y.T, int(found.nfev)

    (y, count), took = best(solve)
    return Run(field.back(y), count, took)


def by_cvode(case: Case, field: Field, rtol: float, method: str, hmax: float = 0.0) -> Run:
    """SUNDIALS' CVODE by scikit-sundae."""
    from sksundae.cvode import CVODE as Solver

    def solve():
        rate = field.watched()

        def rhs(t, y, out):
            out[:] = rate(t, y)

        options = {"rtol": rtol, "atol": rtol * field.unit, "max_num_steps": 10**6, "max_step": hmax}
        found = Solver(rhs, method=method, **options).solve(case.times, field.start)
        if not found.success or len(found.t) != len(case.times):
            raise GaveUp
        return np.asarray(found.y), int(found.nfev)

    (y, count), took = best(solve)
    return Run(field.back(y), count, took)


def by_numba(case: Case, field: Field, rtol: float) -> Run:
    """DOP853 whose loop is compiled by numba too; it ends a step at every sample."""
    from experiments.reference.baselines import branching, compiled_loop

    rhs, (p,) = branching(case.scene.twin), field.arguments

    def solve():
        return compiled_loop(rhs, field.start, case.times, p, rtol, rtol * field.unit, np.inf)

    solve()
    (y, count), took = best(solve)
    return Run(field.back(y), int(count), took)


class CasADi:
    """CVODES with forward sensitivities on a slider-crank written in CasADi's expressions; states in their units,
    because it takes one absolute tolerance.
    """

    def __init__(self, case: Case, field: Field):
        import casadi as ca

        from experiments.reference.problems import CLEARANCE, FRICTION, STIFFNESS
        from experiments.reference.sensitivity_baselines import casadi_ode

        self.case, self.field, self.ca, (p,) = case, field, ca, field.arguments
        self.step = float(p[CLEARANCE])
        t, y, q = ca.SX.sym("t"), ca.SX.sym("y", len(field.start)), ca.SX.sym("q")
        clearance = self.step * (1 + q)
        ode = casadi_ode(ca, t, y * field.unit, clearance, float(p[FRICTION]), float(p[STIFFNESS]), p) / field.unit
        self.model = {"t": t, "x": y, "p": q, "ode": ode}

    def integrator(self, times: np.ndarray, rtol: float, hmax: float = 0.0) -> Any:
        """An integrator to the given times, the start left out."""
        options = {"reltol": rtol, "abstol": rtol, "max_num_steps": 10**6, "fsens_err_con": True, "max_step_size": hmax}
        return self.ca.integrator("crank", "cvodes", self.model, 0.0, times, options)

    def __call__(self, rtol: float) -> Run:
        unit, start = self.field.unit, self.field.start / self.field.unit
        integrate = self.integrator(self.case.times[1:], rtol)
        try:
            found, took = best(lambda: integrate(x0=start, p=0))
            y = np.vstack([start, np.array(found["xf"]).T]) * unit
            count = int(integrate.stats().get("nfevals", -1))
            end = self.integrator(self.case.times[-1:], rtol)
            forward = end.forward(1)
            seeds = {name: self.ca.DM.zeros(*forward.size_in(name)) for name in forward.name_in()}
            seeds |= {"x0": start, "p": 0, "fwd_p": 1}
            moved, slope_took = best(lambda: forward(**seeds))
        except RuntimeError:
            raise GaveUp from None
        slope = np.array(moved["fwd_xf"]).ravel() * unit / self.step
        return Run(self.field.back(y), count, took, slope, slope_took)


def by_diffrax(case: Case, method: str, slope: bool) -> Callable[[float], Run]:
    """By diffrax as it comes: its solver and PID controller on the library's field, in its forward mode."""
    solver, times, unit = getattr(diffrax, method)(), jnp.asarray(case.times), jnp.asarray(case.unit)

    def run(clearance, rtol):
        prepared = cj.replace(case.mechanism, {case.scene.clearance: clearance}).prepare()
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate_of),
            solver,
            times[0],
            times[-1],
            FIRST_STEP * times[-1],
            jnp.asarray(case.y0),
            prepared,
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol * unit),
            adjoint=diffrax.ForwardMode(),
            max_steps=MOST_STEPS[method],
            throw=False,
        )
        return found.ys, found.stats["num_steps"], found.result == diffrax.RESULTS.successful

    def both(clearance, rtol):
        def states(c):
            y, *rest = run(c, rtol)
            return y, rest

        y, moved, _ = jax.jvp(states, (clearance,), (1.0,), has_aux=True)
        return y, moved[-1]

    value, sloped = jax.jit(run), jax.jit(both)
    jax.block_until_ready(value(case.clearance, 1e-3))
    if slope:
        jax.block_until_ready(sloped(case.clearance, 1e-3))
    stages = 6 if method == "Tsit5" else -1

    def solve(rtol: float) -> Run:
        (y, steps, reached), took = best(lambda: jax.block_until_ready(value(case.clearance, rtol)))
        if not bool(reached):
            raise GaveUp
        found = Run(np.asarray(y), stages * int(steps) + 1 if stages > 0 else -1, took)
        if not slope:
            return found
        (_, moved), took = best(lambda: jax.block_until_ready(sloped(case.clearance, rtol)), 3)
        return found._replace(slope=np.asarray(moved), slope_seconds=took)

    return solve


def tools(case: Case, quick: bool = False) -> dict[str, Callable[[float], Run]]:
    """By name, whatever can solve this scene and is installed; `quick`: what does so fast."""
    field = Field(case)
    on = " + numba" if field.by_hand else ""
    found: dict[str, Callable[[float], Run]] = {f"{LSODA}{on}": lambda rtol: by_odeint(case, field, rtol)}
    for method in () if quick else ("DOP853", "Radau"):
        found[f"{method} (solve_ivp){on}"] = lambda rtol, m=method: by_solve_ivp(case, field, rtol, m)
    if installed("CVODE"):
        for method in ("Adams",) if quick else ("Adams", "BDF"):
            found[f"{CVODE} {method}{on}"] = lambda rtol, m=method: by_cvode(case, field, rtol, m)
    if field.by_hand:
        found["DOP853 in numba"] = lambda rtol: by_numba(case, field, rtol)
    if case.scene.of == CRANKS and field.by_hand and installed("CasADi") and not quick:
        found[CASADI] = CasADi(case, field)
    if not quick:
        found["diffrax Tsit5"] = by_diffrax(case, "Tsit5", case.scene.of != SPACE)
        if case.scene.of != SPACE:
            found["diffrax Kvaerno5"] = by_diffrax(case, "Kvaerno5", False)
    return found


def measure(case: Case, rtols: Iterable[float], quick: bool = False) -> list[Point]:
    """All peers on a scene."""
    rtols = tuple(rtols)
    return [point for name, solve in tools(case, quick).items() for point in ladder(case, name, solve, rtols)]
