"""Random mechanisms: which bodies, joined where. A link is a body with the points of its joints in the world at the
start; its frame lies in it at random, so that no coordinate begins at zero.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .ingredients import Draw

GROUND = "ground"


class Edge(NamedTuple):
    """A joint between two bodies at a place of the world, in metres; `direction` of a slide [rad]."""

    name: str
    one: str
    other: str
    at: tuple[float, float]
    direction: float | None = None


class Graph(NamedTuple):
    """The joints of a mechanism; the one that may be driven, and those that may have play, the first if only one;
    `pace`: by how much slower than others it moves, so that its impacts are as fast as theirs.
    """

    edges: tuple[Edge, ...]
    driven: str
    playing: tuple[str, ...]
    plays: int = 1
    pace: float = 1.0


def _chain(draw) -> Graph:
    a = draw.rng.uniform(-np.pi, np.pi, 2)
    knee = 0.2 * np.array([np.cos(a[0]), np.sin(a[0])])
    edges = Edge("hip", GROUND, "thigh", (0.0, 0.0)), Edge("knee", "thigh", "shin", tuple(knee))
    return Graph(edges, "hip", ("knee", "hip"), pace=0.2)


def _pendulum(draw) -> Graph:
    return Graph((Edge("hip", GROUND, "arm", (0.01, -0.02)),), "hip", ("hip",))


def _two_plays_in_a_chain(draw) -> Graph:
    return _chain(draw)._replace(plays=2)


def _slider_crank(draw) -> Graph:
    angle = draw.number(0.4, 1.2)
    pin = 0.05 * np.cos(angle), 0.05 * np.sin(angle)
    piston = pin[0] + np.sqrt(0.12**2 - pin[1] ** 2)
    edges = (
        Edge("main", GROUND, "crank", (0.0, 0.0)),
        Edge("crankpin", "crank", "rod", pin),
        Edge("wrist", "rod", "slider", (piston, 0.0)),
        Edge("guide", GROUND, "slider", (piston, 0.0), draw.one((0.0, np.pi))),
    )
    return Graph(edges, "main", draw.one((("wrist", "crankpin"), ("crankpin", "wrist"))))


def _two_plays_in_a_loop(draw) -> Graph:
    return _slider_crank(draw)._replace(plays=2)


def _guide(draw) -> Graph:
    return _slider_crank(draw)._replace(playing=("guide",))


def _four_bar(draw) -> Graph:
    a, b, c, d = _near(draw, (0.0, 0.0), (0.02, 0.05), (0.13, 0.08), (0.1, 0.0))
    edges = (
        Edge("main", GROUND, "crank", a),
        Edge("crankpin", "crank", "coupler", b),
        Edge("knuckle", "coupler", "rocker", c),
        Edge("pivot", GROUND, "rocker", d),
    )
    return Graph(edges, "main", draw.one((("knuckle", "pivot"), ("crankpin", "pivot"), ("pivot", "knuckle"))))


def _near(draw, *points):
    return [tuple(np.array(point) + draw.rng.uniform(-4e-3, 4e-3, 2)) for point in points]


# Two ternary links T and U joined directly (Watt) or not (Stephenson), and four binary ones.
WATT = {
    "hub": ("T", "U", (0.0, 0.0)),
    "a": ("T", "A", (0.08, 0.01)),
    "ab": ("A", "B", (0.07, 0.09)),
    "b": ("B", "U", (-0.02, 0.07)),
    "c": ("T", "C", (0.03, -0.06)),
    "cd": ("C", "D", (-0.05, -0.09)),
    "d": ("D", "U", (-0.06, -0.01)),
}
STEPHENSON = {
    "a": ("T", "A", (0.0, 0.0)),
    "b": ("A", "U", (0.02, 0.09)),
    "c": ("T", "C", (0.1, 0.0)),
    "d": ("C", "U", (0.12, 0.07)),
    "e": ("T", "E", (0.05, -0.05)),
    "ef": ("E", "F", (-0.06, 0.03)),
    "f": ("F", "U", (-0.03, 0.13)),
}


def _six_bar(chain, ground, driven):
    def of(draw) -> Graph:
        places = _near(draw, *(at for _, _, at in chain.values()))
        named = {ground: GROUND}
        edges = tuple(
            Edge(name, named.get(one, one), named.get(other, other), at)
            for (name, (one, other, _)), at in zip(chain.items(), places, strict=True)
        )
        return Graph(edges, driven, tuple(draw.shuffled(e.name for e in edges if e.name != driven)))

    return of


PLANE: dict[str, Callable[[Draw], Graph]] = {
    "pendulum": _pendulum,
    "chain": _chain,
    "chain-two-plays": _two_plays_in_a_chain,
    "slider-crank": _slider_crank,
    "loop-two-plays": _two_plays_in_a_loop,
    "guide": _guide,
    "four-bar": _four_bar,
    "watt-1": _six_bar(WATT, "A", "a"),
    "watt-2": _six_bar(WATT, "T", "a"),
    "stephenson-1": _six_bar(STEPHENSON, "A", "a"),
    "stephenson-2": _six_bar(STEPHENSON, "E", "e"),
    "stephenson-3": _six_bar(STEPHENSON, "T", "a"),
}


def tables(graph: Graph, draw: Draw) -> dict:
    """Bodies, joints and points of a scene, without laws and drives; joints in a random order that places bodies."""
    links: dict[str, list] = {}
    for edge in graph.edges:
        for body in (edge.one, edge.other):
            links.setdefault(body, []).append(edge.at)
    angles = {body: 0.0 if body == GROUND else draw.number(-1.0, 1.0) for body in links}
    origins = {body: np.zeros(2) if body == GROUND else np.array(places[0]) for body, places in links.items()}
    # A slider slides without turning, and its frame lies at its pin.
    for edge in graph.edges:
        if edge.direction is not None:
            angles[edge.other], origins[edge.other] = edge.direction, np.array(edge.at)

    def local(body, at):
        c, s = np.cos(angles[body]), np.sin(angles[body])
        x, y = np.array(at) - origins[body]
        return [f"{float(c * x + s * y)!r} m", f"{float(c * y - s * x)!r} m"]

    bodies = {}
    for body in draw.shuffled(b for b in links if b != GROUND):
        places = np.array(links[body])
        size = max(np.ptp(places, axis=0).max(), 0.03)
        centre = places.mean(0) + draw.rng.uniform(-0.25, 0.25, 2) * size
        mass = draw.number(0.2, 0.8)
        inertia = f"{mass * draw.number(0.1, 0.3) * size**2:.5g} kg*m^2"
        bodies[body] = {"mass": f"{mass} kg", "inertia": inertia, "center_of_mass": local(body, centre)}
    joints = {}
    placed, left = {GROUND}, list(graph.edges)
    while left:
        # The driven joint first: one that closes a loop cannot be driven.
        near = [e for e in left if e.one in placed or e.other in placed]
        edge = draw.one([e for e in near if e.name == graph.driven] or near)
        left.remove(edge)
        parent, child = (edge.one, edge.other) if edge.one in placed else (edge.other, edge.one)
        closes = child in placed
        placed.add(child)
        table = {"parent": parent, "child": child}
        table |= {"at_parent": local(parent, edge.at), "at_child": local(child, edge.at)}
        if edge.direction is None:
            start = {} if closes else {"position": f"{float(angles[child] - angles[parent])!r} rad"}
            joints[edge.name] = {"type": "revolute", **table, **start}
        else:
            # It slides along the frame of its body, wherever this is parent or child.
            angle = f"{edge.direction - angles[parent]!r} rad"
            start = {} if closes else {"position": "0 m"}
            joints[edge.name] = {"type": "prismatic", **table, **start, "angle": angle}
    points = {}
    for body in bodies:
        points[f"{body}_a"] = {"body": body}
        points[f"{body}_b"] = {"body": body, "at": [f"{draw.number(0.02, 0.1)} m", f"{draw.number(0.02, 0.1)} m"]}
    return {"body": bodies, "joint": joints, "point": points}
