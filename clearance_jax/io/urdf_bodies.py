"""Whether a robot's bodies can be moved, and whether there can be such bodies.

What makes a motion meaningless is refused: a body whose inertia is not positive about every axis, a joint whose motion
moves no mass. What no real body has but a motion can be computed with, many published robots have: that is said.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.io.poses import Matrix3
from clearance_jax.io.urdf_merge import Rigid
from clearance_jax.io.urdf_moved import check_moved
from clearance_jax.io.urdf_parts import Joint

# Inertias are printed with a few digits; of a flat body's three, two just add up to the third.
PRINTED = 1e-3
# A mass within a ten thousandth of a millimetre [m] has no inertia, whatever digits are printed of it.
SMALLEST = 1e-7


def doubts(joints: Sequence[Joint], bodies: Mapping[str, Rigid]) -> list[str]:
    """What no real body has of the `bodies` that the `joints` move (parents first), one sentence each.

    **Raises:** `ClearanceError` naming line, link and fix, where they cannot be moved.
    """
    for body in bodies.values():
        _check_inertia(body)
    if any(body.mass == 0 for body in bodies.values()):
        check_moved(joints, bodies)
    return [said for body in bodies.values() for said in _impossible(body)]


def _said(body: Rigid) -> str:
    fixed = len(body.links) - 1
    others = f" (with {fixed} link{'s' if fixed > 1 else ''} fixed to it)" if fixed else ""
    return f"line {body.line}: link `{body.name}`{others}"


def _check_inertia(body: Rigid) -> None:
    if body.mass > 0 and not _moments(body.inertia)[0] > body.mass * SMALLEST**2:
        raise ClearanceError(
            f"{_said(body)} must have inertia about every axis, but its principal moments are {_shown(body.inertia)}. "
            "Correct <inertia> (a box of mass m has m (a^2 + b^2) / 12 about the axis across its edges a and b)."
        )
    if body.mass == 0 and body.inertia.any():
        raise ClearanceError(f"{_said(body)} has inertia without mass. Give it a mass, or take its <inertial> out.")


def _impossible(body: Rigid) -> Iterator[str]:
    least, middle, greatest = _moments(body.inertia)
    if least + middle < (1 - PRINTED) * greatest:
        yield (
            f"link `{body.name}` has the principal moments of inertia {_shown(body.inertia)}, of which the two smaller "
            "must add up to the greatest"
        )


def _moments(inertia: Matrix3) -> np.ndarray:
    """Principal moments of inertia, the least first."""
    scale = np.abs(inertia).max() or 1.0
    return np.linalg.eigvalsh(inertia / scale) * scale


def _shown(inertia: Matrix3) -> str:
    least, middle, greatest = _moments(inertia)
    return f"{least:.3g}, {middle:.3g} and {greatest:.3g} kg*m^2"
