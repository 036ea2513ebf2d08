"""The partition of a sweep's lanes into regions: blocks of lanes that are solved and written together."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

# Least number of lanes of a region: smaller regions would make too many files of a large sweep.
LEAST = 4096


class Partition(NamedTuple):
    """The regions of a grid of `shape`: blocks of the shape `chunk` (smaller at the far ends), numbered in C order."""

    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @property
    def grid(self) -> tuple[int, ...]:
        """The number of regions along each dimension."""
        return tuple(-(-size // step) for size, step in zip(self.shape, self.chunk, strict=True))

    @property
    def count(self) -> int:
        """The number of regions."""
        return math.prod(self.grid)

    def slices(self, region: int) -> tuple[slice, ...]:
        """The slices of a region in the grid."""
        places = np.unravel_index(region, self.grid)
        ends = zip(places, self.chunk, self.shape, strict=True)
        return tuple(slice(int(p) * step, min((int(p) + 1) * step, size)) for p, step, size in ends)

    def extent(self, region: int) -> tuple[int, ...]:
        """The number of lanes of a region along each dimension."""
        return tuple(part.stop - part.start for part in self.slices(region))

    def size(self, region: int) -> int:
        """The number of lanes of a region."""
        return math.prod(self.extent(region))

    def lane(self, region: int, place: int) -> int:
        """The lane at a place of a region."""
        inside = np.unravel_index(place, self.extent(region))
        where = [part.start + int(at) for part, at in zip(self.slices(region), inside, strict=True)]
        return int(np.ravel_multi_index(where, self.shape))

    def lanes(self, region: int) -> Int[np.ndarray, " lanes"]:
        """The lanes of a region by their index in the whole grid, in C order within the region."""
        ranges = [np.arange(part.start, part.stop) for part in self.slices(region)]
        return np.ravel_multi_index(np.meshgrid(*ranges, indexing="ij"), self.shape).ravel()

    def of(self, lanes: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """The regions of lanes, and the places of lanes within their regions."""
        places = np.unravel_index(lanes, self.shape)
        inside = [p % step for p, step in zip(places, self.chunk, strict=True)]
        regions = np.ravel_multi_index([p // step for p, step in zip(places, self.chunk, strict=True)], self.grid)
        here = np.zeros(len(lanes), int)
        for place, step, size, at in zip(inside, self.chunk, self.shape, places, strict=True):
            begin = at - place
            here = here * np.minimum(step, size - begin) + place
        return regions, here


def partition(shape: Sequence[int], apart: Sequence[bool], least: int = LEAST) -> Partition:
    """Even regions of at least `least` lanes (or all). Dimensions that stay `apart` (models) are cut everywhere."""
    chunk, so_far = [1] * len(shape), 1
    for i in reversed(range(len(shape))):
        if not apart[i]:
            pieces = max(1, shape[i] // -(-least // so_far))
            chunk[i] = -(-shape[i] // pieces)
            so_far *= chunk[i]
    return Partition(tuple(shape), tuple(chunk))
