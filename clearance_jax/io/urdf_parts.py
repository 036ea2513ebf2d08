"""Records of a URDF file: links, joints and the robot.

Units are SI. A pose is a place `xyz` [m] and a turn `rpy` [rad], R = Rz(yaw) Ry(pitch) Rx(roll).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from clearance_jax.mechanism.limits import Limits

Triple = tuple[float, float, float]
Vector3 = Float[np.ndarray, "3"]
Matrix3 = Float[np.ndarray, "3 3"]
NOWHERE: Triple = (0.0, 0.0, 0.0)

# Degrees of freedom of each kind of joint.
KINDS = {"revolute": 1, "continuous": 1, "prismatic": 1, "fixed": 0, "floating": 6, "planar": 3}
# Those that have an axis; of a planar one it is the plane's normal.
WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
# Those whose one coordinate may follow another's.
MAY_MIMIC = ("revolute", "continuous", "prismatic")


class Link(NamedTuple):
    """A rigid body with the frame of the joint that carries it.

    **Arguments:** `mass` [kg], 0 where nothing is said of it; `center` of mass [m] in the link's frame; `inertia`
    [kg m^2] about the centre of mass, along the link's axes; the `line` of the file that it begins at.
    """

    name: str
    mass: float
    center: Vector3
    inertia: Matrix3
    line: int


class Mimic(NamedTuple):
    """A coordinate that follows the one of `joint`: multiplier * q + offset [rad or m]."""

    joint: str
    multiplier: float
    offset: float


class Joint(NamedTuple):
    """A joint. Its frame is the child's; at zero this has the pose `xyz`, `rpy` in the parent's frame.

    **Arguments:** `kind`: one of `KINDS`; `axis`: a unit vector in the joint's frame; `damping` [N m s/rad or N s/m];
    `friction` [N m or N]; `stiffness` of a spring [N m/rad or N/m], relaxed at `rest` [rad or m]; `rotor` [kg m^2 or
    kg]: inertia of its motor, seen through its gears.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    limits: Limits | None
    mimic: Mimic | None
    damping: float
    friction: float
    line: int
    stiffness: float = 0.0
    rest: float = 0.0
    rotor: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it has a coordinate."""
        return KINDS[self.kind] > 0


class Robot(NamedTuple):
    """A robot: links in the file's order, joints parents first, the `root` link, and what was not read, in words."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    root: str
    unread: tuple[str, ...] = ()
