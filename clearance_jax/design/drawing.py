"""Data for the drawing of each clearance joint: nominal diameter, clearance, fit."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from clearance_jax.design.answer import Design
from clearance_jax.design.classes import CLEARANCE
from clearance_jax.design.loads import first_clearance, pin_size
from clearance_jax.joints.fits import Fit


class JointDrawing(NamedTuple):
    """The data for the drawing of a clearance `joint`.

    - `diameter`: the nominal one [m]; `clearance`: the radial one [m], the largest allowed if it is `designed`,
      otherwise that of the mechanism.
    - `fit`: as of `nearest_fits` (`None`: not known); `remark`: where the fit exceeds the designed clearance or bounds.
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
    """The drawings of all clearance joints of a design, with fits and remarks by variable."""
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
