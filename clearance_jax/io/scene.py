"""Scene files: TOML with units to a mechanism. Keys are strict: every message names the file, the key and the fix."""

import csv
import dataclasses
import inspect
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints import RevoluteClearance
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, AbstractNormalLaw, InternalHertz
from clearance_jax.mechanism.body import (
    GROUND,
    AbstractActuator,
    Body,
    ConstantEffort,
    Gravity,
    JointSpring,
    Motion,
    Point,
    Position,
    Servo,
    Spring,
)
from clearance_jax.mechanism.drives import AbstractDrive, ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.mechanism.expressions import read_expression
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.tree import SLIDING, TURNING, AbstractJoint, Fixed, Prismatic, Revolute
from clearance_jax.parameters import Parametrised, check_bounds, find, parameters, resolved_unit
from clearance_jax.solve.attempt import STARTS
from clearance_jax.units import to_si

DRIVES = {"constant-speed": ConstantSpeed, "step": StepSum, "step5": Step5Sum, "harmonic": Harmonic, "spline": Spline}
ACTUATORS = {"constant": ConstantEffort, "servo": Servo, "spring": JointSpring}
JOINTS = {"revolute": Revolute, "prismatic": Prismatic, "fixed": Fixed}


class Scene(NamedTuple):
    """What a scene file says: the mechanism, and how it wants to be solved (keyword arguments of `simulate`)."""

    mechanism: Mechanism
    solve: dict[str, Any]
    text: str


class Table:
    """A TOML table that knows where it stands and which of its keys have been read."""

    def __init__(self, values: Any, where: str):
        if not isinstance(values, dict):
            raise ClearanceError(f"{where} must be a table of keys, but it is {values!r}.")
        self.values, self.where, self.read = values, where, set()

    def key(self, name: str) -> str:
        """How a message names a key of this table."""
        return f"{self.where}.{name}" if not self.where.endswith(":") else f"{self.where} {name}"

    def has(self, name: str) -> bool:
        """Whether the key is there."""
        return name in self.values

    def get(self, name: str, default: Any = None) -> Any:
        """The key's value."""
        self.read.add(name)
        return self.values.get(name, default)

    def need(self, name: str) -> Any:
        """The key's value, which must be there."""
        if name not in self.values:
            raise ClearanceError(f"{self.where} lacks the key `{name}`. Add it.")
        return self.get(name)

    def word(self, name: str, allowed, default: str | None = None) -> str:
        """The key's value, one of `allowed`."""
        value = self.get(name, default) if default is not None else self.need(name)
        if not isinstance(value, str) or value not in allowed:
            raise ClearanceError(
                f"{self.key(name)} must be one of the allowed words, but it is {value!r}. "
                + suggest(str(value), allowed)
            )
        return value

    def number(self, name: str, unit: str) -> float | None:
        """The key's quantity in SI, or `None` where the key is absent."""
        value = self.get(name)
        return to_si(value, unit, self.key(name)) if self.has(name) else None

    def table(self, name: str) -> "Table":
        """The key's sub-table (empty where absent)."""
        return Table(self.get(name, {}), self.key(name))

    def tables(self, name: str):
        """The key's named sub-tables."""
        outer = self.table(name)
        for key in outer.values:
            yield key, outer.table(key)

    def finish(self, allowed=()) -> None:
        """Raise for a key that nobody has read."""
        for name in self.values:
            if name not in self.read:
                raise ClearanceError(f"{self.key(name)} is not a known key. " + suggest(name, {*self.read, *allowed}))


