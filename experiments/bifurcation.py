"""Bifurcations: `python -m experiments.bifurcation` writes out/bifurcation.nc and its pictures.

The sweep simulates the slider-crank at 5000 rpm for many values of its clearance, 200 revolutions each. It is the sweep
of the file `experiments/studies/bifurcation.toml`, which `clearance run` can run and draw without this script. The
piston's velocity is recorded once in each revolution of the last half, at the dead centre where an ideal piston stands
still (a Poincare section). The largest Lyapunov exponent is computed over the same revolutions, from the variational
equations. An interrupted run continues when it is started again.

A motion is called chaotic if its exponent is positive and larger than twice its uncertainty. It is called regular if
the exponent is negative and larger in size than twice the uncertainty. The other motions have no verdict, because the
exponent of a regular motion may be zero, for example at a bifurcation.

The sweep is checked against single solves at ten values of the clearance. A regular motion must agree point by point
(`points differ by` is the difference over the range of all points). Two solves of a chaotic motion move apart by
round-off alone. So their distributions are compared, by the probability that both samples come from one distribution
(Kolmogorov and Smirnov), and their exponents, by the difference over the uncertainties.
"""

import dataclasses
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.stats import ks_2samp

import clearance_jax as cj
from clearance_jax.io.study.study import load_study
from clearance_jax.report.recurrence_figures import bifurcation, sections
from clearance_jax.report.sweep_axes import Exponent, exponent_of
from experiments.common import CRANK_SPEED, STUDIES, compact, output, swept, table
from experiments.publish import command, picture

CLEARANCE = "wrist.radial_clearance"
PERIOD = 2 * np.pi / CRANK_SPEED
SAME = 1e-4
"""Points nearer to each other than this part of all there are belong to one point of a periodic motion."""
MOTIONS = {-1: "regular", 0: "undecided", 1: "chaotic"}


class Size(NamedTuple):
    """Values of the clearance; revolutions of each; of these, those that are looked at; motions compared with single
    solves, and points of the sections that are drawn large.
    """

    values: int = 2000
    revolutions: int = 200
    looked_at: int = 100
    compared: int = 10
    points: int = 2000


QUICK = Size(4, 6, 4, 2, 8)


def question(size: Size) -> dict[str, Any]:
    """The arguments of the sweep, by its file; of another size."""
    asked = load_study(STUDIES / "bifurcation.toml").sweep
    assert asked is not None
    clearances = asked["axes"][CLEARANCE]
    return asked | {
        "axes": {CLEARANCE: np.linspace(clearances[0], clearances[-1], size.values)},
        "outputs": {name: dataclasses.replace(one, count=size.looked_at) for name, one in asked["outputs"].items()},
        "t1": size.revolutions * PERIOD,
    }


