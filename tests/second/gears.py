"""What acts along coordinates, by `docs/couplings.md` and `docs/backlash.md`: couplings of gears, drives that give way,
backlash and stops.

A `Form` is a place x = sum k q - o - A sin(n q_motor + p) of coordinates q, which are those of joints by their names,
and those of motors behind springs. The coordinate of such a joint is here the whole turn of the link, as a body knows
it; in a scene it is only by how much the link is ahead of its motor.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .laws import Normal
from .quantities import Vector, number

MOTOR, FAR = "{}_motor", 1e6


class Form(NamedTuple):
    """Factors of coordinates by their names, an offset, and the A, n, p and motor of a transmission error."""

    terms: dict[str, float]
    offset: float = 0.0
    wave: tuple[float, float, float] = (0.0, 0.0, 0.0)
    motor: str = ""


class Coupling(NamedTuple):
    """A form that is zero, or of backlash; the first name is that of the follower."""

    name: str
    form: Form
    slack: bool

    @property
    def follower(self) -> str:
        """The coordinate that follows."""
        return next(iter(self.form.terms))


class Flank(NamedTuple):
    """The law of a flank: pieces of T_e, each with its stiffness and the depth and effort at which it begins."""

    stiffness: Vector
    depths: Vector
    efforts: Vector
    cubic: float
    damping: float
    factor: float
    limited: bool

    def piece(self, d: Vector) -> Any:
        """Which piece a depth is in."""
        return np.searchsorted(self.depths[1:], d, side="right")

    def elastic(self, d: Vector, piece: Any) -> Vector:
        """T_e."""
        return self.efforts[piece] + self.stiffness[piece] * (d - self.depths[piece]) + self.cubic * d**3

    def energy(self, d: Vector) -> Vector:
        """What it stores."""
        before = np.append(0.0, np.cumsum(0.5 * (self.efforts[1:] + self.efforts[:-1]) * np.diff(self.depths)))
        p = self.piece(d)
        beyond = d - self.depths[p]
        inside = self.efforts[p] * beyond + 0.5 * self.stiffness[p] * beyond**2 + self.cubic * d**4 / 4
        return np.where(d > 0, before[p] + inside, 0.0)

    def effort(self, d: Vector, rate: Vector, piece: Any, held: Any) -> Vector:
        """Before it is cut off at zero; `held`: where the damper is held within the spring's effort."""
        spring = self.elastic(d, piece)
        return np.where(held, 2 * spring, spring + self.damping * rate + self.factor * rate * spring)


def flank(table: dict) -> Flank:
    """The law of a scene's table."""
    given = table["stiffness"]
    stiffness = np.array([number(k) for k in (given if isinstance(given, list) else [given])])
    efforts = np.array([0.0, *(number(effort) for effort in table.get("efforts", ()))])
    depths = np.append(0.0, np.cumsum(np.diff(efforts) / stiffness[:-1]))
    cubic, damping, factor = (number(table.get(key, 0.0)) for key in ("cubic", "damping", "damping_factor"))
    limited = table.get("limited", True) and not factor
    return Flank(stiffness, depths, efforts, cubic, damping, factor, limited)


class Along(NamedTuple):
    """What a gap does: its effort on its place, the amount of the flanks', what they absorb [W], and its place."""

    effort: float
    normal: float
    absorbed: float
    place: float
    rate: float
    depth: float
    rubbed: float = 0.0
    traction: Vector = np.zeros(3)


SIDES = np.array([1.0, -1.0])


class Loss(NamedTuple):
    """What the teeth of a gear take of the motor: a share of the effort that they pass on, against its speed."""

    share: float
    speed: float

    def effort(self, passed: float, rate: float) -> float:
        """The effort against a motor of that rate."""
        return self.share * abs(passed) * float(np.tanh(rate / self.speed))


