"""Reads the clearance of a scene's joint: its geometry, contact laws and worn sleeve."""

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from clearance_jax import joints
from clearance_jax.errors import ClearanceError, naming, suggest, wrong_value
from clearance_jax.io.files import read_table
from clearance_jax.io.keys import play as keys
from clearance_jax.io.keys.declare import Keys, keys_of
from clearance_jax.io.table import TomlTable
from clearance_jax.joints.elements import ELEMENTS
from clearance_jax.joints.presets import PINS, flat_contact, round_contact
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, AbstractFrictionLaw, AbstractNormalLaw, InternalHertz
from clearance_jax.mechanism.tree.compounds import Cylindrical, Spherical
from clearance_jax.mechanism.tree.tree import Prismatic, Revolute
from clearance_jax.parameters import check_demands
from clearance_jax.units import to_si

RADIAL, DIAMETRAL, PIN_RADIUS, SLEEVE = "radial_clearance", "diametral_clearance", "pin_radius", "sleeve_radius"
COMMON = RADIAL, PIN_RADIUS
OF_A_FACE = ("collar_radius", "ring")
OF_A_FIT = ("temperature", "pin_expansion", "sleeve_expansion", "press")
EXPANSIONS = ("pin_expansion", "sleeve_expansion")
LAYER = '"2e13 Pa/m"'
WITH_A_BEARING = ("bearing", "friction", "element", "eccentricity")
# Tolerance of the angles of a table [deg]: they may be rounded to two decimals.
OFF = 0.01
UNUSED = "has no effect here. Remove it."


def play_of(kind: type, table: TomlTable, path: Path, usual: bool = False) -> dict[str, Any]:
    """The `clearance` of a joint (`None`: it is ideal) and its initial `eccentricity`, as arguments of its class
    `kind`. `path`: of the scene file; `usual`: whether contact laws default to those of steel in bronze.
    """
    play = PLAYS[kind]
    start = table.get("eccentricity")
    radii = play.radii and table.has(PIN_RADIUS) and table.has(SLEEVE)
    if not (radii or any(table.has(key) for key in play.makes)):
        others = (key.name for key in play.keys.keys if key.name != "eccentricity")
        table.refuse(*others, why=f"belongs to a joint with clearance: add `{play.makes[0]}` too.")
        return {"clearance": None, "eccentricity": start}
    clearance = play.read(table, usual)
    if table.has("element"):
        if clearance.element is not None:
            why = "would take the place of the bearing's `preload`, which fills the play already."
            table.refuse("element", why=f"{why} Leave one of them out.")
        word, element = table.variant("element", keys.ELEMENT_TABLES)
        clearance = dataclasses.replace(clearance, element=ELEMENTS[word](**element.arguments("type")))
    if play.keys is keys.PIN and isinstance(clearance, joints.AbstractPin) and table.has("worn"):
        clearance = with_wear(clearance, table, path)
    with naming(table.where):
        check_demands(clearance)
    return {"clearance": clearance, "eccentricity": start}


def _pin(table: TomlTable, usual: bool) -> joints.AbstractPin:
    if not table.has("bearing"):
        return _in_a_sleeve(PINS[table.get("kind")], table, usual)
    others = (key.name for key in keys.PIN.keys if key.name not in WITH_A_BEARING)
    table.refuse(*others, why="has no effect beside a `bearing`, which is a whole joint.")
    word, inner = table.variant("bearing", keys.BEARINGS)
    with naming(inner.where):
        return BEARINGS_MADE[word](**inner.arguments("type"), friction=friction_of(table))


def _in_a_sleeve(make: Any, table: TomlTable, usual: bool) -> joints.AbstractPin:
    fields = {name: key.required for name, key in keys_of(make).items() if name not in COMMON}
    for kind, other in PINS.items():
        for key in keys_of(other):
            if key in table.values and key not in (*fields, *COMMON, "length"):
                raise ClearanceError(f'{table.key(key)} belongs to a {kind}: add `kind = "{kind}"` too.')
    table.need(*(key for key, required in fields.items() if required))
    if "axial_clearance" not in table.values:
        table.refuse(*OF_A_FACE, why="has no effect without `axial_clearance`: only then are there faces.")
    clearance, pin, tolerance = _radii(table, usual)
    normal, friction = _laws(table, round_contact(clearance) if usual else None)
    sizes = {key: table.get(key) for key in ("length", *fields) if key in table.values}
    with naming(table.where):
        return make(clearance, pin, normal=normal, friction=friction, tolerance=tolerance, **sizes)


