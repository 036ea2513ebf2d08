"""A mechanism as it moves, in the plane or in space, by a dataset's marks: bodies as lines between their joints."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.proj3d import proj_transform

from clearance_jax.errors import ClearanceError

GROUND = "ground"
# Of the size of the mechanism: the room around it, and half the least extent that is drawn.
ROOM, LEAST = 0.12, 0.3
# A joint whose two places are further from each other than this part of the size is one that slides.
APART = 0.02
# From where space is looked at [degree].
ELEVATION, AZIMUTH = 22.0, -58.0


class Skeleton:
    """Axes with the mechanism on it; `show(i)` puts it where it is at sample `i`.

    **Arguments:** `axis`: axes, of projection "3d" where the dataset has three; `joint`: the joint to point at.
    """

    def __init__(self, axis: Any, dataset: xr.Dataset, joint: str | None = None):
        if "mark_position" not in dataset:
            raise ClearanceError(
                "This result does not say where the mechanism's parts are: it was written by an older version. "
                "Simulate again."
            )
        self.axis, self.places = axis, dataset["mark_position"].values
        self._names = [str(name) for name in dataset["mark"].values]
        self._bodies = [str(name) for name in dataset["mark_body"].values]
        self._joined = [str(name) for name in dataset["any_joint"].values]
        self._limit(axis)
        self._ground(axis)
        self._lines = self._links(axis) + self._pairs(axis)
        self._trails = self._points(axis, dataset)
        self._joints(axis, dataset, joint)
        self.show(0)

    @property
    def in_space(self) -> bool:
        """Whether it has a third axis."""
        return self.places.shape[-1] == 3

    def show(self, i: int) -> None:
        """Draw sample `i`."""
        for line, chosen in self._lines:
            _put(line, self.places[i, chosen])
        for line, mark in self._trails:
            _put(line, self.places[: i + 1, mark])
        if self._label is not None:
            text, mark = self._label
            text.xy = self._on_page(self.places[i, mark])

    def _on_page(self, place: np.ndarray) -> tuple[float, float]:
        """Where a place is in the axes' own plane."""
        if not self.in_space:
            return float(place[0]), float(place[1])
        return proj_transform(place[0], place[1], place[2], self.axis.get_proj())[:2]

    def _limit(self, axis: Any) -> None:
        """One scale along all axes, for the whole motion."""
        every = self.places.reshape(-1, self.places.shape[-1])
        low, high = np.nanmin(every, 0), np.nanmax(every, 0)
        size = self.size = float(max(np.max(high - low), 1e-9))
        half = np.maximum(0.5 * (high - low) + ROOM * size, LEAST * size)
        for name, middle, reach in zip("xyz", 0.5 * (low + high), half, strict=False):
            getattr(axis, f"set_{name}lim")(middle - reach, middle + reach)
            getattr(axis, f"set_{name}label")(f"{name}, m", labelpad=8 if self.in_space else None)
            getattr(axis, f"{name}axis").set_major_locator(MaxNLocator(nbins=3 if reach < 0.7 * half.max() else 5))
        if self.in_space:
            axis.set_box_aspect(tuple(half), zoom=0.93)
            axis.view_init(ELEVATION, AZIMUTH)
            self.low = float((0.5 * (low + high) - half)[2])
        else:
            axis.set_aspect("equal", adjustable="box")

    def _ground(self, axis: Any) -> None:
        """What the ground carries: triangles, in space posts on a floor."""
        for mark in self._of(GROUND):
            at = self.places[0, mark]
            if self.in_space:
                foot = np.array([*at[:2], min(self.low, at[2])])
                axis.plot(*np.stack([foot, at]).T, color="0.6", lw=5, solid_capstyle="butt")
                axis.plot(*foot[:, None], marker="s", ms=12, mfc="0.75", mec="0.5")
            else:
                axis.plot(*at, marker="^", ms=14, mfc="0.85", mec="0.4", zorder=0.5)

    def _links(self, axis: Any) -> list:
        """Every body as a star: from its own joint to whatever else it carries."""
        found = []
        for k, body in enumerate(dict.fromkeys(self._bodies)):
            if body == GROUND:
                continue
            first, *rest = self._of(body)
            path = [mark for other in rest for mark in (first, other)]
            style = {"lw": 4, "solid_capstyle": "round", "solid_joinstyle": "round", "zorder": 2, "alpha": 0.9}
            found.append((axis.plot(*self.places[0, path].T, color=f"C{k % 10}", **style)[0], path))
        return found

    def _pairs(self, axis: Any) -> list:
        """What slides, with a block where it is, and springs: whatever has its two ends apart."""
        found = []
        for name in dict.fromkeys(self._names):
            pair = [mark for mark, other in enumerate(self._names) if other == name][:2]
            if len(pair) == 2 and np.ptp(self.places[:, pair], axis=1).max() > APART * self.size:
                line = axis.plot(*self.places[0, pair].T, color="0.45", lw=1.2, ls=(0, (4, 2)), zorder=1)[0]
                found.append((line, pair))
                if name in self._joined:
                    block = axis.plot(*self.places[0, pair[1:]].T, "s", ms=15, mfc="0.85", mec="0.4", zorder=1.5)[0]
                    found.append((block, pair[1:]))
        return found

    def _points(self, axis: Any, dataset: xr.Dataset) -> list:
        """The paths of the named points so far."""
        named = [str(name) for name in dataset["point"].values] if "point" in dataset.coords else []
        marks = [self._names.index(name) for name in named]
        return [(axis.plot([], [], *([[]] if self.in_space else []), color="0.5", lw=0.9)[0], m) for m in marks]

    def _joints(self, axis: Any, dataset: xr.Dataset, joint: str | None) -> None:
        """A ring at every joint, red where it has play; the one pointed at is called by its name."""
        loose = [str(name) for name in dataset["joint"].values] if "joint" in dataset.coords else []
        self._label = None
        for name in self._joined:
            # The place on the child, which the joint's own name labels last.
            mark = len(self._names) - 1 - self._names[::-1].index(name)
            edge, size = ("tab:red", 8) if name in loose else ("k", 5)
            ring = axis.plot(*self.places[0, mark][:, None], "o", ms=size, mfc="white", mec=edge, mew=1.3, zorder=5)[0]
            self._lines.append((ring, [mark]))
            if name == joint:
                ring.set(markersize=12, markeredgewidth=2.2)
                style = {"xytext": (9, 9), "textcoords": "offset points", "fontsize": 11, "zorder": 6}
                style |= {"bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5}}
                text = axis.annotate(name, self._on_page(self.places[0, mark]), color="tab:red", **style)
                self._label = text, mark

    def _of(self, body: str) -> list[int]:
        return [mark for mark, other in enumerate(self._bodies) if other == body]


def _put(line: Any, places: np.ndarray) -> None:
    if places.shape[-1] == 3:
        line.set_data_3d(*places.T)
    else:
        line.set_data(*places.T)
