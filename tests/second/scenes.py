"""Random scenes that cross features in pairs."""

import itertools
import json
from typing import Any, NamedTuple

import numpy as np

from . import ingredients, mechanisms, spatial, trains
from .ingredients import Draw
from .quantities import number

RESTART = 0.3
"""When a scene of that start is saved and goes on, over its end."""
SECTORS = 720
STARTS = ("centre", "off the centre", "restarted")
BORES = ("round", "worn")
TIMES = ("even", "uneven", "late")
SOLVED = ("alone", "jit", "vmap", "batch")
CONTACTS = ("compared", "not")
NUMBERS = ("clearance", "stiffness", "mass", "length of a link", "gravity", "gears")
FEATURES: dict[str, tuple[str, ...]] = {
    "mechanism": (*mechanisms.PLANE, *spatial.SPACE),
    "normal": ingredients.NORMAL,
    "friction": ingredients.FRICTION,
    "motion": ingredients.MOTION,
    "start": STARTS,
    "bore": BORES,
    "filling": ingredients.FILLING,
    "times": TIMES,
    "solved": SOLVED,
    "by": NUMBERS,
    "contacts": CONTACTS,
    "train": trains.TRAIN,
    "mesh": trains.MESH,
    "gives": trains.GIVES,
    "stops": trains.STOPS,
    "servo": trains.SERVO,
}
"""What a scene has one of each. `by`: the number by which its derivative is taken; `contacts`: whether its contact
episodes are compared, by one more program.
"""

Case = dict[str, str]


class Scene(NamedTuple):
    """A scene with what is asked of it: its tables, the features, times [s], and the name of the derivative's number
    in the library with the keys of its table.
    """

    tables: dict
    case: Case
    times: np.ndarray
    t1: float
    name: str
    keys: tuple


def possible(case: Case) -> bool:
    """Whether its features go together."""
    pin = case["mechanism"] not in ("guide", "sleeve", "sleeve-inside", "ball", "block")
    wide = case["normal"] in ingredients.LINE
    if (wide or case["bore"] == "worn" or case["filling"] == "short-bearing") and not pin:
        return False
    if case["filling"] != "none" and case["mechanism"] in ("guide", "block", "ball"):
        return False
    # Laws of a line know their radii only for a round bore. A film in a worn bore follows the wear: this is not yet
    # written here.
    if wide and case["bore"] == "worn":
        return False
    if case["bore"] == "worn" and case["filling"] == "short-bearing":
        return False
    if case["mechanism"] == "ball" and case["motion"] not in ("load", "spring of points"):
        return False
    if case["by"] == "stiffness" and wide and case["normal"] != "winkler":
        return False
    if not trains.possible(case):
        return False
    return not (case["by"] == "length of a link" and case["mechanism"] in ("pendulum", *spatial.SPACE))


def cases(count: int, seed: int = 0, tries: int = 60) -> list[Case]:
    """Cases of which each has as many new pairs of features as the best of some random ones."""
    draw, seen, out = Draw(seed), set(), []
    while len(out) < count:
        offered = [{name: draw.one(values) for name, values in FEATURES.items()} for _ in range(8 * tries)]
        offered = [case for case in offered if possible(case)][:tries]
        best = max(offered, key=lambda case: len(pairs(case) - seen))
        seen |= pairs(best)
        out.append(best)
    return out


def pairs(case: Case) -> set[tuple]:
    """The pairs of features that a case crosses."""
    return set(itertools.combinations(sorted(case.items()), 2))


CHOOSY = (
    ("mechanism", "normal", "motion", "bore", "filling", "by"),
    ("mechanism", "motion", "train", "mesh", "gives", "servo"),
)
"""The features of which some do not go together, see `possible`: of those of two groups any do."""


def crossable() -> set[tuple]:
    """The pairs of features that go together."""
    out = set()
    for one, two in itertools.combinations(FEATURES, 2):
        if not any({one, two} <= {*group} for group in CHOOSY):
            out |= {tuple(sorted(((one, a), (two, b)))) for a in FEATURES[one] for b in FEATURES[two]}
    usual = {name: values[0] for name, values in FEATURES.items()}
    for group in CHOOSY:
        for values in itertools.product(*(FEATURES[name] for name in group)):
            case = dict(zip(group, values, strict=True))
            if possible(usual | case):
                out |= pairs(case)
    return out


