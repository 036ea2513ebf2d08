"""Explanations of a design: contributions of clearances to limits, trade-offs of bound and cost, lives under wear."""

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.ask.answers import place_of
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.conditions import without_wear
from clearance_jax.design.asked.formulation import formulate
from clearance_jax.design.asked.specification import Limit, Scenario, scenarios_of
from clearance_jax.design.search.evaluate import Simulations, simulations_of
from clearance_jax.design.search.program import SLACK, Evaluation, Program
from clearance_jax.design.search.run import INTERRUPTED, run
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.solve.settings import QUASI_STATIC
from clearance_jax.units import format_quantity
from clearance_jax.wear import AbstractAged

FACTORS = (0.6, 0.8, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0)


class Response(NamedTuple):
    """How a `limit` (its label) depends on the variables, where it is nearest to its `bound`.

    - `where`: in which condition; `value`: there, in the metric's `unit`.
    - `slopes`: derivatives by each variable, in `unit` per the variable's unit (`units`).
    - `contributions`: slope times clearance: the part of the value that each variable causes, to first order.
    """

    limit: str
    where: str
    unit: str
    value: float
    bound: float
    units: dict[str, str]
    slopes: dict[str, float]
    contributions: dict[str, float]

    @property
    def rest(self) -> float:
        """The value minus all contributions: from deformation, inertia, play that is not a variable."""
        return self.value - sum(self.contributions.values())

    def share(self, part: float) -> float:
        """A part of the value over the bound."""
        return part / self.bound

    def sensitivity(self, name: str) -> str:
        """The slope by a variable, with its unit."""
        of, by, slope = self.unit, self.units[name], self.slopes[name]
        if by == "m":  # a clearance changes by micrometres
            of, by, slope = ("um", "um", slope) if of == "m" else (of, "um", 1e-6 * slope)
        return f"{slope:.4g} {of or 1} per {by or 1}"

    def __str__(self) -> str:
        value, bound = (format_quantity(number, self.unit, 5) for number in (self.value, self.bound))
        lines = [f"{self.where}: {value} of {bound}"]
        for name, part in self.contributions.items():
            share = f"{self.share(part):.1%} of the bound"
            lines.append(f"  {name}: {format_quantity(part, self.unit, 4)} ({share}), {self.sensitivity(name)}")
        rest = f"{format_quantity(self.rest, self.unit, 4)} ({self.share(self.rest):.1%})"
        return "\n".join([*lines, f"  the rest: {rest}"])


def responses(design: Design) -> tuple[Response, ...]:
    """How each limit depends on the variables, at the design itself, for parts as designed (neither `Band` nor
    `Yield`).

    **Arguments:** `design`: the answer of a problem.

    **Raises:** `ClearanceError` for a metric without derivatives.
    """
    asked, specification = design.specification, design.specification.nominal()
    if asked.manufacture.among:  # slopes of the dynamics are useless
        specification = specification.judged_by(QUASI_STATIC)
    x, simulations = specification.values(design.evaluation.x), simulations_of(specification)
    by = " by quasi-static poses" * bool(asked.manufacture.among)
    solved = [(scenario.title, *simulations.limits(x, scenario, True)) for scenario in scenarios_of(specification)]
    ends = np.cumsum([0, *simulations.sizes()])
    out = []
    for i, limit in enumerate(specification.limits):
        # The scenario and the peak in it that come nearest to the bound.
        rows = slice(ends[i], ends[i + 1])
        title, limits, slopes = max(solved, key=lambda f: np.max(f[1][rows]))
        k = ends[i] + int(np.argmax(limits[rows]))
        by_name = dict(zip(specification.variables, (slopes[k] * limit.bound).tolist(), strict=True))
        parts = {name: slope * c for (name, slope), c in zip(by_name.items(), x.tolist(), strict=True)}
        label, unit, value = limit.label, limit.metric.unit, float((1 + limits[k]) * limit.bound)
        out.append(Response(label, label + title + by, unit, value, limit.bound, design.units, by_name, parts))
    return tuple(out)


