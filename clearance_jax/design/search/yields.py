"""Statistics of yields: the number of samples they need, the margin for few samples, and estimates from fresh samples.

All of it is at 95 % confidence: of 100 sets of samples 95 lead to a statement that is true.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
import scipy.optimize
import scipy.stats

CONFIDENCE = 0.95
# The default number of samples is such that so many of them fail at the target: in a search (the margin that remains
# costs little, see `worst_parts`), and in a verification (it proves 19 of 20 designs of a search with normal scatter).
SEARCHED, JUDGED = 5.0, 20.0
# The number of failing parts above which the conditional value at risk needs no margin.
ENOUGH = 8.0
# The yield that the samples can prove if there is no target (fits).
USUAL = 0.99


class YieldWarning(UserWarning):
    """A warning that samples are too few for the yield that is asked for."""


def samples_needed(target: float, confidence: float = CONFIDENCE) -> int:
    """The fewest samples that support a yield: at the yield `target`, all of them hold with the probability
    1 - `confidence` (Wilks 1941).
    """
    return math.ceil(round(math.log1p(-confidence) / math.log(target), 9))


def yield_supported(samples: int, confidence: float = CONFIDENCE) -> float:
    """The largest yield that a number of samples supports."""
    return (1 - confidence) ** (1 / samples)


def samples_to_search(target: float) -> int:
    """The default number of samples of a search: a power of two, for Sobol sequences."""
    return 2 ** math.ceil(math.log2(round(SEARCHED / (1 - target), 6)))


def samples_to_judge(target: float | None) -> int:
    """The default number of fresh samples to verify a design; without a target as for 98 %."""
    return 1000 if target is None else math.ceil(round(JUDGED / (1 - target), 6))


@functools.lru_cache
def worst_parts(samples: int, target: float, confidence: float) -> float:
    """The number of worst samples whose mean a search bounds, so that the design has its yield with the `confidence`.
    At most (1 - target) N of N samples (the conditional value at risk), as for `confidence` 0. At least 1, even if this
    does not reach the `confidence`.
    """
    full = max((1 - target) * samples, 1.0)
    if confidence == 0 or full > ENOUGH or confidence_of(full, samples, target) >= confidence:
        return full
    if confidence_of(1.0, samples, target) <= confidence:
        return 1.0
    return float(scipy.optimize.brentq(lambda m: confidence_of(m, samples, target) - confidence, 1.0, full))


def confidence_of(worst: float, samples: int, target: float) -> float:
    """The probability that a yield is at least the target, if the mean of the `worst` of N random limits is 0.

    Let U_1 < U_2 < ... be the shares of parts that are worse than each sample, the worst first: those of N uniform
    numbers. Where the density of the limit falls beyond the target's quantile, its quantile function is convex there,
    and so the share of parts that fail is at most V = w_1 U_1 + w_2 U_2 + ..., with the weights of the mean (Jensen).
    V is a sum of the N + 1 spacings of uniform numbers with weights a_i = w_i + w_(i+1) + ... Spacings are exponential
    numbers over their sum, and so with e = 1 - target

        P(V <= e) = 1 - sum over a_j > e of prod over l != j of (a_j - e) / (a_j - a_l)

    (Weisberg 1971, Annals of Mathematical Statistics 42, 704, DOI 10.1214/aoms/1177693426). With one sample it is
    1 - target^N, without any condition on the density (Wilks 1941).
    """
    share, ranks = 1 - target, np.arange(math.ceil(worst))
    tails = np.cumsum((np.clip(worst - ranks, 0.0, 1.0) / worst)[::-1])[::-1] - share
    others = samples + 1 - len(tails)  # spacings with a = 0
    beyond = 0.0
    for j in np.flatnonzero(tails > 0):
        apart = np.delete(tails, j)
        beyond += float(np.prod(tails[j] / (tails[j] - apart)) * (1 + share / tails[j]) ** -others)
    return 1 - beyond


class YieldEstimate(NamedTuple):
    """A yield from `samples` fresh samples: the `share` that holds all limits, and the `least` yield that this proves
    at 95 % confidence (Clopper and Pearson 1934).
    """

    share: float
    least: float
    samples: int

    def against(self, target: float | None) -> str:
        """A sentence on a target that is not proved; else empty."""
        if target is None or self.least >= target:
            return ""
        if self.share < target:
            return f"THAT IS BELOW THE TARGET, {target:.4%}."
        needed = samples_needed(target)
        more = f"it takes {needed} at least" if self.samples < needed else "more may"
        return f"That does not prove the target, {target:.4%}: {more}."

    def __str__(self) -> str:
        return f"Yield {self.share:.4%} of {self.samples} fresh samples: at least {self.least:.4%} at 95 % confidence."


def estimate_yield(holds: np.ndarray) -> YieldEstimate:
    """The estimate of a yield from whether each sample (n,) holds all limits."""
    n, k = len(holds), int(np.sum(holds))
    least = float(scipy.stats.beta.ppf(1 - CONFIDENCE, k, n - k + 1)) if k else 0.0
    return YieldEstimate(k / n, least, n)
