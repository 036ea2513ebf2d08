"""Contact forces in a dataset that belong to the first fall, an artefact of a start without contact.

A pin that starts apart from its wall falls. Its first fall ends at the first separation after the first touch, or, if
contact goes on, when the contact stops being an impact.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr


class ForcePeak(NamedTuple):
    """A contact force [N], when it acts [s], and in which joint."""

    force: float
    time: float
    joint: str


class Loads(NamedTuple):
    """The largest contact force of a motion; `falling`: whether it belongs to the first fall of its pin, `centred`:
    whether that pin fell from the sleeve's centre; the largest one `after` the first falls (`None`: there is none).
    """

    largest: ForcePeak
    falling: bool
    centred: bool
    after: ForcePeak | None

    def __str__(self) -> str:
        text = f"largest force {_words(self.largest)}"
        if not self.falling:
            return text
        text += ", the first fall from the sleeve's centre" if self.centred else ", the first fall from the start"
        return text if self.after is None else f"{text}; after it {_words(self.after)}"


def first_fall_ends(dataset: xr.Dataset) -> np.ndarray:
    """When the first fall of each joint's pin in a trace ends [s]; minus infinity for one that does not fall."""
    return first_falls_over(dataset["step_time"].values, dataset["step_state"].values)


def first_falls_over(time: np.ndarray, states: np.ndarray) -> np.ndarray:
    """As `first_fall_ends`, from the times [s] and contact states (steps, joints) of the step ends."""
    ends = np.full(states.shape[1], -np.inf)
    for joint, column in enumerate(states.T):
        touches = np.flatnonzero(column > 0)
        if column[0] == 0 and touches.size:
            over = touches[0] + np.flatnonzero(column[touches[0] :] != 2)
            ends[joint] = time[over[0]] if over.size else np.inf
    return ends


def falls_over(dataset: xr.Dataset) -> float:
    """When the last of the first falls that end is over [s]; minus infinity where no pin falls."""
    if not dataset.sizes.get("joint"):
        return -np.inf
    names = ("step_time", "step_state") if "step_state" in dataset else ("time", "contact_state")
    ends = first_falls_over(*(dataset[name].values for name in names))
    return max(ends[np.isfinite(ends)], default=-np.inf)


def loads(dataset: xr.Dataset) -> Loads | None:
    """The largest contact forces of a trace's dataset; `None` where no surfaces met."""
    ends, every = first_fall_ends(dataset), _all(dataset)
    if not every:
        return None
    joints = list(dataset["joint"].values)
    largest = max(every)
    joint = joints.index(largest.joint)
    later = [load for load in every if load.time > ends[joints.index(load.joint)]]
    centred = not np.any(dataset["step_eccentricity"].values[0, joint])
    return Loads(largest, largest.time <= ends[joint], centred, max(later, default=None))


def peak_words(dataset: xr.Dataset, name: str, point: str) -> str:
    """The largest "speed" or "acceleration" of a point in words: when, whether pins were in their first fall, and the
    largest one after it. Without a trace it is the largest of the samples, and the text says so.
    """
    vector = "velocity" if name == "speed" else name
    unit = dataset[vector].attrs["units"]

    def say(value: float, time: float) -> str:
        return f"{value:.6g} {unit} at {seconds(time)}"

    if f"largest_{name}" not in dataset:
        size = np.linalg.norm(dataset[vector].sel(point=point).values, axis=-1)
        k = int(np.argmax(size))
        return f"{say(float(size[k]), float(dataset['time'][k]))}, of {size.size} samples"
    values, times = (dataset[f"largest_{name}{end}"].sel(point=point).values for end in ("", "_time"))
    over = max(first_fall_ends(dataset), default=-np.inf) if "step_state" in dataset else -np.inf
    text = say(values[0], times[0])
    if times[0] > over:
        return text
    return f"{text}, as pins first fall" + (f"; after it {say(values[1], times[1])}" if len(values) > 1 else "")


def _all(dataset: xr.Dataset) -> list[ForcePeak]:
    """Every episode's peak, and every joint's highest peak after its first fall (an episode may last beyond that)."""
    joints, time = dataset["joint"].values, dataset["step_time"].values
    columns = (dataset[name].values for name in ("episode_joint", "peak_time", "peak_force"))
    rows = zip(*columns, strict=True)
    out = [ForcePeak(float(force), float(at), str(joints[int(joint)])) for joint, at, force in rows]
    for joint, end, forces in zip(joints, first_fall_ends(dataset), dataset["step_force"].values.T, strict=True):
        # A peak is where a force stops rising, so there is none where the force of an impact decays.
        peaks = (np.diff(forces, prepend=forces[0]) > 0) & (np.diff(forces, append=-np.inf) <= 0)
        forces = np.where((time > end) & peaks, forces, 0.0)
        k = int(np.argmax(forces))
        if np.isfinite(end) and forces[k] > 0:
            out.append(ForcePeak(float(forces[k]), float(time[k]), str(joint)))
    return out


def _words(load: ForcePeak) -> str:
    return f"{load.force:.6g} N at {seconds(load.time)}"


def seconds(time: float) -> str:
    """A time in words, in ms below 0.1 s."""
    return f"{time * 1e3:.4g} ms" if time < 0.1 else f"{time:.4g} s"
