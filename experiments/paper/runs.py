"""The paper's joint 5 solved: in the plane and in space, in every reading of what the paper prints.

The paper contradicts itself in what every run depends on, so there are four readings of it, in either scene:

- damping: its Eq. 7 (ADAMS IMPACT, c_max = 0.1 % of K) or its Table 1 (D = 1.543e6 d^1.5 / d'0 with the approach speed
  d'0 at touch: the law of Lankarani and Nikravesh with a = 0.6204, for which e = 0.4157);
- clearance: "0.1 mm" is radial, as Eq. 1 defines it, or diametral, as the radii 25 mm and 25.05 mm in Table 1 have it.

And the last step of Velocity_4 ends at 8 s, where the other drives would lead one to expect 9 s.

A scene's numbers are arrays of its compiled program: all runs of a scene with one law are one program.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import SCENES
from experiments.paper.statistics import Signal, size

PLANE, SPACE = "plane", "space"
EQ7, TABLE1 = "Eq. 7", "Table 1"
RADIAL, DIAMETRAL = "radial", "diametral"
FILES = {PLANE: "joint5_velocity_1.toml", SPACE: "tool_changer.toml"}
JOINT, POINT = "joint5", "end"
CLEARANCE, FRICTION = f"{JOINT}.radial_clearance", f"{JOINT}.friction.coefficient"
STIFFNESS, DAMPING = f"{JOINT}.normal.stiffness", f"{JOINT}.normal.damping"
BEGIN, END = f"drive.{JOINT}.begin", f"drive.{JOINT}.end"

SIZES = (1e-4, 2e-4, 1e-3)
"""Clearances of the paper's Fig. 7, as printed [m]."""
SPEEDS = ("Velocity_1", "Velocity_2", "Velocity_3", "Velocity_4")
LATE = "9 s"
"""When the last step of Velocity_4 ends if it is as long as those before it."""
FRICTIONS = (0.0, 0.3, 0.5)
TABLE1_RATIO = 1.543e6 / 2.487e6
"""D / K of Table 1, of which D holds d^1.5 / d'0."""

RTOL = 1e-6
SAMPLES = 15001


class Reading(NamedTuple):
    """In which scene, what the paper is taken to say, and how accurately it is solved."""

    world: str = PLANE
    damping: str = EQ7
    clearance: str = RADIAL
    last: str = "8 s"
    rtol: float = RTOL


class Condition(NamedTuple):
    """What the paper varies: clearance as printed [m], the drive of its Table 2, coefficient of friction."""

    clearance: float = SIZES[0]
    speed: str = SPEEDS[0]
    friction: float = 0.0


class Motion(NamedTuple):
    """A solved motion, sampled evenly and at every step end, and the same of the robot without play [SI].

    `pattern` is None in the plane; `starts`, `ends` (NaN: contact goes on), `peaks` and `impact_speeds` have one entry
    an episode of contact, `steps` is the number of integration steps.
    """

    time: Signal
    position: Signal
    velocity: Signal
    acceleration: Signal
    ideal_position: Signal
    ideal_velocity: Signal
    ideal_acceleration: Signal
    eccentricity: Signal
    force: Signal
    friction_loss: Signal
    damping_loss: Signal
    pattern: Signal | None
    starts: Signal
    ends: Signal
    peaks: Signal
    impact_speeds: Signal
    turned: float
    steps: int
    energy_residual: float

    @property
    def speed(self) -> Signal:
        return size(self.velocity)

    @property
    def fluctuation(self) -> Signal:
        """Speed of the end beyond that of the ideal robot."""
        return self.speed - size(self.ideal_velocity)

    @property
    def shaking(self) -> Signal:
        """Magnitude of the difference of the end's acceleration from the ideal robot's."""
        return size(self.acceleration - self.ideal_acceleration)

    @property
    def deviation(self) -> Signal:
        """Distance of the end from where the ideal robot has it."""
        return size(self.position - self.ideal_position)


@functools.cache
def scene(world: str, damping: str = EQ7) -> cj.Mechanism:
    """The mechanism of a scene without friction, with the normal law of a reading."""
    mechanism = cj.replace(cj.load(SCENES / FILES[world]), {FRICTION: 0.0})
    return mechanism if damping == EQ7 else with_normal(mechanism, table1_law(stiffness(mechanism)))


