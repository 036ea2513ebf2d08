"""Reads scene files (TOML with units) as mechanisms. Unknown keys are errors. Messages name file, key and fix."""

import dataclasses
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, naming, unknown_name, wrong_value
from clearance_jax.io.files import read_toml
from clearance_jax.io.keys import scene as keys
from clearance_jax.io.keys.coupling import COUPLING_TABLES, COUPLINGS, FLANK_KEYS
from clearance_jax.io.robot import ROBOTS, read_any_robot
from clearance_jax.io.scene.contact import friction_of
from clearance_jax.io.scene.joints import body_of, drive_of, joints_of, read_drive, robot_of
from clearance_jax.io.table import TomlTable, variant
from clearance_jax.io.trajectory import Trajectory, read_trajectory
from clearance_jax.io.urdf.mechanism import IN_PYTHON, IN_SCENE, warn_of_notes
from clearance_jax.joints.checks import ImplausibleWarning, above_pin
from clearance_jax.laws import Flank
from clearance_jax.mechanism.body import Point, Spring, Wrench
from clearance_jax.mechanism.controllers import ComputedTorque, Reference
from clearance_jax.mechanism.couplings import Coupling, coupling_units
from clearance_jax.mechanism.imperfections import Compliance, with_compliance, with_misalignment
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Gravity
from clearance_jax.mechanism.structure import check_encoders, check_model
from clearance_jax.mechanism.tree.tree import AbstractJoint, Prismatic
from clearance_jax.parameters import check_demands, outside
from clearance_jax.units import SLIDING, TURNING

# From a speck of dust to a ship. Outside, a unit or an exponent has slipped.
LEAST_MASS, GREATEST_MASS = 1e-12, 1e9
# The diameter of an atom [m].
LEAST_CLEARANCE = 1e-10
# Most sizes in a warning.
NAMED = 4


class Scene(NamedTuple):
    """A scene file as read; `solve`: keyword arguments of `simulate`; `trajectory`: that of its robot, if any."""

    mechanism: Mechanism
    solve: dict[str, Any]
    text: str
    trajectory: Trajectory | None = None


def load_scene(path: str | Path) -> Scene:
    """Read a scene file; it warns of implausible sizes and of unread parts of a robot. **Raises** `ClearanceError`."""
    scene = read_scene(path)
    if warning := implausible(scene.mechanism):
        warnings.warn(f"{path}: {warning}", ImplausibleWarning, stacklevel=2)
    warn_of_notes(path, scene.mechanism)
    return scene


def read_scene(path: str | Path, written: str = IN_PYTHON, **robot: Any) -> Scene:
    """As `load_scene`, without warnings, for callers that change numbers before the mechanism is used; `robot`: options
    of `load_urdf`, for a robot's file, and how messages write them.
    """
    path = Path(path)
    if path.suffix.lower() in ROBOTS:  # a robot says nothing of how it wants to be solved
        text, mechanism = read_any_robot(path, written, **robot)
        return Scene(mechanism, {}, text)
    for name, value in robot.items():
        key = IN_SCENE.format(name, value)
        text = f"{written.format(name, value)} is about a robot's file, but `{path}` is none. In a scene write {key}."
        raise ClearanceError(text).about(name, value)
    text, values = read_toml(path, "scene file")
    if "scene" in values:
        raise ClearanceError(f"`{path}` is a study, and not a scene: use `clearance run`.")
    with naming(str(path)), jax.ensure_compile_time_eval(), warnings.catch_warnings():
        warnings.simplefilter("ignore", ImplausibleWarning)
        # Numbers stay numbers where a scene is loaded inside a jitted function.
        top = TomlTable(values, f"{path}:", keys.SCENE)
        mechanism, trajectory = _whole(top, path)
        solve = top.table("solve", keys.SOLVE)
        options = solve.arguments()
        if options.get("t0", 0.0) >= options.get("t1", float("inf")):
            raise wrong_value(solve.key("t1"), "greater than t0", options["t1"], shown=f"{options['t1']:g} s")
        return Scene(mechanism, options, text, trajectory)


def load(path: str | Path) -> Mechanism:
    """The mechanism of a scene file, or of a robot's URDF or MJCF file (`load_urdf`, `load_mjcf` take options).

    **Arguments:** `path`: of the file.

    **Raises:** `ClearanceError` naming the file, the key or the line, and the fix.
    """
    return load_scene(path).mechanism


