"""Loads of each clearance joint of a design, for the choice of its bearing."""

from typing import Any, NamedTuple

import numpy as np

from clearance_jax.design.observed import Observed
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.observed import Instants


class JointLoad(NamedTuple):
    """The load of a `joint` in one `condition`.

    - `largest`: the largest normal force [N], at `time` [s]; `mean`: its mean over time [N].
    - `first_fall`: whether the largest one belongs to the first fall of a pin that started in mid-air; then `after` is
      the largest one after it [N], at `time_after` [s] (`None`: not known, or none).
    - `impacts`: how often pin and sleeve meet; `friction_loss`, `contact_loss`: energy lost in friction and in contact
      damping [J].
    - `diameter` of the pin and `length` of the contact [m]; `None`: not known.
    - In space, at that time: `force` on the pin along the sleeve's axes [N], and the size of the `moment` on it across
      the axis [N m].
    """

    joint: str
    condition: str
    largest: float
    time: float
    mean: float
    impacts: int
    friction_loss: float
    contact_loss: float
    diameter: float
    length: float | None
    force: tuple[float, ...] | None = None
    moment: float | None = None
    first_fall: bool = False
    after: float | None = None
    time_after: float | None = None

    @property
    def largest_pressure(self) -> float | None:
        """The pressure of the largest force on the pin's projected area, F / (d L) [Pa]."""
        return None if self.length is None else self.largest / (self.diameter * self.length)

    @property
    def mean_pressure(self) -> float | None:
        """The pressure of the mean force on the pin's projected area [Pa]."""
        return None if self.length is None else self.mean / (self.diameter * self.length)


def joint_loads(mechanism: Mechanism, condition: str, times: np.ndarray, seen: Observed) -> tuple[JointLoad, ...]:
    """The load of every clearance joint from an observed motion; components of forces are those at the nearest of the
    sample `times` [s].
    """
    rows = zip(mechanism.clearance_joints(), seen.forces, seen.falls, seen.works, seen.impacts, strict=True)
    out = []
    for joint, force, over, work, impacts in rows:
        turned, k = _of_fall(force, float(over)), int(np.argmin(np.abs(times - float(force.times[0]))))
        if not mechanism.is_plane:
            exerted, moment = seen.wrenches[joint.name]
            turned |= {"force": tuple(exerted[k].tolist()), "moment": float(np.hypot(*moment[k, :2]))}
        out.append(
            JointLoad(
                joint.name,
                condition,
                float(force.values[0]),
                float(force.times[0]),
                float(work.mean_force),
                int(impacts),
                float(work.friction_loss),
                float(work.contact_loss),
                *pin_size(joint),
                **turned,
            )
        )
    return tuple(out)


def _of_fall(force: Instants, over: float) -> dict[str, Any]:
    """The fields of `JointLoad` about the first fall of a pin, which is over at time `over` [s]; empty if the largest
    force comes later.
    """
    if force.times[0] > over:
        return {}
    later = np.flatnonzero((force.times > over) & (force.values > 0))
    after = {"after": float(force.values[later[0]]), "time_after": float(force.times[later[0]])} if later.size else {}
    return {"first_fall": True} | after


def first_clearance(joint: ClearanceJoint) -> float:
    """The radial clearance of a joint, or the clearance of a guide to either side [m]."""
    return float(joint.joint.play()[0].scale)


def pin_size(joint: ClearanceJoint) -> tuple[float, float | None]:
    """Diameter of the pin and length of the contact [m]; `None`: not known."""
    geometry = joint.clearance.geometry()
    return 2 * float(geometry.pin_radius), None if geometry.length is None else float(geometry.length)
