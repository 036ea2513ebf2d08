"""Verification of a design by another solver and a tighter tolerance, and its certificate in numbers and sentences."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.optimize

from clearance_jax.design.asked.formulation import formulate
from clearance_jax.design.asked.specification import Specification
from clearance_jax.design.judge.static import static_error, static_weights
from clearance_jax.design.search.evaluate import fresh_yield, most_violated
from clearance_jax.design.search.methods import Method
from clearance_jax.design.search.program import BudgetSpent, Evaluation, Program
from clearance_jax.design.search.run import INTERRUPTED, run
from clearance_jax.design.search.scaling import feasible_neighbour, optimality
from clearance_jax.design.search.yields import YieldEstimate
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.signals import PositionError
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import DYNAMICS, SMALLEST
from clearance_jax.units import format_quantity

# A limit holds in a fresh simulation if it is violated by at most this share of its bound.
HELD = 1e-6


@dataclasses.dataclass(frozen=True)
class Certificate:
    """The results of the verification of a design. It prints itself in sentences.

    - `names`: the variables, with their units; `x` (n,): their values; `objective`: the cost, or minus the common
      clearance.
    - `worst`: the most violated scaled limit (value over bound, minus 1) in a fresh simulation, by another `solver`
      with a tenth of the `rtol`; `limit`: its name.
    - `scale`: the common factor on all clearances at which a limit is just met, by bisection with that solver (1: the
      design itself; NaN: a bound of a variable is met first).
    - `islands`: intervals of this factor in which the limits hold.
    - `residual`: that of the Karush-Kuhn-Tucker conditions, relative to the gradient of the objective, in logarithms;
      `prices`: for each active limit, the relative change of the objective per relative change of its bound.
    - `price_checks`: name -> (price, price by solving again with the bound 1 % up and down), if asked for.
    - `among`: among which parts each limit is judged at once, in words; then there is no scale and no residual.
    - `optimality`: for chosen classes a statement instead of the residual; `least`: the most violated scaled limit with
      every clearance at the least of its class; `target`: the yield that was asked for.
    - `yield_estimate`: of a `Yield`, on fresh samples; `static`: for each limit on a point's error, how far play alone
      can move the point of the mechanism at rest [m].
    - `starts`: the objectives that other starts led to; `goal`: what a looser bound does, in words.
    """

    names: dict[str, str]
    x: np.ndarray
    worst: float
    limit: str
    scale: float
    islands: tuple[tuple[float, float], ...]
    residual: float
    prices: dict[str, float]
    price_checks: dict[str, tuple[float, float]]
    starts: tuple[float, ...]
    objective: float
    goal: str
    yield_estimate: YieldEstimate | None
    static: dict[str, float]
    solver: str
    rtol: float
    among: str = ""
    optimality: str = ""
    least: float | None = None
    target: float | None = None

    @property
    def holds(self) -> bool:
        """Whether the limits hold in the fresh simulation, to a millionth of their bounds; with chosen classes at both
        ends of these.
        """
        return self.worst <= HELD and (self.least is None or self.least <= HELD)

    @property
    def yields(self) -> bool:
        """Whether the share of fresh samples that hold all limits is at least the target."""
        return self.yield_estimate is None or self.target is None or self.yield_estimate.share >= self.target

    def __str__(self) -> str:
        pairs = zip(self.names.items(), self.x, strict=True)
        at = ", ".join(f"{name} = {format_quantity(value, unit)}" for (name, unit), value in pairs)
        greatest, not_held = self.worst <= HELD, "THE LIMITS DO NOT HOLD"
        met = f"meet it at {self.scale:.9f} times the design"
        if np.isnan(self.scale):
            met = "meet no limit within their bounds" if greatest else "hold at no size within their bounds"
        lines = [
            f"Certificate for {at}",
            f"  {'The limits hold' if greatest else not_held} in a fresh simulation ({self.solver}, rtol "
            f"{self.rtol:.0e}): the closest is {self.limit}, at {1 + self.worst:.9f} of its bound.",
        ]
        if self.least is not None:
            verdict, least = "the limits hold" if self.least <= HELD else not_held, f"{1 + self.least:.9f} of the bound"
            lines.append(f"  With every variable at the least of its class {verdict}: {least}.")
        if not self.among:
            what = "clearances" if all(name.endswith("clearance") for name in self.names) else "variables"
            lines.append(f"  Scaled together, the {what} {met}.")
        spans = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in self.islands) or "none"
        alone = "in one piece" if len(self.islands) == 1 else f"in {len(self.islands)} ISLANDS"
        lines.append(f"  Along that line designs hold {alone}: {spans} times the design.")
        optimal = f"(Karush-Kuhn-Tucker) residual {self.residual:.1e}"
        if self.among or np.isnan(self.residual):
            optimal = f"is not known, as {'slopes say nothing' if self.among else 'no slope was asked for'}"
        lines.append(f"  {self.optimality or f'Optimality {optimal}'}.")
        for name, price in self.prices.items():
            again = f" (re-optimised: {self.price_checks[name][1]:.4g} %)" if name in self.price_checks else ""
            lines.append(f"  A bound 1 % looser on {name} {self.goal} by {price:.4g} %{again}.")
        if self.yield_estimate is not None:
            lines.append(f"  {self.yield_estimate} {self.yield_estimate.against(self.target)}".rstrip())
        for name, value in self.static.items():
            lines.append(
                f"  Limit on {name}: at rest, play alone causes an error of at most {format_quantity(value, 'm', 4)}. "
                "A larger error comes from motion or forces."
            )
        if self.starts:
            others = [s for s in self.starts if s < self.objective - 1e-4 * abs(self.objective)]
            better = (
                f"{len(others)} LED TO A BETTER DESIGN, {min(others):.6g}" if others else "none led to a better one"
            )
            lines.append(f"  {len(self.starts)} other starts: {better}.")
        return "\n".join(lines)


# The approximate number of evaluations of the root search for the scale.
BISECTION = 16
OTHER = {"tsit5": "dopri8"}
# The tolerance of the other solver over that of the design.
FINER = 0.1
# Two solves differ by at most SOLVES_DIFFER of a bound: designs with larger violations are not moved inside, unless
# motions are chaotic. Otherwise bounds are tightened by MORE times the violation, at most TRIES times.
SOLVES_DIFFER, MORE, TRIES = 1e-2, 2.0, 4


def _judging(specification: Specification, solver: str | None) -> tuple[str, float]:
    """The solver of the verification, by default another than the design's, and its tolerance."""
    return solver or OTHER.get(specification.solver, "tsit5"), max(FINER * specification.rtol, SMALLEST)


