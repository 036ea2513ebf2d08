"""How figures look: colours that colour-blind people tell apart, markers besides, legends that cover nothing."""

import math
import textwrap
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

# Okabe and Ito 2008, Color universal design (jfly.uni-koeln.de/color), without yellow, which is too pale for a line.
BLUE, RED, GREEN, PURPLE, ORANGE, SKY, BLACK = COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000",
)  # fmt: skip
MARKERS = ("o", "s", "^", "D", "v", "P")
STYLE = {"axes.grid": True, "grid.alpha": 0.3, "font.size": 9, "axes.axisbelow": True, "legend.frameon": False}
STYLE |= {"axes.prop_cycle": cycler(color=COLOURS), "axes.spines.top": False, "axes.spines.right": False}
STYLED = mpl.rc_context(STYLE)
# Distance of a legend below the lower edge of its axes, past their numbers and label [inch].
BELOW = 0.45
# The width of a figure for a narrow screen [inch]: on 390 pixels text of 9 points is 11 pixels high.
NARROW = 4.2
# How often axes in space are made smaller, each time by this factor, so that their labels lie inside; the first size.
SHRINKS, SMALLER, ZOOM = 8, 0.92, 0.85
# Of a legend in its font size: width of a character, and of a handle with the gaps around it.
CHARACTER, HANDLE = 0.55, 5.0


def look(k: int) -> dict[str, Any]:
    """Colour and marker of the k-th curve; negative `k`, from the end, for points beside joints."""
    return {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}


def new_figure(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure of this size [inch], with one pair of axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def legend_below(axis: Any, columns: int = 3, below: float = BELOW, **how: Any) -> None:
    """A legend below the axes at a distance [inch], with room made for it, of at most so many columns as fit into the
    figure's width; `how`: as `Axes.legend`'s.
    """
    _, labels = axis.get_legend_handles_labels()
    down = axis.transAxes + ScaledTranslation(0.0, -below, axis.figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": down, "borderaxespad": 0.0}
    inside = axis.get_subplotspec().get_topmost_subplotspec().get_gridspec().ncols
    width = axis.figure.bbox.width / axis.figure.dpi / inside
    size = float(how.get("fontsize", mpl.rcParams["font.size"]))
    axis.legend(**where, ncols=_columns(labels, width, columns, size), **how)


def legend_outside(figure: Figure, columns: int, **how: Any) -> None:
    """A legend below all axes of a figure, of at most so many columns as fit, long labels in lines; `how`: as
    `Figure.legend`'s.
    """
    pairs = (zip(*axis.get_legend_handles_labels(), strict=True) for axis in figure.axes)
    known = {label: handle for axis in pairs for handle, label in axis}
    size, width = float(mpl.rcParams["font.size"]), float(figure.get_figwidth())
    # Two letters' widths more are left free: a line may be of letters wider than the mean.
    labels = [fit(label, width - (HANDLE + 2) * size / 72, size) for label in known]
    how["ncols"] = _columns(labels, width, columns, size)
    figure.legend(known.values(), labels, loc="outside lower center", **how)


def keep_labels(figure: Figure) -> None:
    """Make axes in space smaller until their labels are on the page: matplotlib's layout leaves no room for these."""
    waiting, zoom = [axis for axis in figure.axes if axis.name == "3d"], ZOOM
    for _ in range(SHRINKS if waiting else 0):
        figure.draw_without_rendering()
        waiting = [axis for axis in waiting if not _holds_labels(axis)]
        if not waiting:
            break
        zoom *= SMALLER
        for axis in waiting:
            space: Any = axis
            sizes = [np.ptp(limits) for limits in (space.get_xlim(), space.get_ylim(), space.get_zlim())]
            space.set_box_aspect(tuple(sizes), zoom=zoom)


def _holds_labels(axis: Any) -> bool:
    """Whether the labels of axes in space, as they were drawn, are on the page, and above a legend below the axes."""
    boxes = [line.label.get_window_extent() for line in (axis.xaxis, axis.yaxis, axis.zaxis)]
    whole, legend = axis.figure.bbox, axis.get_legend()
    floor = whole.y0 if legend is None else legend.get_window_extent().y1
    return all(whole.x0 <= b.x0 and b.x1 <= whole.x1 and floor <= b.y0 and b.y1 <= whole.y1 for b in boxes)


def _columns(labels: list[str], width: float, most: int, size: float) -> int:
    """How many columns of a legend fit into a width [inch], at most `most`."""
    longest = max((len(line) for label in labels for line in label.split("\n")), default=1)
    return max(1, min(most, int(72 * width / (size * (CHARACTER * longest + HANDLE))), len(labels)))


def fit(text: str, width: float, size: float = 9.0) -> str:
    """A text broken into lines that fit into a width [inch]; `size` of its letters [point]."""
    return "\n".join(textwrap.fill(line, int(72 * width / (0.5 * size))) for line in text.split("\n"))


def panel_grid(figure: Any, count: int, columns: int, **how: Any) -> np.ndarray:
    """Axes (rows, columns) for `count` panels, of which the others are hidden; `how`: as `Figure.subplots`'."""
    panels = figure.subplots(math.ceil(count / columns), columns, squeeze=False, **how)
    for panel in panels.flat[count:]:
        panel.set_axis_off()
    return panels


def length_unit(largest: float) -> tuple[float, str]:
    """The factor and the unit in which a largest length [m] has one to three digits before the point."""
    return (1e9, "nm") if largest < 1e-6 else (1e6, "µm") if largest < 1e-3 else (1e3, "mm")


def force_unit(largest: float) -> tuple[float, str]:
    """The factor and the unit in which a largest force [N] is shown."""
    return (1e-3, "kN") if largest >= 1e4 else (1.0, "N")


def round_down(value: float) -> float:
    """The largest of ..., 0.1, 0.2, 0.5, 1, 2, 5, ... that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{power * max(k for k in (1, 2, 5) if k * power <= value):.1g}")
