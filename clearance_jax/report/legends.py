"""Legends that cover nothing: below their axes, under the label of x."""

from typing import Any

from matplotlib.transforms import ScaledTranslation

# From the axes' lower edge down past numbers and label [inch].
BELOW = 0.45


def legend_below(axis: Any, columns: int = 3, **how: Any) -> None:
    """A legend of at most so many columns below the axes, for which a constrained layout makes room; `how`: as
    `Axes.legend`'s.
    """
    handles, _ = axis.get_legend_handles_labels()
    down = axis.transAxes + ScaledTranslation(0.0, -BELOW, axis.figure.dpi_scale_trans)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": down, "borderaxespad": 0.0}
    axis.legend(**where, ncols=min(columns, max(len(handles), 1)), **how)
