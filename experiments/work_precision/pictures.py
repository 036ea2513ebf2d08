"""The picture: error of the worst position against time, a panel for each scene."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.work_precision.points import Point, of

COLOURS = {
    "tsit5": "tab:blue",
    "dopri8": "tab:orange",
    "LSODA": "tab:green",
    "DOP853 (": "tab:red",
    "Radau": "tab:brown",
    "CVODE ": "tab:purple",
    "DOP853 in": "tab:pink",
    "CVODES": "tab:cyan",
    "diffrax": "black",
}
COLUMNS = 5


def draw(points: Sequence[Point]) -> Figure:
    """All runs that reached the end of their scene."""
    names = list(dict.fromkeys(p.scene for p in points))
    rows, columns = -(-len(names) // COLUMNS), min(COLUMNS, len(names))
    with mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 8}):
        figure = Figure(figsize=(3.2 * columns + 1, 3.2 * rows + 1.2), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).flat
        handles = {}
        for panel, name in zip(panels, names, strict=False):
            for tool in dict.fromkeys(p.tool for p in points if p.scene == name):
                mine = [p for p in of(points, name, tool) if np.isfinite(p.position)]
                label = tool.replace(" + numba", "")
                (line,) = panel.loglog(
                    [1e3 * p.seconds for p in mine], [max(p.position, 1e-14) for p in mine], ms=3, lw=1, **_style(tool)
                )
                handles.setdefault(label, line)
            panel.set(title=name, xlabel="time, ms")
            panel.xaxis.set_minor_formatter(NullFormatter())
        for panel in list(figure.axes)[len(names) :]:
            panel.remove()
        figure.axes[0].set(ylabel="error of the worst position, relative")
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(7, len(handles)))
    return figure


def _style(tool: str) -> dict[str, str]:
    colour = next((c for start, c in COLOURS.items() if tool.startswith(start)), "gray")
    dashed = tool.endswith(("no events", "Kvaerno5", "BDF", "BDF + numba"))
    own = tool.startswith(("tsit5", "dopri8"))
    return {"color": colour, "ls": "--" if dashed else "-" if own else ":", "marker": "o" if own else "s"}
