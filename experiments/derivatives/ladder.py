"""Derivatives of the slider-crank after one revolution, by this library and by other tools, compared with references:
`python -m experiments.derivatives ladder`.

The error of a column is the error of its worst entry, divided by the largest magnitude of this entry in time. The
columns are clearance c, friction mu and stiffness K. K is held constant when c changes.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import slope
from clearance_jax.solve.first_state import initial_state
from experiments.common import output, slider_crank, table
from experiments.reference.baselines import run_compiled
from experiments.reference.make import REVOLUTION, load_variation
from experiments.reference.problems import slider_crank_parameters
from experiments.reference.sensitivity_baselines import (
    COLUMNS,
    PROBLEM,
    column_errors,
    component_sizes,
    cvodes,
    differences,
)

NAMES = ("wrist.radial_clearance", "wrist.friction.coefficient", "wrist.normal.stiffness")
CASES = {"0.5 mm": "slider_crank_0.5mm", "0.1 mm": "slider_crank_0.1mm"}
RTOLS = tuple(10.0**-k for k in range(5, 12))
REVERSE_MAX_STEPS = 2**15
MILD, FINE = 1e-4, 1e-6
"""Relative steps of finite differences."""

# What is required of every column of ours.
AT_NINE, AT_TIGHTEST = 1e-6, 1e-8
SLOPE = 0.8
"""Least slope of log error against log rtol that counts as "in proportion" (the error of a solve has a slope of one up
to scatter, for steps are on a grid and impacts amplify each time anew)."""

Jacobian = Callable[[Any, Any], tuple[Any, Any]]
"""(values of c, mu, K; rtol) to (Jacobian (4, 3), steps)."""


class Rung(NamedTuple):
    """One tool at one tolerance: the errors of the three columns, and the accepted steps (-1: not told)."""

    case: str
    tool: str
    rtol: float
    errors: tuple[float, ...]
    steps: int

    @property
    def worst(self) -> float:
        return max(self.errors)


def crank() -> cj.Mechanism:
    """The slider-crank with its stiffness as a number of its own, not one that follows from moduli."""
    mechanism = slider_crank()
    (wrist,) = (joint.clearance for joint in mechanism.clearance_joints())
    assert wrist is not None
    assert isinstance(wrist.normal, laws.AdamsImpact)
    stiffness = wrist.prepare().normal.constants
    law = laws.AdamsImpact(stiffness, wrist.normal.damping, wrist.normal.full_damping_depth)
    clearance = cj.RevoluteClearance(wrist.radial_clearance, wrist.pin_radius, law, wrist.friction)
    return mechanism.with_clearance("wrist", clearance)


def moved(values) -> cj.Mechanism:
    return cj.replace(crank(), dict(zip(NAMES, values, strict=True)))


def nominal(name: str) -> np.ndarray:
    return load_variation(name)["params"][list(COLUMNS)]


# The derivatives -----------------------------------------------------------------------------------------------------


def jacobian(end) -> Jacobian:
    """Forward-mode Jacobian of `end(values, rtol) -> (final, steps)`."""
    return jax.jit(jax.jacfwd(end, has_aux=True))


def ours(solver: str, derivatives: str = "controlled"):
    """End of a revolution; "screening" differentiates the program, whose steps are chosen for the motion alone."""

    def end(values, rtol):
        s = cj.simulate(
            moved(values),
            REVOLUTION,
            rtol=rtol,
            solver=solver,
            energy_balance=False,
            throw=False,
            derivatives=derivatives,
        )
        return s.final, s.steps

    return end


def textbook(values, rtol):
    """End of a revolution by diffrax's own solver and controller, which know of no contact."""
    mechanism = moved(values).prepare()
    size = jnp.asarray(PROBLEM.scale(slider_crank_parameters(5e-4)))
    s = diffrax.diffeqsolve(
        diffrax.ODETerm(jax.jit(slope)),
        diffrax.Tsit5(),
        0.0,
        REVOLUTION,
        1e-7,
        initial_state(mechanism, jnp.asarray(0.0)),
        args=mechanism,
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol * size),
        adjoint=diffrax.RecursiveCheckpointAdjoint(),
        max_steps=REVERSE_MAX_STEPS,
        throw=False,
    )
    assert s.ys is not None
    return s.ys[-1], s.stats["num_accepted_steps"]


def central(end, step: float) -> Jacobian:
    """Central differences of `end` by relative steps."""

    @jax.jit
    def slopes(values, rtol):
        def column(i):
            up, down = values.at[i].multiply(1 + step), values.at[i].multiply(1 - step)
            return (end(up, rtol)[0] - end(down, rtol)[0]) / (up[i] - down[i])

        # In turn and not as a batch: a batch would go on until its slowest lane ends.
        return jax.lax.map(column, jnp.arange(len(NAMES))).T, jnp.asarray(-1)

    return slopes