class Tradeoff(NamedTuple):
    """The best objective that was found for each bound on one `limit`.

    - `bounds` (n,) in the limit's `unit`; `objectives` (n,), NaN: no design holds the bound; `designs`: the clearances
      by name, `None` there.
    - `label`: what the limit is, in words; `asked`: the bound of the design problem itself; `units` of the variables.
    """

    limit: str
    unit: str
    bounds: np.ndarray
    objectives: np.ndarray
    designs: tuple[dict[str, float] | None, ...]
    label: str
    asked: float
    units: Mapping[str, str] = MappingProxyType({})

    def __str__(self) -> str:
        lines = [f"Trade-off of {self.label}:"]
        for bound, objective, at in zip(self.bounds, self.objectives, self.designs, strict=True):
            # The objective of a largest clearance is minus that.
            words = [f"cost {objective:.6g}"] if objective > 0 else []
            words += [f"{n} = {format_quantity(x, self.units.get(n, ''), 5)}" for n, x in (at or {}).items()]
            told = ", ".join(words) or "no design was found"
            lines.append(f"  bound {format_quantity(float(bound), self.unit, 5)}: {told}")
        return "\n".join(lines)


def tradeoff(
    design: Design,
    limit: str = "",
    factors: Sequence[float] = FACTORS,
    progress: Callable[[str], None] | None = None,
    cluster: Any = None,
) -> Tradeoff:
    """The cost (or minus the common clearance) as a function of the bound of one limit. The problem is solved again for
    each bound but its own, outwards from the design, from the answer of the bound before.

    Every point is kept in the record of the design, if it has one. So a trade-off that was interrupted goes on from it.

    **Arguments:** `design`: the answer of a problem; `limit`: its title, by default that of the limit nearest to its
    bound; `factors`: on the bound; `progress`: called with each evaluation, in words; `cluster`: as of
    `ToleranceProblem.solve`.

    **Raises:** `ClearanceError` for an unknown limit, and for factors that are not positive.
    """
    titles = list(dict.fromkeys(design.program.groups))
    limit = limit or design.program.groups[int(np.argmax(design.evaluation.limits))]
    if limit not in titles:
        raise unknown_name(f"There is no limit {limit!r}.", limit, titles, "limit")
    if not factors or not all(math.isfinite(f) and f > 0 for f in factors):
        raise ClearanceError(f"`factors` must be positive numbers, but they are {list(factors)}.")
    with place_of(cluster) as place:
        program = _traded(design, limit, factors, progress, place)
    # For each factor on the bound the best of all evaluated points, whichever search has found it.
    is_moved, best = np.array([group == limit for group in program.groups]), []
    for factor in factors:
        bounds = np.where(is_moved, factor, 1.0)
        feasible = [p for p in program.history if np.all((1 + p.limits) / bounds - 1 <= SLACK)]
        best.append(min(feasible, key=lambda p: p.objective, default=None))
    asked = {wanted.title: wanted for wanted in design.specification.limits}.get(limit)
    bound, unit, label = (1.0, "", limit) if asked is None else (asked.bound, asked.metric.unit, asked.label)
    objectives = np.array([np.nan if p is None else p.objective for p in best])
    clearances = tuple(None if p is None else design.specification.clearances(p.x) for p in best)
    return Tradeoff(limit, unit, bound * np.array(factors), objectives, clearances, label, bound, design.units)


