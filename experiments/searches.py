"""Searches for designs against sweeps: `python -m experiments.searches` writes out/searches_*.md.

200 problems of three mechanisms: how large may the clearance of a slider-crank's wrist or of a four-bar's knuckle be,
and which clearances of a slider-crank with two such joints are the cheapest (costs are proportional to 1 / clearance),
so that the error of a point stays within a bound? Speeds, bounds and starts are drawn at random from a seed. Every
motion has impacts.

The judge of everything is another solver with a tenfold tighter tolerance. By it the mechanism is swept over its
clearances, once for each speed, and once more about the best place of each problem. The best of all places that hold
the bound is compared with the answer of the search:

- *short*: by which part of the best value (clearance, or cost) the answer is worse. A negative number says that the
  answer is better than the best place of the sweep, which has gaps between its places.
- *over*: by which part of its bound the error of the answer exceeds it, by the judge. The search held its limits.

`SHORT` is the part that is allowed; what exceeds it is listed.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax.design import Design, Limit, Reciprocal, ToleranceProblem
from clearance_jax.metrics import Peak, PositionError
from experiments.common import SCENES, output, table
from experiments.publish import command, say

SEED, RTOL, SHORT = 7, 1e-6, 0.01
LOWER, UPPER = 1e-5, 1e-3
# Places of a first sweep along each of one or two clearances; of the sweep about the best place, and its half-width.
PLACES, ABOUT, AROUND = {1: 256, 2: 28}, {1: 63, 2: 13}, {1: 0.02, 2: 0.2}


class Kind(NamedTuple):
    """Problems of one mechanism: its scene and point, the variables, the largest speed of its crank [rad/s], how many
    turns it makes, and how many speeds and problems of each there are.
    """

    scene: str
    point: str
    variables: tuple[str, ...]
    speed: float
    turns: float
    speeds: int
    each: int


KINDS = {
    "slider-crank": Kind("slider_crank", "piston", ("wrist.radial_clearance",), 600.0, 3.0, 7, 10),
    "four-bar": Kind("four_bar", "tip", ("knuckle.radial_clearance",), 150.0, 1.5, 7, 10),
    "slider-crank, two": Kind(
        "slider_crank_two_clearances",
        "piston",
        ("crankpin.radial_clearance", "wrist.radial_clearance"),
        600.0,
        1.5,
        6,
        10,
    ),
}


class Row(NamedTuple):
    """A problem and what was found: `x` (n,) by the search, and `best` (n,) by the sweep [m]; how much worse the search
    is; the error of its answer over the bound, less 1, by the judge; evaluations; what the search said.
    """

    kind: str
    speed: float
    bound: float
    x: np.ndarray
    best: np.ndarray
    short: float
    over: float
    solves: int
    said: str


def main(quick: bool = False) -> list[Row]:
    kinds = {"slider-crank": KINDS["slider-crank"]._replace(turns=0.5, speeds=1, each=3)} if quick else KINDS
    rng, rows = np.random.default_rng(SEED), []
    for name, kind in kinds.items():
        mechanism = cj.load(SCENES / f"{kind.scene}.toml")
        judged, own = judge_of(kind, mechanism), []
        for speed in kind.speed * rng.uniform(0.3, 1.0, kind.speeds):
            own += list(_compare(name, kind, cj.replace(mechanism, {"drive.main.speed": speed}), speed, judged, rng))
            print(f"{name}, {speed:.4g} rad/s: {len(own)} problems", flush=True)
        _tell(name, own)
        rows += own
    return rows


def judge_of(kind: Kind, mechanism: cj.Mechanism) -> Callable[[np.ndarray, float], np.ndarray]:
    """The largest errors [m] at places (N, n) at a speed [rad/s], by another solver and a tenfold tighter tolerance."""
    peak = Peak(PositionError(kind.point))

    def one(lane):
        x, speed, t1 = lane
        moved = cj.replace(mechanism, {**dict(zip(kind.variables, x, strict=True)), "drive.main.speed": speed})
        return peak(moved, t1, rtol=0.1 * RTOL, solver="dopri8")

    def judged(places: np.ndarray, speed: float) -> np.ndarray:
        full = np.full(len(places), speed)
        return np.asarray(cj.batch(one, (places, full, kind.turns * 2 * np.pi / full)))

    return judged


def value(x: np.ndarray) -> np.ndarray:
    """What is to be small at places (..., n): minus one clearance, or what two of them cost."""
    return -x[..., 0] if x.shape[-1] == 1 else (2e-4 / x[..., 0] + 1e-4 / x[..., 1])


def _grid(lower: np.ndarray, upper: np.ndarray, count: int) -> np.ndarray:
    axes = np.geomspace(lower, upper, count).T
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(lower))


def _compare(name: str, kind: Kind, mechanism: cj.Mechanism, speed: float, judged, rng) -> Iterator[Row]:
    """The problems of one mechanism at one speed."""
    n = len(kind.variables)
    places = _grid(np.full(n, LOWER), np.full(n, UPPER), PLACES[n])
    errors = judged(places, speed)
    for _ in range(kind.each):
        # A bound that is met somewhere inside.
        inside = np.flatnonzero(np.all((places > 3e-5) & (places < 5e-4), axis=1))
        bound = float(errors[rng.choice(inside)] * rng.uniform(0.97, 1.03))
        start = np.exp(rng.uniform(np.log(LOWER), np.log(UPPER), n))
        begin = dict(zip(kind.variables, start.tolist(), strict=True))
        design = asked(kind, mechanism, speed, bound).solve(start=begin)
        x = design.evaluation.x
        centre = places[np.argmin(np.where(errors <= bound, value(places), np.inf))]
        near = np.clip(_grid(centre * (1 - AROUND[n]), centre * (1 + AROUND[n]), ABOUT[n]), LOWER, UPPER)
        of_near = judged(np.concatenate([near, x[None]]), speed)
        tried, tried_errors = np.concatenate([places, near]), np.concatenate([errors, of_near[:-1]])
        best = tried[np.argmin(np.where(tried_errors <= bound, value(tried), np.inf))]
        short = float((value(x) - value(best)) / abs(value(best))) if design.feasible else np.inf
        over = float(of_near[-1] / bound - 1)
        yield Row(name, speed, bound, x, best, short, over, design.program.solves, _said(design))


def asked(kind: Kind, mechanism: cj.Mechanism, speed: float, bound: float) -> ToleranceProblem:
    """One problem."""
    costs: Any = None
    if len(kind.variables) > 1:
        costs = dict(zip(kind.variables, (Reciprocal(2e-4), Reciprocal(1e-4)), strict=True))
    limit = Limit(Peak(PositionError(kind.point)), bound, kind.point)
    variables = dict.fromkeys(kind.variables, (LOWER, UPPER))
    return ToleranceProblem(mechanism, kind.turns * 2 * np.pi / speed, variables, [limit], cost=costs, rtol=RTOL)


def _said(design: Design) -> str:
    return "; ".join(text for text in (design.lack, design.stop_reason, design.note) if text)


def _tell(name: str, rows: list[Row]) -> None:
    """The problems of one mechanism in a line, and those whose answers are short."""
    short, over, solves = (np.array([getattr(row, n) for row in rows]) for n in ("short", "over", "solves"))
    found = [int(np.sum(short > SHORT)), f"{np.median(short):.2%}", f"{short.max():.2%}"]
    judged = [int(np.sum(over > 0)), f"{over.max():.1e}"]
    head = ["problems of", "count", f"short by more than {SHORT:.0%}", "median", "largest"]
    head += ["over the bound", "by at most", "evaluations, median", "most"]
    path = output(f"searches_{name.replace(', ', '_')}.md")
    table(head, [[name, len(rows), *found, *judged, f"{np.median(solves):.0f}", solves.max()]], path)
    for row in (row for row in rows if row.short > SHORT):
        at, best = (", ".join(f"{1e6 * c:.2f}" for c in x) for x in (row.x, row.best))
        say(
            f"{row.kind}, {row.speed:.5g} rad/s, {1e6 * row.bound:.5g} um: {at} um, by the sweep {best} um: short by "
            f"{row.short:.2%} after {row.solves} evaluations. {row.said}".rstrip()
        )


if __name__ == "__main__":
    command(main, __doc__, "three problems of one mechanism")