def stiffness(mechanism: cj.Mechanism) -> Any:
    return cj.parameters(mechanism)[STIFFNESS].value


def table1_law(stiffness: Any, ratio: float = TABLE1_RATIO) -> Any:
    """Lankarani and Nikravesh's law that has the damping ratio a = D / K: a = 3 (1 - e^2) / 4."""
    return laws.lankarani_nikravesh(stiffness, np.sqrt(1 - 4 * ratio / 3))


def with_normal(mechanism: cj.Mechanism, law: Any) -> cj.Mechanism:
    """The same mechanism with another normal law in joint 5."""
    return mechanism.with_clearance(JOINT, eqx.tree_at(lambda c: c.normal, mechanism.joint(JOINT).clearance, law))


@functools.cache
def drive(speed: str, last: str = "8 s") -> dict[str, Signal]:
    """The numbers of a drive of the paper's Table 2; `last` is when Velocity_4 ends."""
    number = SPEEDS.index(speed) + 1
    found = cj.parameters(cj.load(SCENES / f"joint5_velocity_{number}.toml"))
    begin, end = (np.array(found[name].value) for name in (BEGIN, END))
    if last == LATE and speed == SPEEDS[-1]:
        end[-1] = end[-2] + (end[-2] - begin[-2])
    return {BEGIN: begin, END: end}


def numbers(reading: Reading, condition: Condition) -> dict[str, Any]:
    """What a condition sets in a scene."""
    half = 0.5 if reading.clearance == DIAMETRAL else 1.0
    return {CLEARANCE: half * condition.clearance, FRICTION: condition.friction, **drive(condition.speed, reading.last)}


@functools.lru_cache(maxsize=32)
def solved(reading: Reading, condition: Condition = Condition()) -> Motion:
    """The motion of a reading under a condition."""
    mechanism = cj.replace(scene(reading.world, reading.damping), numbers(reading, condition))
    return motion(mechanism, float(drive(condition.speed, reading.last)[END][-1]), rtol=reading.rtol)


def motion(mechanism: cj.Mechanism, t1: float, **options: Any) -> Motion:
    """Solve to t1 [s], and look at every sample and step end."""
    trace = cj.trace(mechanism, t1, **{"rtol": RTOL, "save_at": SAMPLES, **options})
    if trace.message:
        raise RuntimeError(trace.message)
    time, first = np.unique(np.concatenate([trace.solution.time, trace.time]), return_index=True)
    y = np.concatenate([trace.solution.y, trace.y])[first]
    seen = dataclasses.replace(trace, solution=at_times(trace.solution, time, y))
    found, wanted = cj.to_dataset(mechanism, seen), ideal(mechanism, time)
    at, joint = {"point": POINT}, {"joint": JOINT}
    pattern = found["contact_pattern"].sel(joint).values if "contact_pattern" in found else None
    return Motion(
        time,
        *(found[name].sel(at).values for name in ("position", "velocity", "acceleration")),
        *(wanted[name].sel(at).values for name in ("position", "velocity", "acceleration")),
        size(found["eccentricity"].sel(joint).values),
        found["contact_force"].sel(joint).values,
        found["friction_loss"].values,
        found["damping_loss"].values,
        pattern,
        *(found[name].values for name in ("episode_start", "episode_end", "peak_force", "impact_speed")),
        float(np.ptp(found["q"].sel(coordinate=JOINT).values)),
        trace.time.size - 1,
        float(trace.solution.energy_residual),
    )


def at_times(solution: cj.Solution, time: Signal, y: Signal) -> cj.Solution:
    """The same solution looked at at other times, where its states are known."""
    return dataclasses.replace(solution, time=jnp.asarray(time), y=jnp.asarray(y))


def ideal(mechanism: cj.Mechanism, time: Signal) -> Any:
    """The dataset of the same robot without play at any times: its drives alone say where it is, no state does."""
    robot = mechanism.ideal()
    short = cj.simulate(robot, 1e-3, save_at=2, rtol=RTOL, energy_balance=True)
    y = np.broadcast_to(np.asarray(short.final), (time.size, short.final.size))
    return cj.to_dataset(robot, at_times(short, time, y))
