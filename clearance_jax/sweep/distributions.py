"""How a number scatters: by its quantiles, so that any sequence of points between 0 and 1 samples it."""

import abc
from typing import NamedTuple

import numpy as np
import scipy.special
import scipy.stats
from jaxtyping import Float

from clearance_jax.errors import ClearanceError


class AbstractDistribution(abc.ABC):
    """How a number scatters (SI)."""

    @abc.abstractmethod
    def check(self, name: str) -> None:
        """Raise for constants that say nothing; `name`: whose they are."""

    @abc.abstractmethod
    def quantile(self, share: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The number below which a share (0 to 1) of all lies."""


class _Normal(NamedTuple):
    mean: float
    deviation: float


class Normal(_Normal, AbstractDistribution):
    """Normal, by its `mean` and standard `deviation`."""

    def check(self, name):
        _positive(name, self.deviation)

    def quantile(self, share):
        return self.mean + self.deviation * scipy.special.ndtri(share)


class LogNormal(_Normal, AbstractDistribution):
    """Log-normal, by its `mean` and standard `deviation`: for what scatters widely and is never negative, as
    coefficients of wear do.
    """

    def check(self, name):
        _positive(name, self.deviation)
        if not 0 < self.mean < np.inf:
            raise ClearanceError(f"The mean of `{name}`, which is log-normal, must be above zero, not {self.mean}.")

    def quantile(self, share):
        wide = np.log1p((self.deviation / self.mean) ** 2)
        return self.mean * np.exp(np.sqrt(wide) * scipy.special.ndtri(share) - 0.5 * wide)


class _Uniform(NamedTuple):
    least: float
    greatest: float


class Uniform(_Uniform, AbstractDistribution):
    """Uniform from `least` to `greatest`."""

    def check(self, name):
        _ordered(name, self.least, self.greatest)

    def quantile(self, share):
        return self.least + (self.greatest - self.least) * share


class _TruncatedNormal(NamedTuple):
    mean: float
    deviation: float
    least: float
    greatest: float


class TruncatedNormal(_TruncatedNormal, AbstractDistribution):
    """Normal, of which only what lies from `least` to `greatest` is there: parts that were measured and sorted.
    `mean` and `deviation` are those before sorting.
    """

    def check(self, name):
        _positive(name, self.deviation)
        _ordered(name, self.least, self.greatest)

    def quantile(self, share):
        ends = (self.least - self.mean) / self.deviation, (self.greatest - self.mean) / self.deviation
        inside = scipy.stats.truncnorm.ppf(share, *ends, loc=self.mean, scale=self.deviation)
        return np.clip(inside, self.least, self.greatest)


def _positive(name: str, deviation: float) -> None:
    if not 0 < deviation < np.inf:
        raise ClearanceError(f"The deviation of `{name}` must be greater than zero, but it is {deviation}.")


def _ordered(name: str, least: float, greatest: float) -> None:
    if not -np.inf < least < greatest < np.inf:
        raise ClearanceError(f"`{name}` must scatter from its least to a greater number, not {least} to {greatest}.")