def _ball(table: TomlTable, usual: bool) -> joints.SphericalClearance:
    table.need("ball_radius")
    clearance = table.get(RADIAL)
    laws = _laws(table, round_contact(clearance) if usual else None)
    return joints.SphericalClearance(clearance, table.get("ball_radius"), *laws)


def _guide(table: TomlTable, usual: bool) -> joints.GuideClearance:
    table.need("length", *(() if usual else ("height",)))
    length, width = table.get("length"), table.get("width")
    height = table.get("height") if table.has("height") else length
    flat = flat_contact(length, height, 2) if width is None else flat_contact(length, width, 4)
    laws, guide = _laws(table, flat if usual else None), table.get("guide_length")
    return joints.GuideClearance(table.get("side_clearance"), length, height, *laws, width, guide_length=guide)


BEARINGS_MADE: Any = {"radial": joints.rolling_bearing, "crossed-roller": joints.crossed_roller}
BEARINGS_MADE |= {"angular-contact-pair": joints.angular_contact_pair}


class PlayReader(NamedTuple):
    """Reads the clearance of a kind of joint. A joint has one if it has one of the keys `makes`, or both `radii`."""

    keys: Keys
    makes: tuple[str, ...]
    read: Callable[[TomlTable, bool], joints.AbstractClearance]
    radii: bool = False


PLAYS = {
    Revolute: PlayReader(keys.PIN, (RADIAL, DIAMETRAL, "fit", "bearing"), _pin, True),
    Cylindrical: PlayReader(
        keys.SHAFT, (RADIAL, DIAMETRAL, "fit"), partial(_in_a_sleeve, joints.SleeveClearance), True
    ),
    Spherical: PlayReader(keys.BALL, (RADIAL,), _ball),
    Prismatic: PlayReader(keys.GUIDE, ("side_clearance",), _guide),
}
"""Readers by class of joint."""


def _radii(table: TomlTable, usual: bool) -> tuple[Any, float, joints.Tolerance | None]:
    """Radial clearance and pin radius [m], from a fit or from two of clearance, pin radius and sleeve radius."""
    pin, sleeve = table.get(PIN_RADIUS), table.get(SLEEVE)
    if usual and table.has("length") and not (table.has(PIN_RADIUS) or table.has(SLEEVE)):
        pin = table.get("length") / 2
    if table.has("fit"):
        return _fit(table, pin)
    table.refuse(*OF_A_FIT, why="belongs to a fit: add `fit` too.")
    if table.has(RADIAL) and table.has(DIAMETRAL):
        raise ClearanceError(f"{table.where} gives both a radial and a diametral clearance. Give one.")
    clearance = table.get(DIAMETRAL) / 2 if table.has(DIAMETRAL) else table.get(RADIAL)
    if clearance is None:  # then both radii are there
        clearance = sleeve - pin
        if clearance <= 0:
            raise ClearanceError(f"{table.where}: the pin must fit in the sleeve, but {PIN_RADIUS} >= {SLEEVE}.")
    if pin is None:
        if sleeve is None:
            raise ClearanceError(f"{table.where} lacks the key `{PIN_RADIUS}`. Add it (or `{SLEEVE}`).")
        pin = sleeve - clearance
        if pin <= 0:
            why = f"must be greater than the radial clearance {clearance:g} m, or there is no pin"
            table.refuse(SLEEVE, why=f"{why}, but it is {sleeve:g} m.")
    if sleeve is not None and not np.isclose(sleeve - pin, clearance, rtol=1e-6):
        raise ClearanceError(
            f"{table.where}: {SLEEVE} - {PIN_RADIUS} is {sleeve - pin:g} m, but the radial clearance is "
            f"{clearance:g} m. The pin must fit in the sleeve: give two of the three, or make them agree."
        )
    return clearance, pin, None


def _fit(table: TomlTable, pin: float | None) -> tuple[Any, float, joints.Tolerance]:
    table.refuse(RADIAL, DIAMETRAL, SLEEVE, why="has no effect beside a `fit`, which gives the clearance.")
    if not table.has("temperature"):
        table.refuse(*EXPANSIONS, why="has no effect without `temperature`: at 20 degC nothing expands.")
    if pin is None:
        raise ClearanceError(f"{table.where} lacks the key `{PIN_RADIUS}`, half the nominal diameter. Add it.")
    numbers = {key: table.get(key) for key in OF_A_FIT if key != "press" and table.has(key)}
    with naming(table.key("fit")):
        press = joints.PressFit(**table.table("press", keys.PRESS).arguments()) if table.has("press") else None
        clearance, tolerance = joints.Fitting(table.get("fit"), **numbers, press=press).radial_clearance(2 * pin)
    return clearance, pin, tolerance


