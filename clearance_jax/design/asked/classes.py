"""Tolerance classes of a clearance: ISO 286 fits, gears of DIN 3967, or clearances between limits, with costs."""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.design.asked.costs import AbstractCost, CostTable
from clearance_jax.design.asked.specification import Specification
from clearance_jax.errors import ClearanceError, unknown_name, wrong_value
from clearance_jax.joints.fits import Fit
from clearance_jax.joints.fits import fit as fit_of
from clearance_jax.joints.gears import GearBacklash
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import parameters, units_of
from clearance_jax.units import format_quantity

CLEARANCE, RADIUS = ".radial_clearance", ".pin_radius"
# The least clearance of a class that begins at contact [m]: the joint must turn.
SMALLEST = 1e-7
# A choice counts as the cheapest below this relative gap, which solves do not resolve.
CHEAPEST = 1e-5


class ToleranceClass(NamedTuple):
    """A tolerance class of a clearance: its `name`, the `least` and the `greatest` value that is made [m], of the
    backlash of an angle [rad], its `cost` (`None`: that of the greatest value by the variable's cost law), and the ISO
    286 `fit` if it is one; `unit` of the values.
    """

    name: str
    least: float
    greatest: float
    cost: float | None = None
    fit: Fit | None = None
    unit: str = "m"

    def __str__(self) -> str:
        least, greatest = (format_quantity(end, self.unit) for end in (self.least, self.greatest))
        return f"{self.name}: {least} to {greatest}"


Entry = str | ToleranceClass | GearBacklash
Candidates = Mapping[str, Sequence[Entry] | Mapping[Any, float]]
"""The classes to choose from by variable: names of fits, fits with their costs, pairs of gears (`cj.gears.backlash`),
whose backlash at the wheel counts, or classes of your own.
"""


@dataclasses.dataclass(frozen=True)
class ChosenClasses:
    """The classes that a search has chosen, and how good they are.

    - `chosen`: the class of each variable that has classes; empty where no combination was found that holds.
    - `cost` of them, and `bound`: what the cheapest combination costs at least, as far as the optima of the continuous
      problems in the boxes are global ones; `relaxed`: the cost of the continuous problem between the ends of the
      lists (NaN: it has none).
    - `nodes` and `solves` of the search, out of `combinations`.
    - `doubts`: why searches of continuous problems ended early, if some did.
    """

    chosen: dict[str, ToleranceClass]
    cost: float
    bound: float
    relaxed: float
    nodes: int
    solves: int
    combinations: int
    doubts: tuple[str, ...]

    @property
    def gap(self) -> float:
        """The relative gap between the cost and its lower bound; infinite if nothing was chosen."""
        return max(0.0, (self.cost - self.bound) / abs(self.cost)) if self.chosen else np.inf

    @property
    def optimality(self) -> str:
        """A sentence on how good the choice is."""
        least = "By the bounds of the search no combination of classes is cheaper"
        if not np.isfinite(self.gap):
            return "The search has no bound yet, so another combination of classes may be cheaper"
        text = least if self.gap <= CHEAPEST else f"{least} by more than {self.gap:.2%}"
        return text + " (some bounds are in doubt)" * bool(self.doubts)

    @property
    def sentences(self) -> list[str]:
        """Sentences on the search and on how good the choice is."""
        searched = f"branch and bound: {self.nodes} nodes, {self.solves} solves for {self.combinations} combinations"
        if self.chosen:
            continuous = "" if np.isnan(self.relaxed) else f"; continuous clearances would cost {self.relaxed:.6g}"
            searched += f". {self.optimality}{continuous}"
        return [searched] + [f"a bound is in doubt, as its search {doubt}" for doubt in self.doubts]


NONE_CHOSEN = ChosenClasses({}, np.nan, -np.inf, np.nan, 0, 0, 0, ())
"""The result of a search that was stopped before its first node."""


def least_ends(names: Sequence[str], x: np.ndarray, chosen: Mapping[str, ToleranceClass]) -> np.ndarray:
    """The variables (n,), those with classes at the least value of their class."""
    return np.array([max(chosen[n].least, SMALLEST) if n in chosen else v for n, v in zip(names, x, strict=True)])


def fit_costs(names: Iterable[str], diameter: float, hole: AbstractCost, shaft: AbstractCost) -> dict[str, float]:
    """The costs of fits by name: the cost of the hole's tolerance plus that of the shaft's.

    **Arguments:** `names` such as "H7/g6"; `diameter`: the nominal one [m]; `hole`, `shaft`: cost laws of the
    tolerance of a diameter [m], each of one process (boring, reaming, grinding), with constants of your shop.
    """
    fits = {name: fit_of(diameter, name) for name in names}
    ends = {name: (*fit.hole, *fit.shaft) for name, fit in fits.items()}
    return {name: float(hole(b - a)) + float(shaft(d - c)) for name, (a, b, c, d) in ends.items()}


def diameters_of(mechanism: Mechanism, names: Iterable[str]) -> dict[str, float]:
    """The nominal diameter [m] of the joint of each radial clearance: twice the pin's radius."""
    known = parameters(mechanism)
    joints = [name.removesuffix(CLEARANCE) for name in names if name.endswith(CLEARANCE)]
    return {j + CLEARANCE: 2 * float(known[j + RADIUS].value) for j in joints if j + RADIUS in known}