def scene(case: Case, structure: int, numbers: int = 0) -> Scene:
    """A random scene of a case, by a seed of what it consists of and one of its numbers."""
    draw = Draw(structure, numbers)
    t1 = 2.5e-3
    space = case["mechanism"] in spatial.SPACE
    if space:
        tables, plays, driven = spatial.SPACE[case["mechanism"]](draw), ["joint"], "joint"
        if case["motion"] not in ("load", "spring of points"):
            _move(tables, case["motion"], draw, "joint", 1.0, t1)
    else:
        graph = mechanisms.PLANE[case["mechanism"]](draw)
        tables, plays, driven = mechanisms.tables(graph, draw), list(graph.playing[: graph.plays]), graph.driven
        if draw.one((True, False)) or case["by"] == "gravity":
            tables["gravity"] = ["0 m/s^2", "-9.81 m/s^2"]
        _move(tables, case["motion"], draw, graph.driven, graph.pace, t1)
    trains.gear_up(tables, case, draw, driven, space)
    for name in plays:
        _loosen(tables["joint"][name], case, draw, space)
    if case["start"] == "off the centre" and not any("eccentricity" in table for table in tables["joint"].values()):
        case = case | {"start": "centre"}
    if case["motion"] in ("load", "spring of points"):
        _pull(tables, case["motion"], draw, t1, space)
    times = {
        "even": np.linspace(0, t1, 9),
        "uneven": t1 * np.array([0.0, 0.37, 0.41, 0.55, 0.83, 0.9, 0.97]),
        "late": t1 * np.array([0.8, 0.95, 1.0]),
    }[case["times"]]
    if case["start"] == "restarted":
        times = RESTART * t1 + (1 - RESTART) * times
    return Scene(tables, case, times, t1, *_number(tables, case["by"], plays[0], draw))


def _move(tables, motion, draw, driven, pace, t1):
    """Drives or forces the joint that may be driven; free ones of an open chain begin to move by themselves."""
    joint = tables["joint"][driven]
    start, turns = number(joint["position"]), joint["type"] == "revolute"
    if motion in ingredients.DRIVES:
        joint["drive"] = ingredients.drive(motion, draw, start, t1, turns, pace)
        del joint["position"]
        joint.pop("velocity", None)
    elif motion.startswith("actuator"):
        kind = motion.removeprefix("actuator ")
        joint["actuator"] = {"motor": ingredients.effort(kind, draw, start, turns)}
        if kind in ("friction", "spring"):
            joint["actuator"]["load"] = ingredients.effort("constant", draw, start, turns)
        if turns and draw.one((True, False)):
            joint["rotor_inertia"] = draw.quantity(1e-4, 1e-3, "kg*m^2")
    if len(tables["joint"]) == len(tables["body"]):
        for table in tables["joint"].values():
            if not {"drive", "velocity"} & table.keys():
                table["velocity"] = draw.quantity(-15.0, 15.0, "rad/s")


def _pull(tables, motion, draw, t1, space):
    body = list(tables["body"])[-1]
    if motion == "load":
        force = [f"{draw.number(-80.0, 80.0)} N" for _ in range(3 if space else 2)]
        load: dict[str, Any] = {"body": body, "at": tables["point"][f"{body}_b"]["at"], "force": force}
        load["axes"] = draw.one(("world", "body"))
        load["course"] = {"type": "harmonic", "amplitude": 1.0, "angular_frequency": "900 rad/s", "offset": 0.5}
        if not space:
            load["torque"] = ["0 N*m", "0 N*m", f"{draw.number(-2.0, 2.0)} N*m"]
        tables["wrench"] = {"cut": load}
        return
    at = [f"{x} m" for x in (0.3, 0.1, 0.2)[: 3 if space else 2]]
    spring = {"body_a": "ground", "body_b": body, "at_a": at, "at_b": tables["point"][f"{body}_b"]["at"]}
    spring |= {"stiffness": draw.quantity(300.0, 900.0, "N/m"), "free_length": draw.quantity(0.05, 0.15, "m")}
    tables["spring"] = {"coil": {**spring, "damping": draw.quantity(1.0, 10.0, "N*s/m")}}


