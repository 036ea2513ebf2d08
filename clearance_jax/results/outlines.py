"""Outlines of clearance joints in datasets, where no joint exists any more: written once, read by every picture."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from clearance_jax.joints import JointOutline
from clearance_jax.joints.bore import finer


def outline_attributes(joint: str, outline: JointOutline | None) -> dict[str, Any]:
    """The attributes of a dataset, `outline.JOINT.NUMBER`, that keep an outline."""
    numbers = {} if outline is None else {name: x for name, x in outline._asdict().items() if x is not None}
    # NetCDF has no flags (they are 0 or 1), and no arrays of one number.
    return {f"outline.{joint}.{name}": 1 * np.asarray(x).squeeze() for name, x in numbers.items()}


def outline_of(dataset: xr.Dataset, joint: str) -> JointOutline | None:
    """The outline of a joint, its `depth` refined, (1 or heights, sectors), and zero for a round wall. `None`: the
    dataset does not say it.
    """
    given = {name: dataset.attrs.get(f"outline.{joint}.{name}") for name in JointOutline._fields}
    numbers: dict[str, Any] = {name: _plain(name, x) for name, x in given.items() if x is not None}
    if not {"radius", "clearance"} <= numbers.keys():
        return None
    outline = JointOutline(**numbers)
    depth = np.zeros((1, 1)) if outline.depth is None else np.atleast_2d(finer(jnp.asarray(outline.depth, float)))
    return outline._replace(depth=depth, heights=np.atleast_1d(outline.heights))


def _plain(name: str, number: Any) -> Any:
    """A number or a flag as Python's, an array as it is."""
    if np.ndim(number):
        return number
    return bool(number) if isinstance(JointOutline._field_defaults.get(name), bool) else np.asarray(number).item()
