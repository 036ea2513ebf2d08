"""What the drawing of each clearance joint says: nominal diameter, and the deviations of hole and shaft."""

from collections.abc import Mapping
from typing import NamedTuple

from clearance_jax.design.answer import Design
from clearance_jax.design.loads import first_clearance, pin_size
from clearance_jax.joints.fits import Fit

CLEARANCE = ".radial_clearance"


class JointDrawing(NamedTuple):
    """A clearance joint: nominal `diameter` [m], the radial `clearance` [m], which is the largest that is allowed where
    it is `designed` and else as the mechanism has it, and the `fit` that keeps below it (`None`: not known).
    """

    joint: str
    diameter: float
    clearance: float
    designed: bool
    fit: Fit | None


def joint_drawings(design: Design, fits: Mapping[str, Fit]) -> tuple[JointDrawing, ...]:
    """Of every clearance joint of a design, whose fits are known by variable."""
    return tuple(
        JointDrawing(
            joint.name,
            pin_size(joint)[0],
            first_clearance(joint),
            joint.name + CLEARANCE in design.clearances,
            fits.get(joint.name + CLEARANCE),
        )
        for joint in design.mechanism.clearance_joints()
    )
