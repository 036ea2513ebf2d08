"""What of a joint is watched over its life: its depth, a metric of the motion, how fast its surfaces meet."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.measure import AbstractMetric
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import worn_sleeve
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.results.dataset import to_dataset
from clearance_jax.solve.trace import trace


class AbstractWatched(eqx.Module):
    """A number of a joint as it is worn, in its unit."""

    @property
    @abc.abstractmethod
    def unit(self) -> str:
        """The unit of its values."""

    @abc.abstractmethod
    def value(self, worn: Mechanism, joint: str, cycle: float, options: dict[str, Any]) -> Any:
        """Of the mechanism with its joint worn: of the motion of one cycle, to `cycle` [s]."""


class Depth(AbstractWatched):
    """The largest depth of wear [m]."""

    @property
    def unit(self):
        return "m"

    def value(self, worn, joint, cycle, options):
        clearance: Any = worn.joint(joint)
        return jnp.max(clearance.clearance.depth)


class OfMotion(AbstractWatched):
    """A metric of one cycle: the largest error of a point, the largest force."""

    metric: AbstractMetric

    @property
    def unit(self):
        return self.metric.unit

    def value(self, worn, joint, cycle, options):
        return _measured(self.metric, worn, jnp.asarray(cycle, float), options)


@eqx.filter_jit
def _measured(metric: AbstractMetric, worn: Mechanism, cycle, options: dict[str, Any]):
    return metric(worn, cycle, **options)


class ImpactSpeed(AbstractWatched):
    """The largest speed at which the joint's surfaces meet in a cycle [m/s]; 0 where they never part."""

    @property
    def unit(self):
        return "m/s"

    def value(self, worn, joint, cycle, options):
        found = to_dataset(worn, _run(worn, cycle, options))
        speeds = found["impact_speed"].values[found["episode_joint"].values == [*found["joint"].values].index(joint)]
        return max([0.0, *speeds])


def _run(worn: Mechanism, cycle: float, options: dict[str, Any]):
    found = trace(worn, cycle, **{**options, "save_at": None})
    if found.message:
        raise ClearanceError(f"The motion stopped: {found.message}")
    return found


class Watch:
    """A number watched over a life, with the bound that ends it: `beyond` is what `wear.life` takes as `until`."""

    def __init__(
        self,
        what: AbstractWatched,
        bound: float,
        mechanism: Mechanism,
        joint: str,
        cycle: float,
        **options: Any,
    ):
        self.what, self.bound = what, bound
        self._mechanism, self._joint, self._cycle, self._options = mechanism, joint, cycle, options
        self._known: dict[bytes, float] = {}

    def value(self, depth: Any) -> float:
        """Of a profile; one that was asked for before is known."""
        profile = np.ascontiguousarray(depth, float)
        key = profile.tobytes()
        if key not in self._known:
            clearance: Any = getattr(self._mechanism.joint(self._joint), "clearance", None)
            worn = self._mechanism.with_clearance(self._joint, worn_sleeve(clearance, jnp.asarray(profile)))
            self._known[key] = float(self.what.value(worn, self._joint, self._cycle, self._options))
        return self._known[key]

    def beyond(self, depth: Any) -> float:
        """How far beyond its bound it is, as a part of it."""
        return self.value(depth) / self.bound - 1
