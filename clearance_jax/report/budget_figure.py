"""Figure of an error budget: shares by joint, and errors over time."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from clearance_jax.design.budget import ErrorBudget
from clearance_jax.report.panels import time_axis
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import STYLED, legend_below, length_unit
from clearance_jax.results.places import places

# Size of the mark of the largest share [point]. Areas of marks are proportional to shares.
LARGEST = 34.0
MODELS = {
    "dynamics": ("dynamics", "C3"),
    "quasi_static": ("quasi-static", "k"),
    "play": ("play alone", "C0"),
    "elasticity": ("elasticity alone", "C1"),
}


@STYLED
def budget_figure(budget: ErrorBudget) -> Figure:
    """Three panels: the mechanism when its quasi-static error is largest, with marks by the joints' shares; the shares
    with their parts by play and by elasticity; the errors of each model over time.
    """
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(1.1, 1.0, 1.1))
    dataset = budget.dataset.drop_vars(["joint_error", "joint_play"]).drop_dims("axis").rename(page_axis="axis")
    placed = places(dataset)
    left = figure.add_subplot(grid[0], **({"projection": "3d"} if placed.at.shape[-1] == 3 else {}))
    _robot(left, budget, placed)
    _shares(figure.add_subplot(grid[1]), budget)
    _over_time(figure.add_subplot(grid[2]), budget)
    figure.suptitle(f"What the error of `{budget.point}` is made of")
    return figure


def _robot(axis: Any, budget: ErrorBudget, placed: Any) -> None:
    k, shares = int(budget.dataset.quasi_static.values.argmax()), budget.shares
    Skeleton(axis, placed, whole=True).show(k)
    largest = max(abs(share) for share in shares.values())
    for name, share in shares.items():
        size = LARGEST * np.sqrt(abs(share) / largest) if largest > 0 else 0.0
        place = placed.at[k, placed.joints[name]][None].T
        axis.plot(*place, marker="o", ms=size, mfc="tab:red", mec="none", alpha=0.35, zorder=6)
    axis.set_title(f"shares at {budget.peak_time:.3g} s (areas)", fontsize=10)


def _shares(axis: Any, budget: ErrorBudget) -> None:
    shares, play = budget.shares, budget.play_shares
    names = sorted(shares, key=lambda name: abs(shares[name]))
    factor, unit = length_unit(max(abs(share) for share in shares.values()))
    rows = np.arange(len(names))
    total, rigid = (factor * np.array([part[name] for name in names]) for part in (shares, play))
    axis.barh(rows, rigid, 0.55, color=MODELS["play"][1], label="play")
    axis.barh(rows, total - rigid, 0.55, left=rigid, color=MODELS["elasticity"][1], label="elasticity")
    axis.set_yticks(rows, names)
    axis.set(xlabel=f"share of the peak, {unit}")
    axis.set_title("by joint", fontsize=10)
    legend_below(axis, 2)


def _over_time(axis: Any, budget: ErrorBudget) -> None:
    times = budget.dataset.time.values
    per_second = time_axis(axis, float(times[-1]))
    factor, unit = length_unit(max(peak for peak in budget.peaks.values() if np.isfinite(peak)))
    for name, (label, colour) in MODELS.items():
        values = budget.dataset[name].values
        if np.isfinite(values).all():
            axis.plot(per_second * times, factor * values, color=colour, lw=1.2, label=label)
    axis.set(ylabel=f"error of {budget.point}, {unit}")
    axis.set_title("over time", fontsize=10)
    legend_below(axis, 2)
