"""The paper's outlook: error compensation, and what the trajectory does to the motion.

Compensation. A model of the robot predicts how far play takes the end from where the drives want it; averaged over
some periods of the pin's swinging in its sleeve, this error is taken off the drives (by the pseudo-inverse of the
ideal robot's Jacobian), and that again for what is left. The robot that is then driven is the model itself, or one
whose clearance the model has wrong.

Trajectory. The durations of the drive's three segments are parameters: derivatives of what is asked of the motion by
them, from one solve, beside central differences of further solves; and where the gradient leads.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.mechanism.motion.motion_laws import DriveSum
from experiments.paper.runs import (
    BEGIN,
    CLEARANCE,
    END,
    FRICTION,
    FRICTIONS,
    JOINT,
    PLANE,
    POINT,
    SIZES,
    SPACE,
    drive,
    ideal,
    motion,
    scene,
)
from experiments.paper.statistics import Signal, mean, rms, size, within

IN_PLANE = ("shoulder", "elbow", "telescope", JOINT)
DRIVEN = {"joint 5": (JOINT,), "all in the arm's plane": IN_PLANE, "these and yaw": ("yaw", *IN_PLANE)}
KNOTS = 16
"""Of a correction: one every 100 ms, several periods of the pin's swinging in its sleeve."""
NUDGE = 1e-4
"""Of a drive [rad, m], for the ideal robot's Jacobian by central differences."""
START_UP = 0.15
"""What is left out of account [s]: no drive undoes the pin's fall at the start."""
WRONG = 0.8
"""Part of the true clearance that a model reckons with that has it wrong."""


# Compensation ---------------------------------------------------------------------------------------------------------


class Left(NamedTuple):
    """Error of the end after so many corrections, from the start-up on [s, m]: over time, its RMS, and the RMS of what
    the drives can reach.
    """

    rounds: int
    time: Signal
    error: Signal
    rms: float
    reachable: float


class Compensation(NamedTuple):
    """What corrections of some drives leave of the error; `known`: whether the model has the clearance right."""

    world: str
    drives: str
    known: bool
    left: list[Left]

    @property
    def gone(self) -> list[tuple[float, float]]:
        """Part of either error that each number of corrections takes away."""
        first = self.left[0]
        return [(1 - one.rms / first.rms, 1 - one.reachable / first.reachable) for one in self.left]


def corrected(mechanism: cj.Mechanism, knots: Signal, corrections: dict[str, Signal]) -> cj.Mechanism:
    """The robot with a spline through its corrections added to each drive."""
    own = {c.name: c.motion.drive for c in mechanism.coordinates() if c.name in corrections}
    return mechanism.with_drives(
        {name: DriveSum((own[name], cj.drives.Spline(knots, corrections[name]))) for name in own}
    )


def jacobian(mechanism: cj.Mechanism, times: Signal, names: Sequence[str]) -> Signal:
    """Place of the ideal robot's end by its drives at the times, shape (times, axes, drives)."""
    knots = np.linspace(times[0], times[-1], KNOTS)
    nothing = {name: np.zeros(KNOTS) for name in names}

    def moved(name: str, by: float) -> Signal:
        robot = corrected(mechanism, knots, nothing | {name: np.full(KNOTS, by)})
        return ideal(robot, times)["position"].sel(point=POINT).values

    return np.stack([(moved(name, NUDGE) - moved(name, -NUDGE)) / (2 * NUDGE) for name in names], axis=-1)


def averaged(time: Signal, error: Signal, knots: Signal) -> Signal:
    """A vector's average over the knots' spacing, centred at each knot."""
    half = (knots[1] - knots[0]) / 2
    out = []
    for knot in knots:
        near = within(time, knot - half, knot + half)
        out.append([mean(time[near], column[near]) for column in error.T])
    return np.array(out)


def compensated(world: str, drives: str, known: bool = True, rounds: int = 2) -> Compensation:
    """Correct the drives by the error that a model predicts, over and over, and see what is left of the robot's."""
    robot = cj.replace(scene(world), {FRICTION: FRICTIONS[1]})
    model = robot if known else cj.replace(robot, {CLEARANCE: WRONG * SIZES[0]})
    t1, names = float(drive("Velocity_1")[END][-1]), DRIVEN[drives]
    knots = np.linspace(0, t1, KNOTS)
    inverse = np.linalg.pinv(jacobian(robot, knots, names))
    corrections = {name: np.zeros(KNOTS) for name in names}
    left = []
    for done in range(rounds + 1):
        actual = error_of(corrected(robot, knots, corrections), robot, t1)
        time, error = (x[actual[0] > START_UP] for x in actual)
        by_drives = jacobian(robot, time, names)
        reached = np.einsum("tad,tdb,tb->ta", by_drives, np.linalg.pinv(by_drives), error)
        left.append(Left(done, time, size(error), rms(time, size(error)), rms(time, size(reached))))
        predicted = actual if known else error_of(corrected(model, knots, corrections), model, t1)
        steps = np.einsum("kdx,kx->kd", inverse, averaged(*predicted, knots))
        corrections = {name: corrections[name] - step for name, step in zip(names, steps.T, strict=True)}
    return Compensation(world, drives, known, left)


