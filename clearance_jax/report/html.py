"""The report of a design: one HTML file that needs nothing else, its figures inside and the numbers beside them."""

import html
import io
import platform
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from clearance_jax.design.answer import Design
from clearance_jax.design.explain import Response, Tradeoff
from clearance_jax.design.findings import Findings
from clearance_jax.errors import ClearanceError
from clearance_jax.report import design_figures as figures
from clearance_jax.units import shown

CSS = """
:root { color-scheme: light; --line: #d8dce2; --soft: #5b6573; --good: #1b7f4b; --bad: #b3261e; }
* { box-sizing: border-box; }
body { margin: 0; font: 16px/1.5 system-ui, sans-serif; color: #1c2430; background: #f5f6f8; }
main { max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; margin: .5rem 0; } h2 { font-size: 1.15rem; margin: 0 0 .5rem; }
section { background: #fff; border: 1px solid var(--line); border-radius: .5rem; padding: 1rem; margin: 1rem 0; }
.verdict { font-weight: 600; color: var(--good); } .verdict.bad { color: var(--bad); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { vertical-align: bottom; }
th, td { text-align: left; padding: .3rem .6rem .3rem 0; border-bottom: 1px solid var(--line); }
td:not(:first-child) { white-space: nowrap; }
td:not(:first-child), th:not(:first-child) { text-align: right; }
caption, figcaption, .soft { color: var(--soft); font-size: .9rem; text-align: left; }
figure { margin: 1rem 0 0; max-width: 36rem; } figure svg { width: 100%; height: auto; display: block; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .85rem; margin: 0; }
@media (max-width: 40rem) { table { font-size: .85rem; } th, td { padding-right: .35rem; } }
@media print { body { background: #fff; } section { break-inside: avoid; } }
"""


def write_report(found: Findings, path: str | Path, title: str = "Tolerance design", study: str = "") -> None:
    """Write the HTML file; `study`: the text of the study file. **Raises** `ClearanceError` where it cannot."""
    path = Path(path)
    try:
        path.write_text(_page(found, title, study), encoding="utf-8")
    except OSError as error:
        raise ClearanceError(f"Cannot write the report `{path}`: {error.strerror}. Choose another path.") from None


def _page(found: Findings, title: str, study: str) -> str:
    design = found.design
    parts = [_answer(found, title), _limits(found)]
    if found.responses:
        parts.append(_contributions(found.responses))
    if found.tradeoff is not None:
        parts.append(_tradeoff(found.tradeoff, design))
    if found.certificate is not None:
        parts.append(f"<section><h2>Certificate</h2><pre>{html.escape(str(found.certificate))}</pre></section>")
    parts += [_search(design), _asked(design, found.notes, study)]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{CSS}</style></head><body><main>{''.join(parts)}</main></body></html>\n"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    # Long names may break after a dot or an underline: a phone is narrow.
    cells = "".join(f"<th>{_breakable(h)}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{_breakable(c)}</td>" for c in row) + "</tr>" for row in rows)
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return f'<div class="wide"><table>{title}<thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>'


def _breakable(text: str) -> str:
    return re.sub(r"(?<=[A-Za-z0-9])([._])(?=[A-Za-z])", r"\1<wbr>", html.escape(text))


def _figure(figure: Figure, caption: str) -> str:
    text = io.StringIO()
    # Without a date the same design gives the same file.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": caption}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    described = f'<svg role="img" aria-label="{html.escape(caption, quote=True)}"'
    return f"<figure>{svg.replace('<svg', described, 1)}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _answer(found: Findings, title: str) -> str:
    design, units = found.design, found.design.units
    if not design.feasible:
        verdict = f"No feasible design: {design.program.most_violated(design.evaluation)}."
    elif found.certificate is None:
        verdict = "Every limit is held. Not verified by another solver."
    else:
        held = "are held" if found.certificate.holds else "are NOT held"
        verdict = f"The limits {held} in a fresh simulation by another solver ({found.certificate.solver})."
    good = design.feasible and (found.certificate is None or found.certificate.holds)
    fits = {} if found.fits is None else found.fits.fits
    rows = []
    for name, value in design.clearances.items():
        fit = fits.get(name)
        least, greatest = (1e6 * c for c in fit.radial_clearance) if fit else (0.0, 0.0)
        rows.append(
            [name, shown(value, units[name]), fit.name if fit else "", f"{least:g} to {greatest:g}" if fit else ""]
        )
    objective = "" if design.specification.common else f"<p>Cost {design.objective:.6g}.</p>"
    notes = "".join(f'<p class="verdict bad">{html.escape(t)}</p>' for t in (design.stop_reason, design.note) if t)
    share = "" if found.fits is None else f"With these fits: {found.fits.yield_estimate}"
    table = _table(("variable", "largest allowed", "nearest ISO 286 fit", "radial clearance, um"), rows)
    verdict_class = "verdict" if good else "verdict bad"
    return (
        f"<h1>{html.escape(title)}</h1><section><h2>The answer</h2>"
        f'<p class="{verdict_class}">{html.escape(verdict)}</p>{notes}{table}{objective}{_soft(share)}</section>'
    )