def judge_of(
    specification: Specification,
    solver: str | None = None,
    place: Any = None,
    progress: Callable[[Evaluation], None] | None = None,
) -> Program:
    """The program of the problem by another solver and a tenfold tighter tolerance, always by the dynamics."""
    solver, rtol = _judging(specification, solver)
    return formulate(specification.judged_by(DYNAMICS), rtol, solver, place, progress=progress)


def moved_inside(
    program: Program, method: Method, point: Evaluation, fresh: Program, among: str = ""
) -> tuple[Evaluation, dict[str, float]]:
    """The point of a method, moved inside until its limits also hold by the `fresh` program; and by limit the share of
    its bound by which it was tightened. A violation above `SOLVES_DIFFER` is left, but not where a limit is judged
    among neighbours: another solver then sees other motions of the same design, and what differs is their spread.
    """
    differ = np.inf if among else SOLVES_DIFFER
    tightened: dict[str, float] = {}
    for _ in range(TRIES):
        judged = fresh.at(point.x, method.gradients)
        # By limit its largest violation, which comes last.
        over = {fresh.groups[k]: float(judged.limits[k]) for k in np.argsort(judged.limits) if judged.limits[k] > HELD}
        if judged.worst > differ or not over:
            break
        tightened |= {name: tightened.get(name, 0.0) + MORE * part for name, part in over.items()}
        inner = program
        for name, part in tightened.items():
            inner = inner.with_bound(name, 1 - part)
        try:
            # Try smaller clearances first, which costs one solve and little of the objective.
            if feasible_neighbour(inner, point.x, method.gradients) is None:
                _run(inner, method, point.x)
        except BudgetSpent:
            break
        if inner.best is None:
            break
        point = program.at(inner.best.x, method.gradients)
    return point, tightened


def certify(
    specification: Specification,
    method: Method,
    point: Evaluation,
    *,
    least: np.ndarray | None = None,
    sweep: int = 40,
    starts: int = 0,
    reoptimise: bool = False,
    samples: int | None = None,
    seed: int = 0,
    solver: str | None = None,
    place: Any = None,
    progress: Callable[[Evaluation], None] | None = None,
    fresh: Program | None = None,
) -> Certificate:
    """Verify the point of a method with another solver and a tenfold tighter tolerance.

    **Arguments:** `least` (n,): the other end of what is made, which must hold too; `sweep`: scalings at which the
    limits are looked at between a tenth of the design and the bounds; `starts`: random starts of the same method;
    `reoptimise`: check the prices by solving again with changed bounds; `samples`: fresh ones for a `Yield` (default:
    as many as its target needs); `solver`: which one (default: another than the design's); `fresh`: what `judge_of`
    gives, if it is there; `place`: where many simulations are solved; `progress`: called with each evaluation, about
    `expected_evaluations` of them.
    """
    solver, rtol = _judging(specification, solver)
    fresh = fresh or judge_of(specification, solver, place, progress)
    at = fresh.at(point.x, method.gradients)
    residual, multipliers = optimality(fresh, at) if at.gradient is not None else (np.nan, np.zeros(len(at.limits)))
    prices, sampled = dict[str, float](), specification.manufacture.is_sampled
    for k in np.flatnonzero(multipliers > 1e-6):
        prices[fresh.groups[k]] = prices.get(fresh.groups[k], 0.0) + float(multipliers[k])
    judge, checked = specification.as_designed().judged_by(DYNAMICS), prices if reoptimise else {}
    again = functools.partial(formulate, specification, place=place, progress=progress)
    checks = {name: (price, _price_check(again(), method, point, name)) for name, price in checked.items()}
    return Certificate(
        # A common clearance has the first unit.
        names=dict(zip(fresh.names, specification.units.values(), strict=False)),
        x=point.x,
        worst=at.worst,
        limit=fresh.limit_names[int(np.argmax(at.limits))],
        # The largest value of neighbours jumps, so there is no scale at which it meets a bound.
        scale=np.nan if specification.manufacture.among else _scale(fresh, point.x, at),
        islands=_islands(fresh, point.x, sweep),
        residual=residual,
        prices=prices,
        price_checks=checks,
        starts=_others(again, method, starts, seed),
        objective=at.objective,
        goal="enlarges the clearance" if specification.common else "lowers the cost",
        yield_estimate=fresh_yield(specification, point.x, samples, place=place) if sampled else None,
        target=getattr(specification.manufacture, "target", None),
        static=_static(specification, point.x),
        solver=solver,
        rtol=rtol,
        among=specification.manufacture.among,
        least=None if least is None else most_violated(judge, method.gradients, place, rtol, solver)(least),
    )