def error_of(driven: cj.Mechanism, wanted: cj.Mechanism, t1: float) -> tuple[Signal, Signal]:
    """Times, and how far the end is from where the drives as they were want it, shape (times, axes)."""
    found = motion(driven, t1)
    return found.time, found.position - ideal(wanted, found.time)["position"].sel(point=POINT).values


def compensations(quick: bool) -> list[Compensation]:
    cases = [(PLANE, "joint 5", True), (PLANE, "joint 5", False)]
    if not quick:
        cases += [(SPACE, drives, known) for drives in DRIVEN for known in (True, False)]
    return [compensated(*case) for case in cases]


# Trajectory -----------------------------------------------------------------------------------------------------------

DURATIONS = np.array([0.5, 0.5, 0.5])
HORIZON = 1.6
"""Until when motions are looked at [s], whatever their segments last."""
DIFFERENCE = 1e-5
"""By which durations differ for central differences [s]."""
DERIVED_RTOL, CHECKED_RTOL = 1e-8, 1e-10
MOVED = 0.002
"""By how much the durations are changed along the gradient [s]; their sum stays."""


def asked() -> dict[str, tuple[str, float, cj.metrics.AbstractMetric]]:
    """What is asked of the motion: by its name the unit, its size in SI, and the metric."""
    force, since = cj.metrics.ContactForce(JOINT), START_UP
    return {
        "peak contact force": ("N", 1.0, cj.metrics.Peak(force)),
        "the same after the start-up": ("N", 1.0, cj.metrics.Peak(force, since=since)),
        "RMS acceleration of the end": ("m/s²", 1.0, cj.metrics.Rms(cj.metrics.Acceleration(POINT), since=since)),
        "RMS error of the end": ("µm", 1e-6, cj.metrics.Rms(cj.metrics.PositionError(POINT), since=since)),
    }


class Influence(NamedTuple):
    """What is asked, its value and derivatives by the three durations, these by central differences; and what a change
    of the durations along the gradient, their sum kept, is predicted to do to the value and does.
    """

    asked: str
    unit: str
    value: float
    derivatives: Signal
    differences: Signal
    predicted: float
    found: float

    @property
    def error(self) -> float:
        """Of the derivatives against the differences, relative to the largest."""
        return float(np.max(np.abs(self.derivatives - self.differences)) / np.max(np.abs(self.differences)))


def influences(quick: bool) -> list[Influence]:
    """What the segments' durations do to the motion in the plane."""
    robot = cj.replace(scene(PLANE), {FRICTION: FRICTIONS[1]})
    chosen = dict(list(asked().items())[: 1 if quick else None])
    metrics = {name: metric for name, (*_, metric) in chosen.items()}
    sizes = jnp.array([unit for _, unit, _ in chosen.values()])

    @jax.jit
    def of(durations, rtol):
        end = jnp.cumsum(durations)
        begin = jnp.concatenate([jnp.zeros(1), end[:-1]])
        found = cj.measure(cj.replace(robot, {BEGIN: begin, END: end}), metrics, HORIZON, rtol=rtol)
        return jnp.stack([found[name] for name in metrics]) / sizes

    slopes = np.asarray(jax.jit(jax.jacfwd(of))(jnp.asarray(DURATIONS), DERIVED_RTOL))

    def at(durations: Signal) -> Signal:
        return np.asarray(of(jnp.asarray(durations), CHECKED_RTOL))

    steps = DIFFERENCE * np.eye(3)
    differences = np.stack([(at(DURATIONS + d) - at(DURATIONS - d)) / (2 * DIFFERENCE) for d in steps], axis=1)
    base, out = at(DURATIONS), []
    for i, (name, (unit, *_)) in enumerate(chosen.items()):
        down = np.mean(slopes[i]) - slopes[i]
        change = MOVED * down / size(down)
        moved = float(at(DURATIONS + change)[i])
        predicted = float(base[i] + slopes[i] @ change)
        out.append(Influence(name, unit, float(base[i]), slopes[i], differences[i], predicted, moved))
    return out