def load_scene(path: str | Path) -> Scene:
    """Read a scene file. **Raises:** `ClearanceError` naming the file, the key and the fix."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        values = tomllib.loads(text)
    except OSError as error:
        raise ClearanceError(f"Cannot read the scene file `{path}`: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ClearanceError(f"`{path}` is not valid TOML: {error}.") from None
    top = Table(values, f"{path}:")
    try:
        with jax.ensure_compile_time_eval():  # numbers stay numbers where a scene is loaded inside a jitted function
            mechanism = _mechanism(top, path)
    except ClearanceError as error:
        if str(path) in str(error):
            raise
        raise ClearanceError(f"{path}: {error}") from None
    solve = _solve(top.table("solve"))
    top.finish()
    return Scene(mechanism, solve, text)


def load(path: str | Path) -> Mechanism:
    """The mechanism of a scene file."""
    return load_scene(path).mechanism


def _mechanism(top: Table, path: Path) -> Mechanism:
    bodies = tuple(_body(name, table) for name, table in top.tables("body"))
    joints: list[AbstractJoint] = []
    loops: list[Revolute] = []
    placed = {GROUND}
    for name, table in top.tables("joint"):
        joint = _joint(name, table, path)
        if joint.child in placed:
            if not isinstance(joint, Revolute):
                raise ClearanceError(
                    f"{table.where} closes a loop (`{joint.child}` is placed already): only a revolute joint can."
                )
            for key in ("drive", "actuator", "position", "velocity"):
                if table.has(key):
                    raise ClearanceError(
                        f"{table.key(key)} has no effect: the joint closes a loop (`{joint.child}` is placed already). "
                        "Move it to a joint of the tree, or write this joint before the one that places the body."
                    )
            loops.append(joint)
        else:
            joints.append(joint)
            placed.add(joint.child)
    springs = tuple(_spring(name, table) for name, table in top.tables("spring"))
    points = tuple(_point(name, table) for name, table in top.tables("point"))
    x, y = _vector(top, "gravity", "m/s^2")
    assemble = top.get("assemble", True)
    if not isinstance(assemble, bool):
        raise ClearanceError(f"{top.key('assemble')} must be true or false, but it is {assemble!r}.")
    return Mechanism(
        bodies,
        tuple(joints),
        tuple(loops),
        springs,
        points,
        Gravity(x, y),
        str(top.get("name", path.stem)),
        assemble,
    )


def _solve(table: Table) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for name, unit in (("t0", "s"), ("t1", "s"), ("rtol", "")):
        value = table.number(name, unit)
        if value is not None:
            options[name] = value
    if not 0 < options.get("rtol", 1e-8) < 1:
        raise ClearanceError(f"{table.key('rtol')} must be between 0 and 1, but it is {options['rtol']:g}.")
    if not options.get("t0", 0.0) < options.get("t1", np.inf):
        raise ClearanceError(f"{table.key('t1')} must be greater than t0, but it is {options['t1']:g} s.")
    if table.has("samples"):
        samples = table.get("samples")
        if not isinstance(samples, int) or samples < 2:
            raise ClearanceError(f"{table.key('samples')} must be a whole number of at least 2, but it is {samples!r}.")
        options["samples"] = samples
    if table.has("solver"):
        options["solver"] = table.word("solver", {"tsit5", "dopri8"})
    if table.has("start"):
        options["start"] = table.word("start", STARTS)
    table.finish()
    return options


def _vector(table: Table, name: str, unit: str) -> tuple[float | None, float | None]:
    """A pair of quantities; a component that is exactly zero is left out of the compiled program."""
    if not table.has(name):
        return None, None
    value = table.get(name)
    if not isinstance(value, list) or len(value) != 2:
        raise ClearanceError(f'{table.key(name)} must be a pair such as ["0 {unit}", "1 {unit}"], but it is {value!r}.')
    x, y = (to_si(v, unit, f"{table.key(name)}[{i}]") for i, v in enumerate(value))
    return x or None, y or None


def _position(table: Table, name: str) -> Position:
    return Position(*_vector(table, name, "m"))


def _body(name: str, table: Table) -> Body:
    body = Body(name, table.number("mass", "kg"), table.number("inertia", "kg*m^2"), _position(table, "center_of_mass"))
    _bounded(body, table)
    table.finish()
    return body


def _point(name: str, table: Table) -> Point:
    point = Point(name, str(table.need("body")), _position(table, "at"))
    table.finish()
    return point


def _spring(name: str, table: Table) -> Spring:
    ends = str(table.need("body_a")), str(table.need("body_b"))
    table.need("stiffness")
    spring = Spring(
        name,
        *ends,
        table.number("stiffness", "N/m"),
        table.number("damping", "N*s/m") or 0.0,
        table.number("free_length", "m") or 0.0,
        _position(table, "at_a"),
        _position(table, "at_b"),
    )
    _bounded(spring, table)
    table.finish()
    return spring


def _joint(name: str, table: Table, path: Path) -> AbstractJoint:
    kind = table.word("type", JOINTS)
    common = dict(
        name=name,
        parent=str(table.need("parent")),
        child=str(table.need("child")),
        at_parent=_position(table, "at_parent"),
        at_child=_position(table, "at_child"),
        angle=table.number("angle", "rad"),
    )
    if kind == "fixed":
        joint: AbstractJoint = Fixed(**common)
    else:
        motion = _motion(table, TURNING if kind == "revolute" else SLIDING, path)
        if kind == "prismatic":
            joint = Prismatic(**common, motion=motion)
        else:
            joint = Revolute(
                **common, motion=motion, clearance=_clearance(table), eccentricity=_position(table, "eccentricity")
            )
    table.finish(
        {"radial_clearance", "pin_radius", "normal", "friction", "drive", "actuator", "position", "velocity"}
        if kind == "revolute"
        else ()
    )
    return joint


def _motion(table: Table, units: dict[str, str], path: Path) -> Motion:
    coordinate = units["coordinate"]
    drive = _drive(table, "drive", units, path) if table.has("drive") else None
    if drive is not None and (table.has("position") or table.has("velocity") or table.has("actuator")):
        raise ClearanceError(f"{table.where} has a drive: it takes no initial position or velocity and no actuator.")
    position = table.number("position", coordinate)
    velocity = table.number("velocity", f"{coordinate}/s")
    actuators = tuple(_actuator(t, units, path) for _, t in table.tables("actuator"))
    return Motion(drive, position or 0.0, velocity or 0.0, actuators)


def _drive(table: Table, name: str, units: dict[str, str], path: Path) -> AbstractDrive:
    if isinstance(table.values[name], str):
        try:
            return read_expression(table.get(name))
        except ClearanceError as error:
            raise ClearanceError(f"{table.key(name)}: {error}") from None
    inner = table.table(name)
    cls = DRIVES[inner.word("type", DRIVES)]
    if cls is Spline and inner.has("file"):
        times, values = _csv(path.parent / str(inner.get("file")), inner.key("file"))
        scale = to_si(f"1 {inner.need('unit')}", units["coordinate"], inner.key("unit"))
        drive = Spline(times, values * scale, inner.word("ends", {"not-a-knot", "natural", "clamped"}, "not-a-knot"))
    else:
        values = _fields(cls, inner, units)
        try:
            drive = cls(**values)
        except ClearanceError as error:
            raise ClearanceError(f"{inner.where}: {error}") from None
    inner.finish()
    return drive


def _actuator(table: Table, units: dict[str, str], path: Path) -> AbstractActuator:
    cls = ACTUATORS[table.word("type", ACTUATORS)]
    values = _fields(cls, table, units, skip={"target"})
    if cls is Servo:
        table.need("target")
        values["target"] = _drive(table, "target", units, path)
    actuator = cls(**values)
    _bounded(actuator, table)
    table.finish()
    return actuator


def _csv(path: Path, where: str) -> tuple[np.ndarray, np.ndarray]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].lstrip().startswith("#")]
        try:
            float(rows[0][0])
        except ValueError:
            rows = rows[1:]
        table = np.array([[float(cell) for cell in row[:2]] for row in rows])
        return table[:, 0], table[:, 1]
    except (OSError, ValueError, IndexError) as error:
        raise ClearanceError(f"{where}: `{path}` must be a CSV table of time [s] and value ({error}).") from None


def _clearance(table: Table) -> RevoluteClearance | None:
    given = [k for k in ("radial_clearance", "diametral_clearance") if table.has(k)]
    radii = table.has("pin_radius") and table.has("sleeve_radius")
    if not given and not radii:
        for key in ("normal", "friction", "pin_radius", "sleeve_radius"):
            if table.has(key):
                raise ClearanceError(f"{table.key(key)} belongs to a joint with clearance: add `radial_clearance` too.")
        return None
    if len(given) == 2:
        raise ClearanceError(f"{table.where} gives both a radial and a diametral clearance. Give one.")
    pin, sleeve = table.number("pin_radius", "m"), table.number("sleeve_radius", "m")
    clearance = table.number(given[0], "m") if given else None
    if clearance is not None and given[0].startswith("diametral"):
        clearance /= 2
    if clearance is None and pin is not None and sleeve is not None:
        clearance = sleeve - pin
        if clearance <= 0:
            raise ClearanceError(f"{table.where}: the pin must fit in the sleeve, but pin_radius >= sleeve_radius.")
    assert clearance is not None  # given, or from both radii
    if pin is None:
        if sleeve is None:
            raise ClearanceError(f"{table.where} lacks the key `pin_radius`. Add it (or `sleeve_radius`).")
        pin = sleeve - clearance
    if sleeve is not None and not np.isclose(sleeve - pin, clearance, rtol=1e-6):
        raise ClearanceError(
            f"{table.where}: sleeve_radius - pin_radius is {sleeve - pin:g} m, but the radial clearance is "
            f"{clearance:g} m. The pin must fit in the sleeve: give two of the three, or make them agree."
        )
    friction = None if table.get("friction") == "none" else _friction(table.table("friction"))
    joint = RevoluteClearance(clearance, pin, _normal(table.table("normal"), table), friction)
    _bounded(joint, table)
    return joint


def _normal(table: Table, joint: Table):
    if not joint.has("normal"):
        raise ClearanceError(
            f"{joint.where} lacks the table `normal` (its contact law). Add one with a key `law`. "
            + suggest("", NORMAL_LAWS)
        )
    factory: Any = NORMAL_LAWS[table.word("law", NORMAL_LAWS)]
    # A member of a family is a function; its numbers are those of the class that it returns.
    cls = factory if inspect.isclass(factory) else inspect.signature(factory, eval_str=True).return_annotation
    values = _fields(cls, table, skip={"ratio", "stiffness"})
    given = table.need("stiffness")
    if isinstance(given, dict):
        inner = table.table("stiffness")
        values["stiffness"] = InternalHertz(**_fields(InternalHertz, inner))
        _bounded(values["stiffness"], inner)
        inner.finish()
    else:
        # In which unit, the law knows once it has its other numbers.
        provisional = cast(AbstractNormalLaw, factory(**{"stiffness": 1.0, **values}))
        words = provisional.units()
        unit = resolved_unit(_unit_of(cls, "stiffness"), words)
        values["stiffness"] = to_si(given, unit, table.key("stiffness"))
    law = factory(**values)
    _bounded(law, table)
    table.finish()
    return law


def _unit_of(cls, name: str) -> str:
    """The unit that a class's field has."""
    return next(field.metadata["unit"] for field in dataclasses.fields(cls) if field.name == name)


