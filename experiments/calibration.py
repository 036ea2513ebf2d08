"""Calibrations of a pendulum on a pin: `python -m experiments.calibration` writes out/calibration.md.

The data are made by a simulation that shares no code with the library (`experiments/reference/pendulum.py`): an arm of
0.4 m falls from the horizontal on a pin with play, and 201 places of its tip, x and y, are read in 0.3 s with a noise
of 20 um. The play and the friction are then looked for, from 50 um and 0.1, within 10 um to 1 mm and 0 to 0.5, with all
options as they are by default. The bounces of the pin make minima beside the right one.

Each row has calibrations with different noise. An interval of 95 % that is right holds the truth in 95 of 100 on
average, and in 90 at least with a probability of 99 %. A miss is silent if there is no note but that on the ends of the
intervals. In the last row the model is wrong: it has ten times the transition speed of the friction that the data have.
No interval can be right there, and what counts is that every answer says so.
"""

import functools
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import output, table
from experiments.publish import command
from experiments.reference.pendulum import Pendulum

PLAY, FRICTION = "hip.radial_clearance", "hip.friction.coefficient"
BOUNDS = {PLAY: (1e-5, 1e-3), FRICTION: (0.0, 0.5)}
TIMES, NOISE = np.linspace(0.0, 0.3, 201), 2e-5
TRUTHS = (Pendulum(1.2e-4, 0.17), Pendulum(3e-4, 0.1))
WRONG, FACTOR = Pendulum(1.2e-4, 0.17), 10.0
SEEDS, SEEDS_WRONG = 100, 10
# Of these a search over all of the time at once, from one start, ends far from the truth.
QUICK = (5, 6)


class Coverage(NamedTuple):
    """How many of `seeds` calibrations have intervals of the play and of the friction that hold the truth; how many
    miss one in silence; how many say that the model may be wrong; motions and CPU time [s] of each.
    """

    seeds: int
    play: int
    friction: int
    silent: int
    doubted: int
    motions: float
    seconds: float


def model(truth: Pendulum, play: float = 5e-5, friction: float = 0.1, speed: float = 1.0) -> cj.Mechanism:
    """The pendulum as the search begins, its transition speed by a factor `speed` too large."""
    sleeve = cj.RevoluteClearance(
        play,
        truth.pin_radius,
        laws.HuntCrossley(truth.stiffness, truth.damping_factor),
        laws.TanhCoulomb(friction, speed * truth.transition_speed),
    )
    return cj.Mechanism(
        bodies=(cj.Body("arm", truth.mass, truth.inertia, cj.Position(truth.centre, 0.0)),),
        joints=(cj.Revolute("hip", "ground", "arm", clearance=sleeve, motion=cj.Motion(position=0.0, velocity=0.0)),),
        points=(cj.Point("tip", "arm", cj.Position(truth.tip, 0.0)),),
        gravity=cj.Gravity(y=-truth.gravity),
    )


@functools.cache
def moved(truth: Pendulum, times: tuple[float, ...]) -> np.ndarray:
    """Where its tip is."""
    return truth.tip_at(np.array(times))


def measured(truth: Pendulum, seed: int, times: np.ndarray = TIMES) -> xr.Dataset:
    """What was read of its tip."""
    read = moved(truth, tuple(times)) + NOISE * np.random.default_rng(seed).standard_normal((len(times), 2))
    names = ("tip.position.x", "tip.position.y")
    return xr.Dataset({name: ("time", column) for name, column in zip(names, read.T, strict=True)}, {"time": times})


def covered(truth: Pendulum, seeds: Sequence[int], speed: float = 1.0) -> Coverage:
    """Calibrations of one truth."""
    start, held, silent, doubted, motions, began = model(truth, speed=speed), [], 0, 0, 0, time.process_time()
    for seed in seeds:
        found: Any = cj.calibrate(start, measured(truth, seed), BOUNDS)
        (low, high), (least, most) = found.intervals[PLAY], found.intervals[FRICTION]
        held.append((low <= truth.play <= high, least <= truth.friction <= most))
        doubts = [note for note in found.notes if "At the ends of the intervals" not in note]
        silent += not all(held[-1]) and not doubts
        doubted += any("the model" in note for note in doubts)
        motions += found.motions
        print(seed, found.values, held[-1], found.motions, flush=True)
    play, friction = (int(count) for count in np.sum(held, axis=0))
    took, count = time.process_time() - began, len(seeds)
    return Coverage(count, play, friction, silent, doubted, motions / count, took / count)


def main(quick: bool = False) -> list[Coverage]:
    """Write the table."""
    cj.configure(cache=True)
    seeds = QUICK if quick else range(SEEDS)
    found = [covered(truth, seeds) for truth in TRUTHS[: 1 if quick else None]]
    found.append(covered(WRONG, range(1 if quick else SEEDS_WRONG), FACTOR))
    names = [f"{1e6 * one.play:.0f} um, {one.friction}" for one in TRUTHS[: len(found) - 1]]
    rows = [
        (name, one.seeds, one.play, one.friction, one.silent, one.doubted, f"{one.motions:.0f}", f"{one.seconds:.2g}")
        for name, one in zip([*names, "wrong model"], found, strict=True)
    ]
    head = ("truth", "calibrations", "play held", "friction held", "silent misses", "say that the model may be wrong")
    head += ("motions each", "CPU time each, s, with compiling")
    table(head, rows, output(f"calibration{'_quick' if quick else ''}.md"))
    return found


if __name__ == "__main__":
    command(main, __doc__)
