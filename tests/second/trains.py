"""Random couplings, drives that give way, and stops, for the joint of a mechanism that is driven: `gear_up`."""

from typing import Any

from .ingredients import Draw
from .model import read
from .quantities import number

TRAIN = ("none", "linear", "gear", "belt", "rack", "screw", "differential", "planetary")
MESH = ("ideal", "backlash", "leads", "leads with backlash")
"""Whether the further wheel follows the mechanism, or leads it."""
SLACK = ("linear", "gear", "rack", "screw")
FLANKS = ("limited", "not limited", "damping factor", "pieces", "cubic")
GIVES = (
    "rigid",
    "elastic",
    "elastic pieces",
    "elastic cubic",
    "error",
    "error and backlash",
    "elastic efficiency",
    "backlash efficiency",
    *(f"backlash {flank}" for flank in FLANKS),
)
STOPS = ("none", "lower", "upper", "both")
SERVO = ("own", "link", "link and motor", "motor and link", "digital", "own integral", "link and motor integral")
WHEELS = {"linear": 1, "gear": 1, "belt": 1, "rack": 1, "screw": 1, "differential": 2, "planetary": 2}


def possible(case: dict) -> bool:
    """Whether its features go together."""
    train, mesh, gives = (
        case.get(key, usual) for key, usual in (("train", "none"), ("mesh", "ideal"), ("gives", "rigid"))
    )
    moved = case["motion"] not in ("load", "spring of points")
    if train == "none" and mesh != "ideal":
        return False
    if "backlash" in mesh and train not in SLACK:
        return False
    if "leads" in mesh and (train in ("rack", "screw") or not moved or case["mechanism"] in ("block", "ball")):
        return False
    if train != "none" and case["mechanism"] in ("block", "ball"):
        return False
    if gives != "rigid" and (not moved or case["motion"] in ("actuator friction", "actuator spring")):
        return False
    # A spline begins elsewhere than its joint. Where loops close about it is the start's choice unless all is driven.
    if case["motion"] == "spline" and (gives != "rigid" or mesh == "leads with backlash"):
        return False
    servo = case.get("servo", "own")
    if servo != "own" and case["motion"] != "actuator servo":
        return False
    return not ("link" in servo and gives == "rigid")


def gear_up(tables: dict, case: dict, draw: Draw, driven: str, space: bool) -> None:
    """Adds all of these to a scene whose joint `driven` is driven, forced or free."""
    motor = driven
    if case.get("train", "none") != "none":
        motor = _train(tables, case["train"], case["mesh"], draw, driven, space)
    if case.get("servo", "own") != "own":
        _sees(tables["joint"][motor]["actuator"]["motor"], case["servo"], motor, draw)
    if case.get("gives", "rigid") != "rigid":
        _give(tables, case["gives"], draw, motor)
        if "drive" in tables["joint"][motor] and "backlash" not in case.get("mesh", "ideal"):
            # The library refuses friction and springs of what follows such a drive.
            tables["joint"].get("wheel0", {}).pop("actuator", None)
    if case.get("stops", "none") != "none":
        _stop(tables, case["stops"], draw, driven)