def periods(points: np.ndarray, scale: float) -> int:
    """After how many revolutions a motion repeats, of the last half of its points (instants,), in which it has settled
    further; 0: not within a half of these.
    """
    points = points[len(points) // 2 :]
    for n in range(1, len(points) // 2 + 1):
        if np.max(np.abs(points[n:] - points[:-n])) <= SAME * scale:
            return n
    return 0


class Agreement(NamedTuple):
    """A lane of the sweep beside a single solve: both exponents, what both say of the motion, the largest difference of
    the points over all points' range, the probability of samples as different if both are of one distribution, and the
    difference of the exponents over their uncertainties.
    """

    clearance: float
    exponent: float
    single: float
    motion: str
    difference: float
    probability: float
    deviations: float


def compare(found: xr.Dataset, size: Size) -> list[Agreement]:
    """Lanes, evenly chosen, solved again alone."""
    asked, rows = question(size), []
    range_of_all = float(np.ptp(found["section"].values[:, :, 0]))
    for i in np.linspace(0, found.sizes[CLEARANCE] - 1, size.compared).round().astype(int):
        clearance = float(found[CLEARANCE][i])
        alone = cj.replace(asked["mechanism"], {CLEARANCE: clearance})
        solved = cj.measure(alone, asked["outputs"], asked["t1"], rtol=asked["rtol"])
        here, there = found["section"].values[i, :, 0], np.asarray(solved["section"])[:, 0]
        pair = np.stack([found["exponent"].values[i], solved["exponent"]], axis=1)
        (rate, single), (error, other) = pair
        said = set(Exponent(*map(xr.DataArray, pair)).sign.tolist())
        same = cast(Any, ks_2samp(here, there))
        rows.append(
            Agreement(
                clearance,
                exponent=float(rate),
                single=float(single),
                motion=MOTIONS[said.pop() if len(said) == 1 else 0],
                difference=float(np.max(np.abs(here - there))) / range_of_all,
                probability=float(same.pvalue),
                deviations=abs(rate - single) / float(np.hypot(error, other)),
            )
        )
    return rows


def kinds(found: xr.Dataset) -> list[tuple[str, int]]:
    """How many values of the clearance have which kind of motion."""
    points = found["section"].values[:, :, 0]
    scale = float(np.ptp(points[np.isfinite(points)]))
    repeats, sign = np.array([periods(one, scale) for one in points]), exponent_of(found, "exponent").sign
    ended = found["code"].values == 0
    named = [(f"repeats after {n} revolution{'s' if n > 1 else ''}", repeats == n) for n in (1, 2, 3, 4)]
    named += [
        ("repeats after more revolutions", repeats > 4),
        ("chaotic: exponent positive beyond its uncertainty", (repeats == 0) & (sign > 0)),
        ("undecided: exponent zero within its uncertainty", (repeats == 0) & (sign == 0) & ended),
        ("regular, but it has not settled to this accuracy", (repeats == 0) & (sign < 0)),
        ("failed", ~ended),
    ]
    return [(words, int(np.sum(chosen))) for words, chosen in named]


def attractors(found: xr.Dataset, size: Size) -> tuple[xr.Dataset, Figure]:
    """Sections of many points at six clearances, each where the exponent is largest of a sixth of those that are
    chaotic, and their picture.
    """
    rate = exponent_of(found, "exponent")
    chaotic = np.flatnonzero(rate.sign > 0)
    parts = np.array_split(chaotic, 6) if len(chaotic) >= 6 else [np.array([np.nanargmax(rate.value)])]
    best = [int(part[np.argmax(rate.value.values[part])]) for part in parts]
    asked = question(size)
    asked |= {
        "axes": {CLEARANCE: found[CLEARANCE].values[best]},
        "outputs": {"section": dataclasses.replace(asked["outputs"]["section"], count=size.points)},
        "t1": (size.points + size.revolutions - size.looked_at) * PERIOD,
    }
    many = cj.sweep(**asked)
    many["exponent"] = found["exponent"].isel({CLEARANCE: best})
    return many, sections(many, "section", exponent="exponent")


def main(quick: bool = False) -> tuple[xr.Dataset, list[Agreement]]:
    """Write everything; returns the sweep and what single solves say of it."""
    size, ending = (QUICK, "_quick") if quick else (Size(), "")
    found = swept(f"bifurcation{ending}", **question(size))
    found.to_netcdf(output(f"bifurcation{ending}.nc"))
    table(("motion", "values of the clearance"), kinds(found), output(f"bifurcation{ending}.md"))
    rows = compare(found, size)
    head = ("clearance, um", "exponent, 1/s", "of a single solve", "motion")
    head += ("points differ by", "probability", "exponents differ by, uncertainties")
    cells = [
        (
            f"{1e6 * row.clearance:.1f}",
            f"{row.exponent:.1f}",
            f"{row.single:.1f}",
            row.motion,
            f"{row.difference:.1e}" if row.motion == MOTIONS[-1] else "",
            "" if row.motion == MOTIONS[-1] else f"{row.probability:.2f}",
            "" if row.motion == MOTIONS[-1] else f"{row.deviations:.1f}",
        )
        for row in rows
    ]
    table(head, cells, output(f"bifurcation_singles{ending}.md"))
    drawn = compact(bifurcation(found, "section", CLEARANCE, "exponent"), output(f"bifurcation{ending}.png"))
    picture(drawn, "The slider-crank's piston velocity at the dead centre, once a revolution, against the clearance")
    many, figure = attractors(found, size)
    drawn = compact(figure, output(f"bifurcation_sections{ending}.png"))
    count = many.sizes["instant"]
    picture(drawn, f"Poincare sections of {count} points, each where chaos is strongest in a part of the range")
    return found, rows


if __name__ == "__main__":
    command(main, __doc__)
