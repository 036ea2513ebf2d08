"""How many solves of the dynamics a cheapest allocation takes: searched by quasi-static poses and corrected by the
dynamics (`fidelity="auto"`), by SLSQP from the middle of the bounds and from the optimum of the poses, and by CMA-ES,
which uses no gradients and is stopped after 500 solves: `python -m optimize.fidelities`. Pins start settled, and
loads keep them pressed on.
"""

from typing import NamedTuple

from clearance_jax.design import Design, Method, ToleranceProblem
from clearance_jax.design.search.scaling import optimality
from experiments.common import output, table
from experiments.publish import command
from optimize import allocate_four_bar, allocate_planar_arm, allocate_slider_crank
from optimize.cma_method import CMA_ES

# Residual of the conditions of optimality that is asked for, and the part of the cost within which an answer is near.
OPTIMAL, NEAR = 1e-6, 1e-3
# Solves after which CMA-ES is stopped, and joints up to which it is tried.
MOST, FEW = 500, 3


class Route(NamedTuple):
    """One way to an answer: the design, and how many solves of poses it took."""

    design: Design
    poses: int


def settled(problem: ToleranceProblem, part: float) -> ToleranceProblem:
    """A problem with settled pins, over a part of its motion."""
    whole = problem.specification
    costs = dict(zip(whole.variables, whole.costs, strict=True))
    limits = list(whole.limits)
    return ToleranceProblem(whole.mechanism, part * whole.t1, whole.variables, limits, cost=costs, start="settled")


def problems(quick: bool) -> dict[str, ToleranceProblem]:
    """By the mechanism's name."""
    found = {"slider-crank": settled(allocate_slider_crank.problem(), 0.1 if quick else 0.5)}
    if not quick:
        found["four-bar"] = settled(allocate_four_bar.problem(), 0.25)
        found["planar arm, 3 joints"] = settled(allocate_planar_arm.problem(3), 0.5)
    return found


def routes(problem: ToleranceProblem, quick: bool) -> dict[str, Route]:
    """The answers of one problem by every route."""
    found = {}

    def take(name: str, method: str | Method = "slsqp", poses: int = 0, **options) -> None:
        design = problem.solve(method, **options)
        cheap = design.program.cheap
        poses += 0 if cheap is None else cheap.solves
        found[name] = Route(design, poses)
        print(f"{name}\n{design}", flush=True)

    take("auto", fidelity="auto")
    take("SLSQP from the middle")
    if not quick:
        posed = problem.solve(fidelity="quasi-static")
        take("SLSQP from the optimum of poses", start=posed.clearances, poses=posed.program.solves)
    if not quick and len(problem.specification.variables) <= FEW:
        take("CMA-ES from the middle", CMA_ES, most=MOST)
    return found


def first(design: Design, holds) -> str:
    """The number of solves until a point holds something; a dash where none does."""
    history = design.program.history
    found = next((i + 1 for i, point in enumerate(history) if point.feasible and holds(point)), None)
    return "-" if found is None else str(found)


def rows_of(name: str, found: dict[str, Route]) -> list[tuple]:
    """Lines of the table of one mechanism."""
    best = min(route.design.objective for route in found.values())
    rows = []
    for way, (design, poses) in found.items():
        program = design.program

        def optimal(point, program=program):
            return point.gradient is not None and optimality(program, point)[0] <= OPTIMAL

        near = first(design, lambda point: point.objective <= (1 + NEAR) * best)
        cost = f"{design.objective:.6f}"
        rows.append((name, way, cost, program.solves, near, first(design, optimal), poses or ""))
    return rows


HEAD = (
    "mechanism",
    "route",
    "cost",
    "solves of the dynamics",
    "until within a thousandth of the best cost",
    f"until the residual is {OPTIMAL:g}",
    "solves of poses",
)


def main(quick: bool = False) -> list[tuple]:
    rows = []
    for name, problem in problems(quick).items():
        own = rows_of(name, routes(problem, quick))
        table(HEAD, own, output(f"fidelities_{name.replace(' ', '_').replace(',', '')}{'_quick' if quick else ''}.md"))
        rows += own
    return rows


if __name__ == "__main__":
    command(main, __doc__, "a tenth of the slider-crank's motion, without CMA-ES")
