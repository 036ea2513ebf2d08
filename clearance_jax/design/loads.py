"""What each clearance joint bears at a design, and the path that its pin takes: what its bearing is chosen by."""

from typing import NamedTuple

import numpy as np

from clearance_jax.design.observed import Observed
from clearance_jax.design.places import Pin
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.mechanism import Mechanism


class JointLoad(NamedTuple):
    """A joint in one condition: `largest` normal force [N], `time` when it acts [s], `mean` over time [N]; how often
    pin and sleeve meet (`impacts`); energy lost in friction and in contact damping [J]; `diameter` of the pin and
    `length` of the contact [m], where they are known. In space also the `force` on the pin along the sleeve's axes [N]
    and the size of the `moment` on it across the axis [N m] then.
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

    @property
    def largest_pressure(self) -> float | None:
        """Of the largest force on the pin's projected area, F / (d L) [Pa]."""
        return None if self.length is None else self.largest / (self.diameter * self.length)

    @property
    def mean_pressure(self) -> float | None:
        """Of the mean force on the pin's projected area [Pa]."""
        return None if self.length is None else self.mean / (self.diameter * self.length)


class PinPath(NamedTuple):
    """The path of a pin in its sleeve [m], in the sleeve's axes: of its centre (`places`, (n, 2)), or where it tilts of
    both ends of its axis too (`ends`, (2, n, 2)); where it slides along the sleeve, how far (`axial`, (n,)), and how
    far it may. `touching` (n,): whether they touch there; radial `clearance` [m]; `times` (n,) [s].
    """

    joint: str
    condition: str
    clearance: float
    places: np.ndarray
    touching: np.ndarray
    ends: np.ndarray | None = None
    axial: np.ndarray | None = None
    axial_clearance: float = 0.0
    times: np.ndarray | None = None


def joint_loads(mechanism: Mechanism, condition: str, times: np.ndarray, seen: Observed) -> tuple[JointLoad, ...]:
    """Of every clearance joint of the mechanism that was observed, at sample `times` [s] as to its components."""
    found = zip(mechanism.clearance_joints(), seen.forces, seen.works, seen.impacts, strict=True)
    out = []
    for joint, force, work, impacts in found:
        pin, k = seen.places.pins[joint.name], int(np.argmin(np.abs(times - float(force.times[0]))))
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
                None if mechanism.is_plane else tuple(pin.force[k].tolist()),
                None if mechanism.is_plane else float(np.hypot(*pin.moment[k, :2])),
            )
        )
    return tuple(out)


def pin_paths(mechanism: Mechanism, condition: str, times: np.ndarray, seen: Observed) -> tuple[PinPath, ...]:
    """Of every clearance joint of the mechanism that was observed, at sample `times` [s]."""
    pins = seen.places.pins
    return tuple(_path(joint, condition, times, pins[joint.name]) for joint in mechanism.clearance_joints())


def _path(joint: ClearanceJoint, condition: str, times: np.ndarray, pin: Pin) -> PinPath:
    play = {one.suffix: one for one in joint.joint.play()}
    clearance, touching, centre = first_clearance(joint), pin.normal_force > 0, pin.place[:, :2]
    length = pin_size(joint)[1]
    if length is None or all(one.turns is None for one in play.values()):
        return PinPath(joint.name, condition, clearance, centre, touching, times=times)
    ends = np.stack([centre + side * length / 2 * pin.lean for side in (-1, 1)])
    slides = (pin.place[:, 2], float(play[".play_z"].scale)) if ".play_z" in play else (None, 0.0)
    return PinPath(joint.name, condition, clearance, centre, touching, ends, *slides, times)


def first_clearance(joint: ClearanceJoint) -> float:
    """How far the pin may move across its sleeve: the radial clearance, or a guide's to either side [m]."""
    return float(joint.joint.play()[0].scale)


def pin_size(joint: ClearanceJoint) -> tuple[float, float | None]:
    """Diameter of the pin, and length of the contact where it is known [m]."""
    geometry = joint.clearance.geometry()
    return 2 * float(geometry.pin_radius), None if geometry.length is None else float(geometry.length)
