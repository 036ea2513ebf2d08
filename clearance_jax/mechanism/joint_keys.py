"""Fields that several kinds of joints share, as scene files know them."""

import equinox as eqx

from clearance_jax.mechanism.placement import ORIGIN, Axis, as_axis
from clearance_jax.parameters import describe, physical

PARENT = "the body that the joint is on (its sleeve), or `ground`", '"ground"'
CHILD = "the body that the joint carries (its pin)", '"crank"'
AXIS = (
    "what it turns about or slides along, of a planar joint the normal of its plane: an axis of its frame, by its "
    "letter or by three numbers"
)
AT_PARENT, AT_CHILD = "place of the joint in the parent's frame", "place of the joint in the child's frame"
TURN_PARENT = "roll, pitch and yaw of the joint's frame in the parent's, instead of `angle`"
TURN_CHILD = "roll, pitch and yaw of the joint's frame in the child's"


def body_key(help: str, example: str):
    """A field that names a body."""
    return describe(help, example, static=True)


def place_key(help: str):
    """A field that is a place on a body."""
    return describe(help, '["50 mm", "0 mm"]', "the frame's origin", default=ORIGIN)


def angle_key():
    """The field of the angle of a joint's frame."""
    help = "angle of the joint's frame in the parent's, about z: a slide moves along its x axis; the child turns too"
    return physical("rad", default=None, help=help, example='"90 deg"', absent="0 deg")


def orientation_key(help: str):
    """A field that is an orientation."""
    return describe(help, '["90 deg", "0 deg", "0 deg"]', "not turned", default=None)


def axis_key(default: str):
    """A field that is an axis of the joint's frame."""
    about = {"help": AXIS, "example": '"z"', "absent": default}
    return eqx.field(metadata=about, converter=as_axis, default=Axis(default))
