"""Checks that a robot's bodies have physical inertias, and that joints move mass. Links that are fixed to each other
are checked as one body, so that a frame or sensor may lack mass.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.io.poses import Matrix3
from clearance_jax.io.urdf_merge import Rigid
from clearance_jax.io.urdf_moved import check_moved
from clearance_jax.io.urdf_parts import Joint
from clearance_jax.mechanism.placement import PRINTED

# Least radius of gyration [m]: a smaller one is round-off of printed digits.
SMALLEST = 1e-7


def check_bodies(joints: Sequence[Joint], bodies: Mapping[str, Rigid]) -> None:
    """Raise `ClearanceError` for a body with an impossible inertia, and for a joint that moves no mass. `joints`:
    parents first; `bodies`: those that they move.
    """
    for body in bodies.values():
        _check_inertia(body)
    if any(body.mass == 0 for body in bodies.values()):
        check_moved(joints, bodies)


def _say(body: Rigid) -> str:
    fixed = len(body.links) - 1
    others = f" (with {fixed} link{'s' if fixed > 1 else ''} fixed to it)" if fixed else ""
    return f"line {body.line}: link `{body.name}`{others}"


def _check_inertia(body: Rigid) -> None:
    if body.mass == 0:
        if body.inertia.any():
            raise ClearanceError(f"{_say(body)} has inertia without mass. Give it a mass, or take its <inertial> out.")
        return
    least, middle, greatest = _moments(body.inertia)
    if not least > body.mass * SMALLEST**2:
        raise ClearanceError(
            f"{_say(body)} must have inertia about every axis, but its principal moments are {_show(body.inertia)}. "
            "Correct <inertia> (a box of mass m has m (a^2 + b^2) / 12 about the axis across its edges a and b)."
        )
    if least + middle < (1 - PRINTED) * greatest:
        raise ClearanceError(
            f"{_say(body)}: no body has its principal moments of inertia {_show(body.inertia)}, of which the two "
            "smaller must add up to the greatest at least. Correct <inertia> (about the centre of mass; signs; units)."
        )


def _moments(inertia: Matrix3) -> np.ndarray:
    """Principal moments of inertia, the least first."""
    scale = np.abs(inertia).max() or 1.0
    return np.linalg.eigvalsh(inertia / scale) * scale


def _show(inertia: Matrix3) -> str:
    least, middle, greatest = _moments(inertia)
    return f"{least:.3g}, {middle:.3g} and {greatest:.3g} kg*m^2"
