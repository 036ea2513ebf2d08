"""Settled starts of a moving robot: `python -m experiments.settled_starts` writes out/settled_starts.md.

The arm of `experiments/scenes/six_axes.urdf` with the play of `arm_with_play.toml` (sleeves in axes 2, 3 and 5) starts
settled in random postures and moves for 20 ms. All six axes are driven, by one of four kinds of drives: a quintic, a
trapezoid of constant accelerations, a clamped cubic spline through four points, and ADAMS' STEP5. The posture is
random, and so are the distance and the duration of the motion of each axis (its largest speed is between 10 and 100 %
of the limit in the file), and a payload of 0.1 to 5 kg at the tool. Half of the drives start from rest at the start of
the solve. The others have started before, so the robot is already moving.

Three things are checked for each case:

- *Tool*: the tool's velocity at the start less that of the ideal arm. Its size must not be larger than 2 pi f r. The
  frequency f is the lowest one of the seated pose, as the solve has it (`solution.seated.frequency`). r is the largest
  displacement of the tool by play: the three pins lie in their sleeves such that the tool is as far as possible from
  where the ideal arm has it.
- *From rest*: where drives start from rest, this velocity must not be larger than 0.05 m/s.
- *Force*: the largest contact force of each joint in the 20 ms, over the settled one of the same joint, must not be
  larger than 5. The settled force is the sum of a joint's normal forces in the pose in which a settled start would put
  its pin: the largest of three such starts, at the beginning, after 10 ms and after 20 ms, since drives change the load
  in that time. (Each joint is compared with itself, because the large force in axis 2 would hide the others.) The last
  columns of the table also compare with the settled force at the beginning alone: by joint, and the largest force of
  all joints over the largest settled one.

A case that breaks a limit is an exception. It is listed with what the summary of its solve says about its start.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import clearance_jax as cj
from clearance_jax.dynamics.quantities import evaluate
from clearance_jax.mechanism.state import layout
from experiments.common import SCENES, output, table
from experiments.publish import command, say

SEED, EACH, RTOL = 11, 52, 1e-6
SPAN, SAMPLES = 0.02, 2001
PLAY = ("axis_2", "axis_3", "axis_5")
# Of the six axes: how far from zero postures are drawn, and the speed limits of the file [rad/s].
RANGES = np.radians([170, 60, 120, 180, 110, 180])
SPEEDS = np.array([2.6, 2.6, 3.1, 4.0, 4.0, 5.0])
# What is allowed: from rest [m/s]; the largest force over the settled one; the part of cases that are exceptions.
FROM_REST, FORCE, EXCEPTIONS = 0.05, 5.0, 0.05


class Move(NamedTuple):
    """How an axis moves: it begins and takes so long [s], from a place by a rise [rad], of which two via points have
    these parts.
    """

    begin: float
    took: float
    at: float
    rise: float
    via: tuple[float, float]


def quintic(move: Move) -> cj.drives.Quintic:
    return cj.drives.Quintic([move.begin, move.begin + move.took], [move.at, move.at + move.rise])


def trapezoid(move: Move) -> cj.drives.Trapezoid:
    return cj.drives.Trapezoid([move.begin], [move.rise], duration=[move.took], offset=move.at)


def spline(move: Move) -> cj.drives.Spline:
    times = move.begin + move.took * np.array([0, 1 / 3, 2 / 3, 1])
    return cj.drives.Spline(times, move.at + move.rise * np.array([0, *move.via, 1]), ends="clamped")


def five_step(move: Move) -> cj.drives.Step5Sum:
    return cj.drives.Step5Sum([move.begin], [move.begin + move.took], [move.rise], move.at)


DRIVES: dict[str, Callable] = {"quintic": quintic, "trapezoid": trapezoid, "spline": spline, "five-step": five_step}


class Case(NamedTuple):
    """A robot as it starts."""

    drive: str
    from_rest: bool
    payload: float
    took: float
    posture: np.ndarray
    mechanism: cj.Mechanism


class Start(NamedTuple):
    """What is found of a start: result code, how pins begin (`rest`, `pace`, `frequency`), the tool's velocity less
    that of the ideal arm [m/s], its derivative by play rates (3, play), and the contact forces of the joints at the
    samples [N].
    """

    code: Array
    residual: Array
    rest: Array
    frequency: Array
    velocity: Array
    moves: Array
    forces: Array


class Row(NamedTuple):
    """A case and what is checked of it: velocity over its limit, velocity [m/s], forces over settled ones."""

    case: Case
    found: Start
    of_limit: float
    speed: float
    force: float
    force_at_first: float
    force_of_all: float

    @property
    def broken(self) -> list[str]:
        """The limits that it breaks, in words."""
        out = []
        if int(self.found.code):
            out.append(f"the solve did not reach its end (code {int(self.found.code)})")
        if not self.of_limit <= 1:
            out.append(f"tool at {self.of_limit:.2f} of 2 pi f r")
        if self.case.from_rest and not self.speed <= FROM_REST:
            out.append(f"tool at {self.speed:.3f} m/s from rest")
        if not self.force <= FORCE:
            out.append(f"force {self.force:.1f} times the settled one")
        return out


def robot(payload: float) -> cj.Mechanism:
    """The arm with a payload [kg], a lump of 60 mm, at its tool."""
    arm = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")
    tool = next(point for point in arm.points if point.name == "tcp")
    inertia = 0.4 * payload * 0.03**2
    body = cj.Body("payload", payload, cj.Inertia(inertia, inertia, inertia))
    held = cj.Fixed("held", tool.body, "payload", tool.at)
    return dataclasses.replace(arm, bodies=(*arm.bodies, body), joints=(*arm.joints, held))


def cases(drive: str, count: int, play: tuple[str, ...]) -> list[Case]:
    """Random ones; every second one is already moving."""
    rng = np.random.default_rng([SEED, list(DRIVES).index(drive)])
    scene, arm, found = cj.load(SCENES / "arm_with_play.toml"), robot(1.0), []
    clearances = {joint.name: joint.clearance for joint in scene.clearance_joints()}
    for k in range(count):
        at, took = rng.uniform(-1, 1, 6) * RANGES, rng.uniform(0.25, 1.0)
        # Towards the middle, with its largest speed (of a quintic 1.875 times the mean) a part of the limit.
        rise = -np.sign(at) * rng.uniform(0.1, 1.0, 6) * SPEEDS * took / 1.875
        via = rng.uniform([0.2, 0.6], [0.4, 0.8], (6, 2))
        begin = -took * rng.uniform(0.05, 0.9) if k % 2 else 0.0
        mass = float(10 ** rng.uniform(-1, np.log10(5)))
        moves = {f"axis_{i + 1}": Move(begin, took, at[i], rise[i], tuple(via[i])) for i in range(6)}
        fingers = {"finger_left": cj.drives.Constant(0.02), "finger_right": cj.drives.Constant(0.02)}
        mechanism = arm.with_drives({name: DRIVES[drive](move) for name, move in moves.items()} | fingers)
        for name in play:
            mechanism = mechanism.with_clearance(name, clearances[name])
        size = 0.4 * mass * 0.03**2
        numbers = {"payload.mass": mass} | {f"payload.inertia.{axis}": size for axis in ("xx", "yy", "zz")}
        found.append(Case(drive, begin == 0, mass, took, at, cj.replace(mechanism, numbers)))
    return found


@eqx.filter_jit
def started(mechanism: cj.Mechanism, t0: Array) -> Start:
    """A settled start and 20 ms of motion."""
    end = t0 + SPAN
    solution = cj.simulate(mechanism, end, t0=t0, save_at=SAMPLES, rtol=RTOL, start="settled")
    ready, ideal, plan = mechanism.prepare(), mechanism.ideal().prepare(), layout(mechanism)
    y = solution.initial[: plan.size]

    def tool(v: Array) -> Array:
        return evaluate("velocity", t0, y.at[plan.v].set(v), ready)[0]

    off = tool(y[plan.v]) - evaluate("velocity", t0, jnp.zeros(layout(ideal).size), ideal)[0]
    forces = jnp.stack([solution[f"{joint.name}.contact_force"] for joint in mechanism.clearance_joints()], -1)
    assert solution.seated is not None
    how = solution.code, solution.energy_residual, solution.seated.rest, solution.seated.frequency
    return Start(*how, off, jax.jacfwd(tool)(y[plan.v]), forces)


def largest_displacement(mechanism: cj.Mechanism, moves: np.ndarray) -> float:
    """By how far play can move the tool [m], to first order: of every sleeve both ends of the pin's axis lie in a
    circle with the clearance as its radius.
    """
    k = np.arange(2000) + 0.5
    height, turn = 1 - 2 * k / k.size, np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - height**2)
    ways = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], -1)
    reach, along = np.zeros(k.size), ways @ moves
    for i, joint in enumerate(mechanism.clearance_joints()):
        clearance = joint.clearance
        x, y, tilt_x, tilt_y = along[:, 4 * i : 4 * i + 4].T
        for side in (1, -1):
            ends = x / 2 + side * tilt_y / clearance.length, y / 2 - side * tilt_x / clearance.length
            reach += float(clearance.radial_clearance) * np.hypot(*ends)
    return float(reach.max())


def checked(case: Case) -> Row:
    """One case."""
    first, middle, last = (
        jax.tree.map(np.asarray, started(case.mechanism, jnp.asarray(t))) for t in (0.0, SPAN / 2, SPAN)
    )
    settled = np.max([now.forces[0] for now in (first, middle, last)], axis=0)
    peaks, begin = first.forces.max(0), first.forces[0]
    limit = 2 * np.pi * float(first.frequency) * largest_displacement(case.mechanism, first.moves)
    speed = float(np.linalg.norm(first.velocity))
    ratios = np.max(peaks / settled), np.max(peaks / begin), peaks.max() / begin.max()
    return Row(case, first, speed / limit, speed, *map(float, ratios))


def summary(rows: list[Row]) -> tuple:
    """A line of the table."""
    resting = [np.mean(row.found.rest) for row in rows]
    values = [[getattr(row, name) for row in rows] for name in ("of_limit", "speed", "force")]
    values += [[getattr(row, name) for row in rows] for name in ("force_at_first", "force_of_all")]
    worst = [f"{np.max(own):.3g}" for own in values]
    return len(rows), f"{100 * np.mean(resting):.0f}", *worst, sum(bool(row.broken) for row in rows)


def main(quick: bool = False) -> list[Row]:
    """Write the tables; returns all rows."""
    rows: list[Row] = []
    for drive in list(DRIVES)[:1] if quick else DRIVES:
        made = cases(drive, 4 if quick else EACH, PLAY[-1:] if quick else PLAY)
        rows += [checked(case) for case in made]
    lines = []
    for drive in DRIVES:
        for from_rest, word in ((True, "from rest"), (False, "moving")):
            own = [row for row in rows if row.case.drive == drive and row.case.from_rest == from_rest]
            lines += [(drive, word, *summary(own))] if own else []
    head = ("drive", "at the start", "cases", "pins at relative rest [%]", "tool, of 2 pi f r", "tool [m/s]")
    head += ("force over settled", "over that at first", "largest over largest", "exceptions")
    table(head, [*lines, ("all", "", *summary(rows))], output(f"settled_starts{'_quick' if quick else ''}.md"))
    exceptions = [row for row in rows if row.broken]
    allowed = int(EXCEPTIONS * len(rows))
    say(f"{len(exceptions)} of {len(rows)} cases are exceptions (allowed: {allowed}).")
    for row in exceptions:
        say(*described(row))
    return rows


def described(row: Row) -> list[str]:
    """An exception: the case, which limits it breaks, what the summary of its solve says."""
    case = row.case
    posture = ", ".join(f"{np.degrees(angle):.0f}" for angle in case.posture)
    solution = cj.simulate(case.mechanism, 1e-6, start="settled", throw=False)
    return [
        f"{case.drive}, {'from rest' if case.from_rest else 'moving'}, {case.payload:.2g} kg, {case.took:.2g} s, from "
        f"({posture}) deg: {'; '.join(row.broken)}.",
        f"  Its summary: {solution.rests or 'nothing about its start'}",
    ]


if __name__ == "__main__":
    command(main, __doc__, quick="four cases of one drive, with play in one joint")