def _train(tables, kind, mesh, draw, driven, space) -> str:
    """Adds wheels and their coupling; the joint that has the motor then."""
    slides = kind in ("rack", "screw")
    for k in range(WHEELS[kind]):
        _wheel(tables, f"wheel{k}", draw, space, slides)
    joint, wheel = tables["joint"][driven], tables["joint"]["wheel0"]
    start = number(joint.get("position", _begin(joint)))
    table: dict[str, Any]
    if kind in ("differential", "planetary"):
        roles = ("cage", "left", "right") if kind == "differential" else ("carrier", "sun", "ring")
        names = draw.shuffled([driven, "wheel0", "wheel1"])
        table = dict(zip(roles, names, strict=True))
        teeth = [draw.one((20, 24, 30)), draw.one((50, 60, 72))]
        table |= {"teeth": teeth} if kind == "planetary" else {}
        factors = (-1.0, 0.5, 0.5) if kind == "differential" else (-1.0 - teeth[1] / teeth[0], 1.0, teeth[1] / teeth[0])
        relation = dict(zip(names, factors, strict=True))
        table["follower"] = driven if mesh == "leads" else draw.one(("wheel0", "wheel1"))
        if mesh == "leads":
            rest = (relation[driven] * start + relation["wheel0"] * start) / -relation["wheel1"]
            tables["joint"]["wheel1"]["position"] = f"{rest!r} rad"
    else:
        leader, follower = ("wheel0", driven) if "leads" in mesh else (driven, "wheel0")
        table = {"leader": leader, "follower": follower}
        ratio = _ratio(table, kind, draw)
        unit = "m" if slides else "rad"
        table["offset"] = f"{start * (1 - ratio)!r} rad" if "leads" in mesh else draw.quantity(-0.1, 0.1, unit)
    if "leads" in mesh:
        for key in ("drive", "actuator", "rotor_inertia"):
            if key in joint:
                wheel[key] = joint.pop(key)
        wheel.pop("velocity", None)
        wheel.pop("position", None)
        if "drive" not in wheel:
            wheel["position"] = f"{start!r} rad"
            wheel["velocity"] = draw.quantity(-15.0, 15.0, "rad/s")
    if table.get("follower") == driven or "leads" in mesh:
        joint.pop("position", None)
        joint.pop("velocity", None)
    if "backlash" in mesh:
        table |= flank(draw.one(FLANKS), draw, *((5e6, 1e-5, 0.3) if slides else (1e4, 1e-3, 20.0)), slides)
        table["backlash"] = draw.quantity(5e-6, 2e-5, "m") if slides else draw.quantity(3e-4, 1.5e-3, "rad")
        follower = tables["joint"][table["follower"]]
        follower["velocity"] = draw.quantity(-0.1, 0.1, "m/s") if slides else draw.quantity(-4.0, 4.0, "rad/s")
        follower.pop("position", None)
    else:
        _friction(tables["joint"]["wheel0"], draw, slides)
    tables["coupling"] = {"mesh": {"type": kind, **table}}
    if kind == "gear" and mesh == "ideal":
        _wheel(tables, "last", draw, space, False)
        tables["coupling"]["band"] = {
            "type": "belt",
            "leader": "wheel0",
            "follower": "last",
            "radii": ["20 mm", "15 mm"],
        }
    return "wheel0" if "leads" in mesh else driven


def _begin(joint) -> float:
    return number(joint["drive"].get("offset", joint["drive"].get("start", 0.0))) if "drive" in joint else 0.0


def _ratio(table, kind, draw) -> float:
    if kind == "linear":
        table["ratio"] = draw.number(0.6, 1.5) * draw.one((-1, 1))
        return table["ratio"]
    if kind == "gear":
        table |= {"teeth": [draw.one((20, 30)), draw.one((25, 40))], "internal": draw.one((False, True))}
        return (1 if table["internal"] else -1) * table["teeth"][0] / table["teeth"][1]
    if kind == "belt":
        table |= {"radii": ["20 mm", draw.quantity(15.0, 40.0, "mm")], "crossed": draw.one((False, True))}
        return (-1 if table["crossed"] else 1) * number("20 mm") / number(table["radii"][1])
    key = {"rack": "radius", "screw": "lead"}[kind]
    table[key] = draw.quantity(10.0, 30.0, "mm")
    return 0.0