def ladder(case: str, tool: str, run: Jacobian, rtols) -> list[Rung]:
    name = CASES[case]
    values = jnp.asarray(nominal(name))
    rungs = []
    for rtol in rtols:
        slopes, steps = run(values, jnp.asarray(rtol))
        errors = tuple(float(e) for e in column_errors(name, np.asarray(slopes)))
        rungs.append(Rung(case, tool, rtol, errors, int(steps)))
    return rungs


def baselines(case: str, rtols) -> list[Rung]:
    """CVODES with sensitivities, and differences of compiled DOP853: tools that know of no switching."""
    name = CASES[case]
    data = load_variation(name)
    t, p, size = data["t"], data["params"], component_sizes(name)
    rungs = []
    for rtol in rtols:
        for tool, answer in (
            ("CVODES sensitivities", cvodes(p, t, rtol, size)),
            (f"DOP853, differences {MILD:.0e}", differences(run_compiled, p, t, rtol, size, MILD)),
            (f"DOP853, differences {FINE:.0e}", differences(run_compiled, p, t, rtol, size, FINE)),
        ):
            if answer is not None:
                errors = tuple(float(e) for e in column_errors(name, answer[0]))
                rungs.append(Rung(case, tool, rtol, errors, -1))
    return rungs


def measure(quick: bool) -> list[Rung]:
    cases = list(CASES)[:1] if quick else list(CASES)
    rtols = (1e-5, 1e-9) if quick else RTOLS
    few = rtols[-1:] if quick else rtols[::2]
    programs: dict[str, tuple[Jacobian, Any]] = {}
    for solver in ("tsit5",) if quick else ("tsit5", "dopri8"):
        programs[f"ours, {solver}"] = jacobian(ours(solver)), rtols
        if not quick:
            programs[f"no rule, {solver}"] = jacobian(ours(solver, "screening")), rtols
    if not quick:
        programs["textbook reverse mode, tsit5"] = jax.jit(jax.jacrev(textbook, has_aux=True)), few[:3]
        for step in (MILD, FINE):
            programs[f"ours, differences {step:.0e}"] = central(ours("dopri8"), step), few
    rungs = []
    for case in cases:
        for tool, (run, at) in programs.items():
            rungs += ladder(case, tool, run, at)
            print(f"{case}, {tool}: worst {', '.join(f'{r.worst:.1e}' for r in rungs[-len(at) :])}", flush=True)
        rungs += baselines(case, few)
    return rungs


# What is required ----------------------------------------------------------------------------------------------------


def slopes(rungs: list[Rung]) -> np.ndarray:
    """Slope of log error against log rtol, of every column (least squares)."""
    x = np.log([r.rtol for r in rungs])
    return np.polyfit(x, np.log([r.errors for r in rungs]), 1)[0]


def verdicts(rungs: list[Rung]) -> list[tuple]:
    """One line per case and solver of ours: slope, error at 1e-9 and at the tightest, and whether they suffice."""
    rows = []
    for case in dict.fromkeys(r.case for r in rungs):
        for tool in dict.fromkeys(r.tool for r in rungs):
            mine = [r for r in rungs if (r.case, r.tool) == (case, tool)]
            if not tool.startswith(("ours, tsit5", "ours, dopri8")) or not mine:
                continue
            slope = slopes(mine)
            nine = min(mine, key=lambda r: abs(np.log(r.rtol / 1e-9)))
            last = min(mine, key=lambda r: r.rtol)
            held = (np.min(slope) >= SLOPE, nine.worst <= AT_NINE, last.worst <= AT_TIGHTEST)
            rows.append(
                (
                    case,
                    tool,
                    " ".join(f"{s:.2f}" for s in slope),
                    f"{nine.worst:.1e}",
                    f"{last.worst:.1e} at {last.rtol:.0e}",
                    ", ".join("yes" if h else "NO" for h in held),
                )
            )
    return rows


def main(quick: bool = False) -> list[Rung]:
    rungs = measure(quick)
    suffix = "_quick" if quick else ""
    table(
        ("clearance", "tool", "rtol", "error by c", "by mu", "by K", "steps"),
        [
            (r.case, r.tool, f"{r.rtol:.0e}", *(f"{e:.1e}" for e in r.errors), r.steps if r.steps >= 0 else "")
            for r in rungs
        ],
        output(f"derivatives_ladder{suffix}.md"),
    )
    limits = f"slope >= {SLOPE:g}, <= {AT_NINE:.0e} at 1e-9, <= {AT_TIGHTEST:.0e} at the tightest"
    table(
        ("clearance", "tool", "slopes by c, mu, K", "worst at 1e-9", "worst at the tightest", limits),
        verdicts(rungs),
        output(f"derivatives_limits{suffix}.md"),
    )
    return rungs
