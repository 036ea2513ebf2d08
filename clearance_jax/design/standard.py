"""The nearest standard fits to a design, and the share of what is made with them that holds the limits."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.stats

from clearance_jax.ask.place import Place, place_of
from clearance_jax.design.answer import Design
from clearance_jax.design.classes import SMALLEST, ToleranceClass, diameters_of
from clearance_jax.design.evaluate import FEW, simulations_of, yield_of
from clearance_jax.design.evaluation import SLACK
from clearance_jax.design.manufacture import YieldEstimate
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import fits

# Standard deviations between the middle and the limits of a tolerance.
SIGMAS = 3.0


class StandardFits(NamedTuple):
    """ISO fits for a design.

    - `fits`: by variable (a variable that is no joint's clearance keeps its designed value).
    - `worst`, `least`: the most violated scaled limit with every clearance at its fit's greatest, and at its least.
    - `yield_estimate`: of random samples.
    """

    fits: dict[str, fits.Fit]
    worst: float
    least: float
    yield_estimate: YieldEstimate

    @property
    def shares(self) -> tuple[float, float]:
        """What the worst limit has of its bound with every clearance at its greatest, and at its least."""
        return 1 + self.worst, 1 + self.least

    def __str__(self) -> str:
        lines = [f"{name}: {found}" for name, found in self.fits.items()]
        greatest, least = self.shares
        lines.append(
            f"The worst limit reaches {greatest:.4f} of its bound with every clearance at its greatest, "
            f"{least:.4f} at its least."
        )
        return "\n".join([*lines, str(self.yield_estimate)])


def nearest_fits(
    design: Design,
    diameters: Mapping[str, float] | None = None,
    samples: int = 200,
    seed: int = 0,
    cluster: Any = None,
) -> StandardFits | None:
    """The loosest common fits whose greatest clearances, all together, hold the limits; `None` if there are none.

    The search begins with the loosest fits within the designed clearances. As long as the limits hold, it loosens one
    joint after the other by one fit: the one that gains most. Holes and shafts of the samples are normal about the
    middle of their tolerances, whose limits are three standard deviations away.

    **Arguments:** `design`: the answer of a problem; `diameters`: nominal ones by variable [m], by default twice the
    joint's pin radius; `samples`: how many for the yield, by `seed`; `cluster`: as of `ToleranceProblem.solve`.
    """
    with place_of(cluster) as place:
        return _nearest(design, diameters or {}, samples, seed, place)


def _nearest(
    design: Design, diameters: Mapping[str, float], samples: int, seed: int, place: Place
) -> StandardFits | None:
    specification = design.specification.nominal()
    names = list(design.clearances)
    designed = specification.values(design.evaluation.x)
    sizes = {**diameters_of(design.mechanism, names), **diameters}
    fitted = [i for i, name in enumerate(names) if name in sizes]
    if not fitted:
        raise ClearanceError("No variable is a radial clearance of known diameter: give `diameters`.")
    # The tightest first: a chosen fit is a place in its list.
    lists = {i: sorted(fits.fits_within(sizes[names[i]], 1.0), key=_greatest) for i in fitted}
    chosen = {i: max(sum(_greatest(f) <= designed[i] for f in lists[i]) - 1, 0) for i in fitted}
    simulations, scenarios = simulations_of(specification, place=place), scenarios_of(specification)
    exact = design.program.gradients > 0 and len(designed) <= FEW  # by the program that is compiled already

    def worst(places):
        x = designed.copy()
        for i in fitted:
            x[i] = _greatest(lists[i][places[i]])
        # Not `program.at`: the bounds on the variables are for designs, and a fit's ends may lie outside.
        return float(np.max(simulations.worst(x, scenarios, exact)))

    while worst(chosen) > SLACK:
        # A tightest fit wider than the design, islands, or errors that do not grow with the clearance: all tighter.
        if not any(chosen.values()):
            return None
        chosen = {i: max(place - 1, 0) for i, place in chosen.items()}
    growing = True
    while growing:
        looser = [{**chosen, i: place + 1} for i, place in chosen.items() if place + 1 < len(lists[i])]
        looser.sort(key=lambda p: _gain(design, lists, chosen, p), reverse=True)
        growing = next((p for p in looser if worst(p) <= SLACK), None)
        chosen = growing or chosen
    made = {names[i]: lists[i][place] for i, place in chosen.items()}
    return _judged(design, {name: _as_class(fit) for name, fit in made.items()}, samples, seed, place)


def chosen_fits(design: Design, samples: int = 200, seed: int = 0, cluster: Any = None) -> StandardFits:
    """The classes that a design has chosen, as `nearest_fits` gives fits.

    **Arguments:** `design`: the answer of a problem that was solved with `classes`; `samples`, `seed`, `cluster`: as of
    `nearest_fits`.

    **Raises:** `ClearanceError` where none were chosen.
    """
    if design.classes is None or not design.classes.chosen:
        raise ClearanceError("No classes were chosen: solve the problem with `classes`.")
    with place_of(cluster) as place:
        return _judged(design, design.classes.chosen, samples, seed, place)


def _as_class(fit: fits.Fit) -> ToleranceClass:
    return ToleranceClass(fit.name, *fit.radial_clearance, fit=fit)


def _judged(design: Design, made: Mapping[str, ToleranceClass], samples: int, seed: int, place: Place) -> StandardFits:
    """Limits with classes at their ends, and the yield of parts that are made to them."""
    specification = design.specification.nominal()
    names, designed = list(design.clearances), specification.values(design.evaluation.x)
    judge = design.specification.as_designed()
    simulations, scenarios = simulations_of(judge, place=place), scenarios_of(specification)
    exact = design.program.gradients > 0 and len(designed) <= FEW

    def worst(end: str) -> float:
        ends = [max(getattr(made[n], end), SMALLEST) if n in made else x for n, x in zip(names, designed, strict=True)]
        return float(np.max(simulations.worst(np.array(ends), scenarios_of(judge), exact)))

    rng = np.random.default_rng(seed)
    drawn = np.tile(designed, (samples, 1))
    for i, name in enumerate(names):
        if name in made:
            drawn[:, i] = np.maximum(_draw(made[name], samples, rng), SMALLEST)
    sampled = [Scenario(s.title, s.values, row / designed, s.values) for s in scenarios for row in drawn]
    found = {name: one.fit for name, one in made.items() if one.fit is not None}
    estimate = yield_of(specification, designed, sampled, exact, place)
    return StandardFits(found, worst("greatest"), worst("least"), estimate)


def _greatest(found: fits.Fit) -> float:
    return found.radial_clearance[1]


def _gain(design, lists, chosen, moved) -> float:
    """What a looser fit gains: cost, or clearance where there is none."""
    (i,) = (i for i in chosen if moved[i] != chosen[i])
    before, after = (_greatest(lists[i][p[i]]) for p in (chosen, moved))
    cost = design.specification.costs[i] if design.specification.costs else (lambda c: -c)
    return float(cost(before) - cost(after))


def _draw(made: ToleranceClass, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Radial clearances of parts made to a class: of a fit the hole and the shaft are drawn."""

    def drawn(low: float, high: float) -> np.ndarray:
        normal = scipy.stats.truncnorm.rvs(-SIGMAS, SIGMAS, size=samples, random_state=rng)
        return np.asarray((low + high) / 2 + normal * (high - low) / (2 * SIGMAS))

    if made.fit is None:
        return drawn(made.least, made.greatest)
    hole, shaft = drawn(*made.fit.hole), drawn(*made.fit.shaft)
    return (hole - shaft) / 2