def _laws(joint: TomlTable, usual: AbstractNormalLaw | None) -> tuple[AbstractNormalLaw, AbstractFrictionLaw | None]:
    """Normal and friction law; `usual`: the default of the normal law, if there is one."""
    return _normal(joint) if usual is None or joint.has("normal") else usual, friction_of(joint)


def _normal(joint: TomlTable) -> AbstractNormalLaw:
    if not joint.has("normal"):
        fix = f"Add one with a key `law`. {suggest('', NORMAL_LAWS)}"
        raise ClearanceError(f"{joint.where} lacks the table `normal` (its contact law). {fix}")
    word, table = joint.variant("normal", keys.NORMAL_TABLES)
    make: Any = NORMAL_LAWS[word]
    if "stiffness" not in {key.name for key in keys.NORMAL_TABLES[word].keys}:
        return make(**table.arguments("law"))
    table.need("stiffness")
    values = table.arguments("law", "stiffness")
    if isinstance(table.values["stiffness"], dict):
        if not getattr(make, "has_radii", True):
            text = f"{table.key('stiffness')} must be a quantity such as {LAYER}: a layer has no radii."
            raise ClearanceError(text).about(table.key("stiffness"))
        inner = table.table("stiffness", keys.STIFFNESS)
        return make(stiffness=InternalHertz(**inner.arguments()), **values)
    # The law's other numbers decide the unit.
    provisional = cast(AbstractNormalLaw, make(stiffness=1.0, **values))
    return make(stiffness=table.get("stiffness", provisional.units()), **values)


def friction_of(joint: TomlTable) -> AbstractFrictionLaw | None:
    """The friction law of a table, if it names one."""
    if not joint.has("friction") or joint.get("friction") in ("none", {}):
        return None
    word, table = joint.variant("friction", keys.FRICTION_TABLES)
    return FRICTION_LAWS[word](**table.arguments("law"))


def with_wear(clearance: joints.AbstractPin, joint: TomlTable, path: Path) -> joints.AbstractPin:
    """The clearance with its sleeve worn as the table `worn` says, evenly along its length; `path`: of the scene."""
    where = joint.key("worn")
    table = joint.table("worn", keys.WORN)
    if table.has("depth") == table.has("file"):
        raise ClearanceError(f"{where} must have `depth` or `file`, and not both.")
    if table.has("depth"):
        table.refuse("cycles", "unit", why=UNUSED)
        depth = np.array(table.get("depth"))
    else:
        file = path.parent / table.get("file")
        read = _of_life if file.suffix.lower() == ".nc" else _of_table
        depth = read(table, file)
    if np.any(depth < 0):
        raise ClearanceError(f"{where} must have depths of at least 0, but one is {depth.min():g} m.")
    with naming(where):
        return clearance.worn(depth)


def _of_life(table: TomlTable, file: Path) -> np.ndarray:
    """The depths of a wear result at an age [m], shape (sectors,)."""
    table.refuse("unit", why=UNUSED)
    where = table.key("file")
    if not file.is_file():
        raise ClearanceError(f"{where}: there is no file `{file}`.")
    from clearance_jax.results.store import load_dataset  # xarray takes a third of a second, and few scenes need it

    dataset = load_dataset(file)
    if "depth" not in dataset or dataset["depth"].dims != ("cycle", "sector"):
        raise ClearanceError(f"{where}: `{file}` is not the result of a study of wear.")
    lived = dataset["cycle"].values
    age = float(lived[-1]) if table.get("cycles") is None else table.get("cycles")
    if not lived[0] <= age <= lived[-1]:
        raise wrong_value(table.key("cycles"), f"at most the {lived[-1]:g} cycles of the file", age, shown=f"{age:g}")
    return dataset["depth"].interp(cycle=age).values


def _of_table(table: TomlTable, file: Path) -> np.ndarray:
    table.refuse("cycles", why=UNUSED)
    table.need("unit")
    angle, depth = read_table(file, table.key("file"), "angle [deg] and depth")
    if np.any(np.abs(angle - 360 * np.arange(angle.size) / angle.size) > OFF):
        why = f"the angles of `{file}` must go round once, evenly, from 0 to less than 360 deg"
        raise ClearanceError(f"{table.key('file')}: {why}.")
    return depth * to_si(f"1 {table.get('unit')}", "m", table.key("unit"))
