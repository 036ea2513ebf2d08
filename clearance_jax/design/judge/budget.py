"""The error budget of a point by play, elasticity of contacts, transmission errors and dynamics; joint by joint."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from clearance_jax.analysis.pose_errors import budget_names, check_driven, deviations, has_waves, pose_errors
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.laws.stiffness import Stiffened
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.variants import DRIVE, change_drives, change_each_play
from clearance_jax.results.dataset import picture_dataset
from clearance_jax.results.places import mark_positions
from clearance_jax.solve.settings import evenly, settings_of
from clearance_jax.solve.simulate import run

# The factor on contact stiffness that leaves play alone; the factor on clearances that leaves elasticity alone.
RIGID, CLOSED = 1e6, 1e-3
INSTANTS = 201
WAVES = "transmission_error"


@dataclasses.dataclass(frozen=True)
class ErrorBudget:
    """The error of a `point` of a mechanism, in parts; `print` gives the table.

    - `dataset`: over `time` [s], in metres: `quasi_static` (pins where loads press them), `play` (the same with rigid
      contacts and true gears), `elasticity` (with closed clearances and true gears), `transmission_error` (with closed
      clearances and rigid contacts; only if there is one), `dynamics` (NaN where it was not asked for); of each `joint`
      with play, then of each drive that gives way or coupling with backlash, the vectors `joint_error`, `joint_play`
      and `joint_transmission` that it alone makes (their sum over joints is the whole but for the square of play over
      length); `frequency`, the lowest about each pose [Hz].

    The parts do not add up: a contact gives way more where it is less conformal, and so where there is more play.
    """

    point: str
    dataset: xr.Dataset

    @property
    def peaks(self) -> dict[str, float]:
        """The largest error of each part over time [m]."""
        names = ("dynamics", "quasi_static", "play", "elasticity", WAVES)
        return {name: float(self.dataset[name].max()) for name in names if name in self.dataset}

    @property
    def drives(self) -> tuple[str, ...]:
        """Those of the joints that are drives or couplings."""
        names = self.dataset.joint.values.tolist()
        return tuple(names[int(self.dataset.attrs["pins"]) :])

    @property
    def drawn_at(self) -> dict[str, str]:
        """By joint, drive or coupling the joint where pictures show its share; couplings are left out."""
        joints = {name: name.removesuffix(DRIVE.format("")) for name in self.dataset.joint.values.tolist()}
        return {name: joint for name, joint in joints.items() if joint in self.dataset.attrs["joints"]}

    @property
    def peak_time(self) -> float:
        """When the quasi-static error is largest [s]."""
        return float(self.dataset.time[int(self.dataset.quasi_static.values.argmax())])

    @property
    def shares(self) -> dict[str, float]:
        """What the pin of each joint adds to the quasi-static peak, along the direction of this error [m]."""
        return self._along(self.dataset.joint_error)

    @property
    def play_shares(self) -> dict[str, float]:
        """What of the `shares` it adds with rigid contacts, by its play alone [m]."""
        return self._along(self.dataset.joint_play)

    @property
    def transmission_shares(self) -> dict[str, float]:
        """What of the `shares` its transmission error adds, with rigid contacts and without play [m]."""
        return self._along(self.dataset.get("joint_transmission", 0.0 * self.dataset.joint_play))

    def _along(self, vectors: xr.DataArray) -> dict[str, float]:
        k = int(self.dataset.quasi_static.values.argmax())
        whole = self.dataset.joint_error[k].sum("joint").values
        parts = vectors[k].values @ (whole / max(np.linalg.norm(whole), 1e-300))
        return dict(zip(self.dataset.joint.values.tolist(), map(float, parts), strict=True))

    def __str__(self) -> str:
        return "\n".join(_lines(self))


def error_budget(mechanism: Mechanism, point: str, t1: float, dynamics: bool = True, **options: Any) -> ErrorBudget:
    """The error budget of a named point over a motion.

    **Arguments:** `mechanism`, whose drives move it; `point`: the name of one of its points; `t1`: the motion's end
    [s]; `dynamics`: whether the equations of motion are solved as well; `options`: as `simulate`'s, by default with a
    settled start and `rtol=1e-6`.

    **Returns:** an `ErrorBudget`, over 201 instants.

    **Raises:** `ClearanceError` for an unknown point, a mechanism without play, and one that moves freely.
    """
    names = [p.name for p in mechanism.points]
    if point not in names:
        raise unknown_name(f"There is no point `{point}`.", point, names)
    joints = budget_names(mechanism)
    if not joints:
        raise ClearanceError("A mechanism without play has no error. Give a joint clearance.").about("clearance")
    check_driven(mechanism)
    settings = settings_of(mechanism, t1, {"start": "settled", "rtol": 1e-6} | options | {"save_at": INSTANTS})
    times, index = evenly(settings.t0, t1, INSTANTS), names.index(point)

    def parts_of(mechanism: Mechanism, stiffer: float):
        # A law within a law: any factor uses the same program.
        stiff = change_each_play(mechanism, lambda p: dataclasses.replace(p, normal=Stiffened(p.normal, stiffer)))
        stiff = change_drives(stiff, stiffer=stiffer)
        return pose_errors(stiff, index, times, mark_positions)

    closed = change_drives(change_each_play(mechanism, _closer), closer=CLOSED)
    parts = {
        "quasi_static": parts_of(mechanism, 1.0),
        "play": parts_of(change_drives(mechanism, truer=CLOSED), RIGID),
        "elasticity": parts_of(change_drives(closed, truer=CLOSED), 1.0),
    }
    if has_waves(mechanism):
        parts[WAVES] = parts_of(closed, RIGID)
    for name, part in parts.items():
        if not bool(jnp.all(part.good)):
            raise ClearanceError(f"There is no quasi-static pose for the part `{name}` of the error: {_BAD[name]}.")
    sizes = {name: np.linalg.norm(part.whole, axis=1) for name, part in parts.items()}
    sizes["dynamics"] = np.full(INSTANTS, np.nan)
    if dynamics:
        solution = run(mechanism, t1, settings)
        sizes["dynamics"] = np.asarray(deviations(mechanism, index, solution.time, solution.y))
    variables: dict[str, Any] = {name: ("time", np.asarray(size), {"units": "m"}) for name, size in sizes.items()}
    vectors = {"joint_error": parts["quasi_static"].joints, "joint_play": parts["play"].joints}
    vectors |= {"joint_transmission": parts[WAVES].joints} if WAVES in parts else {}
    for name, vector in vectors.items():
        variables[name] = (("time", "joint", "axis"), np.asarray(vector), {"units": "m"})
    variables["frequency"] = ("time", np.asarray(parts["quasi_static"].frequency), {"units": "Hz"})
    attrs = {"point": point, "mechanism": mechanism.name, "pins": len(mechanism.clearance_joints())}
    attrs["joints"] = [joint.name for joint in (*mechanism.joints, *mechanism.loops)]
    drawn = picture_dataset(mechanism, np.asarray(times), {"mark_position": np.asarray(parts["quasi_static"].drawn)})
    drawn = drawn.rename(axis="page_axis").assign_coords(joint=[*joints], axis=["x", "y", "z"])
    return ErrorBudget(point, drawn.assign(variables).assign_attrs(attrs))


_BAD = {
    "quasi_static": "a pin finds no rest under its load",
    "play": "with contacts so stiff a pin finds no rest under its load",
    "elasticity": "with clearances so small a pin finds no rest under its load",
    WAVES: "with clearances so small and contacts so stiff a pin finds no rest under its load",
}


def _closer(clearance):
    """The clearance with nearly no play."""
    sizes = {name: getattr(clearance, name) for name, play in clearance.sizes().items() if play}
    return dataclasses.replace(clearance, **{name: CLOSED * x for name, x in sizes.items() if x is not None})


def _lines(budget: ErrorBudget):
    peaks, um = budget.peaks, 1e6
    if np.isfinite(peaks["dynamics"]):
        yield f"`{budget.point}` is off by {peaks['dynamics'] * um:.4g} um at most (dynamics)"
    yield f"quasi-static: {peaks['quasi_static'] * um:.4g} um at most, at {budget.peak_time:.4g} s"
    yield f"  play alone (contacts {RIGID:g} times stiffer): {peaks['play'] * um:.4g} um"
    yield f"  elasticity alone (clearances {CLOSED:g} of theirs): {peaks['elasticity'] * um:.4g} um"
    if WAVES in peaks:
        yield f"  transmission error alone: {peaks[WAVES] * um:.4g} um"
    yield f"lowest frequency of pins about their places of rest: {float(budget.dataset.frequency.min()):.3g} Hz"
    shares, play, waves = budget.shares, budget.play_shares, budget.transmission_shares
    width, more = max(map(len, shares)), f"  {'of transmission':>15}" * (WAVES in peaks)
    yield f"{'joint'.ljust(width)}  {'share [um]':>11}  {'of play':>9}  {'of elasticity':>13}{more}"
    for name in sorted(shares, key=lambda name: -abs(shares[name])):
        share, rigid, wave = (um * part[name] for part in (shares, play, waves))
        more = f"  {wave:15.4g}" * (WAVES in peaks)
        yield f"{name.ljust(width)}  {share:11.4g}  {rigid:9.4g}  {share - rigid - wave:13.4g}{more}"
    yield advice(budget)


def advice(budget: ErrorBudget) -> str:
    """A sentence on what reduces the error most."""
    shares, play, waves, peaks = budget.shares, budget.play_shares, budget.transmission_shares, budget.peaks
    worst = max(shares, key=lambda name: abs(shares[name]))
    if np.isfinite(peaks["dynamics"]) and peaks["dynamics"] > 2 * peaks["quasi_static"]:
        return "Most of the error is dynamics: damp or preload the joints, or move with less jerk."
    if worst in budget.drives:
        parts = {"play": play[worst], "transmission error": waves[worst]}
        parts["elasticity"] = shares[worst] - sum(parts.values())
        what = max(parts, key=lambda part: abs(parts[part]))
        return f"Most is {what} of `{worst}`: a drive or gear with less of it helps most."
    if abs(play[worst]) >= 0.5 * abs(shares[worst]):
        return f"Most is play of `{worst}`: a smaller clearance there, a longer sleeve, or a preload helps most."
    return f"Most is elasticity of `{worst}`: a longer sleeve, a larger pin, or a stiffer material helps most."
