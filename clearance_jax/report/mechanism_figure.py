"""The picture of a mechanism: its bodies, its joints by name, the paths of its named points."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from clearance_jax.design.outline import Outline
from clearance_jax.report.design_figures import STYLED, WIDTH, drawn

# Heights of the picture, whatever the mechanism's shape [inch].
LOW, HIGH = 1.5, 4.2
# Of the size of the mechanism: how close places are one place, half a slider's length, half a guide's.
SAME, SLIDER, GUIDE = 0.02, 0.045, 0.13
# Of that size too: what is left for names all around.
ROOM = 0.2
# Of a label: the height of a line and the width of a character, and how far it stands off [point].
LINE, CHARACTER, OFF = 11.0, 5.6, 9.0
# Where a label may stand, the best place first.
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))


class Box(NamedTuple):
    """A rectangle in points: its middle and half its sides."""

    x: float
    y: float
    width: float
    height: float

    def overlap(self, other: "Box") -> float:
        """How much of it another one covers [square point]."""
        across = min(self.x + self.width, other.x + other.width) - max(self.x - self.width, other.x - other.width)
        up = min(self.y + self.height, other.y + other.height) - max(self.y - self.height, other.y - other.height)
        return max(across, 0.0) * max(up, 0.0)


@STYLED
def mechanism(found: Outline) -> Figure:
    """The mechanism at one instant."""
    pins = [where[None] for where in found.joints.values()]
    places = np.concatenate([*found.bodies.values(), *pins, *found.springs.values(), *found.paths.values()])
    low, high = places.min(axis=0), places.max(axis=0)
    size = float(max(high - low))
    width, height = high - low + 2 * ROOM * size
    figure, axes = drawn(float(np.clip(WIDTH * height / width, LOW, HIGH)))
    # The whole page is the axes': names are placed in points, which no layout may move afterwards.
    figure.set_layout_engine("none")
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    # One scale both ways: what is left of the page lies around the mechanism.
    page = float(max(width / WIDTH, height / figure.get_figheight())) * figure.get_size_inches()
    left, bottom = 0.5 * (low + high - page)
    axes.set(xlim=(left, left + page[0]), ylim=(bottom, bottom + page[1]))
    for path in found.paths.values():
        axes.plot(*path.T, color="0.75", lw=0.8, zorder=0)
    for i, places in enumerate(found.bodies.values()):
        _body(axes, places, f"C{i % 10}", SAME * size)
    for a, b in found.springs.values():
        axes.plot([a[0], b[0]], [a[1], b[1]], color="0.3", lw=1.2, ls=(0, (1, 1)), zorder=1)
    for name, where in found.joints.items():
        _joint(axes, name, where, found, size)
    _names(figure, axes, found, SAME * size)
    _scale(axes, size)
    return figure


def _body(axes: Axes, places: np.ndarray, colour: str, same: float) -> None:
    """A link: a line, or the plate that its joints span."""
    middle = places.mean(axis=0)
    around = places[np.argsort(np.arctan2(*(places - middle).T[::-1]))]
    if len(places) > 2 and np.linalg.svd(places - middle, compute_uv=False)[1] > same:
        axes.add_patch(Polygon(around, closed=True, facecolor=colour, edgecolor=colour, alpha=0.35, lw=2, zorder=1))
    else:
        axes.plot(*places[np.argsort(places @ _along(places))].T, color=colour, lw=3, solid_capstyle="round", zorder=1)


def _along(places: np.ndarray) -> np.ndarray:
    return np.linalg.svd(places - places.mean(axis=0))[2][0]


def _joint(axes: Axes, name: str, where: np.ndarray, found: Outline, size: float) -> None:
    """A pin, double where it has clearance; a slider on its guide; the ground below what it holds."""
    if name in found.slides:
        _slider(axes, where, found.slides[name], size)
        return
    if name in found.grounded:
        axes.plot(*where, marker="^", ms=15, mfc="0.85", mec="0.4", zorder=0.5)
    if name in found.loose:
        axes.plot(*where, marker="o", ms=10, mfc="white", mec="tab:red", mew=1.2, zorder=3)
    axes.plot(*where, marker="o", ms=5, mfc="white", mec="k", zorder=4)


def _slider(axes: Axes, where: np.ndarray, along: np.ndarray, size: float) -> None:
    across = np.array([-along[1], along[0]])
    guide = np.stack([where - GUIDE * size * along, where + GUIDE * size * along]) - 0.6 * SLIDER * size * across
    axes.plot(*guide.T, color="0.4", lw=1.5, zorder=0.5)
    corners = [where + size * SLIDER * (a * along + 0.6 * b * across) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    axes.add_patch(Polygon(corners, closed=True, facecolor="0.9", edgecolor="0.4", zorder=0.8))


def _names(figure: Figure, axes: Axes, found: Outline, same: float) -> None:
    """A name beside each place, those of one place together, where they hide least."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    for name, where in {**found.joints, **found.points}.items():
        near = next((names for at, names in groups if np.hypot(*(at - where)) < same), None)
        if near is None:
            groups.append((where, [name]))
        else:
            near.append(name)
    figure.draw_without_rendering()  # from here on the axes know where they are
    scale = 72 / figure.dpi
    at = [scale * axes.transData.transform(where) for where, _ in groups]
    taken = [Box(x, y, 8.0, 8.0) for x, y in at]
    for places in found.bodies.values():
        along = np.linspace(0, 1, 25)[:, None]
        for a, b in itertools.pairwise(scale * axes.transData.transform(places)):
            taken += [Box(x, y, 2.0, 2.0) for x, y in a + along * (b - a)]
    page = Box(*(36 * figure.get_size_inches()), *(36 * figure.get_size_inches()))
    for (x, y), (where, names) in zip(at, groups, strict=True):
        text = "\n".join(names)
        box = min(_boxes(x, y, names, page), key=lambda box: sum(box.overlap(other) for other in taken))
        taken.append(box)
        axes.annotate(
            text, where, (box.x - x, box.y - y), textcoords="offset points", ha="center", va="center", zorder=5,
            linespacing=1.1, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )  # fmt: skip


def _boxes(x: float, y: float, names: Sequence[str], page: Box) -> list[Box]:
    """Where on the page the names of a place may stand."""
    width, height = CHARACTER * max(map(len, names)) / 2, LINE * len(names) / 2

    def inside(middle: float, half: float, whole: float) -> float:
        return max(min(middle, 2 * whole - half), half)

    return [
        Box(
            inside(x + a * (OFF + width), width, page.width),
            inside(y + b * (OFF + height), height, page.height),
            width,
            height,
        )
        for a, b in SIDES
    ]


def _scale(axes: Axes, size: float) -> None:
    """A bar of a round length below the mechanism."""
    power = 10.0 ** np.floor(np.log10(0.4 * size))
    length = power * max(k for k in (1, 2, 5) if k * power <= 0.4 * size)
    text = f"{1e3 * length:g} mm" if length < 1 else f"{length:g} m"
    left, bottom = axes.get_xlim()[0] + 0.03 * size, axes.get_ylim()[0] + 0.05 * size
    axes.plot([left, left + length], [bottom, bottom], color="k", lw=2, solid_capstyle="butt")
    axes.annotate(text, (left + length, bottom), (5, 0), textcoords="offset points", va="center")
