"""Positions of a mechanism's bodies, joints, points and springs over time, from a dataset, for pictures."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.body import GROUND

# Relative to the mechanism's size: two marks of one name that come further apart belong to a spring or a slide.
APART = 0.02


class Places(NamedTuple):
    """Places [m] of marks, `at` (times, marks, axes), at `time` [s] (times,); and which of the marks are what:

    - `ground`: what the ground carries, and `bodies`: what each body carries;
    - `joints`: each joint on its child, `points`: each named point;
    - `pairs`: both ends of each spring, and of each joint that slides.

    `slides`: the direction of each joint that slides, (times, axes); `loose`: the joints with clearance.
    """

    time: np.ndarray
    at: np.ndarray
    ground: list[int]
    bodies: dict[str, list[int]]
    joints: dict[str, int]
    points: dict[str, int]
    pairs: dict[str, list[int]]
    slides: dict[str, np.ndarray]
    loose: frozenset[str]

    @property
    def size(self) -> float:
        """The largest extent along an axis [m]."""
        low, high = bounds(self.at)
        return float(max(np.max(high - low), 1e-9))


class Outline(NamedTuple):
    """A mechanism in a still picture: `places` along two axes, at a `sample`; `seen`: the axis of space along which it
    is viewed, x, y or z (in the plane empty).
    """

    places: Places
    sample: int
    seen: str

    @property
    def time(self) -> float:
        """Time of the sample [s]."""
        return float(self.places.time[self.sample])

    @property
    def visible(self) -> np.ndarray:
        """The positions in the picture [m], (n, 2): all marks at the sample, and points at all times."""
        at = self.places.at
        return np.concatenate([at[self.sample], *(at[:, mark] for mark in self.places.points.values())])


def names_of(dataset: xr.Dataset, label: str) -> list[str]:
    """The names along a dimension of a dataset; none where it has no such dimension."""
    return [str(name) for name in dataset[label].values] if label in dataset.coords else []


def bounds(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest coordinates of places (..., axes) [m], (axes,)."""
    every = at.reshape(-1, at.shape[-1])
    return np.nanmin(every, 0), np.nanmax(every, 0)


def places(dataset: xr.Dataset) -> Places:
    """The positions of a motion's marks. **Raises** `ClearanceError` for a dataset without marks."""
    if "mark_position" not in dataset:
        raise ClearanceError(
            "This result does not say where the mechanism's parts are: it was written by an older version. "
            "Simulate again."
        )
    names, owners, joined, points, loose = (
        names_of(dataset, label) for label in ("mark", "mark_body", "any_joint", "point", "joint")
    )
    bodies: dict[str, list[int]] = {}
    for mark, owner in enumerate(owners):
        bodies.setdefault(owner, []).append(mark)
    ends = {name: [mark for mark, other in enumerate(names) if other == name] for name in names}
    at = dataset["mark_position"].values
    placed = Places(
        dataset["time"].values,
        at,
        bodies.pop(GROUND, []),
        bodies,
        # A joint has a mark on its parent, then one on its child.
        {name: ends[name][-1] for name in joined},
        {name: ends[name][0] for name in points},
        {},
        {},
        frozenset(loose),
    )
    apart = {name: np.diff(at[:, pair[:2]], axis=1)[:, 0] for name, pair in ends.items() if len(pair) > 1}
    apart = {name: between for name, between in apart.items() if np.abs(between).max() > APART * placed.size}
    return placed._replace(
        pairs={name: ends[name][:2] for name in apart},
        slides={
            name: _directions(between, owners[ends[name][0]] == GROUND)
            for name, between in apart.items()
            if name in joined
        },
    )


def _directions(between: np.ndarray, fixed: bool) -> np.ndarray:
    """Unit vectors along vectors (times, axes). A short vector, whose direction play disturbs, gets that of the last
    long one; if `fixed`, all get that of the longest.
    """
    length = np.linalg.norm(between, axis=1)
    long = length >= (1.0 if fixed else 0.1) * length.max()
    last = np.maximum.accumulate(np.where(long & (not fixed), np.arange(len(long)), np.argmax(long)))
    return between[last] / length[last, None]


def outline(dataset: xr.Dataset) -> Outline:
    """A still view of a motion along the axis along which it is thinnest, at the sample at which the mechanism is least
    stretched out: joints in a line hide each other. **Raises** `ClearanceError` as `places`.
    """
    placed, axes, seen = places(dataset), [0, 1], ""
    if placed.at.shape[-1] == 3:
        low, high = bounds(placed.at)
        along = int(np.argmin(high - low))
        axes, seen = [k for k in range(3) if k != along], "xyz"[along]
    flat = places(dataset.isel(axis=axes))
    return Outline(flat, int(np.argmax(_thickness(flat.at))), seen)


def _thickness(points: np.ndarray) -> np.ndarray:
    """The thickness of sets of points (n, k, 2): their smaller singular value about the mean."""
    away = points - points.mean(axis=1, keepdims=True)
    return np.linalg.svd(away, compute_uv=False)[:, -1]