class Gap(NamedTuple):
    """A contact of a place between two flanks, the upper one first; `springs`: or a spring about zero, without touch;
    `counts`: whether its energy is elastic energy, and not an actuator's work. Its regime is a number for each flank,
    0 or 1 + twice the piece of the spring, plus 1 where the damper is held.
    """

    name: str
    form: Form
    ends: Vector
    flank: Flank
    springs: bool = False
    counts: bool = True
    loss: Loss | None = None

    count: int = 2
    memories: int = 0
    friction: None = None
    normal: Normal = Normal(lambda *_: np.zeros(2), lambda d: d)

    @property
    def play(self) -> "Gap":
        """Itself, like the play of a joint."""
        return self

    def depths(self, pose, memory, speed):
        """Penetrations of both flanks, their rates, and the efforts before they are cut off."""
        place, rate = pose
        depth, rate = SIDES * (place - self.ends), SIDES * rate
        piece = self.flank.piece(np.abs(depth))
        return depth, rate, self.flank.effort(depth, rate, piece, self._held(depth, rate, piece))

    def _held(self, depth, rate, piece):
        return self.flank.limited & (not self.springs) & (self.flank.damping * rate > self.flank.elastic(depth, piece))

    def regime(self, pose, memory, speed):
        """Which flanks touch, and how they press."""
        depth, rate, force = self.depths(pose, memory, speed)
        piece = self.flank.piece(np.abs(depth))
        if self.springs:
            return np.zeros(2, bool), 1 + 2 * piece
        how = 1 + 2 * piece + self._held(depth, rate, piece)
        return depth > 0, np.where((depth > 0) & (force > 0), how, 0)

    def stored(self, pose) -> float:
        """Elastic energy [J]."""
        return float(self.flank.energy(SIDES * (pose[0] - self.ends)).sum()) if self.counts else 0.0

    def act(self, pose, memory, speed, touches, presses) -> Along:
        """Its effort in a regime."""
        depth, rate = SIDES * (pose[0] - self.ends), SIDES * pose[1]
        if self.springs:
            sign, piece = (1.0 if pose[0] >= 0 else -1.0), presses[:1] // 2
            damper = self.flank.damping * pose[1]
            effort = -sign * float(self.flank.elastic(np.abs(depth[:1]), piece)[0]) - damper
            absorbed = damper * pose[1] if not self.counts else -effort * pose[1]
            return Along(effort, abs(effort), absorbed, pose[0], pose[1], abs(pose[0]))
        code = np.maximum(presses - 1, 0)
        each = np.where(presses > 0, self.flank.effort(depth, rate, code // 2, code % 2 == 1), 0.0)
        return Along(-float(SIDES @ each), float(each.sum()), float(each @ rate), pose[0], pose[1], depth.max())


def couplings(scene: dict) -> tuple[Coupling, ...]:
    """The couplings of a scene."""
    out = []
    for name, table in scene.get("coupling", {}).items():
        follower, leaders = _relation(table)
        terms = {follower: 1.0, **{leader: -ratio for leader, ratio in leaders.items()}}
        out.append(Coupling(name, Form(terms, number(table.get("offset", 0.0))), "backlash" in table))
    return tuple(out)


def _relation(table: dict) -> tuple[str, dict[str, float]]:
    """The follower, and the ratios of its leaders."""
    kind = table.get("type", "linear")
    if kind in TRAINS:
        # Of a relation sum k q = 0 any one may be the follower.
        relation, usual = TRAINS[kind](table)
        follower = table.get("follower", usual)
        return follower, {name: -k / relation[follower] for name, k in relation.items() if name != follower}
    if kind == "linear":
        second = {table["second"]: number(table["second_ratio"])} if "second" in table else {}
        return table["follower"], {table["leader"]: number(table["ratio"]), **second}
    return table["follower"], {table["leader"]: RATIOS[kind](table)}


def _gear(table) -> float:
    leader, follower = table["teeth"]
    return (1 if table.get("internal", False) else -1) * leader / follower


def _belt(table) -> float:
    leader, follower = (number(radius) for radius in table["radii"])
    return (-1 if table.get("crossed", False) else 1) * leader / follower


RATIOS: dict[str, Callable[[dict], float]] = {
    "gear": _gear,
    "belt": _belt,
    "rack": lambda table: number(table["radius"]),
    "screw": lambda table: number(table["lead"]) / (2 * np.pi),
}


def _differential(table):
    return {table["cage"]: 1.0, table["left"]: -0.5, table["right"]: -0.5}, table["cage"]


def _planetary(table):
    sun, ring = table["teeth"]
    return {table["carrier"]: 1 + ring / sun, table["sun"]: -1.0, table["ring"]: -ring / sun}, table["carrier"]


TRAINS: dict[str, Callable[[dict], tuple[dict, str]]] = {"differential": _differential, "planetary": _planetary}


def gaps(scene: dict, every: tuple[Coupling, ...]) -> tuple[Gap, ...]:
    """The gaps of a scene: of couplings, of drives that give way, and of stops."""
    out = [
        Gap(one.name, one.form, _wide(scene["coupling"][one.name]), flank(scene["coupling"][one.name]))
        for one in every
        if one.slack
    ]
    for name, table in scene.get("compliance", {}).items():
        motor, waves, slack = MOTOR.format(name), "error" in table, "backlash" in table
        wave = tuple(number(table.get(key, 0.0)) for key in ("error", "error_order", "error_phase"))
        form = Form({name: 1.0, motor: -1.0}, 0.0, wave, motor)
        ends = _wide(table) if slack else np.zeros(2)
        loss = None
        if "efficiency" in table:
            loss = Loss(1 - number(table["efficiency"]), number(table.get("efficiency_speed", 0.01)))
        counts = slack or waves or loss is not None or "efforts" in table  # corners make a contact of it
        out.append(Gap(f"{name}_drive", form, ends, flank(table), not slack, counts, loss))
    for name, joint in scene["joint"].items():
        if "stops" in joint:
            table = joint["stops"]
            ends = np.array([number(table.get("upper", FAR)), number(table.get("lower", -FAR))])
            # The library counts its place from the middle, or from the only stop.
            middle = ends[np.abs(ends) < FAR].mean()
            out.append(Gap(f"{name}_stop", Form({name: 1.0}, middle), ends - middle, flank(table)))
    return tuple(out)


def _wide(table: dict) -> Vector:
    return 0.5 * number(table["backlash"]) * SIDES
