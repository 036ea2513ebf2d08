"""Contact patterns of clearance joints over time, and properties of these joints, from a dataset."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.results.episodes import SHORTEST

# Added to a contact pattern while a face bears.
FACE = 4


class BearingSpans(NamedTuple):
    """Consecutive time spans [s] with a constant contact pattern of a joint (in the plane 0 apart, 1 in contact), shape
    (spans,) each.
    """

    begin: np.ndarray
    end: np.ndarray
    pattern: np.ndarray

    def share(self, chosen: np.ndarray) -> float:
        """The fraction of the whole time in the chosen spans."""
        lasts = self.end - self.begin
        return float(np.sum(lasts[chosen]) / np.sum(lasts))


def require_joint(dataset: xr.Dataset, joint: str) -> str:
    """The name of a clearance joint. **Raises** `ClearanceError` where there is no such joint."""
    known = [str(name) for name in dataset["joint"].values] if "joint" in dataset.coords else []
    if joint not in known:
        raise ClearanceError(f"There is no clearance joint `{joint[:100]}` in this result. {suggest(joint, known)}")
    return joint


def kind(dataset: xr.Dataset, joint: str) -> str:
    """The `kind` of a clearance joint's class; empty for a user's own class."""
    return str(dataset.attrs.get(f"clearance.{joint}", ""))


def spans(dataset: xr.Dataset, joint: str) -> BearingSpans:
    """The spans of constant contact pattern of a joint. A pattern holds from one step end to the next, since every
    touch and separation is a step end. Without step ends (a `Solution`) the samples are used.
    """
    name = "contact_pattern" if "contact_pattern" in dataset else "contact_state"
    time, patterns = at_steps(dataset, require_joint(dataset, joint), name)
    codes = patterns.astype(int)
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
    return BearingSpans(begin, np.append(begin[1:], time[-1]), codes[first])


def at_steps(dataset: xr.Dataset, joint: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and values of a variable in a joint: at the step ends if the dataset has them, else at the samples."""
    time, known = ("step_time", at_step(name)) if at_step(name) in dataset else ("time", name)
    return dataset[time].values, dataset[known].sel(joint=joint).values


def at_step(name: str) -> str:
    """The name of a variable at the step ends."""
    return f"step_{name.removeprefix('contact_').removeprefix('pin_')}"