def _static(specification: Specification, x: np.ndarray) -> dict[str, float]:
    """The static error by limit on a point's error [m], of the condition where it is largest; for driven mechanisms."""
    designed = replace(specification.mechanism, specification.clearances(x))
    errors: dict[str, float] = {}
    for limit in specification.limits:
        if limit.ages or not limit.metric.base_metric.ranked or not isinstance(limit.signal, PositionError):
            continue
        for values in specification.conditions.values():
            moved = specification.move(designed, values)
            try:
                weights = static_weights(moved, limit.signal.point, specification.t1, t0=specification.t0)
            except ClearanceError:
                continue
            errors[limit.title] = max(static_error(moved, weights), errors.get(limit.title, 0.0))
    return errors


def expected_evaluations(
    searched: int, among: str = "", *, sweep: int = 40, starts: int = 0, reoptimise: bool = False, **_
) -> int:
    """About how many evaluations `Design.verify` takes after a search of `searched`; `among`: as of manufacture."""
    return 1 + BISECTION * (not among) + sweep + searched * (starts + 2 * reoptimise)


def _others(again: Callable[[], Program], method: Method, starts: int, seed: int) -> tuple[float, ...]:
    """The objectives of searches from random starts, each with a new program."""
    objectives, rng = [], np.random.default_rng(seed)
    for _ in range(starts):
        program = again()
        start = np.exp(rng.uniform(np.log(program.lower), np.log(program.upper)))
        objectives.append(_run(program, method, start, np.inf))
    return tuple(objectives)


def _run(program: Program, method: Method, start: np.ndarray, none: float = np.nan) -> float:
    """The best objective of a run (or `none`), in which an interruption ends the whole verification."""
    if run(program, method, start) == INTERRUPTED:
        raise KeyboardInterrupt
    return program.best.objective if program.best else none


def _scale(program: Program, x: np.ndarray, at: Evaluation) -> float:
    """The factor on all variables, nearest to 1, at which the worst limit is just met; NaN if bounds come first."""
    low, high = _ends(program, x)

    def worst(s):
        return program.at(s * x).worst

    # Search outwards if the design holds its limits, else inwards, until they change from held to violated.
    holds, step, s, before = at.worst <= 0, 1e-5, 1.0, 1.0
    while (worst(s) <= 0) == holds:
        if s == (high if holds else low):
            return np.nan
        s, before, step = (min(1 + step, high) if holds else max(1 - step, low)), s, 4 * step
    good, bad = (before, s) if holds else (s, before)
    return float(scipy.optimize.brentq(worst, good, bad, xtol=1e-12, rtol=1e-10)) if worst(good) < 0 else float(good)


def _ends(program: Program, x: np.ndarray) -> tuple[float, float]:
    """The scalings beyond which no variable changes any more: all are at their bounds."""
    return float(np.min(program.lower / x)), float(np.max(program.upper / x))


def _islands(program: Program, x: np.ndarray, count: int) -> tuple[tuple[float, float], ...]:
    """The intervals of scalings whose designs are feasible, to the spacing of `count` scalings."""
    low, high = _ends(program, x)
    s = np.unique(np.append(np.geomspace(max(low, 0.1), max(min(high, 10.0), 1.0), count), 1.0))
    holds = np.array([point.worst <= HELD for point in program.at_each([v * x for v in s])])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return tuple((float(s[a]), float(s[b - 1])) for a, b in edges.reshape(-1, 2))


def _price_check(program: Program, method: Method, point: Evaluation, name: str) -> float:
    """Relative change of the best objective per relative change of one limit's bound, by two more searches."""
    looser, tighter = (_run(program.with_bound(name, 1 + change), method, point.x) for change in (0.01, -0.01))
    return float((tighter - looser) / 0.02 / abs(point.objective))