def _loosen(joint, case, draw, space):
    """Gives a joint its play and its laws."""
    clearance = draw.number(2e-5, 6e-5)
    if joint["type"] == "prismatic":
        joint |= {"side_clearance": f"{clearance} m", "length": "40 mm", "height": "30 mm"}
    else:
        joint["radial_clearance"] = f"{clearance * 1e6:.5g} um"
        joint["ball_radius" if joint["type"] == "spherical" else "pin_radius"] = draw.quantity(8.0, 12.0, "mm")
    if joint["type"] == "revolute" and "length" not in joint:
        joint["length"] = draw.quantity(8.0, 15.0, "mm")
    joint["normal"] = ingredients.normal(case["normal"], draw)
    if case["friction"] != "none":
        joint["friction"] = ingredients.friction(case["friction"], draw)
    if case["filling"] != "none":
        joint["element"] = ingredients.filling(case["filling"], draw, joint, space)
    if case["bore"] == "worn":
        angles, depth = 2 * np.pi * np.arange(SECTORS) / SECTORS, np.zeros(SECTORS)
        for order in (1, 2):
            depth += clearance * draw.number(0.02, 0.08) * (1 + np.cos(order * (angles - draw.number(-3.0, 3.0))))
        joint["worn"] = {"depth": [f"{float(x):.9g} m" for x in depth]}
    # A joint that closes a loop begins where the others have it.
    closes = not space and "position" not in joint and "drive" not in joint
    if case["start"] != "centre" and not closes:
        angle, size = draw.number(-3.0, 3.0), draw.number(0.4, 0.9) * clearance
        off = size * np.cos(angle), size * np.sin(angle)
        if joint["type"] == "prismatic":
            # Of a guide x is across; along it there is no play, and what is held has none.
            off = off[0], 0.0
        joint["eccentricity"] = [f"{float(x):.6g} m" for x in off]
        if not space:
            _shift(joint)


def _shift(joint):
    """Moves the sleeve, so that the pin is where it was: loops are closed then. Which pose is the nearest one at which
    a loop closes depends on the coordinates in which it is sought, so that both simulators would find another.
    """
    x, y = (number(value) for value in joint["eccentricity"])
    if joint["type"] == "prismatic":
        angle = number(joint["angle"])
        x, y = -x * np.sin(angle), x * np.cos(angle)
    joint["at_parent"] = [f"{number(at) - float(off)!r} m" for at, off in zip(joint["at_parent"], (x, y), strict=True)]


def _number(tables, by, play, draw) -> tuple[str, tuple]:
    joint = tables["joint"][play]
    if by == "gravity" and "gravity" in tables:
        return "gravity.y", ("gravity", 1)
    if by == "gears" and (found := _of_gears(tables, draw)):
        return found
    if by == "mass":
        body = list(tables["body"])[-1]
        return f"{body}.mass", ("body", body, "mass")
    if by == "length of a link":
        for name, table in tables["joint"].items():
            if table["parent"] != "ground" and table["type"] == "revolute" and number(table["at_parent"][0]):
                return f"{name}.at_parent.x", ("joint", name, "at_parent", 0)
    if by == "stiffness" and "stiffness" in joint["normal"]:
        return f"{play}.normal.stiffness", ("joint", play, "normal", "stiffness")
    key = "side_clearance" if joint["type"] == "prismatic" else "radial_clearance"
    return f"{play}.{key}", ("joint", play, key)


def _of_gears(tables, draw) -> tuple[str, tuple] | None:
    """A number of a coupling, of a drive that gives way, or of stops."""
    found: list[tuple[str, tuple]] = []
    for name, one in tables.get("coupling", {}).items():
        found += [(f"{name}.{key}", ("coupling", name, key)) for key in ("backlash", "offset", "ratio") if key in one]
    for name, one in tables.get("compliance", {}).items():
        found += [(f"{name}.backlash", ("compliance", name, "backlash"))] if "backlash" in one else []
        if "efficiency" in one:
            found.append((f"{name}.actuator.compliance.efficiency", ("compliance", name, "efficiency")))
    for name, one in tables["joint"].items():
        keys = [key for key in ("lower", "upper") if key in one.get("stops", {})]
        found += [(f"{name}.stops.{key}", ("joint", name, "stops", key)) for key in keys]
        if "integral" in one.get("actuator", {}).get("motor", {}):
            moved = f"{name}_motor" if name in tables.get("compliance", {}) else name
            found.append((f"{moved}.actuator.motor.integral", ("joint", name, "actuator", "motor", "integral")))
    return draw.one(found) if found else None


def value(tables: dict, keys: tuple) -> float:
    """A number of a scene in SI units."""
    for key in keys:
        tables = tables[key]
    return number(tables)


def changed(tables: dict, keys: tuple, new: float) -> dict:
    """The scene with another number."""
    tables = json.loads(json.dumps(tables))
    at: Any = tables
    for key in keys[:-1]:
        at = at[key]
    at[keys[-1]] = float(new)
    return tables


def toml(tables: dict) -> str:
    """The scene as a file."""
    return "\n".join(f"{key} = {_inline(entry)}" for key, entry in tables.items()) + "\n"


def _inline(entry) -> str:
    if isinstance(entry, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_inline(one)}" for key, one in entry.items()) + " }"
    if isinstance(entry, list):
        return "[" + ", ".join(_inline(one) for one in entry) + "]"
    return json.dumps(entry)
