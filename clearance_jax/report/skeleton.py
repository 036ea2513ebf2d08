"""Draws a mechanism on axes, in the plane or in space: bodies, joints, springs, paths of points; films move it."""

import itertools
from typing import Any

import numpy as np
from matplotlib.patches import Circle, Polygon
from mpl_toolkits.mplot3d.proj3d import proj_transform

from clearance_jax.report.panels import same_scale
from clearance_jax.report.style import BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from clearance_jax.results.places import Places

# Relative to the mechanism's size: least breadth of a body that is drawn as a plate; half a slider's length and
# breadth, half the length of its guide.
PLATE, SLIDER, BREADTH, GUIDE = 0.02, 0.045, 0.027, 0.13
# From where space is looked at [degree].
ELEVATION, AZIMUTH = 22.0, -58.0
# Corners of a slider, and two rails beside it: along, across.
CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (SLIDER, BREADTH)
RAILS = np.array([(-1, 1), (1, 1), (np.nan, 1), (-1, -1), (1, -1)]) * (GUIDE, BREADTH)
# Of bodies; not red, which is that of joints with clearance.
COLOURS = (ORANGE, GREEN, BLUE, PURPLE, SKY, "0.5")
LINK: Any = {"lw": 4, "solid_capstyle": "round", "solid_joinstyle": "round", "zorder": 2, "alpha": 0.9}


class Skeleton:
    """Axes (of projection "3d" in space) with a mechanism on it; `show(i)` puts it where it is at sample `i`. `joint`:
    the joint to point at; `whole`: whether paths of points show all of the motion, or what lies before the sample.
    """

    def __init__(self, axis: Any, places: Places, joint: str | None = None, whole: bool = False):
        self.axis, self.places, self.size, self.whole = axis, places, places.size, whole
        self._lines, self._plates, self._sliders = [], [], []
        floor = same_scale(axis, np.concatenate([places.at, places.rims], axis=1))[-1]
        if self.in_space:
            axis.view_init(ELEVATION, AZIMUTH)
        for mark in places.ground:
            self._support(places.at[0, mark], floor)
        for marks, colour in zip(places.bodies.values(), itertools.cycle(COLOURS), strict=False):
            self._body(marks, colour)
        for name, pair in places.pairs.items():
            self._pair(name, pair)
        for name, mark in places.joints.items():
            edge, size = (RED, 8) if name in places.loose else ("k", 5)
            size, width = (12, 2.2) if name == joint else (size, 1.3)
            self._line([mark], marker="o", ms=size, mfc="white", mec=edge, mew=width, zorder=5)
        self._spokes = [self._wheel(places.joints[name], *wheel) for name, wheel in places.wheels.items()]
        self._trails = [(self._plot(color="0.5", lw=0.9, zorder=0.8), mark) for mark in places.points.values()]
        self._label = None
        if joint is not None:
            mark, box = places.joints[joint], {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5}
            style: Any = {"textcoords": "offset points", "fontsize": 11, "zorder": 6, "color": RED, "bbox": box}
            self._label = axis.annotate(joint, self._on_page(places.at[0, mark]), xytext=(9, 9), **style), mark
        self.show(0)

    @property
    def in_space(self) -> bool:
        """Whether it has a third axis."""
        return self.places.at.shape[-1] == 3

    def show(self, i: int) -> None:
        """Draw sample `i`."""
        at = self.places.at[i]
        for line, marks in self._lines:
            _put(line, at[marks])
        for plate, marks in self._plates:
            away = at[marks] - at[marks].mean(axis=0)  # in the order in which they lie around their middle
            plate.set_xy(at[marks][np.argsort(np.arctan2(away[:, 1], away[:, 0]))])
        for block, guide, name, mark in self._sliders:
            x, y = self.places.slides[name][i]
            turned = self.size * np.array([[x, y], [-y, x]])
            block.set_xy(at[mark] + CORNERS @ turned)
            _put(guide, at[mark] + RAILS @ turned)
        for spoke, centre, radius, turn in self._spokes:
            away = radius * np.array([np.cos(turn[i]), np.sin(turn[i])])
            _put(spoke, np.stack([at[centre] - away, at[centre] + away]))
        for line, mark in self._trails:
            _put(line, self.places.at[: None if self.whole else i + 1, mark])
        if self._label is not None:
            text, mark = self._label
            text.xy = self._on_page(at[mark])

    def _plot(self, places: np.ndarray | None = None, **style: Any) -> Any:
        """A line through places, or one that has none yet."""
        none = np.zeros((0, self.places.at.shape[-1]))
        return self.axis.plot(*(none if places is None else places).T, **style)[0]

    def _line(self, marks: list[int], **style: Any) -> None:
        self._lines.append((self._plot(self.places.at[0, marks], **style), marks))

    def _support(self, at: np.ndarray, floor: float) -> None:
        """Draw a support on the ground: a triangle, in space a post on the floor."""
        if self.in_space:
            foot = np.array([*at[:2], min(floor, at[2])])
            self._plot(np.stack([foot, at]), color="0.6", lw=5, solid_capstyle="butt")
            self._plot(foot[None], marker="s", ms=12, mfc="0.75", mec="0.5")
        else:
            self._plot(at[None], marker="^", ms=14, mfc="0.85", mec="0.4", zorder=0.5)

    def _body(self, marks: list[int], colour: str) -> None:
        """Draw a body: a plate that its marks span, or lines from its own joint to the others."""
        at = self.places.at[0, marks]
        if not self.in_space and np.linalg.svd(at - at.mean(axis=0), compute_uv=False)[1] > PLATE * self.size:
            plate = Polygon(at, closed=True, fc=colour, ec=colour, alpha=0.4, lw=2, zorder=1)
            self._plates.append((self.axis.add_patch(plate), marks))
        else:
            self._line([mark for other in marks[1:] for mark in (marks[0], other)], color=colour, **LINK)

    def _wheel(self, mark: int, radius: float, turn: np.ndarray) -> tuple[Any, int, float, np.ndarray]:
        """Draw the pitch circle of a gear; returns the line across it that turns."""
        centre = self.places.at[0, mark]
        self.axis.add_patch(Circle(centre, radius, fill=False, ec="0.5", lw=1.2, ls=(0, (6, 2, 1, 2)), zorder=0.9))
        return self._plot(color="0.5", lw=1.2, zorder=0.9), mark, radius, turn

    def _pair(self, name: str, pair: list[int]) -> None:
        self._line(pair, color="0.45", lw=1.2, ls=(0, (4, 2)), zorder=1)
        if name in self.places.slides and self.in_space:
            self._line(pair[1:], marker="s", ms=15, mfc="0.85", mec="0.4", zorder=1.5)
        elif name in self.places.slides:
            block = self.axis.add_patch(Polygon(CORNERS, closed=True, fc="0.85", ec="0.4", zorder=1.5))
            self._sliders.append((block, self._plot(color="0.4", lw=1.5, zorder=0.6), name, pair[1]))

    def _on_page(self, place: np.ndarray) -> tuple[float, float]:
        """A place projected to the axes' plane."""
        if not self.in_space:
            return float(place[0]), float(place[1])
        return proj_transform(place[0], place[1], place[2], self.axis.get_proj())[:2]


def _put(line: Any, places: np.ndarray) -> None:
    if places.shape[-1] == 3:
        line.set_data_3d(*places.T)
    else:
        line.set_data(*places.T)
