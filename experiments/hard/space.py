"""A pin in one sleeve in space. Reference: Newton's and Euler's laws of a free body, every switching located; with
friction the library's own solve at a thousandth of the tolerance ("own").
"""

from typing import Any

import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.hard.amplification import amplified
from experiments.hard.case import RTOLS, Row, compared, options
from experiments.reference.sleeve import Sleeve, play, problem_of

RADIUS = 0.01
PLAY = ("play_x", "play_y", "play_z", "tilt_x", "tilt_y")
BODY = Sleeve(
    mass=0.5,
    moments=(4e-4, 5e-4, 2e-4),
    height=0.05,
    force=(3.0, 2.0, -20.0),
    torque=(1.0, 0.3, 0.0),
    stiffness=1e9,
    damping=0.5,
    radial=1e-4,
    axial=5e-5,
    length=0.04,
    collar=0.015,
    through=True,
)


def mechanism(scene: Sleeve, friction: Any = None) -> cj.Mechanism:
    """The same in the library: the body turns freely about its pin."""
    clearance = cj.SleeveClearance(
        scene.radial,
        RADIUS,
        scene.length,
        laws.HuntCrossley(scene.stiffness, scene.damping),
        friction,
        axial_clearance=scene.axial,
        collar_radius=scene.collar,
        stations=scene.stations,
        ring=scene.ring,
        pin="through" if scene.through else "inside",
    )
    centre = cj.Position(0.0, 0.0, -scene.height)
    body = cj.Body("body", scene.mass, cj.Inertia(*scene.moments), centre)
    load = cj.Wrench("load", "body", centre, cj.Force(*scene.force), cj.Torque(*scene.torque))
    return cj.Mechanism((body,), (cj.Revolute("joint", "ground", "body", clearance=clearance),), wrenches=(load,))


def places(m: cj.Mechanism, y: np.ndarray) -> np.ndarray:
    """Pin's centre and axis across, (samples, 5), from the library's states."""
    names = [c.name for c in m.free_coordinates()]
    x, z, along, about_x, about_y = (y[:, names.index(f"joint.{name}")] for name in PLAY)
    # The tilts a and b turn by 2 atan |g| about g = (a, b, 0) / 2.
    share = 1 / (1 + (about_x**2 + about_y**2) / 4)
    return np.stack([x, z, along, share * about_y, -share * about_x], -1)


def patterns(m: cj.Mechanism, end: float) -> dict[int, float]:
    """In which share of the samples each pattern of contact is seen."""
    seen = cj.to_dataset(m, cj.simulate(m, end, save_at=401, rtol=1e-8))["contact_pattern"].values
    return {int(k): float(np.mean(seen == k)) for k in np.unique(seen)}


def in_words(shares: dict[int, float]) -> str:
    words = {0: "nowhere", 1: "an edge", 2: "a line", 3: "opposite edges"}
    return ", ".join(f"{words[k % 4]}{' and a face' if k > 3 else ''} {share:.0%}" for k, share in shares.items())


def located(case: str, scene: Sleeve, end: float, needed: tuple[int, ...] = ()) -> Row:
    """`needed`: patterns of contact that must be seen."""
    t = np.linspace(0, end, 101)
    start = np.zeros(13)
    start[2], start[3] = -scene.height, 1.0
    fast = float(np.sqrt(scene.radial * np.linalg.norm(scene.force) / scene.mass))
    tilt = 2 * scene.radial / scene.length
    scale = np.concatenate([np.full(3, scene.radial), np.full(4, tilt), np.full(3, fast), np.full(3, fast / 0.01)])
    units = scale.copy()
    units[3:7] = 0.0

    def see(y):
        return play(y, scene.height)

    truth, amplification = amplified(problem_of(start, scale, 1e-5), t, scene.parameters(), units, see)
    m = mechanism(scene)
    shares = patterns(m, end)
    checks = [(f"pattern {k} is not seen", k in shares) for k in needed]
    said = f"{len(truth.switchings)} switchings; touches {in_words(shares)}; error of places"
    return compared(case, m, t, see(truth.y), lambda y: places(m, y), said, amplification=amplification, checks=checks)


def both_edges(quick: bool) -> Row:
    return located("a sleeve tilted to both edges, on its face", BODY, 2e-3 if quick else 12e-3, () if quick else (7,))


def long_pin(quick: bool) -> Row:
    """Its centre is well outside of the sleeve's middle: it slides far along."""
    scene = BODY._replace(axial=5e-3, force=(5.0, 1.0, -30.0), torque=(0.05, 0.2, 0.0))
    return located("a pin longer than its guide slides", scene, 4e-3 if quick else 12e-3)


def short_pin(quick: bool) -> Row:
    return located("a pin inside its sleeve, tilted", BODY._replace(through=False), 2e-3 if quick else 12e-3)


def rubbing(quick: bool) -> Row:
    end = 2e-3 if quick else 12e-3
    m = mechanism(BODY, laws.TanhCoulomb(0.2, 0.01))
    t = np.linspace(0, end, 101)
    tight = options(1e-3 * RTOLS[-1])
    truth = np.asarray(cj.simulate(m, end, save_at=t, **tight).y)
    said = f"own reference; touches {in_words(patterns(m, end))}"
    half = 2 * len(m.free_coordinates())
    return compared("opposite edges with friction", m, t, truth[:, :half], lambda y: y[:, :half], said)


CASES = (both_edges, long_pin, short_pin, rubbing)
