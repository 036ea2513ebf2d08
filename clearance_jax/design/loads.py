"""What each clearance joint bears at a design, and the path that its pin takes: what its bearing is chosen by."""

from typing import NamedTuple

import numpy as np

from clearance_jax.design.observed import Observed
from clearance_jax.mechanism.mechanism import ClearanceJoint, Mechanism


class JointLoad(NamedTuple):
    """A joint in one condition: `largest` normal force [N], `time` when it acts [s], `mean` over time [N]; how often
    pin and sleeve meet (`impacts`); energy lost in friction and in contact damping [J]; `diameter` of the pin and
    `length` of the contact [m], where they are known.
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

    @property
    def largest_pressure(self) -> float | None:
        """Of the largest force on the pin's projected area, F / (d L) [Pa]."""
        return None if self.length is None else self.largest / (self.diameter * self.length)

    @property
    def mean_pressure(self) -> float | None:
        """Of the mean force on the pin's projected area [Pa]."""
        return None if self.length is None else self.mean / (self.diameter * self.length)


class PinPath(NamedTuple):
    """The path of a pin's centre in its sleeve [m], shape (n, 2), in the sleeve's axes; `touching` (n,): whether they
    touch there; radial `clearance` [m].
    """

    joint: str
    condition: str
    clearance: float
    places: np.ndarray
    touching: np.ndarray


def joint_loads(mechanism: Mechanism, condition: str, seen: Observed) -> tuple[JointLoad, ...]:
    """Of every clearance joint of the mechanism that was observed."""
    found = zip(mechanism.clearance_joints(), seen.forces, seen.works, seen.impacts, strict=True)
    return tuple(
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
        )
        for joint, force, work, impacts in found
    )


def pin_paths(mechanism: Mechanism, condition: str, seen: Observed) -> tuple[PinPath, ...]:
    """Of every clearance joint of the mechanism that was observed."""
    places, forces = seen.places.pins, seen.places.forces
    return tuple(
        PinPath(joint.name, condition, float(joint.size), places[joint.name], forces[joint.name] > 0)
        for joint in mechanism.clearance_joints()
    )


def pin_size(joint: ClearanceJoint) -> tuple[float, float | None]:
    """Diameter of the pin, and length of the contact where it is known [m]."""
    geometry = joint.clearance.geometry()
    return 2 * float(geometry.pin_radius), None if geometry.length is None else float(geometry.length)
