"""Time against error: `python -m experiments.work_precision` writes out/work_precision.{md,png}.

Every solver gives the states at the same times (201 in a revolution of the slider-crank, 3001 for joint 5). The error
is that of the worst state, compared with the references of `experiments.reference`, which share no code with the
library. Times are the shortest of several runs in one process, without compilation. The library runs without its energy
balance here, because the other tools do not compute one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import clearance_jax as cj
from clearance_jax.solve.settings import SOLVERS as SOLVER_CLASSES
from experiments.common import as_reference, error, joint5, output, seconds, slider_crank, table
from experiments.publish import command, say
from experiments.reference.baselines import run_compiled, run_odeint, run_solve_ivp
from experiments.reference.make import load
from experiments.reference.problems import PROBLEMS

CASES = {
    "slider-crank, c = 0.5 mm": ("slider_crank", "slider_crank_0.5mm", {"wrist.radial_clearance": 5e-4}),
    "slider-crank, c = 0.2 mm": ("slider_crank", "slider_crank_0.2mm", {"wrist.radial_clearance": 2e-4}),
    "slider-crank, c = 0.1 mm": ("slider_crank", "slider_crank_0.1mm", {"wrist.radial_clearance": 1e-4}),
    "joint 5, no friction": ("joint5", "joint5_mu0.0", {"joint5.friction.coefficient": 0.0}),
    "joint 5, mu = 0.3": ("joint5", "joint5_mu0.3", {"joint5.friction.coefficient": 0.3}),
}
SOLVERS = ("tsit5", "dopri8")
COLOURS = {
    "tsit5": "tab:blue",
    "dopri8": "tab:orange",
    "scipy odeint + numba": "tab:green",
    "scipy DOP853 + numba": "tab:red",
    "numba DOP853": "tab:purple",
}
ERRORS = (1e-4, 1e-6, 1e-8)


class Point(NamedTuple):
    """One run of one tool at one tolerance."""

    case: str
    tool: str
    rtol: float
    error: float
    evaluations: int
    seconds: float


def ours(kind: str, solver: str, events: bool):
    """One compiled solve of a problem, for any numbers and any rtol."""
    mechanism = slider_crank() if kind == "slider_crank" else joint5()

    @jax.jit
    def run(values, time, rtol):
        changed = cj.replace(mechanism, values)
        s = cj.simulate(
            changed, time[-1], save_at=time, rtol=rtol, solver=solver, locate_events=events, energy_balance=False
        )
        return s.y, s.steps + s.rejected

    return run


def evaluations(solver: str, attempts: int) -> int:
    """Vector-field evaluations of a number of attempted steps (the last stage of one is the first of the next)."""
    tableau = SOLVER_CLASSES[solver]().tableau
    return attempts * (len(tableau.c) + (0 if tableau.fsal else 1)) + 1


def measure(quick: bool) -> list[Point]:
    points = []
    cases = dict(list(CASES.items())[:1]) if quick else CASES
    ladder = (1e-5, 1e-8) if quick else tuple(10.0**-k for k in range(4, 12))
    repeats = 1 if quick else 5
    runs = {
        (kind, solver, events): ours(kind, solver, events)
        for kind in {kind for kind, *_ in cases.values()}
        for solver in SOLVERS
        for events in (True, False)
    }
    for case, (kind, name, values) in cases.items():
        reference = load(name)
        t, truth, p = reference["t"], reference["y"], reference["params"]
        for (own, solver, events), run in runs.items():
            if own != kind:
                continue
            for rtol in ladder:
                arguments: Any = (values, jnp.asarray(t), jnp.asarray(rtol))
                y, attempts = run(*arguments)
                took = seconds(lambda run=run, arguments=arguments: run(*arguments), repeats)
                worst = error(as_reference(kind, y, t), truth).max()
                tool = f"{solver}{'' if events else ', no events'}"
                points.append(Point(case, tool, rtol, worst, evaluations(solver, int(attempts)), took))
        scale = PROBLEMS[kind].scale(p)
        tools = {
            "scipy odeint + numba": run_odeint,
            "scipy DOP853 + numba": run_solve_ivp,
            "numba DOP853": run_compiled,
        }
        for tool, solve in tools.items():
            slow = solve is run_solve_ivp
            for rtol in ladder[: 5 if slow else None : 2 if slow else 1]:
                result = solve(kind, p, t, rtol, scale, repeats=1 if slow else repeats)
                worst = error(result.y, truth).max()
                points.append(Point(case, tool, rtol, worst, result.nfev, result.seconds))
        print(f"{case}: done", flush=True)
    return points


def cheapest(points: list[Point], case: str, tool: str, bound: float) -> float:
    """Least time in which a tool has an error below `bound` at that and every tighter measured tolerance (infinite: it
    never has).
    """
    mine = sorted((p for p in points if p.case == case and p.tool == tool), key=lambda p: p.rtol)
    good = []
    for point in mine:
        if point.error > bound:
            break
        good.append(point.seconds)
    return min(good, default=np.inf)


def milliseconds(time: float) -> str:
    """For a table: "none" where an error is not reached at all."""
    return f"{time * 1e3:.2f}" if np.isfinite(time) else "none"


def figure(points: list[Point]):
    cases = list(dict.fromkeys(p.case for p in points))
    tools = list(dict.fromkeys(p.tool for p in points))
    with mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 8}):
        drawn = Figure(figsize=(3.4 * len(cases) + 1, 7), layout="constrained")
        axes = drawn.subplots(2, len(cases), squeeze=False, sharey="row")
        for column, case in enumerate(cases):
            for tool in tools:
                mine = [p for p in points if p.case == case and p.tool == tool]
                style = {
                    "color": COLOURS[tool.removesuffix(", no events")],
                    "ls": "--" if "not watched" in tool else ":" if "numba" in tool else "-",
                    "marker": "s" if "numba" in tool else "o",
                }
                for row, x in enumerate(("seconds", "evaluations")):
                    axes[row, column].loglog(
                        [getattr(p, x) * (1e3 if row == 0 else 1) for p in mine],
                        [p.error for p in mine],
                        ms=3,
                        lw=1,
                        label=tool,
                        **style,
                    )
            axes[0, column].set(title=case, xlabel="time, ms")
            axes[1, column].set(xlabel="vector-field evaluations")
            for axis in axes[:, column]:
                axis.xaxis.set_minor_formatter(NullFormatter())
        for row in (0, 1):
            axes[row, 0].set(ylabel="error of the worst state, relative")
        drawn.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(tools))
    return drawn


def main(quick: bool = False) -> list[Point]:
    points = measure(quick)
    suffix = "_quick" if quick else ""
    table(
        ("case", "tool", "rtol", "error of worst state", "evaluations", "time, ms"),
        [(p.case, p.tool, f"{p.rtol:.0e}", f"{p.error:.1e}", p.evaluations, f"{p.seconds * 1e3:.2f}") for p in points],
        output(f"work_precision{suffix}.md"),
    )
    cases, tools = (list(dict.fromkeys(getattr(p, k) for p in points)) for k in ("case", "tool"))
    say("Least time [ms] with the worst state below the error, at that and every tighter tolerance measured:")
    table(
        ("case", "tool", *(f"{bound:.0e}" for bound in ERRORS)),
        [
            (case, tool, *(milliseconds(cheapest(points, case, tool, bound)) for bound in ERRORS))
            for case in cases
            for tool in tools
        ],
        output(f"work_precision_summary{suffix}.md"),
    )
    figure(points).savefig(output(f"work_precision{suffix}.png"), dpi=130)
    return points


if __name__ == "__main__":
    command(main, __doc__)
