"""A still picture of a mechanism: its joints and points by name, and how large it is."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from clearance_jax.report.design_figures import STYLED, WIDTH, drawn
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import round_down
from clearance_jax.results.places import Outline, bounds

# Heights of the picture, whatever the mechanism's shape [inch].
LOW, HIGH = 1.5, 4.2
# Of the size of the mechanism: how close places are one place, and what is left for names all around.
SAME, ROOM = 0.02, 0.2
# Of a label: the height of a line and the width of a character, and how far it stands off [point].
LINE, CHARACTER, OFF = 11.0, 5.6, 9.0
# Where a label may stand, the best place first.
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))


@STYLED
def mechanism(found: Outline) -> Figure:
    """The mechanism at one instant."""
    low, high = bounds(found.shown)
    size = float(max(high - low))
    width, height = high - low + 2 * ROOM * size
    figure, axes = drawn(float(np.clip(WIDTH * height / width, LOW, HIGH)))
    # The whole page is the axes': names are placed in points, which no layout may move afterwards.
    figure.set_layout_engine("none")
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    Skeleton(axes, found.places, whole=True).show(found.sample)
    # One scale both ways: what is left of the page lies around the mechanism.
    page = float(max(width / WIDTH, height / figure.get_figheight())) * figure.get_size_inches()
    left, bottom = 0.5 * (low + high - page)
    axes.set(xlim=(left, left + page[0]), ylim=(bottom, bottom + page[1]))
    _names(figure, axes, found, SAME * size)
    _scale(axes, size)
    return figure


def _names(figure: Figure, axes: Axes, found: Outline, same: float) -> None:
    """A name beside each place, those of one place together, where they hide least."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    places = found.places.at[found.sample]
    for name, mark in {**found.places.joints, **found.places.points}.items():
        near = next((names for at, names in groups if np.hypot(*(at - places[mark])) < same), None)
        if near is None:
            groups.append((places[mark], [name]))
        else:
            near.append(name)
    figure.draw_without_rendering()  # from here on the axes know where they are
    scale = 72 / figure.dpi
    at = [scale * axes.transData.transform(where) for where, _ in groups]
    taken = [_box(x, y, 8.0, 8.0) for x, y in at]
    along = np.linspace(0, 1, 25)[:, None]
    for marks in found.places.bodies.values():
        for a, b in itertools.pairwise(scale * axes.transData.transform(places[marks])):
            taken += [_box(x, y, 2.0, 2.0) for x, y in a + along * (b - a)]
    page = 72 * figure.get_size_inches()
    for (x, y), (where, names) in zip(at, groups, strict=True):
        box = min(_boxes(x, y, names, page), key=lambda box: sum(_overlap(box, other) for other in taken))
        taken.append(box)
        axes.annotate(
            "\n".join(names), where, np.mean(box.get_points(), axis=0) - (x, y), textcoords="offset points",
            ha="center", va="center", zorder=5, linespacing=1.1,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )  # fmt: skip


def _boxes(x: float, y: float, names: Sequence[str], page: np.ndarray) -> list[Bbox]:
    """Where on the page [point] the names of a place may stand."""
    half = np.array([CHARACTER * max(map(len, names)), LINE * len(names)]) / 2
    middles = [np.clip((x, y) + np.array(side) * (OFF + half), half, page - half) for side in SIDES]
    return [_box(*middle, *half) for middle in middles]


def _box(x: float, y: float, width: float, height: float) -> Bbox:
    """About a middle, with half its sides [point]."""
    return Bbox.from_extents(x - width, y - height, x + width, y + height)


def _overlap(box: Bbox, other: Bbox) -> float:
    """How much of one another one covers [square point]."""
    common = Bbox.intersection(box, other)
    return 0.0 if common is None else common.width * common.height


def _scale(axes: Axes, size: float) -> None:
    """A bar of a round length below the mechanism."""
    length = round_down(0.4 * size)
    text = f"{1e3 * length:g} mm" if length < 1 else f"{length:g} m"
    left, bottom = axes.get_xlim()[0] + 0.03 * size, axes.get_ylim()[0] + 0.05 * size
    axes.plot([left, left + length], [bottom, bottom], color="k", lw=2, solid_capstyle="butt")
    axes.annotate(text, (left + length, bottom), (5, 0), textcoords="offset points", va="center")