def _soft(text: str) -> str:
    return f'<p class="soft">{html.escape(text)}</p>' if text else ""


def _limits(found: Findings) -> str:
    design = found.design
    names, values = design.program.limit_names, design.evaluation.limits
    order = np.argsort(-np.nan_to_num(values, nan=np.inf))[:12]
    rows = [[names[k], f"{100 * (1 + values[k]):.4f} %"] for k in order]
    left = len(names) - len(order)
    caption = f"The {len(order)} nearest to their bounds, of {len(names)}." if left else ""
    captions = {f"{signal.limit} over time, and its bound": signal for signal in found.time_histories}
    plots = "".join(_figure(figures.over_time(signal), caption) for caption, signal in captions.items())
    table = _table(("limit", "share of its bound"), rows, caption)
    return f"<section><h2>Limits</h2>{table}{plots}</section>"


def _contributions(why: Sequence[Response]) -> str:
    tables = []
    for response in why:
        unit = response.unit
        rows = [
            [name, shown(part, unit, 4), f"{part / response.bound:.1%}", response.sensitivity(name)]
            for name, part in response.contributions.items()
        ]
        rows.append(["the rest", shown(response.rest, unit, 4), f"{response.rest / response.bound:.1%}", ""])
        caption = f"{response.where}: {shown(response.value, unit, 5)} of {shown(response.bound, unit, 5)}"
        tables.append(_table(("variable", "contribution", "share of the bound", "sensitivity"), rows, caption))
    note = (
        "A contribution is the clearance times the error's derivative by it; the rest is deformation, inertia and play "
        "that is no variable."
    )
    plot = _figure(figures.contributions(why), "Error budget: each clearance's share of the bound")
    return f"<section><h2>Where the error comes from</h2>{''.join(tables)}{_soft(note)}{plot}</section>"


def _tradeoff(found: Tradeoff, design: Design) -> str:
    common, names = design.specification.common, list(design.clearances)
    unit, rows = next(iter(design.units.values())), []
    for bound, objective, at in zip(found.bounds, found.objectives, found.designs, strict=True):
        value = "none holds it" if at is None else shown(-objective, unit, 5) if common else f"{objective:.5g}"
        sizes = ["" if at is None else shown(at[n], design.units[n], 4) for n in names]
        rows.append([shown(bound, found.unit, 4), value, *sizes])
    head = ("bound", "clearance" if common else "least cost", *names)
    plot = _figure(figures.trade(found, design), "What a tighter bound costs")
    return (
        f"<section><h2>What another bound on {html.escape(found.limit)} would mean</h2>"
        f"{_table(head, rows)}{plot}</section>"
    )


def _search(design: Design) -> str:
    program = design.program
    text = f"{design.method.name}: {program.gradients} evaluations with derivatives, {program.evaluations} without."
    plot = _figure(figures.convergence(design), "Every evaluated design")
    return f"<section><h2>How it was found</h2><p>{html.escape(text)}</p>{plot}</section>"


def _asked(design: Design, notes: Sequence[str], study: str) -> str:
    asked = design.specification
    bounds = [
        [name, shown(low, unit), shown(high, unit)]
        for (name, (low, high)), unit in zip(asked.variables.items(), design.units.values(), strict=True)
    ]
    limits = [[limit.title, shown(limit.bound, limit.metric.unit)] for limit in asked.limits]
    conditions = [
        [name, ", ".join(f"{k} = {np.asarray(v).tolist()}" for k, v in values.items()) or "the mechanism as it is"]
        for name, values in asked.conditions.items()
    ]
    parts = "as designed" if asked.manufacture is None else str(asked.manufacture)
    lines = [
        f"Mechanism {asked.mechanism.name}, to t = {asked.t1:g} s, solver {asked.solver}, rtol {asked.rtol:g}.",
        f"Parts are made: {parts}.",
        f"clearance_jax {version('clearance-jax')}, jax {version('jax')}, Python {platform.python_version()}.",
        *notes,
    ]
    text = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
    source = f"<h2>Study</h2><pre>{html.escape(study)}</pre>" if study else ""
    return (
        f"<section><h2>What was asked</h2>{text}{_table(('variable', 'least', 'greatest'), bounds)}"
        f"{_table(('limit', 'bound'), limits)}{_table(('condition', 'values in SI'), conditions)}{source}</section>"
    )