def _whole(top: TomlTable, path: Path) -> tuple[Mechanism, Trajectory | None]:
    robot, file = robot_of(top, path) if top.has("robot") else (None, None)
    bodies, tree, points, notes, couplings, closed, wrenches = ((),) * 7
    if robot is not None:
        bodies, tree, points, notes = robot.bodies, robot.joints, robot.points, robot.notes
        couplings, closed, wrenches = robot.couplings, robot.loops, robot.wrenches
    joints, loops = joints_of(top, path, {joint.child for joint in tree})
    gravity = Gravity(*top.get("gravity")) if robot is None or top.has("gravity") else robot.gravity
    mechanism = Mechanism(
        (*bodies, *(body_of(name, table) for name, table in top.tables("body", keys.BODY))),
        (*tree, *joints),
        (*closed, *loops),
        tuple(Spring(name, **table.arguments()) for name, table in top.tables("spring", keys.SPRING)),
        (*points, *(Point(name, **table.arguments()) for name, table in top.tables("point", keys.POINT))),
        gravity,
        top.get("name") or path.stem,
        top.get("assemble"),
        (*wrenches, *(_wrench(*part, path) for part in top.tables("wrench", keys.WRENCH, {"coordinate": ""}))),
        notes=notes,
        couplings=(*couplings, *_couplings(top, (*tree, *joints))),
    )
    trajectory = None
    if file is not None:
        trajectory = Trajectory(file, read_trajectory(file, mechanism))
        twice = {c.name for c in mechanism.coordinates() if not c.motion.is_free} & set(trajectory.drives)
        if twice:
            what = f"`{min(twice)}` has a drive, and a column of the trajectory `{file}`"
            raise ClearanceError(f"{what}. Take one of the two away.")
        mechanism = mechanism.with_drives(trajectory.drives)
    if top.has("misalignment"):
        with naming(top.key("misalignment")):
            mechanism = with_misalignment(mechanism, top.get("misalignment"))
    for name, values, where in top.entries("compliance"):
        with naming(where):
            words = SLIDING if isinstance(mechanism.joint(name), Prismatic) else TURNING
            table = TomlTable(values, where, keys.COMPLIANCE, words)
            table.need("stiffness")
            mechanism = with_compliance(mechanism, name, Compliance(**table.arguments()))
    with naming(str(path)):
        check_encoders(tuple(mechanism.coordinates()))
    controllers = [_controller(*part, path, mechanism) for part in top.tables("controller", keys.CONTROLLER)]
    return dataclasses.replace(mechanism, controllers=tuple(controllers)), trajectory


def _couplings(top: TomlTable, joints: Sequence[AbstractJoint]) -> Iterator[Coupling]:
    kinds = {c.name: "rad" if c.slides is None else "m" for joint in joints for c in joint.own_coordinates()}
    for name, values, where in top.parts("coupling"):
        word, table = variant(values, where, COUPLING_TABLES)
        named = [values.get(key) for key in ("follower", "leader", "second")]
        follower, leader, second = (name if isinstance(name, str) else "" for name in named)
        table.words = coupling_units(kinds, follower, leader, second)
        if {"module", "base_radius"} & values.keys():
            table.words |= {"coordinate": "m", "effort": "N"}
        with naming(where):
            given = table.arguments("type", "friction", *FLANK_KEYS)
            if "friction" in table.values:
                given["friction"] = friction_of(table)
            if word == "gear" and "module" not in table.values:
                table.refuse("pressure_angle", why="has no effect without `module`.")
            if "backlash" in table.values:
                table.need("stiffness")
                given["flank"] = Flank(**table.only(*FLANK_KEYS))
                check_demands(given["flank"], words=lambda words=table.words: words)
            else:
                table.refuse(*FLANK_KEYS, why="has no effect without `backlash`")
            yield COUPLINGS[word][0](name, **given)


def _wrench(name: str, table: TomlTable, path: Path) -> Wrench:
    course = drive_of(table, "course", path) if table.has("course") else None
    return Wrench(name, course=course, **table.arguments("course"))


def _controller(name: str, table: TomlTable, path: Path, mechanism: Mechanism) -> ComputedTorque:
    references, free = [], {c.name: c for c in mechanism.free_coordinates() if not c.is_ball}
    table.need("target")
    for coordinate, target, there in table.entries("target"):
        if coordinate not in free:
            raise unknown_name(f"{there}: there is no free coordinate of this name.", coordinate, free, there)
        words = TURNING if free[coordinate].slides is None else SLIDING
        references.append(Reference(coordinate, read_drive(target, there, words, path)))
    with naming(table.where):
        made = ComputedTorque(name, tuple(references), **table.arguments("target"))
        check_model(made, mechanism.ideal())
        return made


def implausible(mechanism: Mechanism) -> str:
    """A sentence that names implausible sizes, likely errors of units; empty if there are none."""
    faults = list(_faults(mechanism))
    if not faults:
        return ""
    more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
    return f"These sizes are hardly meant: {'; '.join(faults[:NAMED])}{more}. Check their units."


def _faults(mechanism: Mechanism) -> Iterator[str]:
    for joint in mechanism.clearance_joints():
        # By Python's numbers: a scene may be loaded while a function is traced.
        size = max(float(play.scale) for play in outside(joint.clearance).play() if play.slides is not None)
        radial, pin = (getattr(joint.clearance, name, None) for name in ("radial_clearance", "pin_radius"))
        if size < LEAST_CLEARANCE:
            yield f"the clearance of {joint.name}, {size:g} m, is less than an atom"
        elif radial is not None and pin is not None and (fault := above_pin(radial, pin)):  # plane joints accept it
            yield f"{joint.name}.{fault}"
    for body in mechanism.bodies:
        mass = np.nan if body.mass is None else float(body.mass)
        if mass < LEAST_MASS or mass > GREATEST_MASS:
            yield f"{body.name}.mass = {mass:g} kg"
