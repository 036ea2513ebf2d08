"""Models of manufacture: parts as designed, over a band below the designed clearance, or scattered about it.

Your own model is a subclass of `AbstractManufacture`; with an entry in `MANUFACTURE` studies can name it.
"""

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.stats

from clearance_jax.design.search import yields
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.parameters import describe, physical
from clearance_jax.sweep.axes import check_scatter, sample_points

# The relative standard deviation above which a number scatters log-normally.
WIDE = 0.2


class Part(NamedTuple):
    """A part as it is made.

    - `title`: a suffix for the title of the condition; `is_design`: whether it is the design itself.
    - `factors` (n,): on the variables of the design; `others`: factors on other numbers, by name; `values`: other
      numbers as they are, by name.
    """

    title: str
    factors: np.ndarray
    others: Mapping[str, float] = {}
    values: Mapping[str, float] = {}
    is_design: bool = False


class AbstractManufacture(abc.ABC):
    """A model of manufacture: the parts that are made of a design, and how their limits are judged."""

    is_sampled: ClassVar[bool] = False
    """Whether parts are samples: then a design has a yield, and fresh samples can be drawn."""

    title: ClassVar[str] = ""
    """The name of the single number that replaces the limits of all parts in a condition; empty: there is none."""
    among: ClassVar[str] = ""
    """In words, the parts over which the largest value of each limit is taken; empty: each part counts by itself."""
    is_design: ClassVar[bool] = False
    """Whether the only part is the design itself."""
    scattered: ClassVar[tuple[str, ...]] = ()
    """Names of the numbers that scatter."""
    doubt: ClassVar[str] = ""
    """A sentence on why the design may miss its target, if that is known before the search; else empty."""

    def check(self) -> None:
        """Raise `ClearanceError` for numbers that are not allowed."""
        return

    def check_worth(self, name: str, worth: Any, is_given: bool) -> None:
        """Raise `ClearanceError` if a number of a condition cannot scatter as it is asked to.

        **Arguments:** `name` of a number that scatters and is no variable; its value (`worth`) in the condition;
        `is_given`: whether the condition sets it.
        """
        return

    @abc.abstractmethod
    def parts(self, names: tuple[str, ...], fresh: int = 0, seed: int | None = None) -> list[Part]:
        """The parts of a design with variables of these names; if parts are samples, `fresh` > 0 asks for so many new
        ones, by `seed`.
        """

    def judge(self, values: np.ndarray, slopes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
        """The numbers (k,) that must not exceed 0 in one condition, and their slopes (k, n); by default every limit of
        every part.

        **Arguments:** `values`: scaled limits of all parts (parts, m); `slopes`: their derivatives (parts, m, n).
        """
        return values.ravel(), None if slopes is None else slopes.reshape(-1, slopes.shape[-1])


@dataclasses.dataclass(frozen=True)
class AsDesigned(AbstractManufacture):
    """Every part is exactly as designed."""

    is_design: ClassVar[bool] = True

    def parts(self, names, fresh=0, seed=None):
        return [Part("", np.ones(len(names)), is_design=True)]

    def __str__(self) -> str:
        return "as designed"


@dataclasses.dataclass(frozen=True)
class Band(AbstractManufacture):
    """Made clearances lie between `least` times the designed clearance and the designed clearance, which is their upper
    limit. The limits must hold at `points` values between these, the same in all joints, and at every corner of this
    range, if there are at most `corners` joints.
    """

    least: float = physical("", above=0.0, below=1.0, help="the least share of the designed clearance", example="0.8")
    points: int = describe("values between, all joints alike", "3", least=2, most=1000, default=3)
    corners: int = describe("the largest number of joints whose corners are all judged", "3", most=12, default=3)

    def check(self):
        if not 0 < self.least < 1:
            raise wrong_value("`Band.least`", "between 0 and 1", self.least, shown=str(self.least))

    def parts(self, names, fresh=0, seed=None):
        rows = self.factors(len(names))
        return [Part(f", clearances times {' '.join(f'{f:g}' for f in row)}", row) for row in rows]

    def factors(self, count: int) -> np.ndarray:
        """Factors on the designed clearances, shape (parts, count)."""
        self.check()
        along = np.append(np.linspace(self.least, 1.0, self.points), 1.0)[:, None] * np.ones(count)
        if 1 < count <= self.corners:
            grid = np.stack(np.meshgrid(*[[self.least, 1.0]] * count), -1).reshape(-1, count)
            along = np.concatenate([along, grid])
        return np.unique(along, axis=0)


@dataclasses.dataclass(frozen=True)
class Yield(AbstractManufacture):
    """At least the share `target` of the made parts must hold all limits, in every condition.

    **Arguments:**

    - `scatter`: name -> relative standard deviation, of variables and of any other number, also of wear
      ("wear.coefficient"). The numbers are independent; their distribution is normal, and from 0.2 on log-normal. A
      number that is no variable may have a distribution instead (`cj.scatter(...)`, or one of `scipy.stats`), and must
      if its mean is zero.
    - `target`: the share.
    - `samples`: the number of points of a scrambled Sobol sequence with this `seed`, the same for all designs (common
      random numbers). As many purely random samples would say less about rare parts. `None`: the power of two that is
      at least 5 / (1 - target).
    - `confidence`: with which the made parts have this yield; 0: no margin is left for the samples being few.

    The design is limited by the conditional value at risk of the worst scaled limit: its mean over the worst (1 -
    target) of the samples (Rockafellar and Uryasev 2000). It is at least the quantile that the yield is about, and has
    a derivative. With few samples it is too small by chance. So the mean is taken over fewer of them, as many as the
    `confidence` allows (`design.search.yields.confidence_of` has the formula). With fewer than log(1 - confidence) /
    log(target) samples, the worst one decides, and a `YieldWarning` says which yield they support.
    """

    scatter: Mapping[str, Any] = describe(
        "relative standard deviations by the numbers' names, below 100 percent; log-normal from 20 percent on",
        '{ "slider.mass" = "2 percent" }',
    )
    target: float = physical("", above=0.0, below=1.0, default=0.99, help="the share", example="0.95")
    samples: int | None = describe(
        "samples of a Sobol sequence", "256", "what the target needs", least=1, most=1_000_000, default=None
    )
    seed: int = describe("its seed", "1", default=0)
    confidence: float = physical(
        "",
        least=0.0,
        below=1.0,
        default=yields.CONFIDENCE,
        help="with which the made parts have this share",
        example="0.9",
    )
    is_sampled: ClassVar[bool] = True

    @property
    def title(self):
        return f"yield of {self.target:.4g}"

    @property
    def scattered(self):
        return tuple(self.scatter)

    @property
    def count(self) -> int:
        """The number of samples."""
        return yields.samples_to_search(self.target) if self.samples is None else self.samples

    @property
    def doubt(self):
        if not self.confidence or self.count >= yields.samples_needed(self.target, self.confidence):
            return ""
        supported = yields.yield_supported(self.count, self.confidence)
        return (
            f"{self.count} samples support a yield of {supported:.4g} at {self.confidence:.4g} confidence, but the "
            f"target is {self.target:.6g}: the made parts may fall short of it. Give at least "
            f"{yields.samples_needed(self.target, self.confidence)} `samples`, or leave them out "
            f"({yields.samples_to_search(self.target)})."
        )

    def check(self):
        if not 0 < self.target < 1 or not 0 <= self.confidence < 1 or (self.samples is not None and self.samples < 1):
            raise ClearanceError(
                "`Yield` wants a target between 0 and 1, a confidence from 0 to below 1, and at least one sample, but "
                f"they are {self.target}, {self.confidence} and {self.samples}."
            ).about("Yield", (self.target, self.confidence, self.samples))
        for name, deviation in self.scatter.items():
            if not isinstance(deviation, int | float):
                check_scatter(name, deviation)
            elif not 0 <= deviation < 1:
                raise ClearanceError(
                    f"The scatter of `{name}` must be relative, not negative and below 1 (100 %), but it is "
                    f"{deviation:g}."
                ).about(name, deviation)

    def check_worth(self, name, worth, is_given):
        deviation = self.scatter[name]
        if not isinstance(deviation, int | float):
            if is_given:
                raise ClearanceError(
                    f"`{name}` scatters by a distribution, which would take the place of the condition's value. Give a "
                    "relative deviation (in percent), which is one about this value, or leave it out of the condition."
                ).about(name, np.asarray(worth).tolist())
        elif deviation and not np.any(worth):
            raise ClearanceError(
                f"`{name}` is zero, and so a relative scatter (in percent) of it is none. Give a distribution with an "
                "absolute deviation."
            ).about(name, 0.0)

    def parts(self, names, fresh=0, seed=None):
        draws = self.draws(names, fresh, seed)
        rows = np.stack([draws[name] for name in names], axis=1)
        parts = []
        for i, row in enumerate(rows):
            others = {name: column[i] for name, column in draws.items() if name not in names}
            factors = {name: x for name, x in others.items() if isinstance(self.scatter[name], int | float)}
            values = {name: x for name, x in others.items() if name not in factors}
            parts.append(Part(f", sample {i + 1}", row, factors, values))
        return parts

    def draws(self, names: tuple[str, ...], fresh: int = 0, seed: int | None = None) -> dict[str, np.ndarray]:
        """Draws (samples,) by name: factors on the scattered numbers and on all `names` (1 without scatter), and values
        of numbers with a distribution. `fresh` > 0: so many purely random samples. **Raises** `ClearanceError` for a
        variable with a distribution.
        """
        self.check()
        count, seed = fresh or self.count, self.seed if seed is None else seed
        if fresh or not self.scatter:
            normal = np.random.default_rng(seed).standard_normal((count, len(self.scatter)))
        else:
            normal = _normal_scores(len(self.scatter), count, seed)
        draws = {name: np.ones(count) for name in names}
        for (name, deviation), column in zip(self.scatter.items(), normal.T, strict=True):
            if isinstance(deviation, int | float):
                # A normal factor with a large deviation could be negative.
                wide = np.sqrt(np.log1p(deviation**2))
                draws[name] = 1 + deviation * column if deviation < WIDE else np.exp(wide * column - 0.5 * wide**2)
            elif name in names:
                raise ClearanceError(
                    f"`{name}` is a variable: it scatters about what is designed, so give a relative deviation."
                )
            else:
                draws[name] = deviation.ppf(scipy.stats.norm.cdf(column))
        return draws

    def judge(self, values, slopes):
        pairs = np.arange(len(values)), np.argmax(values, axis=1)
        worst = values[pairs]
        weights = self.weights(worst)
        return np.array([float(weights @ worst)]), None if slopes is None else (weights @ slopes[pairs])[None]

    def weights(self, worst: np.ndarray) -> np.ndarray:
        """The weights (samples,) of the mean over the worst samples, by their worst scaled limits; their sum is 1."""
        tail, weights = yields.worst_parts(len(worst), self.target, self.confidence), np.zeros(len(worst))
        # `tail` need not be whole: its last sample counts by the part of it that is left (2.5: 1, 1, 0.5, 0, ...).
        weights[np.argsort(-worst)] = np.clip(tail - np.arange(len(worst)), 0.0, 1.0) / tail
        return weights

    def __str__(self) -> str:
        worst = yields.worst_parts(self.count, self.target, self.confidence)
        scattered = ", ".join(self.scatter) or "nothing"
        asked = f"{scattered} scattered; {self.target:.6g} of the parts must hold every limit"
        return f"{asked}: of {self.count} samples the worst {worst:.3g} on average"


@dataclasses.dataclass(frozen=True)
class Neighbours(AbstractManufacture):
    """Each limit is judged by its largest value among the design and neighbours whose variables differ by `scatter`,
    for chaotic motions. One more neighbour exceeds the largest of n with probability 1 / (n + 1).
    """

    scatter: float = physical("", above=0.0, default=0.01, help="relative standard deviation", example="0.01")
    samples: int = describe("the design and its neighbours", "8", least=2, default=8)
    seed: int = describe("of the Sobol sequence", "1", default=0)

    @property
    def among(self):
        return f", largest of {self.samples} neighbours"

    def parts(self, names, fresh=0, seed=None):
        rows = 1 + self.scatter * _normal_scores(len(names), self.samples, self.seed)
        rows[0] = 1.0
        return [Part(f", neighbour {i}" if i else "", row, is_design=not i) for i, row in enumerate(rows)]

    def judge(self, values, slopes):
        which = np.argmax(np.where(np.isnan(values), np.inf, values), axis=0)
        pairs = which, np.arange(values.shape[1])
        return values[pairs], None if slopes is None else slopes[pairs]

    def __str__(self) -> str:
        largest = "as designed; of each limit the largest counts"
        return f"{largest} among {self.samples} neighbours within {self.scatter:.0%}"


def _normal_scores(width: int, count: int, seed: int) -> np.ndarray:
    """The normal scores (count, width) of a scrambled Sobol sequence."""
    return scipy.stats.norm.ppf(sample_points("sobol", width, count, seed))


MANUFACTURE: Mapping[str, type[AbstractManufacture]] = {"band": Band, "yield": Yield}
"""Models of manufacture by their names in a study."""
