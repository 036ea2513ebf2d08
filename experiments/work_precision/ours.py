"""The library's own solvers on a scene: with and without event location, and with a derivative."""

from collections.abc import Callable, Iterable
from typing import Any

import jax
import numpy as np

import clearance_jax as cj
from clearance_jax.solve.settings import SOLVERS
from experiments.work_precision.points import GaveUp, Point, Run, best, ladder
from experiments.work_precision.scenes import SPACE, Case

TOOLS = {
    f"{solver}{words}": (solver, events) for events, words in ((True, ""), (False, ", no events")) for solver in SOLVERS
}
"""By the name of a tool: its solver, and whether it locates events."""


def program(case: Case, solver: str, events: bool) -> Callable[[float, float], Any]:
    """A compiled solve, a function of the clearance [m] and rtol: states at the samples, attempted steps, code."""

    def run(clearance, rtol):
        mechanism = cj.replace(case.mechanism, {case.scene.clearance: clearance})
        options = {"locate_events": events, "energy_balance": False, "throw": False}
        s = cj.simulate(mechanism, case.scene.t1, y0=case.y0, save_at=case.times, rtol=rtol, solver=solver, **options)
        return s.y, s.steps + s.rejected, s.code

    return run


def with_slope(run: Callable[[float, float], Any]) -> Callable[[float, float], Any]:
    """The same with the derivative of the states at the samples by the clearance."""

    def both(clearance, rtol):
        def states(c):
            y, attempts, code = run(c, rtol)
            return y, (attempts, code)

        y, slope, aux = jax.jvp(states, (clearance,), (1.0,), has_aux=True)
        return y, slope, aux

    return both


def evaluations(solver: str, attempts: int) -> int:
    """Evaluations of the field in a number of attempted steps (the last stage of one is the first of the next)."""
    tableau = SOLVERS[solver]().tableau
    return attempts * (len(tableau.c) + (0 if tableau.fsal else 1)) + 1


class Programs:
    """The compiled solves of a case, each made when it is first asked for."""

    def __init__(self, case: Case):
        self.case = case
        self.made: dict[Any, Callable] = {}

    def value(self, solver: str, events: bool = True) -> Callable[[float], Any]:
        """A function of rtol: states, attempts, code."""
        return self._get(solver, events, lambda run: run)

    def slope(self, solver: str, events: bool = True) -> Callable[[float], Any]:
        """A function of rtol: states, their derivatives, (attempts, code)."""
        return self._get(solver, events, with_slope)

    def _get(self, solver, events, kind) -> Callable[[float], Any]:
        key = solver, events, kind is with_slope
        if key not in self.made:
            run = jax.jit(kind(program(self.case, solver, events)))
            self.made[key] = lambda rtol: jax.block_until_ready(run(self.case.clearance, rtol))
        return self.made[key]


def sloped(case: Case, solver: str, events: bool) -> bool:
    """Whether a tool's derivative is measured: of arms only the default solver's, because their programs are large."""
    return events and (case.scene.of != SPACE or solver == "tsit5")


def measure(programs: Programs, rtols: Iterable[float], tools: Iterable[str] = tuple(TOOLS)) -> list[Point]:
    """All own tools on a scene."""
    points, case = [], programs.case
    rtols = tuple(rtols)
    for tool in tools:
        solver, events = TOOLS[tool]
        if case.scene.of == SPACE and tool == "dopri8, no events":
            continue
        value = programs.value(solver, events)
        slope = programs.slope(solver, events) if sloped(case, solver, events) else None
        value(rtols[0])
        if slope is not None:
            slope(rtols[0])

        def solve(rtol, value=value, slope=slope, solver=solver) -> Run:
            (y, attempts, code), took = best(lambda: value(rtol))
            if int(code):
                raise GaveUp
            run = Run(np.asarray(y), evaluations(solver, int(attempts)), took)
            if slope is None:
                return run
            (_, moved, (_, failed)), took = best(lambda: slope(rtol), 3)
            return run if int(failed) else run._replace(slope=np.asarray(moved)[-1], slope_seconds=took)

        points += ladder(case, tool, solve, rtols)
    return points
