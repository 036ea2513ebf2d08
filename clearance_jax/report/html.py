"""Reports of designs and calibrations as one HTML file, with figures and numbers inside.

Everything on it was found before; a template says where it stands.
"""

import io
import math
from pathlib import Path

import jinja2
import matplotlib as mpl
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from clearance_jax.calibrate.result import Calibration
from clearance_jax.design.findings import Findings
from clearance_jax.errors import ClearanceError
from clearance_jax.report import calibration_figures, design_figures, mechanism_figure, words

FILTERS = (
    words.quantity,
    words.percent,
    words.instant,
    words.pressure,
    words.span,
    words.deviations,
    words.settings,
    words.breakable,
)
FIGURES = (
    mechanism_figure.mechanism,
    design_figures.pin_in_sleeve,
    design_figures.over_time,
    design_figures.contributions,
    design_figures.trade,
    design_figures.intervals,
    design_figures.convergence,
    calibration_figures.signal_fit,
    calibration_figures.interval_widths,
    calibration_figures.correlations,
)


def write_report(findings: Findings, path: str | Path, title: str = "Tolerance design", study: str = "") -> None:
    """Write the HTML file; `study`: the text of the study file. **Raises** `ClearanceError` where it cannot."""
    _write(render(findings, title, study), Path(path))


def calibration_report(found: Calibration, path: str | Path, title: str = "Calibration", study: str = "") -> None:
    """Write a calibration as one HTML file: values, intervals, residuals over time.

    **Arguments:** `found`: what `calibrate` found; `path` of the file; `title` of the page; `study`: the text of the
    study.

    **Raises:** `ClearanceError` if it cannot be written.
    """
    _write(_environment().get_template("calibration.html").render(found=found, title=title, study=study), Path(path))


def _write(page: str, path: Path) -> None:
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ClearanceError(f"Cannot write the report `{path}`: {error.strerror}. Choose another path.") from None


def render(findings: Findings, title: str = "Tolerance design", study: str = "") -> str:
    """The page of a design's findings."""
    return _environment().get_template("design.html").render(found=findings, title=title, study=study)


def _environment() -> jinja2.Environment:
    """The templates, with what they may call; names of a study are text there, never markup."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("clearance_jax.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {function.__name__: function for function in FILTERS}
    environment.globals |= {function.__name__: function for function in FIGURES} | {
        "embedded": embed,
        "infinity": math.inf,
    }
    return environment


def embed(figure: Figure, caption: str) -> Markup:
    """A figure as SVG inside a page, with its caption."""
    text = io.StringIO()
    # Without a date the same design gives the same file; text stays text, which can be searched and read aloud.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": caption}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    described = f'<svg role="img" aria-label="{escape(caption)}"'
    svg = svg[svg.index("<svg") :].replace("<svg", described, 1)
    return Markup(f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>")
