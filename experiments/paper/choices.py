"""Which modelling choices matter: each is varied alone, and ranked by how far it moves what is seen of the motion.

The base is the literal reading: Table 1's K, Eq. 7's damping, 0.1 mm radial, the pin in the middle of the sleeve, no
friction, Velocity_1. Some choices are the paper's own, its contradictions and slips among them; the others fill in what
it does not say.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from experiments.paper import statistics as of
from experiments.paper.runs import (
    DAMPING,
    DIAMETRAL,
    END,
    FRICTION,
    JOINT,
    PLANE,
    RTOL,
    SPACE,
    STIFFNESS,
    TABLE1,
    Motion,
    Reading,
    drive,
    motion,
    scene,
    solved,
)

MODULUS = 1 / ((1 - 0.3**2) / 2.01e11 + (1 - 0.3**2) / 2.06e11)
"""E* of Table 1's materials [Pa]."""
PIN, SLEEVE = 25e-3, 25.05e-3
"""Radii of Table 1 [m]."""
EXTERNAL = 4 / 3 * MODULUS * np.sqrt(PIN * SLEEVE / (PIN + SLEEVE))
INTERNAL = 4 / 3 * MODULUS * np.sqrt(PIN * SLEEVE / (SLEEVE - PIN))
"""Hertz's K = (4/3) E* sqrt(R) [N/m^1.5], R of a pin beside a pin as in Table 1, and of a pin inside a sleeve."""
LONGER = 353.23e-3 - 176.62e-3
"""By how much the arm is longer if the printed peak speed is that of Velocity_2 [m]."""
REST = 1.0
"""How long a pin is given to come to rest [s]."""
MASS = {PLANE: "payload.mass", SPACE: "cutter.mass"}
ARM = {PLANE: ("payload.center_of_mass.x", "end.at.x"), SPACE: ("grip.at_parent.x",)}


class Choice(NamedTuple):
    """What is varied, whether it is the paper's own (or what it does not say), and the motion of a scene with it."""

    name: str
    own: bool
    motion: Callable[[str], Motion]


class Effect(NamedTuple):
    """What a choice does in a scene: each number of `SEEN` over that of the base."""

    choice: Choice
    world: str
    ratios: dict[str, float]

    @property
    def size(self) -> float:
        """Geometric mean of the factors by which the choice moves the numbers, up or down."""
        return float(np.exp(np.mean(np.abs(np.log(list(self.ratios.values()))))))


SEEN: dict[str, Callable[[Motion], float]] = {
    "peak force": lambda m: float(m.peaks.max()),
    "peak acceleration": lambda m: of.peak(of.size(m.acceleration)),
    "RMS of fluctuation": lambda m: of.rms(m.time, m.fluctuation),
    "largest deviation": lambda m: of.peak(m.deviation),
    "touches": lambda m: float(m.starts.size),
}


def number(world: str, name: str) -> float:
    return float(cj.parameters(scene(world))[name].value)


def last() -> float:
    """When Velocity_1 ends [s]."""
    return float(drive("Velocity_1")[END][-1])


def changed(numbers: Callable[[str], dict[str, Any]]) -> Callable[[str], Motion]:
    """The motion of a scene with other numbers."""
    return lambda world: motion(cj.replace(scene(world), numbers(world)), last())


def rested(world: str) -> Motion:
    """The motion of a scene whose pin has come to rest on the sleeve before the drive begins."""
    waiting = cj.replace(scene(world), {name: times + REST for name, times in drive("Velocity_1").items()})
    still = cj.simulate(waiting, REST, rtol=RTOL)
    return motion(scene(world), last(), y0=still.final)


def stiffened(value: float) -> Callable[[str], Motion]:
    """With another K; c_max stays 0.1 % of K in mm and N: 1e-3 (1e-3)^1.5 K N s/mm, that is K 1e-4.5 N s/m."""
    return changed(lambda world: {STIFFNESS: value, DAMPING: value / 1000**1.5})


def scaled(names: Callable[[str], tuple[str, ...]], factor: float) -> Callable[[str], Motion]:
    return changed(lambda world: {name: factor * number(world, name) for name in names(world)})


CHOICES = (
    Choice("damping of Table 1 instead of Eq. 7", True, lambda world: solved(Reading(world, TABLE1))),
    Choice("clearance diametral", True, lambda world: solved(Reading(world, clearance=DIAMETRAL))),
    Choice("K with its root, R of Table 1", True, stiffened(EXTERNAL)),
    Choice("K with its root, R of a pin in a sleeve", True, stiffened(INTERNAL)),
    Choice("the pin lies in the sleeve at the start", True, rested),
    Choice("c_max 1 % of K", False, scaled(lambda world: (DAMPING,), 10.0)),
    Choice("friction coefficient 0.3", False, changed(lambda world: {FRICTION: 0.3})),
    Choice("half the payload", False, scaled(lambda world: (MASS[world],), 0.5)),
    Choice("twice the payload", False, scaled(lambda world: (MASS[world],), 2.0)),
    Choice(
        "an arm of 353 mm", False, changed(lambda world: {name: number(world, name) + LONGER for name in ARM[world]})
    ),
    Choice("the arm starts hanging down", False, changed(lambda world: {f"drive.{JOINT}.offset": -np.pi / 2})),
)


def effects(world: str, choices: tuple[Choice, ...] = CHOICES) -> list[Effect]:
    """What each choice does in a scene, the one that moves most first."""
    base = {name: seen(solved(Reading(world))) for name, seen in SEEN.items()}
    found = []
    for choice in choices:
        m = choice.motion(world)
        found.append(Effect(choice, world, {name: seen(m) / base[name] for name, seen in SEEN.items()}))
    return sorted(found, key=lambda effect: effect.size, reverse=True)
