"""Magnified views of a clearance joint as it moves: sections across it and views from the side. Bodies have their true
size; displacement and tilt of the pin in its sleeve are multiplied by a stated factor.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.patches import Circle, Polygon, Rectangle

from clearance_jax.errors import ClearanceError
from clearance_jax.report.style import BLUE, PURPLE, RED
from clearance_jax.results.play import JointPlay, kind, penetration, pin_travel, play

# Default size of the drawn play over the pin's radius; the factor is rounded down.
SHOWN = 0.35
# Relative to the pin's radius: thickness of the sleeve's wall, overhang of the longer of pin and sleeve, thickness of a
# collar, radius of the neck between a collar and a shorter pin.
WALL, OUT, COLLAR, NECK = 0.3, 0.35, 0.25, 0.6
# Half angle that is marked at a contact [rad]; samples in the trail of the pin's centre.
HALF_ANGLE, TRAIL = 0.35, 150
SLEEVE, PIN, EDGE, CONTACT, PATH = "#c3d3e6", "0.82", "0.35", RED, BLUE


def round_factor(value: float) -> float:
    """The largest number with one significant digit that is at most `value`; at least 1."""
    power = 10.0 ** np.floor(np.log10(max(value, 1.0)))
    return float(power * np.floor(max(value, 1.0) / power))


def magnify(dataset: xr.Dataset, name: str, factor: float | None = None) -> JointPlay:
    """A joint with its play magnified, by default so that it is seen. **Raises** for a joint without a view."""
    joint = play(dataset, name)
    if joint is None:
        raise ClearanceError(
            f"`{name}` cannot be magnified: of what it is ({kind(dataset, name) or 'an older result does not say'}) "
            "there is no view, or not all is known. Choose a joint with a pin, a ball, or a block in the tree."
        )
    return joint._replace(factor=factor or round_factor(SHOWN * joint.outline.radius / joint.outline.clearance))


def bushing(axis: Any, bore: np.ndarray, radius: float, outside: float) -> tuple[Polygon, Circle]:
    """Draw a section of a sleeve with its bore (2, points) and a pin [m]; returns their patches, to be moved."""
    axis.add_patch(Circle((0, 0), outside, fc=SLEEVE, ec="none", zorder=0))
    wall = axis.add_patch(Polygon(bore.T, closed=True, fc="white", ec=EDGE, lw=1.2, zorder=1))
    pin = axis.add_patch(Circle((0, 0), radius, fc=PIN, ec=EDGE, lw=1.2, alpha=0.9, zorder=2))
    axis.set(xlim=(-1.06 * outside, 1.06 * outside), ylim=(-1.06 * outside, 1.06 * outside))
    _bare(axis)
    return wall, pin


class CrossSection:
    """A section at a height (`station`), along two of the sleeve's `axes`, and the path of the pin's centre so far."""

    def __init__(self, axis: Any, joint: JointPlay, station: int = 0, axes: tuple[int, int] = (0, 1)):
        self.joint, self.station, depth, outline = joint, station, joint.wear_depth(station), joint.outline
        across = joint.place[:, list(axes)] if outline.ball else joint.centres(outline.heights)[:, station]
        self.places = joint.factor * across
        deep = penetration(across, outline.clearance, depth)
        self.touching = (np.linalg.norm(joint.place, axis=1) > outline.clearance) if outline.ball else deep > 0
        outside = joint.wall + WALL * outline.radius + joint.factor * float(depth.max())
        bore = joint.around(np.linspace(0, 2 * np.pi, max(181, depth.size + 1)), station)
        _, self.pin = bushing(axis, bore, outline.radius, outside)
        self.spoke = axis.plot([], [], color=EDGE, lw=1.0, zorder=2.5)[0]
        axis.plot(*joint.factor * pin_travel(outline.clearance, depth), color="k", lw=0.7, ls="--", zorder=4)
        self.trail = axis.plot([], [], color=PATH, lw=0.8, zorder=5)[0]
        self.centre = axis.plot([], [], "o", ms=4, color=PATH, zorder=6)[0]
        self.mark = axis.plot([], [], color=CONTACT, lw=5, solid_capstyle="butt", zorder=7)[0]

    def show(self, i: int) -> None:
        """Draw sample `i`."""
        x, y = self.places[i]
        self.pin.center = x, y
        self.centre.set_data([x], [y])
        self.trail.set_data(*self.places[max(i - TRAIL, 0) : i + 1].T)
        if self.joint.turn is not None:
            turn = self.joint.turn[i] + np.array([0.0, np.pi])
            radius = self.joint.outline.radius
            self.spoke.set_data(x + radius * np.cos(turn), y + radius * np.sin(turn))
        around = np.arctan2(y, x) + np.linspace(-HALF_ANGLE, HALF_ANGLE, 15)
        shown = self.joint.around(around, self.station)
        self.mark.set_data(*(shown if self.touching[i] else ([], [])))


class Side:
    """A section along the joint's axis, which is horizontal; `up`: which of the sleeve's axes is upright, 0 or 1."""

    def __init__(self, axis: Any, joint: JointPlay, up: int):
        outline = joint.outline
        if outline.height is not None:
            outline = outline._replace(radius=((outline.height, outline.width)[up] or 0.0) / 2)
            joint = joint._replace(outline=outline)
        self.joint, self.up, half = joint, up, (outline.length or 0.0) / 2
        self.half, self.slopes = half, joint.tilt / np.sqrt(1 - np.sum(joint.tilt**2, axis=1, keepdims=True))
        self.reach = joint.factor * (outline.axial or 0.0)
        wall, thick = joint.wall, WALL * outline.radius
        self.top = wall + 0.5 * thick
        # A shorter pin's sleeve goes on beyond its ends.
        self.face = half if outline.through else half + OUT * outline.radius
        for low in (wall, -wall - thick):
            axis.add_patch(Rectangle((-self.face, low), 2 * self.face, thick, fc=SLEEVE, ec=EDGE, lw=1.0))
        self.outlines = self._pin()
        how: Any = {"closed": True, "fc": PIN, "ec": EDGE, "lw": 1.2, "alpha": 0.9, "zorder": 2}
        self.patches = [axis.add_patch(Polygon(points, **how)) for points in self.outlines]
        self.line = axis.plot([], [], color=PATH, lw=0.9, ls="-.", zorder=4)[0]
        axis.axhline(0, color="0.5", lw=0.6, ls=(0, (8, 3, 2, 3)), zorder=1)
        self.walls = axis.plot([], [], "o", ms=6, color=CONTACT, zorder=7)[0]
        self.faces = axis.plot([], [], "s", ms=6, color=PURPLE, zorder=7)[0]
        centres = joint.centres(outline.heights)
        self.lateral = centres[..., up]
        # Contacts on the sides towards the reader and away from him are not at the edge of this picture.
        self.touching = np.hypot(*np.moveaxis(centres, -1, 0)) > outline.clearance
        self.touching &= np.abs(self.lateral) >= np.abs(centres[..., 1 - up])
        if outline.height is not None:
            self.touching = np.abs(self.lateral) > outline.clearance
        length = self.face + self.reach + (OUT + COLLAR) * outline.radius
        axis.set_xlim(-1.1 * length, 1.1 * length)
        tall = 1.06 * max(wall + thick, outline.collar + 1.3 * (wall - outline.radius) if outline.axial else 0.0)
        axis.set_ylim(-tall, tall)
        _bare(axis)

    def _pin(self) -> list[np.ndarray]:
        """Outlines of the pin at rest, (points, 2): along and across its axis."""
        outline, r = self.joint.outline, self.joint.outline.radius
        beyond = self.face + self.reach
        outlines = [_box(-beyond - OUT * r, beyond + OUT * r, r if outline.through else NECK * r)]
        if not outline.through:
            outlines = [*(outlines if outline.axial is not None else []), _box(-self.half, self.half, r)]
        if outline.axial is not None:
            thick = COLLAR * r
            outlines += [_box(beyond, beyond + thick, outline.collar), _box(-beyond - thick, -beyond, outline.collar)]
        return outlines

    def show(self, i: int) -> None:
        """Draw sample `i`."""
        for patch, points in zip(self.patches, self.outlines, strict=True):
            patch.set_xy(self.move(points, i))
        self.line.set_data(*self.move(np.array([[-self.half, 0.0], [self.half, 0.0]]) * 1.15, i).T)
        chosen = self.touching[i]
        side = np.sign(self.lateral[i, chosen])
        # Stations are the sleeve's, or those of a shorter pin, which takes them along.
        outline = self.joint.outline
        along = outline.heights[chosen] + (0.0 if outline.through else self.joint.factor * self._slid(i))
        self.walls.set_data(along, side * self.joint.wall)
        self.faces.set_data(*self._on_faces(i))

    def move(self, points: np.ndarray, i: int) -> np.ndarray:
        """Points of the pin (along, across) at sample `i`, with the motion magnified."""
        along, across = points.T
        k, up, slope = self.joint.factor, self.joint.place[i, self.up], self.slopes[i, self.up]
        return np.stack([along + k * (self._slid(i) - slope * across), across + k * (up + slope * along)], 1)

    def _slid(self, i: int) -> float:
        return float(self.joint.place[i, 2]) if self.joint.place.shape[1] > 2 else 0.0

    def _on_faces(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Where the collars touch the sleeve's faces: the points of the ring beyond the axial play."""
        joint, outline = self.joint, self.joint.outline
        if outline.axial is None:
            return np.zeros(0), np.zeros(0)
        around = 2 * np.pi * np.arange(outline.ring) / outline.ring
        ring = outline.collar * np.stack([np.cos(around), np.sin(around)], 1)
        height = joint.place[i, 2] - (ring - joint.place[i, :2]) @ self.slopes[i]
        bears = np.abs(height) > outline.axial
        # A pin that has come to the right bears with the collar on its left, and the other way round.
        return -np.sign(height[bears]) * self.face, np.clip(ring[bears, self.up], -self.top, self.top)


def _box(left: float, right: float, half: float) -> np.ndarray:
    return np.array([[left, -half], [right, -half], [right, half], [left, half]])


def _bare(axis: Any) -> None:
    """Hide ticks and frame: play and sizes have different scales."""
    axis.set_aspect("equal", adjustable="box")
    axis.set(xticks=[], yticks=[])
    axis.spines[:].set_visible(False)
