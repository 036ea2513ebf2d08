"""Misaligned joints: errors of link lengths, axes and zeros of coordinates.

Each joint gets two frames without mass: `NAME_frame` is where it is meant to be, the joint `NAME_misalignment` places
`NAME_axis` on it, and the joint itself is on `NAME_axis`. The ideal mechanism has no misalignment, so errors of
position and orientation include its effect.
"""

import dataclasses
from collections.abc import Iterable

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.mechanism.body import Body
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import ORIGIN, Orientation, Position
from clearance_jax.mechanism.tree import AbstractJoint, Fixed, Misalignment


def with_misalignment(mechanism: Mechanism, names: Iterable[str] | None = None) -> Mechanism:
    """The same mechanism whose joints can be off the places and the directions that they are meant to have. All that
    they are off by is zero at first: scatter it by its names, of the joint `hip`

    - `hip_misalignment.at_parent.x`, `.y`, `.z` [m]: the place of its frame, along the frame's own axes;
    - `hip_misalignment.orientation.roll`, `.pitch`, `.yaw` [rad]: turns of its frame about its own axes. The one about
      the joint's axis (`yaw` for z) is the error of the coordinate's zero, which a calibration leaves.

    In the plane these are `x`, `y` and `yaw`.

    **Arguments:** `mechanism`; `names`: of joints of the tree; `None`: all that move.

    **Raises:** `ClearanceError` for an unknown joint, one that closes a loop, and one that is misaligned already.
    """
    known = [joint.name for joint in mechanism.joints]
    moving = [joint.name for joint in mechanism.joints if joint.own_coordinates()]
    wanted = moving if names is None else list(names)
    for name in wanted:
        if name not in known:
            raise ClearanceError(f"There is no joint `{name}` of the tree to be misaligned. " + suggest(name, known))
        if f"{name}_misalignment" in known:
            raise ClearanceError(f"Joint `{name}` has a misalignment already. Name it once.")
    plane, bodies, joints = mechanism.is_plane, list(mechanism.bodies), []
    for joint in mechanism.joints:
        if joint.name in wanted:
            bodies += [Body(f"{joint.name}_frame"), Body(f"{joint.name}_axis")]
            joints += _misaligned(joint, plane)
        else:
            joints.append(joint)
    return dataclasses.replace(mechanism, bodies=tuple(bodies), joints=tuple(joints))


def _misaligned(joint: AbstractJoint, plane: bool) -> list[AbstractJoint]:
    """The joint's nominal frame, its misalignment, and the joint on it."""
    meant, axis, name = f"{joint.name}_frame", f"{joint.name}_axis", f"{joint.name}_misalignment"
    place = Fixed(f"{joint.name}_place", joint.parent, meant, joint.at_parent, ORIGIN, joint.angle, joint.orientation)
    none = None if plane else 0.0
    off = Misalignment(name, meant, axis, Position(0.0, 0.0, none), ORIGIN, None, Orientation(none, none, 0.0))
    changed = {"parent": axis, "at_parent": ORIGIN, "angle": None, "orientation": None}
    return [place, off, dataclasses.replace(joint, **changed)]  # pyright: ignore[reportArgumentType]
