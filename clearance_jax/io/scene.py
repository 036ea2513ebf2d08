"""Scene files: TOML with units to a mechanism. Keys are strict: every message names the file, the key and the fix."""

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import jax

from clearance_jax.errors import ClearanceError
from clearance_jax.io.files import read_toml
from clearance_jax.io.plausible import ImplausibleWarning, implausible
from clearance_jax.io.scene_joint import joints_of
from clearance_jax.io.scene_keys import BODY, POINT, SCENE, SOLVE, SPRING
from clearance_jax.io.table import Table, naming
from clearance_jax.io.urdf import read_robot
from clearance_jax.mechanism.body import Body, Point, Spring
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Gravity, Orientation, Position


class Scene(NamedTuple):
    """What a scene file says: the mechanism, and how it wants to be solved (keyword arguments of `simulate`)."""

    mechanism: Mechanism
    solve: dict[str, Any]
    text: str


def load_scene(path: str | Path) -> Scene:
    """Read a scene file, and warn where its sizes are not to be believed.

    **Raises:** `ClearanceError` naming the file, the key and the fix.
    """
    scene = read_scene(path)
    said = implausible(scene.mechanism)
    if said:
        warnings.warn(f"{path}: {said}", ImplausibleWarning, stacklevel=2)
    return scene


def read_scene(path: str | Path) -> Scene:
    """As `load_scene`, without a warning: for who changes numbers before the mechanism is used."""
    path = Path(path)
    if path.suffix.lower() == ".urdf":  # a robot says nothing of how it wants to be solved
        text, mechanism = read_robot(path)
        return Scene(mechanism, {}, text)
    text, values = read_toml(path, "scene file")
    with naming(str(path)), jax.ensure_compile_time_eval():
        # Numbers stay numbers where a scene is loaded inside a jitted function.
        top = Table(values, f"{path}:", SCENE)
        return Scene(_mechanism(top, path), _solve(top.table("solve", SOLVE)), text)


def load(path: str | Path) -> Mechanism:
    """The mechanism of a scene file, or of a robot's URDF file (`load_urdf` takes options for it)."""
    return load_scene(path).mechanism


def _mechanism(top: Table, path: Path) -> Mechanism:
    bodies = tuple(_body(*part) for part in top.parts("body"))
    joints, loops = joints_of(top, path)
    springs = tuple(_spring(*part) for part in top.parts("spring"))
    points = tuple(_point(*part) for part in top.parts("point"))
    title = top.get("name") or path.stem
    return Mechanism(bodies, joints, loops, springs, points, Gravity(*top.get("gravity")), title, top.get("assemble"))


def _solve(table: Table) -> dict[str, Any]:
    options = table.given()
    if options.get("t0", 0.0) >= options.get("t1", float("inf")):
        raise ClearanceError(f"{table.key('t1')} must be greater than t0, but it is {options['t1']:g} s.")
    return options


def _body(name: str, values: Any, where: str) -> Body:
    table = Table(values, where, BODY)
    return Body(name, table.get("mass"), table.get("inertia"), Position(*table.get("center_of_mass")))


def _point(name: str, values: Any, where: str) -> Point:
    table = Table(values, where, POINT)
    orientation = Orientation(*table.get("orientation")) if table.has("orientation") else None
    return Point(name, table.get("body"), Position(*table.get("at")), orientation)


def _spring(name: str, values: Any, where: str) -> Spring:
    table = Table(values, where, SPRING)
    numbers = {key: table.get(key) for key in ("stiffness", "damping", "free_length")}
    places = {key: Position(*table.get(key)) for key in ("at_a", "at_b")}
    return Spring(name, table.get("body_a"), table.get("body_b"), **numbers, **places)
