"""The nearest standard fits to a design, and the yield of parts that are made to them."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import scipy.stats

from clearance_jax.ask.answers import place_of
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import SMALLEST, ToleranceClass, diameters_of
from clearance_jax.design.asked.specification import Scenario, scenarios_of
from clearance_jax.design.search.evaluate import most_violated, yield_of
from clearance_jax.design.search.program import SLACK
from clearance_jax.design.search.yields import USUAL, YieldEstimate, samples_needed, samples_to_judge
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import fits
from clearance_jax.units import format_quantity

# A relative difference of clearances that does not matter.
HAIR = 1e-6
# Standard deviations between the middle and the limits of a tolerance.
SIGMAS = 3.0


class StandardFits(NamedTuple):
    """ISO fits for a design.

    - `fits`: by variable (a variable that is no joint's clearance keeps its designed value).
    - `worst`, `least`: the most violated scaled limit with every clearance at its fit's greatest, and at its least.
    - `yield_estimate`: of random samples; `target`: the yield that was asked for (`None`: none was).
    - `remarks`: by variable, if a fit exceeds the bounds of the study or the designed clearance.
    """

    fits: dict[str, fits.Fit]
    worst: float
    least: float
    yield_estimate: YieldEstimate
    target: float | None = None
    remarks: Mapping[str, str] = MappingProxyType({})

    @property
    def shares(self) -> tuple[float, float]:
        """The worst limit over its bound, with every clearance at its greatest and at its least."""
        return 1 + self.worst, 1 + self.least

    def __str__(self) -> str:
        remarks = {name: f" ({text})" for name, text in self.remarks.items()}
        lines = [f"{name}: {fit}{remarks.get(name, '')}" for name, fit in self.fits.items()]
        ends = "{:.4f} of its bound with every clearance at its greatest, {:.4f} at its least".format(*self.shares)
        return "\n".join([*lines, f"The worst limit reaches {ends}.", self.judgement])

    @property
    def judgement(self) -> str:
        """A sentence on the yield, and on its target if there is one."""
        return f"{self.yield_estimate} {self.yield_estimate.against(self.target)}".rstrip()


def nearest_fits(
    design: Design,
    diameters: Mapping[str, float] | None = None,
    samples: int | None = None,
    seed: int = 0,
    cluster: Any = None,
) -> StandardFits | None:
    """The loosest common fits whose greatest clearances, all together, hold the limits; `None` if there are none.

    The search begins with the loosest fits within the designed clearances. As long as the limits hold, it loosens one
    joint after the other by one fit: the one that gains most. So a fit may be looser than its joint's clearance was
    designed, where others are tighter. Fits lie within the bounds of their variables, as far as such fits hold the
    limits. `remarks` say where one does not, and where one is looser than designed. For a `Yield` all fits are
    tightened until the samples prove its target.

    Holes and shafts of the samples are normal about the middle of their tolerances, whose limits are three standard
    deviations away. What else a `Yield` lets scatter, scatters in them too.

    **Arguments:** `design`: the answer of a problem; `diameters`: nominal ones by variable [m], by default twice the
    joint's pin radius; `samples`: how many for the yield, by `seed` (default: as many as the
    target of a `Yield` needs, else the fewest that can prove 99 %); `cluster`: as of `ToleranceProblem.solve`.
    """
    specification, names = design.specification, list(design.clearances)
    sizes = {**diameters_of(design.mechanism, names), **(diameters or {})}
    fitted = [i for i, name in enumerate(names) if name in sizes]
    if not fitted:
        raise ClearanceError("No variable is a radial clearance of known diameter: give `diameters`.")
    between = list(specification.variables.values())
    within = {i: fits.fits_within(sizes[names[i]], between[i][1], between[i][0]) for i in fitted}
    every = {i: fits.fits_within(sizes[names[i]], 1.0) for i in fitted}
    with place_of(cluster) as place:
        # If no fits within the bounds of the study hold the limits, others are tried, with remarks.
        for candidates in (within, every):
            # The tightest first: a chosen fit is a place in its list.
            lists = {i: sorted(listed, key=_greatest) for i, listed in candidates.items()}
            if all(lists.values()) and (chosen := _loosest(design, lists, place)) is not None:
                break
        else:
            return None
        while True:
            picked = {names[i]: lists[i][k] for i, k in chosen.items()}
            made = {name: ToleranceClass(fit.name, *fit.radial_clearance, fit=fit) for name, fit in picked.items()}
            judged = _judged(design, made, samples, seed, place)
            if not judged.yield_estimate.against(judged.target) or not any(chosen.values()):  # proved, or all tightest
                return judged
            chosen = {i: max(k - 1, 0) for i, k in chosen.items()}


def _loosest(design: Design, lists: Mapping[int, Sequence[fits.Fit]], place: Any) -> dict[int, int] | None:
    """The index of a fit in each list, the loosest ones that hold the limits together; `None` if none do."""
    specification = design.specification.nominal()
    designed, fitted = specification.values(design.evaluation.x), list(lists)
    chosen = {i: max(sum(_greatest(f) <= float(designed[i]) for f in lists[i]) - 1, 0) for i in fitted}
    violated = most_violated(specification, design.program.gradients > 0, place)

    def worst(places):
        x = designed.copy()
        for i in fitted:
            x[i] = _greatest(lists[i][places[i]])
        return violated(x)

    while worst(chosen) > SLACK:
        # The tightest fit may be wider than the design, or errors may not grow with clearances: tighten all.
        if not any(chosen.values()):
            return None
        chosen = {i: max(k - 1, 0) for i, k in chosen.items()}
    growing = True
    while growing:
        looser = [i for i, k in chosen.items() if k + 1 < len(lists[i])]
        looser.sort(key=lambda i: _gain(design, i, *lists[i][chosen[i] : chosen[i] + 2]), reverse=True)
        moved = ({**chosen, i: chosen[i] + 1} for i in looser)
        growing = next((places for places in moved if worst(places) <= SLACK), None)
        chosen = growing or chosen
    return chosen


def chosen_fits(design: Design, samples: int | None = None, seed: int = 0, cluster: Any = None) -> StandardFits:
    """The classes that a design has chosen, as `nearest_fits` gives fits.

    **Arguments:** `design`: the answer of a problem that was solved with `classes`; `samples`, `seed`, `cluster`: as of
    `nearest_fits`.

    **Raises:** `ClearanceError` where none were chosen.
    """
    if design.classes is None or not design.classes.chosen:
        raise ClearanceError("No classes were chosen: solve the problem with `classes`.")
    with place_of(cluster) as place:
        return _judged(design, design.classes.chosen, samples, seed, place)


def _judged(
    design: Design, made: Mapping[str, ToleranceClass], samples: int | None, seed: int, place: Any
) -> StandardFits:
    """The limits with classes at their ends, and the yield of parts made to the classes."""
    specification, names = design.specification, list(design.clearances)
    designed = specification.values(design.evaluation.x)
    target = getattr(specification.manufacture, "target", None)
    if samples is None:
        samples = samples_needed(USUAL) if target is None else samples_to_judge(target)
    exact = design.program.gradients > 0
    violated = most_violated(specification.as_designed(), exact, place)

    def worst(end: str) -> float:
        pairs = zip(names, designed, strict=True)
        return violated(np.array([max(getattr(made[n], end), SMALLEST) if n in made else x for n, x in pairs]))

    fitted = {name: entry.fit for name, entry in made.items() if entry.fit is not None}
    estimate = yield_of(specification.nominal(), designed, _sampled(design, made, samples, seed), exact, place)
    remarks = {n: text for n, entry in made.items() if (text := _beyond(design, n, entry))}
    return StandardFits(fitted, worst("greatest"), worst("least"), estimate, target, remarks)


def _sampled(design: Design, made: Mapping[str, ToleranceClass], samples: int, seed: int) -> list[Scenario]:
    """Scenarios of parts made to classes, in every condition; other numbers scatter as the problem says."""
    names, designed = list(design.clearances), design.specification.values(design.evaluation.x)
    rng = np.random.default_rng(seed)
    drawn = {names.index(name): np.maximum(_draw(entry, samples, rng), SMALLEST) for name, entry in made.items()}
    if design.specification.manufacture.is_sampled:
        sampled = scenarios_of(design.specification, samples, seed)
    else:
        whole = scenarios_of(design.specification.nominal())
        sampled = [s._replace(designed=s.values) for s in whole for _ in range(samples)]
    factors = np.array([s.factors for s in sampled], float)
    for i, column in drawn.items():
        # Every condition has the same parts.
        factors[:, i] = np.tile(column / designed[i], len(sampled) // samples)
    return [s._replace(factors=row) for s, row in zip(sampled, factors, strict=True)]


def _beyond(design: Design, name: str, made: ToleranceClass) -> str:
    """A remark if a class exceeds the bounds or the designed value of its variable; else empty."""
    designed, (least, most) = design.clearances[name], design.specification.variables[name]
    remarks = []
    if made.least < least * (1 - HAIR):
        remarks.append(f"may be below the least of the study, {format_quantity(least, 'm', 4)}")
    if made.greatest > most * (1 + HAIR):
        remarks.append(f"may be above the greatest of the study, {format_quantity(most, 'm', 4)}")
    elif made.greatest > designed * (1 + HAIR):
        remarks.append(f"may be above the designed {format_quantity(designed, 'm', 4)}, as others are tighter")
    return "; ".join(remarks)


def _greatest(fit: fits.Fit) -> float:
    return fit.radial_clearance[1]


def _gain(design: Design, i: int, fit: fits.Fit, looser: fits.Fit) -> float:
    """The gain of a looser fit of variable `i`: in cost, or in clearance if there are no costs."""
    cost = design.specification.costs[i] if design.specification.costs else (lambda c: -c)
    return float(cost(_greatest(fit)) - cost(_greatest(looser)))


def _draw(made: ToleranceClass, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Draw radial clearances (samples,) of parts made to a class; for a fit, hole and shaft are drawn."""

    def drawn(low: float, high: float) -> np.ndarray:
        normal = scipy.stats.truncnorm.rvs(-SIGMAS, SIGMAS, size=samples, random_state=rng)
        return np.asarray((low + high) / 2 + normal * (high - low) / (2 * SIGMAS))

    if made.fit is None:
        return drawn(made.least, made.greatest)
    hole, shaft = drawn(*made.fit.hole), drawn(*made.fit.shaft)
    return (hole - shaft) / 2