def classes_of(
    specification: Specification, candidates: Candidates, diameters: Mapping[str, float] | None = None
) -> dict[str, tuple[ToleranceClass, ...]]:
    """The classes to choose from by variable, the tightest first; of equal greatest clearances the cheapest is kept.
    Classes whose greatest clearance is not within the variable's bounds are left out. `diameters`: nominal ones by
    variable [m], by default twice the joint's pin radius.
    """
    sizes = {**diameters_of(specification.mechanism, specification.variables), **(diameters or {})}
    if not candidates:
        raise ClearanceError("`classes` wants at least one variable with classes to choose from.")
    classes = {}
    for name, given in candidates.items():
        if name not in specification.variables:
            raise unknown_name(f"There are classes for `{name}`, which is no variable.", name, specification.variables)
        costs = given if isinstance(given, Mapping) else {}
        unit = units_of(specification.mechanism, [name])[name]
        read = [_class(name, entry, costs.get(entry), sizes.get(name), unit) for entry in given]
        classes[name] = _within(name, read, specification.variables[name])
    return {name: classes[name] for name in specification.variables if name in classes}


def _class(variable: str, name: Entry, cost: float | None, diameter: float | None, unit: str) -> ToleranceClass:
    if isinstance(name, ToleranceClass):
        made = name if cost is None else name._replace(cost=cost)
    elif isinstance(name, GearBacklash):
        if unit != "rad":
            text = f"`{variable}` is no angle [{unit}], so the class {name.name} of gears says nothing of it."
            raise ClearanceError(f"{text} Give it fits, or classes of your own.").about(variable, name.name)
        made = ToleranceClass(name.name, *name.wheel_angle, cost)
    elif diameter is None:
        raise ClearanceError(
            f"`{variable}` has no nominal diameter, so the fit {name!r} says nothing of it: give `diameters`, or "
            "classes of your own (`ToleranceClass`)."
        ).about(variable, name)
    else:
        fit = fit_of(diameter, name)
        made = ToleranceClass(fit.name, *fit.radial_clearance, cost, fit)
    made = made._replace(unit=unit)
    if made.least > made.greatest:
        raise ClearanceError(
            f"The class {made.name} of `{variable}` has its ends in the wrong order ({made}). Exchange them."
        ).about(variable, made.name)
    if not (made.least >= 0 and made.greatest > 0):
        raise ClearanceError(
            f"The class {made.name} of `{variable}` is no clearance fit: it leaves {made.least:g} to {made.greatest:g} "
            f"{made.unit}. Take a looser one."
        ).about(variable, made.name)
    if made.cost is not None and not (math.isfinite(made.cost) and made.cost > 0):
        raise wrong_value(
            f"The cost of the class {made.name} of `{variable}`", "a positive number", made.cost, shown=str(made.cost)
        )
    return made


def _within(variable: str, read: Sequence[ToleranceClass], between: tuple[float, float]) -> tuple[ToleranceClass, ...]:
    if not read:
        raise ClearanceError(f"There is no class for `{variable}`. Give at least one, or leave the variable out.")
    priced = [entry.cost is not None for entry in read]
    if any(priced) and not all(priced):
        raise ClearanceError(f"Some classes of `{variable}` have a cost and some have none. Give all a cost, or none.")
    low, high = between
    kept: dict[float, ToleranceClass] = {}
    for entry in sorted(read, key=lambda entry: (entry.greatest, entry.cost or 0.0)):
        if low <= entry.greatest <= high:
            kept.setdefault(entry.greatest, entry)
    if not kept:
        unit = read[0].unit
        listed = ", ".join(f"{entry.name} {format_quantity(entry.greatest, unit)}" for entry in read)
        raise ClearanceError(
            f"No class of `{variable}` has its greatest clearance within the variable's bounds, "
            f"{format_quantity(low, unit)} to {format_quantity(high, unit)} ({listed}). Change the one or the other."
        ).about(variable, listed)
    return tuple(kept.values())


def priced(specification: Specification, classes: Mapping[str, tuple[ToleranceClass, ...]]) -> Specification:
    """The problem with cost curves through the costs of classes, for variables whose classes have costs. **Raises**
    `ClearanceError` if a variable has no cost then, or if a looser class costs more.
    """
    laws = dict(zip(specification.variables, specification.costs, strict=False))
    for name, listed in classes.items():
        if listed[0].cost is not None:
            x, y = [entry.greatest for entry in listed], [entry.cost for entry in listed]
            laws[name] = CostTable(x, y) if len(x) > 1 else CostTable([0.5 * x[0], x[0]], [y[0], y[0]])
    for name in specification.variables:
        if name not in laws:
            raise ClearanceError(
                f"Classes are chosen by cost, but `{name}` has none. Give every variable a cost, or its classes costs."
            ).about(name)
    for name, listed in classes.items():
        costs = [float(laws[name](entry.greatest)) for entry in listed]
        for (tight, less), (loose, more) in itertools.pairwise(zip(listed, costs, strict=True)):
            if more > less * (1 + CHEAPEST):
                raise ClearanceError(
                    f"The class {loose.name} of `{name}` costs more ({more:g}) than the tighter one {tight.name} "
                    f"({less:g}), but the search wants costs that fall as the clearance grows. Leave {loose.name} out."
                ).about(name, loose.name)
    return dataclasses.replace(specification, costs=tuple(laws[name] for name in specification.variables))
