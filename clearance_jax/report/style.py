"""How figures look: grid and text, legends that cover nothing (below their axes), round numbers."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

STYLED = mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 9, "axes.axisbelow": True})
# Distance of a legend below the lower edge of its axes, past their numbers and label [inch].
BELOW = 0.45


def new_figure(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure of this size [inch], with one pair of axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def legend_below(axis: Any, columns: int = 3, **how: Any) -> None:
    """A legend of at most so many columns below the axes, with room made for it; `how`: as `Axes.legend`'s."""
    handles, _ = axis.get_legend_handles_labels()
    down = axis.transAxes + ScaledTranslation(0.0, -BELOW, axis.figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": down, "borderaxespad": 0.0}
    axis.legend(**where, ncols=min(columns, max(len(handles), 1)), **how)


def panel_grid(figure: Any, count: int, columns: int, **how: Any) -> np.ndarray:
    """Axes (rows, columns) for `count` panels, of which the others are hidden; `how`: as `Figure.subplots`'."""
    panels = figure.subplots(-(-count // columns), columns, squeeze=False, **how)
    for panel in panels.flat[count:]:
        panel.set_axis_off()
    return panels


def length_unit(largest: float) -> tuple[float, str]:
    """The factor and the unit in which a largest length [m] has one to three digits before the point."""
    return (1e9, "nm") if largest < 1e-6 else (1e6, "µm") if largest < 1e-3 else (1e3, "mm")


def round_down(value: float) -> float:
    """The largest of ..., 0.1, 0.2, 0.5, 1, 2, 5, ... that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{power * max(k for k in (1, 2, 5) if k * power <= value):.1g}")
