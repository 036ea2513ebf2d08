"""Reads the file of a robot, whichever format it has: URDF or MJCF."""

from pathlib import Path
from typing import Any

from clearance_jax.errors import ClearanceError
from clearance_jax.io.mjcf.mechanism import read_mjcf
from clearance_jax.io.mjcf.source import outermost
from clearance_jax.io.urdf.mechanism import IN_PYTHON, read_robot
from clearance_jax.mechanism.mechanism import Mechanism

# Endings of robots' files: xacro expands the second; either format may end in .xml.
ROBOTS = (".urdf", ".xacro", ".xml")
# Options that MJCF files do not have, and their defaults.
OF_URDF = {"base": "fixed", "inertia": "refuse", "density": None}


def read_any_robot(path: Path, written: str = IN_PYTHON, **options: Any) -> tuple[str, Mechanism]:
    """Text and mechanism of a robot's file; `options` as in `load_urdf` or `load_mjcf`; `written`: how messages write
    one.
    """
    if path.suffix.lower() != ".xml" or outermost(path)[1] != "mujoco":
        return read_robot(path, **options, written=written)
    for name, usual in OF_URDF.items():
        if (value := options.pop(name, usual)) != usual:
            what = f"`{path}`: {written.format(name, value)} is for URDF files"
            text = f"{what}. An MJCF file says itself how its base moves and what its bodies weigh. Leave it out."
            raise ClearanceError(text).about(name, value)
    return read_mjcf(path, **options)
