"""A still picture of a mechanism: its joints and points by name, and how large it is."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clearance_jax.report.design_figures import STYLED, WIDTH, new_figure
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import round_down
from clearance_jax.results.places import Outline, bounds

# Least and greatest height of the picture [inch].
LOW, HIGH = 1.5, 4.2
# Relative to the mechanism's size: distance below which places share a label, and margin for labels.
SAME, ROOM = 0.02, 0.2
# Of a label: the height of a line and the width of a character, and how far it stands off [point].
LINE, CHARACTER, OFF = 11.0, 5.6, 9.0
# Where a label may stand, the best place first; half the size of a joint's mark [point]; points all over a label.
SIDES = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1)])
MARK, SPREAD = 8.0, np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5)), -1).reshape(-1, 2)


@STYLED
def mechanism(outline: Outline) -> Figure:
    """The mechanism at one instant."""
    low, high = bounds(outline.visible)
    size = float(max(high - low))
    width, height = high - low + 2 * ROOM * size
    figure, axes = new_figure(float(np.clip(WIDTH * height / width, LOW, HIGH)))
    # The whole page is the axes': names are placed in points, which no layout may move afterwards.
    figure.set_layout_engine("none")
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    Skeleton(axes, outline.places, whole=True).show(outline.sample)
    # One scale both ways: what is left of the page lies around the mechanism.
    page = float(max(width / WIDTH, height / figure.get_figheight())) * figure.get_size_inches()
    left, bottom = 0.5 * (low + high - page)
    axes.set(xlim=(left, left + page[0]), ylim=(bottom, bottom + page[1]))
    _names(figure, axes, outline, SAME * size)
    _scale(axes, size)
    return figure


def _names(figure: Figure, axes: Axes, outline: Outline, same: float) -> None:
    """Write names beside their places, those of one place together, where they hide least."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    places = outline.places.at[outline.sample]
    for name, mark in {**outline.places.joints, **outline.places.points}.items():
        near = next((names for at, names in groups if np.hypot(*(at - places[mark])) < same), None)
        if near is None:
            groups.append((places[mark], [name]))
        else:
            near.append(name)
    figure.draw_without_rendering()  # from here on the axes know where they are
    scale, page, along = 72 / figure.dpi, 72 * figure.get_size_inches(), np.linspace(0, 1, 25)[:, None]
    at = [scale * axes.transData.transform(where) for where, _ in groups]
    # Points of the page that names would hide: of joints, bodies, other names.
    taken = [middle + MARK * SPREAD for middle in at]
    for marks in outline.places.bodies.values():
        taken += [a + along * (b - a) for a, b in itertools.pairwise(scale * axes.transData.transform(places[marks]))]
    for middle, (where, names) in zip(at, groups, strict=True):
        half = np.array([CHARACTER * max(map(len, names)), LINE * len(names)]) / 2
        sides = [np.clip(middle + side * (OFF + half), half, page - half) for side in SIDES]
        hidden = [np.sum(np.all(np.abs(np.concatenate(taken) - side) < half, axis=1)) for side in sides]
        best = sides[int(np.argmin(hidden))]
        taken.append(best + half * SPREAD)
        axes.annotate(
            "\n".join(names), where, best - middle, textcoords="offset points", ha="center", va="center", zorder=5,
            linespacing=1.1, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )  # fmt: skip


def _scale(axes: Axes, size: float) -> None:
    """A bar of a round length below the mechanism."""
    length = round_down(0.4 * size)
    text = f"{1e3 * length:g} mm" if length < 1 else f"{length:g} m"
    left, bottom = axes.get_xlim()[0] + 0.03 * size, axes.get_ylim()[0] + 0.05 * size
    axes.plot([left, left + length], [bottom, bottom], color="k", lw=2, solid_capstyle="butt")
    axes.annotate(text, (left + length, bottom), (5, 0), textcoords="offset points", va="center")
