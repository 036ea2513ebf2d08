"""Where pins bear, from a dataset: when which contact lasts, and where the pin's centre is along a sleeve."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints.sleeve import lobatto
from clearance_jax.results.episodes import SHORTEST

# Of a contact pattern: what is added where a face bears.
FACE = 4


class Spans(NamedTuple):
    """Stretches of time [s] throughout which a joint bears in one way, one after another; of each its contact pattern
    (in a plane 0 apart, 1 in contact).
    """

    begin: np.ndarray
    end: np.ndarray
    pattern: np.ndarray

    def share(self, chosen: np.ndarray) -> float:
        """Of the whole time the part of some of them."""
        lasts = self.end - self.begin
        return float(np.sum(lasts[chosen]) / np.sum(lasts))


PLANE = "RevoluteClearance"
"""What a pin in a plane sleeve is."""


class Stations(NamedTuple):
    """Of a pin in its sleeve: `heights` along the sleeve's axis [m], (stations,), and there the place of the pin's
    centre from the sleeve's [m], (times, stations, 2), and the penetration [m], (times, stations).
    """

    time: np.ndarray
    heights: np.ndarray
    places: np.ndarray
    penetration: np.ndarray


def require_joint(dataset: xr.Dataset, joint: str) -> str:
    """The name of a clearance joint. **Raises** `ClearanceError` where there is no such joint."""
    known = [str(name) for name in dataset["joint"].values] if "joint" in dataset.coords else []
    if joint not in known:
        raise ClearanceError(f"There is no clearance joint `{joint[:100]}` in this result. {suggest(joint, known)}")
    return joint


def kind(dataset: xr.Dataset, joint: str) -> str:
    """The class of a clearance joint."""
    return str(dataset.attrs.get(f"clearance.{joint}", ""))


def number(dataset: xr.Dataset, joint: str, name: str) -> float | None:
    """A number of a clearance joint, if it has it."""
    found = dataset.attrs.get(f"parameter.{joint}.{name}")
    return None if found is None else float(found)


def worn_depth(dataset: xr.Dataset, joint: str) -> np.ndarray:
    """By how much a sleeve is worn off [m], (1 or stations, sectors); of a round one by nothing."""
    return np.atleast_2d(np.asarray(dataset.attrs.get(f"parameter.{joint}.depth", np.zeros(1)), float))


def outline(dataset: xr.Dataset, joint: str, station: int = 0) -> np.ndarray:
    """How far a pin's centre can go in its sleeve [m], all around, (2, points): a circle, or what wear makes of it."""
    clearance, depths = number(dataset, joint, "radial_clearance") or 0.0, worn_depth(dataset, joint)
    depth = depths[min(station, len(depths) - 1)]
    around = np.linspace(0, 2 * np.pi, max(361, depth.size + 1))
    far = np.full(around.shape, clearance)
    if np.any(depth > 0):
        # The wall of each sector is a half-plane to the centre of a round pin.
        ahead = np.cos(around[:, None] - 2 * np.pi * np.arange(depth.size) / depth.size)
        far = np.where(ahead > 0, (clearance + depth) / np.where(ahead > 0, ahead, 1.0), np.inf).min(axis=1)
    return far * np.stack([np.cos(around), np.sin(around)])


def penetration(dataset: xr.Dataset, joint: str, places: np.ndarray) -> np.ndarray:
    """How deep a pin stands in the wall [m] whose centre is at places (times, stations, 2)."""
    clearance, depth = number(dataset, joint, "radial_clearance") or 0.0, worn_depth(dataset, joint)
    if not np.any(depth > 0):
        return np.hypot(places[..., 0], places[..., 1]) - clearance
    angle = 2 * np.pi * np.arange(depth.shape[1]) / depth.shape[1]
    return np.max(places @ np.stack([np.cos(angle), np.sin(angle)]) - depth, axis=-1) - clearance


def spans(dataset: xr.Dataset, joint: str) -> Spans:
    """When a joint bears how: what is known at a step's end holds until the next one, for every touch and separation is
    one. Without step ends (of a `Solution`) the samples have to do.
    """
    steps = "step_time" in dataset
    time = dataset["step_time" if steps else "time"].values
    name = ("step_pattern", "contact_pattern") if "contact_pattern" in dataset else ("step_state", "contact_state")
    codes = dataset[name[0] if steps else name[1]].sel(joint=require_joint(dataset, joint)).values.astype(int)
    if "contact_pattern" not in dataset:
        codes = np.minimum(codes, 1)  # an impact is a contact
    if len(time) < 2:
        raise ClearanceError("A motion needs two instants at least, but this result has fewer.")
    codes, begin, end = codes[:-1], time[:-1], time[1:]
    # What lasts for less is round-off.
    lasting = end - begin >= SHORTEST
    codes, begin = codes[lasting], begin[lasting]
    first = np.flatnonzero(np.concatenate([[True], codes[1:] != codes[:-1]]))
    begin = begin[first]
    return Spans(begin, np.append(begin[1:], time[-1]), codes[first])


def stations(dataset: xr.Dataset, joint: str) -> Stations:
    """The pin's centre at every station of a sleeve, at the samples and, where these are known, at the step ends; of a
    pin that cannot tilt at one.

    **Raises** `ClearanceError` of a joint that is no pin in a sleeve.
    """
    if kind(dataset, require_joint(dataset, joint)) not in (PLANE, "SleeveClearance"):
        raise ClearanceError(f"`{joint}` has no pin in a sleeve: it is a {kind(dataset, joint) or 'joint unknown'}.")
    names = [("time", "eccentricity", "pin_tilt")]
    if "step_time" in dataset:
        names.append(("step_time", "step_eccentricity", "step_tilt"))
    here, tilts = dataset.sel(joint=joint), kind(dataset, joint) == "SleeveClearance"
    time = np.concatenate([here[name].values for name, _, _ in names])
    place = np.concatenate([here[name].values for _, name, _ in names])
    time, order = np.unique(time, return_index=True)
    place, heights = place[order], np.zeros(1)
    centre = place[:, None, :2]
    if tilts:
        tilt = np.concatenate([here[name].values for _, _, name in names])[order]
        heights = sleeve_heights(dataset, joint)
        centre = along_sleeve(place, tilt, heights, through=is_through(dataset, joint))
    return Stations(time, heights, centre, penetration(dataset, joint, centre))


def is_through(dataset: xr.Dataset, joint: str) -> bool:
    """Whether the pin of a sleeve is the longer one."""
    return dataset.attrs.get(f"clearance.{joint}.pin", "through") == "through"


def sleeve_heights(dataset: xr.Dataset, joint: str) -> np.ndarray:
    """Of a sleeve with tilt its stations along the axis [m]."""
    places, _ = lobatto(int(dataset.attrs[f"clearance.{joint}.stations"]))
    return 0.5 * (number(dataset, joint, "length") or 0.0) * places


def along_sleeve(place: np.ndarray, tilt: np.ndarray, heights: np.ndarray, through: bool) -> np.ndarray:
    """The pin's centre at heights along the sleeve [m], (times, heights, 2), from its middle's place (times, 3) and the
    components of its axis across (times, 2): of a longer pin where its axis comes by a height of the sleeve, of a
    shorter one so far along its own.
    """
    if not through:
        return place[:, None, :2] + tilt[:, None] * heights[:, None]
    slope = tilt / np.sqrt(1 - np.sum(tilt**2, axis=1, keepdims=True))
    return place[:, None, :2] + slope[:, None] * (heights - place[:, 2:])[..., None]
