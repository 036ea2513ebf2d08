"""How parts come out of manufacture: over a band below the designed clearance, or scattered about what was designed."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.stats

from clearance_jax.errors import ClearanceError

# Relative standard deviation from which on a number scatters log-normally.
WIDE = 0.2


class Band(NamedTuple):
    """Made clearances lie between `least` times the designed one and the designed one, which is their upper limit: the
    limits must hold on `points` values between, all joints alike, and at every corner for up to `corners` joints.
    """

    least: float
    points: int = 3
    corners: int = 3

    def check(self) -> None:
        """Raise for numbers that say nothing."""
        if not 0 < self.least < 1:
            raise ClearanceError(f"`Band.least` must be between 0 and 1, but it is {self.least}.")

    def factors(self, count: int) -> np.ndarray:
        """Factors on the designed clearances, shape (scenarios, count)."""
        self.check()
        along = np.append(np.linspace(self.least, 1.0, self.points), 1.0)[:, None] * np.ones(count)
        if 1 < count <= self.corners:
            grid = np.stack(np.meshgrid(*[[self.least, 1.0]] * count), -1).reshape(-1, count)
            along = np.concatenate([along, grid])
        return np.unique(along, axis=0)


class Yield(NamedTuple):
    """A share `target` of what is made holds all limits, in every condition.

    **Arguments:** `scatter`: name -> relative standard deviation, of variables and of any other number, also of wear
    ("wear.coefficient"); independent, normal, and log-normal from 0.2 on; `target`: the share; `samples`: of a
    scrambled Sobol sequence, one and the same for all designs (common random numbers; so few purely random ones would
    hardly know the tail), by `seed`.

    The limit is the conditional value at risk of the worst scaled limit: its mean over the worst (1 - target) of the
    samples (Rockafellar and Uryasev 2000), which is no less than the quantile that the yield is about, and has a
    derivative. Samples fewer than 1 / (1 - target) leave one of them to decide.
    """

    scatter: Mapping[str, float]
    target: float = 0.99
    samples: int = 256
    seed: int = 0

    def check(self) -> None:
        """Raise for numbers that say nothing."""
        if not 0 < self.target < 1 or self.samples < 1:
            raise ClearanceError(
                f"`Yield` wants a target between 0 and 1, and at least one sample, but they are {self.target} and "
                f"{self.samples}."
            )
        for name, deviation in self.scatter.items():
            if not 0 <= deviation < 1:
                raise ClearanceError(
                    f"The scatter of `{name}` must be relative, not negative and below 1 (100 %), but it is "
                    f"{deviation:g}."
                )

    def draws(self, names: tuple[str, ...], fresh: int = 0, seed: int | None = None) -> dict[str, np.ndarray]:
        """Factors on each scattered number, shape (samples,); of `names` all, 1 where one does not scatter. Of `fresh`
        samples, so many purely random ones.
        """
        self.check()
        count, seed = fresh or self.samples, self.seed if seed is None else seed
        if fresh or not self.scatter:
            normal = np.random.default_rng(seed).standard_normal((count, len(self.scatter)))
        else:
            sequence = scipy.stats.qmc.Sobol(len(self.scatter), rng=seed).random_base2(int(np.ceil(np.log2(count))))
            normal = scipy.stats.norm.ppf(sequence[:count])
        found = {name: np.ones(count) for name in names}
        for (name, deviation), column in zip(self.scatter.items(), normal.T, strict=True):
            # A normal factor that scatters by so much would be negative for some.
            wide = np.sqrt(np.log1p(deviation**2))
            found[name] = 1 + deviation * column if deviation < WIDE else np.exp(wide * column - 0.5 * wide**2)
        return found

    def weights(self, worst: np.ndarray) -> np.ndarray:
        """Of each sample (its worst scaled limit) in the conditional value at risk; they add up to 1."""
        tail = max((1 - self.target) * len(worst), 1.0)
        order = np.argsort(-worst)
        weights = np.zeros(len(worst))
        weights[order] = np.clip(tail - np.arange(len(worst)), 0.0, 1.0) / tail
        return weights


class YieldEstimate(NamedTuple):
    """Of fresh samples: the share that holds all limits, and the least yield that this proves at 95 % confidence
    (Clopper and Pearson 1934).
    """

    share: float
    least: float
    samples: int

    def __str__(self) -> str:
        return f"Yield {self.share:.4%} of {self.samples} fresh samples: at least {self.least:.4%} at 95 % confidence."


def estimate_yield(held: np.ndarray) -> YieldEstimate:
    """From which samples (n,) held all limits."""
    n, k = len(held), int(np.sum(held))
    least = float(scipy.stats.beta.ppf(0.05, k, n - k + 1)) if k else 0.0
    return YieldEstimate(k / n, least, n)
