"""The paper's studies as sweeps: `python -m experiments.paper_sweeps` writes out/paper_sweeps.nc, tables and pictures.

Qian et al. 2022 (doi 10.3390/app122111041) simulate joint 5 of a tool-changing robot with three clearances, four drives
and three coefficients of friction, one varied at a time. This page uses the plane model of the scenes
`joint5_velocity_1..4` in the literal reading of `experiments.paper` (damping of Eq. 7, radial clearance). It varies all
three together: clearances up to 1 mm in 200 steps, the four drives of Table 2, and friction from 0 to 0.5. A sample is
one motion of the sweep. All its results come from one solve. An interrupted run continues when it is started again.

The number of impacts depends on the damping. So the four drives are swept again with the damping of Table 1 (e = 0.42).

- Deviation: the largest distance of the end from where the ideal robot has it. Velocity fluctuation: root mean square
  of the end's speed less the ideal one's. Peak acceleration: of the end. Impacts: how often pin and sleeve meet.
- Samples at the paper's clearances are compared with the traced single solves of `experiments.paper`.
- A trend is described by its Spearman rank correlation with the clearance (+1: always rising). If a result scales with
  the clearance, the exponent of the power law through the values from 50 um on is given too.
"""

from typing import Any, ClassVar, NamedTuple, cast

import equinox as eqx
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.stats import spearmanr

import clearance_jax as cj
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.state import layout
from clearance_jax.report.sweep_figures import STYLED, draw_curves, heat_map
from clearance_jax.spatial import length_of
from experiments.common import compact, output, swept, table
from experiments.paper.runs import (
    CLEARANCE,
    END,
    EQ7,
    FRICTION,
    JOINT,
    POINT,
    RTOL,
    SIZES,
    SPEEDS,
    TABLE1,
    Condition,
    Reading,
    drive,
    scene,
    solved,
)
from experiments.publish import command, picture, say

READING = Reading()
LARGEST = 1e-3
"""The largest clearance of the paper [m]."""
SCALING = 50e-6
"""From where on a power law is looked for [m]."""


class Fluctuation(cj.metrics.AbstractSignal):
    """The speed of a point less that of the ideal mechanism at the same time [m/s]."""

    unit: ClassVar[str] = "m/s"
    needs_ideal: ClassVar[bool] = True
    point: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        return self._speed(time, y, mechanism) - self._speed(time, reference, mechanism.ideal())

    def _speed(self, time, y, mechanism):
        point = next(point for point in mechanism.points if point.name == self.point)
        frame = frames(mechanism, time, layout(mechanism).split(y))[point.body]
        return length_of(frame.velocity_at(frame.point(point.at.vector)))


class Result(NamedTuple):
    """A result of a lane: how it is got, its unit, and what it is called."""

    metric: Any
    unit: str
    words: str


RESULTS = {
    "deviation": Result(cj.metrics.Peak(cj.metrics.PositionError(POINT)), "m", "largest deviation"),
    "fluctuation": Result(cj.metrics.Rms(Fluctuation(POINT)), "m/s", "velocity fluctuation, RMS"),
    "acceleration": Result(cj.metrics.Peak(cj.metrics.Acceleration(POINT)), "m/s^2", "peak acceleration"),
    "peak_force": Result(cj.metrics.Peak(cj.metrics.ContactForce(JOINT)), "N", "peak contact force"),
    "mean_force": Result(cj.metrics.Mean(cj.metrics.ContactForce(JOINT)), "N", "mean contact force"),
    "impacts": Result(cj.metrics.Impacts(JOINT), "", "impacts"),
    "friction_loss": Result("friction_loss", "J", "loss in friction"),
    "loss": Result(cj.metrics.EnergyLost(), "J", "loss in all"),
}


def sweep(
    name: str, clearances: np.ndarray, frictions: np.ndarray, speeds: tuple[str, ...], damping: str = EQ7
) -> xr.Dataset:
    """All of them with each other."""
    drives = [drive(speed) for speed in speeds]
    # A drive is the numbers of its table, and when the last of its steps ends.
    columns = {
        f"{part}.{i}": [one[part][i] for one in drives] for part in drives[0] for i in range(len(drives[0][part]))
    }
    found = swept(
        name,
        mechanism=scene(READING.world, damping),
        axes={
            CLEARANCE: clearances,
            FRICTION: frictions,
            "drive": cj.Zipped(columns | {"t1": [one[END][-1] for one in drives]}),
        },
        outputs={name: one.metric for name, one in RESULTS.items()},
        rtol=RTOL,
        energy_balance=True,
    )
    say(f"a sample takes {found['steps'].median():.0f} steps (median)")
    found = found.drop_vars([*columns, "t1"]).assign_coords(drive=list(speeds))
    for name, one in RESULTS.items():
        found[name].attrs = {"units": one.unit, "long_name": one.words}
    found[CLEARANCE].attrs["long_name"], found[FRICTION].attrs["long_name"] = "radial clearance", "friction"
    return found


class Trend(NamedTuple):
    """How a result goes with the clearance: rank correlation, exponent of a power law, its values at the paper's
    clearances.
    """

    result: str
    drive: str
    friction: float
    rank: float
    power: float
    values: tuple[float, ...]


