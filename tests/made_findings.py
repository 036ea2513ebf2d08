"""Findings of a design made by hand, and what a reader reads of its report."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from catalogue import slider_crank

from clearance_jax import design, metrics
from clearance_jax.design.judge.observed import joint_drawings
from clearance_jax.design.search.yields import YieldEstimate
from clearance_jax.joints import fits
from clearance_jax.results.dataset import picture_dataset
from clearance_jax.results.places import picture

CLEARANCE = "wrist.radial_clearance"

TIMES = np.linspace(0.0, 0.012, 50)


def answer(limits, cost_unit: str = "EUR", held: bool = True, **options) -> design.Design:
    """A design of the slider-crank's wrist, without a solve."""
    problem = design.ToleranceProblem(
        slider_crank(),
        0.012,
        {CLEARANCE: (1e-5, 1e-3)},
        limits,
        design.Reciprocal(1e-4),
        cost_unit=cost_unit,
        **options,
    )
    asked = problem.specification
    rows = [(limit.title, label) for limit in asked.limits for label in limit.labels(3)] * len(asked.conditions)
    value = -1e-4 if held else 0.5

    def evaluate(x, gradient):
        return design.Evaluation(x, 1e-4 / x[0], np.full(len(rows), value), -1e-4 / x**2, np.ones((len(rows), 1)))

    program = design.Program(evaluate, asked.names, *asked.bounds, [row[1] for row in rows], [row[0] for row in rows])
    program.at(np.array([1e-4]), True)
    return design.Design(asked, program, design.METHODS["slsqp"], program.at(np.array([8e-5]), True), "", "")


def piston_limit(name: str = "piston") -> design.Limit:
    return design.Limit(metrics.Peak(metrics.PositionError("piston")), 2e-4, name)


@functools.cache
def crank_motion(count: int = 50) -> xr.Dataset:
    """Of a crank that turns from its dead centre, and of a pin that circles in its sleeve, out to the wall half way."""
    angle, turn = np.linspace(0.0, np.pi / 2, count), np.linspace(0, 2 * np.pi, count)
    rod = -np.arcsin(0.05 * np.sin(angle) / 0.12)
    far = np.where(turn > np.pi, 5.1e-4, 4e-4)
    slider = 0.05 * np.cos(angle) + 0.12 * np.cos(rod) - far * np.cos(turn)
    y = jnp.asarray(np.stack([rod - angle, slider, 0 * angle, 0 * angle], 1))
    mechanism, times = slider_crank(), angle / (5000 * np.pi / 30)
    at = jax.jit(jax.vmap(lambda t, y: picture(mechanism.prepare(), t, y)))(times, y)
    return picture_dataset(mechanism, times, jax.tree.map(np.asarray, at))


def made(found: design.Design, length: float | None = 0.02) -> design.Findings:
    """Everything that can be found of a design, by hand."""
    (limit,) = found.specification.limits
    fit = fits.fit(0.02, "H8/f7")
    standard = design.StandardFits({CLEARANCE: fit}, -0.02, -0.6, YieldEstimate(1.0, 0.985, 200))
    drawn = joint_drawings(found, standard.fits)
    values = {"": 1e-4 * np.abs(np.sin(600 * TIMES))}
    return design.Findings(
        found,
        responses=(
            design.Response(limit.label, limit.label, "m", 1.9e-4, 2e-4, {CLEARANCE: "m"}, {CLEARANCE: 1.5},
                            {CLEARANCE: 1.2e-4}),
        ),
        tradeoff=design.Tradeoff(
            limit.title, "m", np.array([1e-4, 2e-4]), np.array([np.nan, 1.25]), (None, {CLEARANCE: 8e-5}),
            limit.label, 2e-4,
        ),
        fits=standard,
        time_histories=(design.TimeHistory(limit.label, limit.signal_label, "m", "", 4e-3, 2e-4, TIMES, values),),
        notes=("A note.",),
        standings=(design.Standing(limit.labels(3)[0], "m", 1.9998e-4, 2e-4, 0.9999, 0.0034),),
        drawings=drawn,
        loads=(design.JointLoad("wrist", "", 2449.0, 0.0004285, 156.2, 7, 0.26, 0.0104, 0.02, length),),
        motions={"": crank_motion()},
        software="clearance_jax 0.1.0",
    )  # fmt: skip


def text_of(page: str) -> str:
    """What a reader reads: no figures, no markup, no line breaks."""
    return " ".join(re.sub(r"<[^>]*>", "", re.sub(r"<(svg|style).*?</\1>", "", page, flags=re.S)).split())


def rows_of(page: str, head: str) -> list[list[str]]:
    """The rows of the table whose first head is so called, cell by cell."""
    table = next(t for t in re.findall(r"<table>.*?</table>", page, re.S) if f"<th>{head}</th>" in t)
    return [
        [text_of(c) for c in re.findall(r"<td.*?</td>", row, re.S)]
        for row in re.findall(r"<tr>.*?</tr>", table, re.S)[1:]
    ]
