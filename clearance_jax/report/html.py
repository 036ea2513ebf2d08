"""Reports of designs and calibrations as one HTML file, with figures and numbers inside, and how these are written.

A page shows findings that were computed before. Templates say where they stand.
"""

import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from clearance_jax.calibrate.result import Calibration
from clearance_jax.design.judge.findings import Findings
from clearance_jax.report import calibration_figures, design_figures
from clearance_jax.report.panels import SHORT
from clearance_jax.results.store import whole_file
from clearance_jax.units import format_quantity


def quantity(value: float | None, unit: str, digits: int = 6) -> str:
    """A quantity in a unit of the workshop; empty for `None`."""
    return "" if value is None else format_quantity(value, unit, digits).replace(" um", " µm")


def percent(share: float, digits: int = 1) -> str:
    """A share in percent."""
    return f"{100 * share:.{digits}f} %"


def instant(time: float | None) -> str:
    """A time [s], in ms or s as the time axes have it."""
    if time is None:
        return ""
    return f"{1e3 * time:.5g} ms" if abs(time) < SHORT else f"{time:.5g} s"


def pressure(value: float | None) -> str:
    """A pressure [Pa], in MPa."""
    return "" if value is None else f"{1e-6 * value:.4g} MPa"


def span(ends: tuple[float, float]) -> str:
    """A least and a greatest length [m], in µm."""
    return f"{1e6 * ends[0]:g} to {1e6 * ends[1]:g} µm"


def deviations(ends: tuple[float, float]) -> str:
    """Of a size, as on a drawing: the upper over the lower one [m], in µm."""
    upper, lower = (f"{1e6 * end:+g}" if end else "0" for end in ends[::-1])
    return f"{upper} / {lower} µm".replace("-", "−").replace(" ", "\N{NO-BREAK SPACE}")


def settings(values: Mapping[str, Any]) -> str:
    """Values by name."""
    return ", ".join(f"{name} = {np.asarray(value).tolist()}" for name, value in values.items())


def breakable(text: Any) -> Markup:
    """A text whose long names may break after a dot or an underline: a phone is narrow."""
    return Markup(re.sub(r"(?<=[A-Za-z0-9])([._])(?=[A-Za-z])", r"\1<wbr>", str(escape(text))))


FILTERS = (quantity, percent, instant, pressure, span, deviations, settings, breakable)
FIGURES = {
    design_figures: (
        "mechanism", "pin_in_sleeve", "bearing", "over_time", "contributions", "trade", "intervals", "convergence",
    ),
    calibration_figures: ("signal_fit", "interval_widths", "correlations"),
}  # fmt: skip


def write_report(findings: Findings, path: str | Path, title: str = "Tolerance design", study: str = "") -> None:
    """Write the HTML file; `study`: the text of the study file. **Raises** `ClearanceError` where it cannot."""
    _write(render(findings, title, study), path)


def calibration_report(found: Calibration, path: str | Path, title: str = "Calibration", study: str = "") -> None:
    """Write a calibration as one HTML file: values, intervals, residuals over time.

    **Arguments:** `found`: what `calibrate` found; `path` of the file; `title` of the page; `study`: the text of the
    study.

    **Raises:** `ClearanceError` if it cannot be written.
    """
    _write(_environment().get_template("calibration.html").render(found=found, title=title, study=study), path)


def _write(page: str, path: str | Path) -> None:
    with whole_file(path, "the report ") as partial:
        partial.write_text(page, encoding="utf-8")


def render(findings: Findings, title: str = "Tolerance design", study: str = "") -> str:
    """The page of a design's findings."""
    return _environment().get_template("design.html").render(found=findings, title=title, study=study)


def _environment() -> jinja2.Environment:
    """The templates, with what they may call; names of a study are text there, never markup."""
    how: Any = {"autoescape": True, "undefined": jinja2.StrictUndefined, "trim_blocks": True, "lstrip_blocks": True}
    environment = jinja2.Environment(loader=jinja2.PackageLoader("clearance_jax.report"), **how)
    environment.filters |= {function.__name__: function for function in FILTERS}
    environment.globals |= {name: getattr(module, name) for module, names in FIGURES.items() for name in names}
    environment.globals |= {"embedded": embed, "infinity": math.inf}
    return environment


def embed(figure: Figure, caption: str) -> Markup:
    """A figure as SVG inside a page, with its caption."""
    text = io.StringIO()
    # Without a date the same design gives the same file; text stays text, which can be searched and read aloud.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": caption}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    described = f'<svg role="img" aria-label="{escape(caption)}"'
    svg = described + text.getvalue().partition("<svg")[2]
    return Markup(f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>")