def _friction(table: Table):
    if not table.values:
        return None
    cls = FRICTION_LAWS[table.word("law", FRICTION_LAWS)]
    law = cls(**_fields(cls, table))
    _bounded(law, table)
    table.finish()
    return law


def _fields(cls, table: Table, units: Mapping[str, str] | None = None, skip=frozenset()) -> dict[str, Any]:
    """Constructor arguments of a class whose numbers are `physical` fields, from a table."""
    out: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.name in skip:
            continue
        if field.metadata.get("static", False):
            if table.has(field.name):
                out[field.name] = table.get(field.name)
            continue
        if not table.has(field.name):
            if field.default is dataclasses.MISSING:
                table.need(field.name)
            continue
        unit = resolved_unit(field.metadata["unit"], units or {})
        value = table.get(field.name)
        if isinstance(value, list):
            if not issubclass(cls, AbstractDrive):
                raise ClearanceError(f"{table.key(field.name)} must be one quantity, but it is the list {value!r}.")
            out[field.name] = [to_si(v, unit, f"{table.key(field.name)}[{i}]") for i, v in enumerate(value)]
        else:
            out[field.name] = to_si(value, unit, table.key(field.name))
    return out


def _bounded(module, table: Table) -> None:
    """Raise for a number of `module` outside its bounds, naming the table's key."""
    words = module.units() if isinstance(module, Parametrised) else {}
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if "unit" in field.metadata and value is not None and not dataclasses.is_dataclass(value):
            check_bounds(value, field.metadata, table.key(field.name), resolved_unit(field.metadata["unit"], words))


def parse_setting(text: str, mechanism: Mechanism) -> tuple[str, float]:
    """`name=value` of the command line, in SI, checked against the parameters of a mechanism."""
    name, equals, value = text.partition("=")
    name, value = name.strip(), value.strip()
    if not equals:
        raise ClearanceError(f"`--set {text}` must read NAME=VALUE, for instance `joint5.radial_clearance=0.2mm`.")
    try:
        unit = find(parameters(mechanism), name)[0].unit
    except ClearanceError as error:
        raise ClearanceError(f"`--set {text}`: {error}") from None
    if unit == "":
        try:
            return name, float(value)
        except ValueError:
            raise ClearanceError(f"`--set {text}`: `{name}` is a bare number, but {value!r} is not.") from None
    return name, to_si(value, unit, f"`--set {name}`")
