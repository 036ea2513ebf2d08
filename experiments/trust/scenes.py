"""The mechanisms on which gradient reports are judged: in the plane, worn, in space, and an arm."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.joints.bore import Modes
from experiments.common import SCENES

NAME = "play.radial_clearance"
PIN_MASS, PIN_RADIUS, STIFFNESS = 0.1, 0.01, 1e9
SECTORS, WEAR = 24, 1e-4
"""Sectors of a worn sleeve, and its depth at an amount of one [m]."""


class Numbers(NamedTuple):
    """A scene: clearance [m], amplitude [m, of the arm rad] and frequency [Hz] of the shaker, damping factor of the
    impacts [s/m], gravity [m/s^2], speed at the start [m/s, of the pendulums rad/s]; and the amount of wear of a worn
    sleeve, or the length of a sleeve in space [m].
    """

    clearance: float
    amplitude: float
    frequency: float
    damping: float
    gravity: float = 0.0
    speed: float = 0.05
    extra: float = 0.0


def scene(n: Numbers, law: Callable = laws.HuntCrossley) -> cj.Mechanism:
    """A pin on a guide, in a sleeve that is shaken along it."""
    play = cj.RevoluteClearance(n.clearance, PIN_RADIUS, law(STIFFNESS, n.damping))
    return cj.Mechanism(
        bodies=(cj.Body("sleeve", 1.0), cj.Body("pin", PIN_MASS)),
        joints=(_shaker(n, "sleeve"), cj.Prismatic("guide", "ground", "pin", motion=cj.Motion(None, 0.0, n.speed))),
        loops=(cj.Revolute("play", "sleeve", "pin", clearance=play),),
        gravity=cj.Gravity(x=-n.gravity),
        assemble=False,
    )


def worn(n: Numbers) -> cj.Mechanism:
    """A pendulum whose pin hangs in a shaken sleeve that is worn where the weight presses."""
    angles = 2 * np.pi * np.arange(SECTORS) / SECTORS
    shape = WEAR * np.maximum(0.0, -np.sin(angles)) ** 2
    modes = Modes(shape[None], np.ones(1) * n.extra)
    law = laws.HuntCrossley(STIFFNESS, n.damping)
    play = cj.RevoluteClearance(n.clearance, PIN_RADIUS, law, depth=np.zeros(SECTORS), modes=modes)
    return _pendulum(n, play, cj.Body("bob", 0.2, 5e-4, cj.Position(0.0, -0.05)))


def sleeve(n: Numbers) -> cj.Mechanism:
    """A pendulum in space, whose weight tilts its pin in a shaken sleeve."""
    play = cj.SleeveClearance(n.clearance, PIN_RADIUS, n.extra, laws.HuntCrossley(STIFFNESS, n.damping), stations=2)
    return _pendulum(n, play, cj.Body("bob", 0.2, cj.Inertia(5e-4, 5e-4, 5e-4), cj.Position(0.0, -0.05, 0.01)))


def arm(n: Numbers) -> cj.Mechanism:
    """An arm of two axes from a URDF file, with a sleeve in its elbow. Its shoulder swings."""
    robot = cj.load_urdf(SCENES / "two_axes.urdf", end_effector="tool")
    robot = robot.with_drives({"shoulder": cj.drives.Harmonic(0.1, 10.0), "play": cj.drives.Constant(0.5)})
    law = laws.HuntCrossley(STIFFNESS, 1.0)
    robot = robot.with_clearance("play", cj.SleeveClearance(1e-4, PIN_RADIUS, 0.03, law, stations=2))
    numbers = {
        NAME: n.clearance,
        "drive.shoulder.amplitude": n.amplitude,
        "drive.shoulder.angular_frequency": 2 * np.pi * n.frequency,
        "play.normal.damping_factor": n.damping,
        "play.length": n.extra,
        "drive.play.value": n.speed,
    }
    return cj.replace(robot, numbers)


def _shaker(n: Numbers, child: str) -> cj.Prismatic:
    shaking = cj.drives.Harmonic(n.amplitude, 2 * np.pi * n.frequency)
    return cj.Prismatic("shaker", "ground", child, motion=cj.Motion(shaking))


def _pendulum(n: Numbers, play: Any, bob: cj.Body) -> cj.Mechanism:
    hinge = cj.Revolute("play", "base", "bob", clearance=play, motion=cj.Motion(None, 0.0, n.speed))
    return cj.Mechanism(
        bodies=(cj.Body("base", 1.0), bob),
        joints=(_shaker(n, "base"), hinge),
        points=(cj.Point("tip", "bob", cj.Position(0.0, -0.1)),),
        gravity=cj.Gravity(y=-n.gravity),
    )


def place(solution):
    """The pin's position at the end [m]."""
    return solution.state("guide")


