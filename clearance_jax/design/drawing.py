"""What the drawing of each clearance joint says: nominal diameter, and the deviations of hole and shaft."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from clearance_jax.design.answer import Design
from clearance_jax.design.loads import first_clearance, pin_size
from clearance_jax.joints.fits import Fit

CLEARANCE = ".radial_clearance"


class JointDrawing(NamedTuple):
    """What a drawing says of a clearance `joint`.

    - `diameter` [m]: the nominal one; `clearance` [m]: the radial one. If it is `designed`, it is the largest that is
      allowed, and otherwise that of the mechanism.
    - `fit`: as of `nearest_fits`; `None`: not known. `remark`: where it goes beyond what is allowed by itself.
    """

    joint: str
    diameter: float
    clearance: float
    designed: bool
    fit: Fit | None
    remark: str = ""


def joint_drawings(
    design: Design, fits: Mapping[str, Fit], remarks: Mapping[str, str] = MappingProxyType({})
) -> tuple[JointDrawing, ...]:
    """Of every clearance joint of a design, whose fits, and what is to be said of them, are known by variable."""
    return tuple(
        JointDrawing(
            joint.name,
            pin_size(joint)[0],
            first_clearance(joint),
            joint.name + CLEARANCE in design.clearances,
            fits.get(joint.name + CLEARANCE),
            remarks.get(joint.name + CLEARANCE, ""),
        )
        for joint in design.mechanism.clearance_joints()
    )
