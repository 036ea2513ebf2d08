"""Order of lanes in a batch: lanes with equally many step attempts fill a chunk best.

No solve is spent on it. The first chunks, spread over the given order, show how full that order makes them. A linear
fit of their attempts over the lanes' numbers then sorts the other lanes, if this promises fuller chunks.
"""

import numpy as np
from jaxtyping import Float, Int

Lanes = Int[np.ndarray, " _"]

# Number of the first chunks, from which the order is learned.
PILOTS = 8
# They are at most this part (1 / SHARE) of a batch.
SHARE = 4
# Lanes that must be seen for each fitted number: with fewer the line would follow their scatter.
SEEN = 4


def cut(lanes: Lanes, width: int) -> list[Lanes]:
    """Chunks of `width` lanes; the last one may be shorter."""
    return [lanes[i : i + width] for i in range(0, len(lanes), width)]


def pilots(chunks: list[Lanes]) -> tuple[list[Lanes], list[Lanes]]:
    """The chunks to run first, evenly spread, and the others."""
    first = min(PILOTS, len(chunks) // SHARE)
    chosen = set(np.linspace(0, len(chunks) - 2, first).astype(int).tolist()) if first else set()
    return [chunks[i] for i in sorted(chosen)], [c for i, c in enumerate(chunks) if i not in chosen]


def as_numbers(leaves: list[np.ndarray], count: int) -> Float[np.ndarray, "lanes numbers"]:
    """The numbers in which the lanes differ, a scaled column each; a lane with an impossible number is all NaN."""
    columns = [np.real(leaf).reshape(count, -1).astype(float) for leaf in leaves]
    table = np.concatenate([*columns, np.zeros((count, 0))], axis=1)
    fine = np.all(np.isfinite(table), axis=1)
    table[~fine] = np.nan
    if not fine.any():
        return table[:, :0]
    spread = np.ptp(table[fine], axis=0)
    table = table[:, spread > 0] - table[fine].mean(axis=0)[spread > 0]
    return table / spread[spread > 0]


def sorted_lanes(
    numbers: Float[np.ndarray, "lanes columns"],
    attempts: Float[np.ndarray, " lanes"],
    tried: Lanes,
    others: Lanes,
    given: float,
    width: int,
) -> Lanes | None:
    """The lanes still to be run, the longest first (`None`: the given order is better); `attempts`: of the lanes
    `tried`; `given`: how full chunks are in the given order.
    """
    tried = tried[np.all(np.isfinite(numbers[tried]), axis=1)]
    seen, terms = len(tried), numbers.shape[1] + 1
    if terms == 1 or seen < SEEN * terms:
        return None
    # About the mean of those tried: a number that is the same in all of them then has no slope.
    mean, moved = attempts[tried].mean(), numbers - numbers[tried].mean(axis=0)
    slope, *_ = np.linalg.lstsq(moved[tried], attempts[tried] - mean, rcond=None)
    left = (attempts[tried] - mean - moved[tried] @ slope) * np.sqrt(seen / (seen - terms))
    if mean / (mean + largest_of(left, width)) <= given:
        return None
    expected = np.nan_to_num(mean + moved[others] @ slope, nan=0.0)  # impossible numbers: they end at once
    return others[np.argsort(-expected, kind="stable")]


def largest_of(draws: Float[np.ndarray, " draws"], count: int) -> float:
    """Mean of the largest of `count` draws."""
    share = np.arange(len(draws) + 1) / len(draws)
    return float(np.sort(draws) @ np.diff(share**count))