def _wheel(tables, name, draw, space, slides) -> None:
    inertia = draw.quantity(2e-4, 8e-4, "kg*m^2")
    at = [f"{draw.number(-0.1, 0.3)} m" for _ in range(3 if space else 2)]
    body = {"mass": draw.quantity(0.3, 0.8, "kg"), "inertia": [inertia] * 3 if space else inertia}
    body["center_of_mass"] = [f"{draw.number(-0.01, 0.01)} m" for _ in range(3 if space else 2)]
    tables["body"][f"{name}_body"] = body
    # On the ground, or on a link that moves itself.
    links = ("ground", *(one for one in tables["body"] if not one.endswith("_body")))
    joint = {
        "type": "prismatic" if slides else "revolute",
        "parent": draw.one(links),
        "child": f"{name}_body",
        "at_parent": at,
    }
    if space:
        joint["orientation"] = [f"{draw.number(-0.6, 0.6)} rad" for _ in range(3)]
    elif slides:
        joint["angle"] = draw.quantity(-1.0, 1.0, "rad")
    unit = "m" if slides else "rad"
    joint |= {"position": f"{0.01 if slides else 0.3} {unit}", "velocity": draw.quantity(-0.1, 0.1, f"{unit}/s")}
    tables["joint"][name] = joint
    tables["point"][f"{name}_body_b"] = {
        "body": f"{name}_body",
        "at": [f"{x} m" for x in (0.02, 0.03, 0.01)[: len(at)]],
    }


def _friction(joint, draw, slides) -> None:
    """Springs, dampers and a rotor of what follows act on what it follows."""
    unit, per = ("m", "N") if slides else ("rad", "N*m")
    if "drive" not in joint and "actuator" not in joint and draw.one((True, False)):
        spring = {
            "type": "spring",
            "stiffness": f"{draw.number(5.0, 20.0)} {per}/{unit}",
            "damping": f"0.05 {per}*s/{unit}",
        }
        rubs = {"type": "friction", "effort": f"{draw.number(0.1, 0.5)} {per}", "transition_speed": f"0.5 {unit}/s"}
        joint["actuator"] = {"spring": spring, "rubs": rubs}
        if not slides:
            joint["rotor_inertia"] = draw.quantity(1e-4, 1e-3, "kg*m^2")


def flank(kind: str, draw: Draw, stiffness: float, depth: float, speed: float, slides: bool = False) -> dict:
    """A flank's keys, of a usual stiffness, depth and speed."""
    unit, per = ("m", "N") if slides else ("rad", "N*m")
    k = stiffness * draw.number(0.5, 2.0)
    table: dict[str, Any] = {"stiffness": f"{k:.5g} {per}/{unit}"}
    damping = f"{draw.number(0.05, 0.2) * k * depth / speed:.4g} {per}*s/{unit}"
    if kind == "damping factor":
        return table | {"damping_factor": f"{draw.number(0.2, 0.6) / speed:.4g} s/{unit}"}
    if kind == "cubic":
        table["cubic"] = f"{draw.number(0.2, 1.0) * k / depth**2:.4g} {per}/{unit}^3"
    if kind == "pieces":
        table["stiffness"] = [f"{k * x:.5g} {per}/{unit}" for x in (1.0, 1.6, 0.7)]
        table["efforts"] = [f"{k * depth * x:.4g} {per}" for x in (0.15, 0.4)]
    if kind == "not limited":
        table["limited"] = False
    return table | {"damping": damping}


def _give(tables, gives, draw, motor) -> None:
    slides = tables["joint"][motor]["type"] == "prismatic"
    joint, sizes = tables["joint"][motor], (2e5, 1e-4, 0.2) if slides else (2e4, 1e-3, 20.0)
    unit = "m" if slides else "rad"
    kind = gives.removeprefix("elastic").removeprefix("backlash").strip()
    table = flank(kind if kind in FLANKS else "limited", draw, *sizes, slides)
    if "backlash" in gives:
        table["backlash"] = draw.quantity(0.5 * sizes[1], 2 * sizes[1], unit)
    if "error" in gives:
        table |= {
            "error": draw.quantity(0.1 * sizes[1], 0.5 * sizes[1], unit),
            "error_order": f"{draw.number(50.0, 200.0)} 1/{unit}",
        }
        table["error_phase"] = draw.quantity(-1.0, 1.0, "rad")
    if "efficiency" in gives:
        speed = sizes[2] * draw.number(0.02, 0.1)
        table |= {"efficiency": draw.number(0.5, 0.95), "efficiency_speed": f"{speed:.4g} {unit}/s"}
    if "actuator" in joint:
        joint.pop("rotor_inertia", None)
        table["rotor_inertia"] = draw.quantity(1.0, 3.0, "kg") if slides else draw.quantity(5e-4, 3e-3, "kg*m^2")
    tables["compliance"] = {motor: table}


