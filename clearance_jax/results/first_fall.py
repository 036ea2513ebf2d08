"""Which of the forces in a dataset belong to the first fall: what a start in mid-air causes, and the machine does not.

A pin that starts apart from its wall falls. Its first fall ends with the first separation after the first touch; where
contact goes on instead, as soon as that is no impact any more.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr


class Load(NamedTuple):
    """A contact force [N], when it acts [s], and in which joint."""

    force: float
    time: float
    joint: str


class Loads(NamedTuple):
    """The largest contact force of a motion; `falling`: whether it belongs to the first fall of its pin, `centred`:
    whether that pin fell from the sleeve's centre; the largest one `after` the first falls (`None`: there is none).
    """

    largest: Load
    falling: bool
    centred: bool
    after: Load | None

    def __str__(self) -> str:
        text = f"largest force {_words(self.largest)}"
        if not self.falling:
            return text
        text += ", the first fall from the sleeve's centre" if self.centred else ", the first fall from the start"
        return text if self.after is None else f"{text}; after it {_words(self.after)}"


def first_fall_ends(dataset: xr.Dataset) -> np.ndarray:
    """When the first fall of each joint's pin is over [s]; minus infinity for one that does not fall.

    **Arguments:** a dataset of a trace.
    """
    time, states = dataset["step_time"].values, dataset["step_state"].values
    return np.array([_end(time, own) for own in states.T])


def _end(time: np.ndarray, states: np.ndarray) -> float:
    touches = np.flatnonzero(states > 0)
    if states[0] > 0 or touches.size == 0:
        return -np.inf
    over = touches[0] + np.flatnonzero(states[touches[0] :] != 2)
    return float(time[over[0]]) if over.size else np.inf


def loads(dataset: xr.Dataset) -> Loads | None:
    """The largest contact forces of a trace's dataset; `None` where no surfaces met."""
    ends, every = first_fall_ends(dataset), _all(dataset)
    if not every:
        return None
    joints = list(dataset["joint"].values)
    largest = max(every)
    own = joints.index(largest.joint)
    later = [load for load in every if load.time > ends[joints.index(load.joint)]]
    centred = not np.any(dataset["step_eccentricity"].values[0, own])
    return Loads(largest, largest.time <= ends[own], centred, max(later, default=None))


def peak_words(dataset: xr.Dataset, name: str, point: str) -> str:
    """The largest size of a point's velocity or acceleration in words: when, whether pins were still falling for the
    first time, and the largest one after that.
    """
    time, unit = dataset["time"].values, dataset[name].attrs["units"]
    size = np.linalg.norm(dataset[name].sel(point=point).values, axis=-1)

    def say(k: int) -> str:
        return f"{size[k]:.6g} {unit} at {seconds(float(time[k]))}"

    largest = int(np.argmax(size))
    falling = time <= max(first_fall_ends(dataset), default=-np.inf) if "step_state" in dataset else time < time[0]
    if not falling[largest]:
        return say(largest)
    text = f"{say(largest)}, as pins first fall"
    return text if np.all(falling) else f"{text}; after it {say(int(np.argmax(np.where(falling, 0.0, size))))}"


def _all(dataset: xr.Dataset) -> list[Load]:
    """The peak of every episode, and of every joint the highest peak at a step's end after its first fall (an episode
    that goes on after the fall has its largest force in it).
    """
    joints, time = dataset["joint"].values, dataset["step_time"].values
    out = [
        Load(float(force), float(at), str(joints[int(joint)]))
        for joint, at, force in zip(
            *(dataset[name].values for name in ("episode_joint", "peak_time", "peak_force")), strict=True
        )
    ]
    for joint, end, forces in zip(joints, first_fall_ends(dataset), dataset["step_force"].values.T, strict=True):
        forces = np.where((time > end) & _peaks(forces), forces, 0.0)
        k = int(np.argmax(forces))
        if np.isfinite(end) and forces[k] > 0:
            out.append(Load(float(forces[k]), float(time[k]), str(joint)))
    return out


def _peaks(forces: np.ndarray) -> np.ndarray:
    """Where a force stops rising: what only dies away after an impact has its largest value in the impact."""
    rises = np.diff(forces, prepend=forces[0]) > 0
    return rises & (np.diff(forces, append=-np.inf) <= 0)


def _words(load: Load) -> str:
    return f"{load.force:.6g} N at {seconds(load.time)}"


def seconds(time: float) -> str:
    """An instant in words, in ms where it is early."""
    return f"{time * 1e3:.4g} ms" if time < 0.1 else f"{time:.4g} s"
