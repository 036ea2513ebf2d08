"""Wear maps: depth over angle and height of a sleeve or a pin."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from clearance_jax.errors import ClearanceError
from clearance_jax.report.style import length_unit


def wear_map(worn: Any, title: str = "") -> Figure:
    """A map of depths over the angle and along the sleeve, and beside it the deepest of every height.

    **Arguments:** `worn`: what has worn off (`wear.Wear`), with `angle` [rad], `heights` [m] and `depth` [m] of every
    height and angle.

    **Raises:** `ClearanceError` for wear of a joint in the plane, which is the same all along it.
    """
    angle, heights, depth = (np.asarray(x) for x in (worn.angle, worn.heights, worn.depth))
    if len(heights) < 2:
        raise ClearanceError("A wear map needs a joint with stations along its sleeve, but this one wears evenly.")
    factor, unit = length_unit(float(depth.max()))
    # A station's strip ends halfway to the next.
    edges = 1e3 * np.concatenate([heights[:1], 0.5 * (heights[1:] + heights[:-1]), heights[-1:]])
    across = np.degrees(np.append(angle, 2 * np.pi) - 0.5 * (angle[1] - angle[0]))
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(8.5, 3.2), layout="constrained")
        field, beside = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
        drawn = field.pcolormesh(across, edges, factor * depth, cmap="inferno_r", vmin=0.0)
        field.set(xlabel="angle, deg", ylabel="height along the sleeve, mm", xticks=range(0, 361, 45), title=title)
        figure.colorbar(drawn, ax=field, label=f"depth of wear, {unit}")
        beside.plot(factor * depth.max(axis=1), 1e3 * heights, "o-", ms=3, lw=0.8)
        beside.set(xlabel=f"deepest, {unit}", xlim=(0, None))
        beside.grid(alpha=0.3)
    return figure