def _sees(servo, kind, motor, draw) -> None:
    """What a servo measures."""
    moved, slides = f"{motor}_motor", "N/m" in servo["stiffness"]
    if kind.endswith("integral"):
        gain = draw.number(100.0, 800.0) * number(servo["stiffness"])
        servo["integral"] = f"{gain:.5g} {'N/(m*s)' if slides else 'N*m/(rad*s)'}"
        kind = kind.removesuffix("integral").strip()
    if kind == "own":
        return
    if kind == "digital":
        servo["period"] = f"{draw.one((0.3, 0.4, 0.7))} ms"
    else:
        servo["encoder"] = [moved, motor] if kind.startswith("link") else [moved]
    if kind in ("link and motor", "motor and link"):
        servo["rate_encoder"] = [moved] if kind == "link and motor" else [moved, motor]


def _closing(tables) -> set[str]:
    """The joints that close loops."""
    placed, out = {"ground"}, set()
    for name, joint in tables["joint"].items():
        out |= {name} if joint["child"] in placed else set()
        placed.add(joint["child"])
    return out


def _stop(tables, kind, draw, driven) -> None:
    """Stops of a coordinate that is free."""
    every = [c for joint in read(tables).joints for c in joint.coordinates if c.name in tables["joint"]]
    starts = {c.name: c.start for c in every if c.drive is None and c.name not in _closing(tables)}
    if "drive" in str(tables["joint"]):
        for one in tables.get("coupling", {}).values():
            if "backlash" not in one:
                starts.pop(one["follower"], None)
    free = [name for name in starts if "drive" not in tables["joint"][name]]
    if not free:
        return
    name = driven if driven in free and draw.one((True, False)) else draw.one(free)
    joint, start = tables["joint"][name], starts[name]
    slides = joint["type"] == "prismatic"
    unit, near = ("m", 2e-4) if slides else ("rad", 0.01)
    table = flank(draw.one(FLANKS), draw, *((2e5, 1e-4, 0.2) if slides else (2e4, 1e-3, 20.0)), slides)
    if kind in ("lower", "both"):
        table["lower"] = f"{float(start - draw.number(0.2, 1.0) * near)!r} {unit}"
    if kind in ("upper", "both"):
        table["upper"] = f"{float(start + draw.number(0.2, 1.0) * near)!r} {unit}"
    joint["stops"] = table


def told(tables: dict) -> dict[str, str]:
    """Quantities of the library that the second simulator has by another name."""
    out = {}
    for name, one in tables.get("coupling", {}).items():
        out[f"{name}.torque"] = f"{name}.torque"
        out |= {f"{name}.gap": f"{name}.position"} if "backlash" in one else {}
    contacts = [f"{name}_stop" for name, joint in tables["joint"].items() if "stops" in joint]
    for name, one in tables.get("compliance", {}).items():
        out[f"{name}_motor.turned"] = f"{name}_motor"
        if "backlash" in one:
            contacts.append(f"{name}_drive")
        elif "error" not in one:
            out[f"{name}_drive.gap"] = name
    return out | {
        f"{c}.{one}": f"{c}.{other}" for c in contacts for one, other in (("gap", "position"), ("torque", "effort"))
    }