def tip(solution):
    """How far the pendulum's tip is aside at the end [m]."""
    return solution["tip.position"][0]


def tool(solution):
    """How high the tool is at the end [m]."""
    return solution["tool.position"][2]


FORCE = metrics.Peak(metrics.ContactForce("play"))


class Family(NamedTuple):
    """Scenes of one structure: how they are made, what is asked of them, and the parameters by which, with the columns
    of `Numbers` that they are.
    """

    scene: Callable[[Numbers], cj.Mechanism]
    metrics: dict[str, Any]
    parameters: dict[str, int]
    asked: tuple[tuple[str, str], ...]
    """Pairs of metric and parameter, in turn."""


CLEARANCE, AMPLITUDE, EXTRA = (Numbers._fields.index(name) for name in ("clearance", "amplitude", "extra"))
SHAKE, AMOUNT, LENGTH = "drive.shaker.amplitude", "play.modes.amounts.0", "play.length"
FAMILIES = {
    "plane": Family(
        scene,
        {"place": place, "peak force": FORCE},
        {NAME: CLEARANCE, SHAKE: AMPLITUDE},
        (("place", NAME), ("peak force", NAME), ("place", SHAKE)),
    ),
    "worn": Family(
        worn,
        {"place": tip, "peak force": FORCE},
        {NAME: CLEARANCE, AMOUNT: EXTRA},
        (("place", NAME), ("peak force", AMOUNT), ("place", AMOUNT)),
    ),
    "sleeve": Family(
        sleeve,
        {"place": tip, "peak force": FORCE},
        {NAME: CLEARANCE, LENGTH: EXTRA},
        (("place", NAME), ("peak force", NAME), ("place", LENGTH)),
    ),
    "arm": Family(arm, {"place": tool}, {NAME: CLEARANCE}, (("place", NAME),)),
}


def random_scenes(
    rng: np.random.Generator, count: int, damping: tuple[float, float], family: str = "plane"
) -> list[Numbers]:
    """Scenes of a family of all sizes; damping factors between the given ones, evenly in the logarithm."""

    def one() -> Numbers:
        factor = np.exp(rng.uniform(*np.log(damping)))
        clearance = rng.uniform(0.5e-3, 2e-3) if family == "plane" else rng.uniform(2e-4, 1e-3)
        if family == "arm":
            swing = rng.uniform(0.05, 0.3), rng.uniform(3.0, 8.0)
            return Numbers(clearance, *swing, factor, 9.81, rng.uniform(0.2, 1.2), rng.uniform(0.02, 0.04))
        shake = clearance * rng.uniform(0.5, 2.0), rng.uniform(15, 30)
        if family == "plane":
            return Numbers(clearance, *shake, factor, rng.choice([0.0, 9.81]), rng.uniform(-0.1, 0.1))
        extra = rng.uniform(0.5, 5.0) if family == "worn" else rng.uniform(0.02, 0.05)
        return Numbers(clearance, *shake, factor, 9.81, rng.uniform(-5.0, 5.0), extra)

    return [one() for _ in range(count)]
