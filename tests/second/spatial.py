"""Random mechanisms in space: one body with play in its joint, which falls and turns, or is driven."""

from collections.abc import Callable

from .ingredients import Draw


def _body(draw: Draw) -> dict:
    inertia = [f"{draw.number(1.5e-4, 2.8e-4)} kg*m^2" for _ in range(3)]
    centre = [f"{draw.number(-0.02, 0.02)} m" for _ in range(3)]
    return {"mass": draw.quantity(0.2, 0.6, "kg"), "inertia": inertia, "center_of_mass": centre}


def _scene(draw: Draw, joint: dict) -> dict:
    at = [f"{draw.number(0.01, 0.05)} m" for _ in range(3)]
    point = {"body_a": {"body": "body", "at": ["0 m", "0 m", "0 m"]}, "body_b": {"body": "body", "at": at}}
    point["body_c"] = {"body": "body", "at": ["0.03 m", "-0.02 m", "0.01 m"]}
    gravity = [f"{x} m/s^2" for x in (3.0, -9.0, draw.number(-4.0, 4.0))]
    turned = [f"{draw.number(-0.6, 0.6)} rad" for _ in range(3)]
    joint |= {"parent": "ground", "child": "body", "at_parent": [f"{x} m" for x in (0.1, -0.05, 0.2)]}
    joint |= {"at_child": [f"{draw.number(-0.02, 0.02)} m" for _ in range(3)], "orientation": turned}
    joint["child_orientation"] = [f"{draw.number(-0.5, 0.5)} rad" for _ in range(3)]
    return {"gravity": gravity, "body": {"body": _body(draw)}, "joint": {"joint": joint}, "point": point}


def _sleeve(pin: str):
    def of(draw: Draw) -> dict:
        joint = {"type": "revolute", "kind": "sleeve", "pin": pin, "length": "40 mm", "stations": 4}
        joint |= {"axial_clearance": draw.quantity(20.0, 60.0, "um")} if draw.one((True, False)) else {}
        start = {"position": draw.quantity(0.2, 1.0, "rad"), "velocity": draw.quantity(5.0, 20.0, "rad/s")}
        return _scene(draw, {**joint, **start})

    return of


def _ball(draw: Draw) -> dict:
    spin = [f"{draw.number(-10.0, 10.0)} rad/s" for _ in range(3)]
    start = [f"{draw.number(-0.5, 0.5)} rad" for _ in range(3)]
    return _scene(draw, {"type": "spherical", "start": start, "spin": spin})


def _block(draw: Draw) -> dict:
    start = {"position": draw.quantity(0.01, 0.03, "m"), "velocity": draw.quantity(0.1, 0.3, "m/s")}
    return _scene(draw, {"type": "prismatic", "width": "25 mm", **start})


SPACE: dict[str, Callable[[Draw], dict]] = {
    "sleeve": _sleeve("through"),
    "sleeve-inside": _sleeve("inside"),
    "ball": _ball,
    "block": _block,
}