def trends(found: xr.Dataset) -> list[Trend]:
    """Of every result, for every drive without friction, and for the first drive with each friction."""
    conditions = [(speed, 0) for speed in found["drive"].values]
    conditions += [(found["drive"].values[0], k) for k in range(1, found.sizes[FRICTION])]
    clearances = found[CLEARANCE].values
    nearest = [int(np.argmin(np.abs(clearances - size))) for size in SIZES]
    rows = []
    for name in RESULTS:
        for speed, k in conditions:
            values = found[name].sel(drive=speed).isel({FRICTION: k}).values.astype(float)
            some = np.isfinite(values) & (values > 0) & (clearances >= SCALING)
            power = np.polyfit(np.log(clearances[some]), np.log(values[some]), 1)[0] if some.sum() > 1 else np.nan
            # Of something that is zero throughout (a loss in no friction) there is no rank.
            ranked = cast(Any, spearmanr(clearances, values, nan_policy="omit")) if np.ptp(values) > 0 else None
            rank = np.nan if ranked is None else ranked.statistic
            friction = float(found[FRICTION][k])
            rows.append(Trend(name, str(speed), friction, float(rank), float(power), tuple(values[nearest])))
    return rows


def singles(found: xr.Dataset) -> list[tuple[float, str, float, float]]:
    """Lanes at the paper's clearances beside the traced solves of `experiments.paper`, which look at samples and step
    ends: clearance, result, the lane's value, the trace's.
    """
    rows = []
    for size in SIZES:
        motion = solved(READING, Condition(size))
        traced = {
            "deviation": motion.deviation.max(),
            "acceleration": np.linalg.norm(motion.acceleration, axis=1).max(),
            "peak_force": motion.peaks.max(),
            "impacts": motion.starts.size,
        }
        here = found.sel({CLEARANCE: size}, method="nearest").sel({FRICTION: 0.0, "drive": SPEEDS[0]})
        rows += [(size, name, float(here[name]), float(value)) for name, value in traced.items()]
    return rows


@STYLED
def drawn(found: xr.Dataset, by: str, fixed: dict[str, Any]) -> Figure:
    """Every result over the clearance, a curve for each value along `by`; dotted lines stand where the paper has its
    points.
    """
    part = found.isel(fixed)
    # What is the same for all lanes is no curve.
    names = [name for name in RESULTS if np.ptp(part[name].values) > 0]
    columns = -(-len(names) // 2)
    figure = Figure(figsize=(3.4 * columns, 2.9 * 2), layout="constrained")
    axes = figure.subplots(2, columns, squeeze=False).ravel()
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes, names, strict=False):
        draw_curves(axis, part, name, CLEARANCE, by)
        for size in SIZES:
            axis.axvline(1e3 * size, color="0.5", lw=0.8, ls=":", zorder=0)
        axis.get_legend().remove()
        axis.set_ylim(0, None)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def main(quick: bool = False) -> tuple[xr.Dataset, list[Trend]]:
    """Write everything; returns the sweep and its trends."""
    steps = 3 if quick else 200
    clearances = LARGEST / steps * np.arange(1, steps + 1)
    frictions = np.array([0.0, 0.3]) if quick else np.linspace(0.0, 0.5, 6)
    ending = "_quick" if quick else ""
    found = sweep(f"paper_sweeps{ending}", clearances, frictions, SPEEDS[:1] if quick else SPEEDS)
    found.to_netcdf(output(f"paper_sweeps{ending}.nc"))
    rows = trends(found)
    cells = [
        (
            RESULTS[row.result].words,
            row.drive,
            f"{row.friction:.1f}",
            "constant" if np.isnan(row.rank) else f"{row.rank:+.3f}",
            "" if np.isnan(row.rank) else f"{row.power:.2f}",
            *(f"{value:.4g} {RESULTS[row.result].unit}".strip() for value in row.values),
        )
        for row in rows
    ]
    head = ("result", "drive", "friction", "rank correlation", "power of the clearance")
    table((*head, *(f"at {1e3 * size:g} mm" for size in SIZES)), cells, output(f"paper_sweeps{ending}.md"))
    if not quick:
        beside = [
            (
                f"{1e3 * size:g} mm",
                RESULTS[name].words,
                f"{value:.6g}",
                f"{traced:.6g}",
                f"{abs(value / traced - 1):.1e}",
            )
            for size, name, value, traced in singles(found)
        ]
        head = ("clearance", "result", "sample", "traced solve", "relative difference")
        table(head, beside, output("paper_sweeps_singles.md"))
    shown = {
        "drives": (
            drawn(found, "drive", {FRICTION: 0}),
            "Joint 5 over its clearance, with the paper's four drives, no friction",
        ),
        "friction": (drawn(found, FRICTION, {"drive": 0}), "Joint 5 over its clearance with Velocity_1 and friction"),
        "map": (
            heat_map(found.isel(drive=0), "fluctuation", CLEARANCE, FRICTION),
            "Velocity fluctuation of the end over clearance and friction, Velocity_1",
        ),
    }
    if not quick:
        bouncing = sweep("paper_sweeps_table1", clearances, np.zeros(1), SPEEDS, TABLE1)
        bouncing.to_netcdf(output("paper_sweeps_table1.nc"))
        caption = "Joint 5 over its clearance with the four drives, no friction, and the damping of Table 1"
        shown["table1"] = (drawn(bouncing, "drive", {FRICTION: 0}), caption)
    for name, (figure, caption) in shown.items():
        # A map has more colours than curves have.
        colours = 255 if name == "map" else 64
        picture(compact(figure, output(f"paper_sweeps_{name}{ending}.png"), colours), caption)
    return found, rows


if __name__ == "__main__":
    command(main, __doc__)
