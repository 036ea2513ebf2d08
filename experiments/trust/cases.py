"""Designs of every kind, drawn with one seed, and what is asked of each: metric, parameter, time span."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax import metrics
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run
from experiments.trust.scenes import CLEARANCE, FAMILIES, FORCE, Numbers, random_scenes

STEP = 0.02
RTOL, SWEEP_RTOL = 1e-8, 1e-10
GRID = 33
WINDOW = 0.1


class Case(NamedTuple):
    """A design and what is asked of it."""

    family: str
    kind: str
    metric: str
    parameter: str
    numbers: Numbers
    end: float

    @property
    def column(self) -> int:
        """Which of the numbers the parameter is."""
        return FAMILIES[self.family].parameters[self.parameter]


@cache
def _primal(family: str, kind: str) -> Callable[[Any], Any]:
    """A function of numbers (7,) and an end: a number of the motion, far more accurate than a report has it."""
    known = FAMILIES[family]

    def of(lane):
        mechanism, end = known.scene(Numbers(*lane["numbers"])), lane["end"]
        options = {"rtol": SWEEP_RTOL, "solver": "dopri8"}
        if kind == "peak time":
            return FORCE.times(mechanism, end, rtol=RTOL)[0]
        if kind == "impacts":
            return metrics.Impacts("play")(mechanism, end, rtol=RTOL)
        metric = known.metrics[kind]
        if isinstance(metric, metrics.Peak):
            return metric(mechanism, end, **options)
        return metric(run(mechanism, end, settings_of(mechanism, end, options)))

    return of


def evaluated(
    kind: str,
    numbers: np.ndarray,
    ends: np.ndarray,
    points: np.ndarray,
    family: str = "plane",
    columns: Any = CLEARANCE,
) -> np.ndarray:
    """A number of motions for every case (cases, 7) with each of its `points` (cases, points) in the `columns`."""
    moved = np.repeat(numbers[:, None], points.shape[1], 1)
    moved[np.arange(len(moved)), :, columns] = points
    lanes = {"numbers": moved.reshape(-1, numbers.shape[1]), "end": np.repeat(ends, points.shape[1])}
    return np.asarray(cj.batch(_primal(family, kind), lanes)).reshape(points.shape)


def at_events(family: str, seen: str, scenes: list[Numbers], ends: np.ndarray, rng: np.random.Generator) -> dict:
    """Of the scenes those near which `seen` jumps over the clearance, by number, moved to within a step of the jump."""
    numbers = np.array(scenes)
    grid = numbers[:, :1] * np.linspace(1 - WINDOW, 1 + WINDOW, GRID)
    values = evaluated(seen, numbers, ends, grid, family)
    # A time moves smoothly by less than this share of a period from one grid point to the next.
    jump = 0.5 if seen == "impacts" else 0.25 / numbers[:, 2]
    jumps = np.abs(np.diff(values, axis=1)) > np.broadcast_to(np.asarray(jump), len(numbers))[:, None]
    has, first = np.any(jumps, axis=1), np.argmax(jumps, axis=1)
    # The grid is finer than the step: where between two of its points the jump is, does not matter.
    moved = grid[np.arange(len(numbers)), first] * (1 + STEP * rng.uniform(-0.8, 0.8, len(numbers)))
    return {i: scenes[i]._replace(clearance=float(moved[i])) for i in np.flatnonzero(has)}


class Draws(NamedTuple):
    """How many scenes of a family are drawn, and of what kind: damping factors [s/m] and ends [periods of the drive],
    each between two; `event`: what must jump within the step; `later`: by how many periods then the end is put off.
    """

    family: str
    kind: str
    count: int
    damping: tuple[float, float]
    ends: tuple[float, float]
    event: str = ""
    later: tuple[float, float] = (0.0, 0.0)


DRAWS = (
    Draws("plane", "regular, short", 80, (0.05, 50), (0.8, 2)),
    Draws("plane", "chaos", 50, (0.02, 0.2), (4, 7)),
    Draws("plane", "regular, damped", 60, (20, 200), (2, 6)),
    Draws("plane", "grazing", 50, (0.1, 20), (1, 3), "impacts"),
    Draws("plane", "ties", 50, (0.1, 20), (1, 3), "peak time"),
    # What jumps with the parameter: the motion a while after an impact that happens or not.
    Draws("plane", "jumps", 40, (0.1, 5), (1, 3), "impacts", (0.2, 0.6)),
    Draws("worn", "regular, short", 60, (0.05, 50), (0.5, 1.5)),
    Draws("worn", "chaos", 35, (0.02, 0.5), (3, 6)),
    Draws("worn", "regular, damped", 35, (20, 200), (1, 3)),
    Draws("worn", "grazing", 20, (0.1, 20), (1, 3), "impacts"),
    Draws("sleeve", "regular, short", 60, (0.05, 50), (0.4, 1.2)),
    Draws("sleeve", "chaos", 40, (0.02, 0.5), (2, 5)),
    Draws("sleeve", "regular, damped", 40, (20, 200), (0.5, 2)),
    Draws("sleeve", "grazing", 20, (0.1, 20), (0.5, 2), "impacts"),
    Draws("arm", "swing", 16, (5, 500), (0.04, 0.25)),
)
QUICK = tuple(Draws("plane", kind, 4, DRAWS[i].damping, DRAWS[i].ends) for i, kind in enumerate(("regular", "chaos")))


def cases(draws: tuple[Draws, ...], seed: int) -> list[Case]:
    """What is asked of the designs that are drawn."""
    rng = np.random.default_rng(seed)
    return [case for drawn in draws for case in _drawn(drawn, rng)]


def _drawn(of: Draws, rng: np.random.Generator) -> list[Case]:
    scenes = random_scenes(rng, of.count, of.damping, of.family)
    ends = np.array([rng.uniform(*of.ends) / n.frequency for n in scenes])
    asked = FAMILIES[of.family].asked
    chosen = at_events(of.family, of.event, scenes, ends, rng) if of.event else dict(enumerate(scenes))
    out = []
    for i, numbers in chosen.items():
        # Peaks tie in forces, and events are those of the clearance.
        metric, parameter = asked[1] if of.event == "peak time" else asked[i % (2 if of.event else len(asked))]
        parameter = asked[0][1] if of.event else parameter
        end = ends[i] + rng.uniform(*of.later) / numbers.frequency
        out.append(Case(of.family, of.kind, metric, parameter, numbers, float(end)))
    return out
