"""The dataset of a life: profiles, growth of the clearance, the criterion."""

from importlib.metadata import version
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from clearance_jax.analysis.rubbing import sections_of
from clearance_jax.joints import AbstractPin
from clearance_jax.parameters import parameters
from clearance_jax.wear.history import WearHistory
from clearance_jax.wear.model import WearModel


def to_dataset(history: WearHistory, model: WearModel, **provenance: Any) -> xr.Dataset:
    """The result of `simulate_wear` as a dataset, over the `cycle` numbers and the `sector` numbers of the sleeve.

    - `depth` (cycle, sector) [m], with the `angle` of each sector [rad].
    - `deepest`, `mean_depth` (cycle,) [m], `volume` (cycle,) [m^3].
    - `pin_travel` (cycle, sector) [m]: how far the pin's centre can go in each direction.
    - `radial_clearance` (cycle,) [m]: half of how far the pin can go to and fro, in the direction in which this is
      most.
    - `watched` (cycle,): the number of the criterion, if there was one. Its `long_name` is what you give as `watched`,
      by default the criterion's label.

    Attributes say how many cycles were lived and computed, and the `life` in cycles if the bound was reached.

    **Arguments:** `history`: of `simulate_wear`; `model`: its `WearModel`; `provenance`: anything to be kept as
    attributes.
    """
    pin, sleeve, depth = model.clearance, sections_of(model.mechanism, model.joint), np.asarray(history.depth)
    count = depth.shape[1]
    angle, clearance = 2 * np.pi * np.arange(count) / count, pin.radial_clearance
    pin_travel = np.asarray(pin_travels(pin, jnp.asarray(depth)))
    # The travel in the opposite direction: of an odd number of sectors the mean of the two next to it.
    below, above = (np.roll(pin_travel, -shift, axis=1) for shift in (count // 2, -(-count // 2)))
    across = 0.5 * (pin_travel + 0.5 * (below + above))
    area = float(jnp.sum(sleeve.lengths) * sleeve.geometry.sleeve_radius) * 2 * np.pi / count
    widest = "radial clearance, at its widest"
    data: dict[str, Any] = {
        "depth": (("cycle", "sector"), depth, {"units": "m", "long_name": "depth of wear"}),
        "deepest": ("cycle", depth.max(axis=1), {"units": "m", "long_name": "largest depth of wear"}),
        "mean_depth": ("cycle", depth.mean(axis=1), {"units": "m", "long_name": "mean depth of wear"}),
        "volume": ("cycle", depth.sum(axis=1) * area, {"units": "m^3", "long_name": "volume worn off"}),
        "pin_travel": (("cycle", "sector"), pin_travel, {"units": "m", "long_name": "how far the pin's centre can go"}),
        "radial_clearance": ("cycle", across.max(axis=1), {"units": "m", "long_name": widest}),
    }
    until = history.until
    if until is not None and history.beyond is not None:
        words = {"units": until.unit, "bound": float(until.bound)}
        long_name = provenance.pop("watched", until.label)
        data["watched"] = "cycle", history.beyond + float(until.bound), {"long_name": long_name, **words}
    coords = {
        "cycle": ("cycle", history.cycles, {"units": "1", "long_name": "cycles lived"}),
        "angle": ("sector", angle, {"units": "rad", "long_name": "angle around the sleeve"}),
    }
    numbers = {f"parameter.{n}": np.asarray(leaf.value) for n, leaf in parameters(model.mechanism).items()}
    attributes = {
        "software": f"clearance_jax {version('clearance-jax')}, jax {jax.__version__}, numpy {np.__version__}",
        "mechanism": model.mechanism.name,
        "joint": model.joint,
        "pin_radius": float(sleeve.geometry.pin_radius),
        "unworn_clearance": float(clearance),
        "cycles_lived": int(history.cycles[-1]),
        "cycles_computed": int(history.evaluations),
        **({} if history.end is None else {"life": float(history.end)}),
    }
    return xr.Dataset(data, coords, attributes | numbers | provenance)


@eqx.filter_jit
def pin_travels(pin: AbstractPin, depth: Float[Array, "cycle sector"]) -> Float[Array, "cycle sector"]:
    """How far a pin can go from the middle of its worn sleeve towards each sector [m]."""
    angle = 2 * np.pi * np.arange(depth.shape[1]) / depth.shape[1]
    ahead = jnp.asarray(np.cos(angle)), jnp.asarray(np.sin(angle))

    def of_one(profile):
        worn = pin.worn(profile)
        return jax.lax.map(lambda n: worn.travel((*n, 0.0)), ahead)

    return jax.lax.map(of_one, depth)