def _traded(
    design: Design, limit: str, factors: Sequence[float], progress: Callable[[str], None] | None, place: Any
) -> Program:
    """The program of a design with all points of the searches for the bounds."""
    words = ""

    def tell(_: Evaluation) -> None:
        if progress is not None:
            progress(f"{words}, {program.solves} designs")

    # Points of the record are read from it.
    known = {"record": design.program.record} if design.program.record else {"known": design.program.points}
    program = formulate(design.specification, place=place, progress=tell, **known)
    # Start from the answer of the bound before, not from the best known point: so a search that is repeated with a
    # record takes the same way, and solves nothing.
    answers = {1.0: design.evaluation.x}
    outwards = sorted({f for f in factors if f != 1.0}, key=lambda f: abs(math.log(f)))
    for i, factor in enumerate(outwards):
        words = f"trade-off, bound {i + 1} of {len(outwards)} ({factor:g} times)"
        if progress is not None:
            progress(words)
        moved = program.with_bound(limit, factor)
        nearest = min(answers, key=lambda f: abs(math.log(f / factor)))
        if run(moved, design.method, answers[nearest]) == INTERRUPTED:
            raise KeyboardInterrupt
        feasible = [point for point in moved.asked if point.feasible]
        if feasible:
            answers[factor] = min(feasible, key=lambda point: point.objective).x
    return program


# The lives to be shown, over the number of cycles asked for; clearances are chosen for these as if wear were even. Each
# life is simulated up to LONGEST times that number.
TIMES, LONGEST = (0.5, 1.0, 2.0, 4.0, 7.0), 20
# Shares of the designed clearances if an error does not grow with them.
SHARES = np.array([0.5, 0.7, 0.85, 1.0, 1.2])


class Maintenance(NamedTuple):
    """After how many cycles a `limit` (its label) is met, as a function of the clearances.

    - `shares` (n,): factors on all designed clearances; `lives` (n,), by condition (with one condition only, under an
      empty name): cycles until the limit is met, infinite if more than `most`.
    - `asked`: the number of cycles for which the limit must hold.
    """

    limit: str
    asked: int
    most: int
    shares: np.ndarray
    lives: dict[str, np.ndarray]


def maintenances(design: Design) -> tuple[Maintenance, ...]:
    """For each limit that must hold while a joint wears, after how many cycles it is met, for parts as designed.

    **Arguments:** `design`: the answer of a problem.

    **Raises:** `ClearanceError` if a life cannot be computed.
    """
    parts, out = design.specification.nominal(), []
    for limit in parts.limits:
        if not isinstance(metric := limit.metric, AbstractAged):
            continue
        asked, shares, lives = max(metric.cycles[-1], 1), _shares(design, limit), {}
        for condition, given in parts.conditions.items():
            columns = {name: shares * value for name, value in design.clearances.items()}
            of_wear = given.keys() - without_wear(parts.mechanism, [metric], given).keys()
            columns |= {name: np.full(len(shares), float(given[name])) for name in of_wear}
            now = parts.move(parts.mechanism, given)
            life = metric.lives(now, columns, parts.t1, limit.bound, LONGEST * asked, **parts.options)
            lives[parts.label(condition)] = life.end
        out.append(Maintenance(limit.label, asked, LONGEST * asked, shares, lives))
    return tuple(out)


def _shares(design: Design, limit: Limit) -> np.ndarray:
    """The shares of the designed clearances at which lives are simulated, by the room that limits leave for wear."""
    parts, x = design.specification.nominal(), design.specification.values(design.evaluation.x)
    asked = [limit.metric.base_metric], [limit.bound], tuple(parts.variables)
    simulations = Simulations(parts.mechanism, *asked, parts.t1, parts.settings())

    def margin(scenario: Scenario) -> float:
        """The share by which clearances can grow until the limit of the new mechanism is met."""
        # Numbers of wear do not affect a new part.
        new = scenario._replace(values=without_wear(parts.mechanism, [limit.metric], scenario.values))
        values, slopes = simulations.limits(x, new, True)
        assert slopes is not None
        k = int(np.argmax(values))
        grows = float(slopes[k] @ x)
        return -float(values[k]) / grows if grows > 0 else np.nan

    room = min(map(margin, scenarios_of(parts)))
    # The design wears by `room` until its limit is met. A life of twice the cycles needs this room a second time, by
    # which the new clearance must be smaller.
    shares = 1 + room * (1 - np.array(TIMES))
    return np.sort(shares[shares > 0.1]) if room > 0 else SHARES
