"""The cost of play in space, and its limit of zero clearance: `python -m experiments.play_in_space` writes
out/play_in_space.md.

*Fields*: the cost of one evaluation of the vector field (without energy balance), alone and as a lane of 64 (one motion
in a batch of 64). One model is the paper's joint 5 in the plane (one contact point). The other is the tool changer in
space (8 stations and a ring of 8 on the thrust faces: 16 points, 5 play coordinates, 6 driven joints). Both have
friction. Operations are counted by the compiler for one lane, before fusion. *A point* is the cost of the field divided
by its number of points. *Contact alone* leaves out the equations of motion.

*Arms*: the six axes of six_axes.urdf carry 5 kg along a trajectory, with sleeves (radial 50 um, 40 mm long, 8 stations,
steel on bronze, no friction) in one axis, in three or in all six, without axial play and with it (100 um, 8 points of
the faces). *Form* is the form of the equations of motion: one operation for each number, or loops over a table.
*Program* is the processor time [s] of tracing and compiling without a cache. *Cold* and *kept* are the first call of
hardly any steps, in wall seconds: without a cache, and with the kept program of an earlier process. *Solve* is the
shortest of later calls. The methods are those that "auto" chooses (dopri8 here) and, for the cost of a try alone,
tsit5. The arm of seven axes is made up (links of 0.1 to 0.2 m, 17.5 kg, every axis turns to and fro); its base of 20 kg
is fixed, or floats without gravity. The Delta robot has play in all twelve balls of its rods (50 um; five of them close
loops). robot_arm.toml ends at 0.25 s. MuJoCo steps the ideal arm of six axes, falling freely; `PINOCCHIO_PYTHON` names
an interpreter that has `mujoco` (`python -m venv there; there/bin/pip install mujoco`).

*Chains*: sleeves without axial play one behind the other, each on an axis that turns to and fro, and plane chains of
pins with play, each link free to turn; from the start at rest to the first milliseconds. *A try* is an attempt at a
step; its time leaves out that of a call with hardly any steps, and is not told of a few hundred tries or less.

*Lanes*: the same arms without axial play, as a batch (each motion is a lane) with radial clearances from half to one
and a half times 50 um, and every sixteenth of them alone. Chunks of 64 lanes run until the slowest one ends.

*To zero*: the largest distance of the arm's end from that of the ideal arm in the first 20 ms. All clearances are
multiplied by a factor f. The moduli are 100 f^-1.5 times those of steel and bronze, so that contact deformations shrink
in proportion to the clearances. (With the largest f the arm has not yet fallen through its play after 20 ms.)

*Ladder*: the five play coordinates of the tool changer after 0.1 s, for several tolerances, compared with a solve at
rtol 1e-12. The derivatives at rtol 1e-9 are compared with central differences of solves at 1e-12, extrapolated once.

*Stations*: the place of the tool changer's end after 0.1 s, compared with that of 32 stations.
"""

import dataclasses
import itertools
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

import clearance_jax as cj
from clearance_jax._compile.barriers import sharing
from clearance_jax._compile.kept import keep_in
from clearance_jax._compile.one_function import one_function
from clearance_jax.dynamics.field import rate
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.joints import PreparedClearance
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.solve.flow import compiled_solve
from experiments.common import SCENES, joint5, output, seconds, table
from experiments.forward_dynamics import compiled_anew
from experiments.hlo import busiest_loop
from experiments.publish import command, say

WORKER = Path(__file__).parent / "reference" / "mujoco_steps.py"
LANES, EVALUATIONS, ROUNDS = 64, 2000, 9
BARREL = {"kind": "sleeve", "radial_clearance": 5e-5, "length": 0.04, "pin_radius": 0.015}
SLEEVE = BARREL | {"axial_clearance": 1e-4}
AXES = ("5", "235", "123456")
CHAINS, PINS = (5, 10, 20, 40), (6, 12, 24)
BATCH, BATCH_END, ALONE = 256, 0.005, 16
ROBOT_ARM = "robot_arm.toml"
RTOL, BEGUN = 1e-6, 1e-7
# Tries from which on their time can be told from that of a call.
TIMED = 1000
# A sleeve of 40 mm that holds the weight of an arm by its edges gives by as much as its clearance: as steel and bronze
# are, what is left without clearance is an elastic arm, not the ideal one.
STIFFER = 100.0


# Scenes ---------------------------------------------------------------------------------------------------------------


def plane() -> cj.Mechanism:
    """The paper's joint 5, with the friction of the tool changer."""
    return cj.replace(joint5(), {"joint5.friction.coefficient": 0.05})


def tool_changer() -> cj.Mechanism:
    return cj.load(SCENES / "tool_changer.toml")


def sleeves(axes: str) -> str:
    """How many, in words."""
    return f"{len(axes)} sleeve{'s' if len(axes) > 1 else ''}"


def arm(axes: str, sleeve: dict[str, float] = SLEEVE) -> cj.Mechanism:
    """Six axes on their trajectory with 5 kg in the gripper, with sleeves in the axes that are named."""
    robot = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")
    robot = robot.with_drives(
        {**cj.read_trajectory(SCENES / "six_axes_turn.csv"), "finger_left": cj.drives.Constant(0.0)}
    )
    holder = next(point.body for point in robot.points if point.name == "tcp")
    place = next(point.at for point in robot.points if point.name == "tcp")
    payload = cj.Body("payload", 5.0, cj.Inertia(0.01, 0.01, 0.01))
    robot = dataclasses.replace(
        robot, bodies=(*robot.bodies, payload), joints=(*robot.joints, cj.Fixed("held", holder, "payload", place))
    )
    for axis in axes:
        robot = robot.with_clearance(f"axis_{axis}", **sleeve)
    return robot


# Fields ---------------------------------------------------------------------------------------------------------------


def states(mechanism: cj.Mechanism) -> tuple[jax.Array, tuple[jax.Array, ...]]:
    """Times and rows of states near the start, pins anywhere in their sleeves and a little beyond."""
    rng, start = np.random.default_rng(0), np.asarray(initial_values(mechanism))
    sizes = np.array([float(c.play) for c in mechanism.free_coordinates() if c.play is not None])
    y = np.tile(start[:, None], (1, LANES))
    y[: len(sizes)] += sizes[:, None] * rng.uniform(-1.2, 1.2, (len(sizes), LANES))
    y[len(sizes) :] += 100 * sizes[:, None] * rng.uniform(-1, 1, (len(sizes), LANES))
    return jnp.asarray(rng.uniform(0.01, 0.04, LANES)), tuple(jnp.asarray(y))


def whole(mechanism, t, y):
    return rate(t, y, mechanism)


def contact(mechanism, t, y):
    """What the joint does, by its own coordinates."""
    (joint,) = mechanism.clearance_joints()
    at = relative_motions(t, y, mechanism)[0]
    action = PreparedClearance.act(joint.clearance, at, layout(mechanism).split(y).memory[joint.name])
    return [jnp.asarray(term, float) for term in (*action.force, *action.torque)]


def cost(function: Callable, mechanism: cj.Mechanism) -> tuple[float, float, float, float]:
    """Operations of a lane, seconds alone, seconds a lane, seconds of a processor to compile."""
    ready = mechanism.prepare()
    times, rows = states(ready)

    def lane(ready, t, y):
        with sharing():
            return function(ready, t, y)

    over = jax.vmap(lane, (None, 0, 0))
    one = times[0], tuple(row[0] for row in rows)
    clock = time.process_time()
    compiled_anew(jax.jit(function).lower(ready, *one))
    clock = time.process_time() - clock

    def looped(evaluate, count):
        @jax.jit
        @one_function
        def loop(ready, t, y):
            def following(_, carry):
                # The next time and state hang on this evaluation, and stay where they were.
                t, y = carry
                rates = evaluate(ready, t, y)
                y = tuple(row + 1e-20 * r for row, r in zip(y, itertools.cycle(rates), strict=False))
                return t + 1e-20 * rates[-1], y

            return jax.lax.fori_loop(0, count, following, (t, y))

        return loop

    alone, lanes = looped(function, EVALUATIONS), looped(over, EVALUATIONS // 10)
    single = seconds(lambda: alone(ready, *one), ROUNDS) / EVALUATIONS
    many = seconds(lambda: lanes(ready, times, rows), ROUNDS) / (EVALUATIONS // 10) / LANES
    unfused = {"xla_backend_optimization_level": 0, "xla_disable_hlo_passes": "fusion"}
    operations = busiest_loop(alone.lower(ready, *one).compile(compiler_options=unfused).as_text())
    return operations, single, many, clock


def fields() -> None:
    rows, measured = [], {}
    for name, mechanism, points in (("joint 5, plane", plane(), 1), ("tool changer, space", tool_changer(), 16)):
        for part, function in (("field", whole), ("contact alone", contact)):
            found = measured[name, part] = cost(function, mechanism)
            operations, alone, lane, compiled = found
            each = [f"{operations:.0f}", f"{1e6 * alone:.3f}", f"{1e6 * lane:.4f}"]
            by_point = [f"{operations / points:.0f}", f"{1e6 * alone / points:.3f}", f"{1e6 * lane / points:.4f}"]
            rows.append((name, part, points, *each, *by_point, f"{compiled:.1f}"))
    here, there = (measured[name, "field"] for name in ("joint 5, plane", "tool changer, space"))
    head = ["scene", "part", "points", "operations", "alone [us]", "a lane [us]"]
    head += ["operations a point", "alone a point [us]", "a lane a point [us]", "compile [CPU s]"]
    table(head, rows, output("play_in_space_fields.md"))
    ratios = [f"{b / a:.1f}" for a, b in zip(here[:3], there[:3], strict=True)]
    say(f"Field in space over field in the plane: operations {ratios[0]}, alone {ratios[1]}, a lane {ratios[2]}.")


# Arms -----------------------------------------------------------------------------------------------------------------


class Solved(NamedTuple):
    """A solve; seconds of a processor for its program, seconds of a first call, cold and with the program kept, seconds
    of a later call, and microseconds of a try (the time beyond that of a call of hardly any steps, over the tries).
    """

    solution: cj.Solution
    program: float
    cold: float
    kept: float
    seconds: float
    a_try: float


def tries_of(solution: cj.Solution) -> int:
    return int(solution.steps) + int(solution.rejected)


def solved(mechanism: cj.Mechanism, end: float, solver: str = "auto") -> Solved:
    def solve(end):
        solution = cj.simulate(mechanism, end, rtol=RTOL, solver=solver, max_steps=10_000_000)
        return jax.block_until_ready(solution)

    def first():
        jax.clear_caches()
        for known in (compiled_solve._programs, compiled_solve._calls):
            known.clear()
        clocks = time.process_time(), time.perf_counter()
        solution = solve(BEGUN)  # a step or two: where it ends is no part of the program
        return solution, time.process_time() - clocks[0], time.perf_counter() - clocks[1]

    settings: Any = jax.config
    cached = settings.jax_enable_compilation_cache
    settings.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    with tempfile.TemporaryDirectory() as folder:
        keep_in(Path(folder))
        started, program, cold = first()
        _, _, kept = first()
        keep_in(None)
    settings.update("jax_enable_compilation_cache", cached)
    compilation_cache.reset_cache()
    few, fixed = tries_of(started), seconds(lambda: solve(BEGUN), 3)
    solution = solve(end)
    clock = seconds(lambda: solve(end), 3)
    return Solved(solution, program, cold, kept, clock, 1e6 * (clock - fixed) / (tries_of(solution) - few))


def points(mechanism: cj.Mechanism) -> int:
    """Where its clearance joints may touch."""
    joints: Any = mechanism.prepare().clearance_joints()
    return sum(joint.clearance.joint.count for joint in joints)


def form(mechanism: cj.Mechanism) -> str:
    return "table" if mechanism.form.is_table else "written out"


def seven_axes(floats: bool) -> cj.Mechanism:
    """An arm of seven axes that turn to and fro, each in a sleeve with axial play, on a base that is held or not."""
    masses, lengths = (4.0, 4.0, 3.0, 2.7, 1.7, 1.8, 0.3), (0.16, 0.2, 0.2, 0.2, 0.2, 0.1, 0.1)
    bodies = [cj.Body("base", 20.0, cj.Inertia(0.5, 0.5, 0.5))]
    joints: list[Any] = [(cj.Free if floats else cj.Fixed)("foot", "ground", "base")]
    for i, (mass, length) in enumerate(zip(masses, lengths, strict=True)):
        inertia, centre = cj.Inertia(5e-3 * mass, 5e-3 * mass, 2e-3 * mass), cj.Position(0.02, 0.0, length / 2)
        motion = cj.Motion(cj.drives.Harmonic(0.2, 3.0 + i))
        place = cj.Position(z=lengths[i - 1] if i else 0.0)
        joints.append(cj.Revolute(f"j{i}", bodies[-1].name, f"b{i}", place, axis="zy"[i % 2], motion=motion))
        bodies.append(cj.Body(f"b{i}", mass, inertia, centre))
    mechanism = cj.Mechanism(tuple(bodies), tuple(joints), gravity=cj.Gravity(z=0.0 if floats else -9.81))
    for i in range(len(masses)):
        mechanism = mechanism.with_clearance(f"j{i}", **SLEEVE)
    return mechanism


def delta() -> cj.Mechanism:
    """A Delta robot with play in the balls at both ends of its six rods; five of them close loops."""
    base, arm, rod, foot, half, tilt = 0.2, 0.3, 0.6, 0.05, 0.06, np.deg2rad(20.0)
    ball = cj.SphericalClearance(5e-5, 0.008, cj.laws.HuntCrossley(1e9, 0.5))
    bodies, joints, wrist, loops = [cj.Body("platform", 0.5, cj.Inertia(1e-3, 1e-3, 2e-3))], [], [], []
    for i in range(3):
        yaw = 2 * np.pi * i / 3
        outward, sideways = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        bodies.append(cj.Body(f"arm{i}", 1.0, cj.Inertia(1e-3, 8e-3, 8e-3), cj.Position(arm / 2)))
        motion, turned = cj.Motion(cj.drives.Harmonic(0.2, 8.0 + i)), cj.Orientation(yaw=yaw)
        place = cj.Position(*(base * outward))
        joints.append(cj.Revolute(f"motor{i}", "ground", f"arm{i}", place, orientation=turned, axis="y", motion=motion))
        for k, side in enumerate((half, -half)):
            name, above, below = f"rod{i}{k}", cj.Ball(cj.Orientation(pitch=tilt)), cj.Ball(cj.Orientation(pitch=-tilt))
            bodies.append(cj.Body(name, 0.1, cj.Inertia(3e-3, 3e-3, 1e-5), cj.Position(z=-rod / 2)))
            elbow = cj.Position(arm, side)
            joints.append(cj.Spherical(f"elbow{i}{k}", f"arm{i}", name, elbow, motion=above, clearance=ball))
            ends = cj.Position(z=-rod), cj.Position(*(foot * outward + side * sideways))
            closing = loops if wrist else wrist
            closing.append(cj.Spherical(f"wrist{i}{k}", name, "platform", *ends, motion=below, clearance=ball))
    # A loop's balls have no motion of their own.
    loops = [dataclasses.replace(closing, motion=cj.Ball()) for closing in loops]
    return cj.Mechanism(tuple(bodies), (*joints, *wrist), tuple(loops), gravity=cj.Gravity(z=-9.81))


def arms(end: float) -> None:
    rows, with_one = [], 0.0
    cases = [("tool changer", tool_changer())]
    for axes in AXES:
        cases += [(f"arm, {sleeves(axes)}", arm(axes, BARREL)), (f"arm, {sleeves(axes)}, axial", arm(axes))]
    cases += [(ROBOT_ARM, cj.load(SCENES / ROBOT_ARM))]
    cases += [("seven sleeves, axial", seven_axes(False)), ("seven sleeves, axial, floating", seven_axes(True))]
    cases += [("Delta, twelve balls", delta())]
    for name, mechanism in cases:
        last = 0.25 if name == ROBOT_ARM else end
        solution, program, cold, kept, again, a_try = solved(mechanism, last)
        free = len(mechanism.free_coordinates()), points(mechanism), form(mechanism)
        steps = int(solution.steps), int(solution.rejected), int(solution.cuts)
        residual, by_tsit5 = f"{float(solution.energy_residual):.1e}", solved(mechanism, last, "tsit5")
        tries = f"{a_try:.0f}", f"{by_tsit5.a_try:.0f}"
        first = f"{program:.0f}", f"{by_tsit5.program:.0f}", f"{cold:.1f}", f"{kept:.2f}"
        rows.append((name, *free, *first, f"{again:.2f}", *steps, *tries, residual))
        print(rows[-1], flush=True)
        with_one = again if name == "arm, 1 sleeve" else with_one
    head = ("scene", "free coordinates", "points", "form", "program [CPU s]", "by tsit5", "cold [s]", "kept [s]")
    head = (*head, "solve [s]", "steps", "rejected", "for a cut", "us a try", "by tsit5", "residual")
    table(head, rows, output("play_in_space_arms.md"))
    say(f"Span {end} s, rtol {RTOL}, with energy balance.")
    interpreter = os.environ.get("PINOCCHIO_PYTHON")
    if not interpreter:
        say("MuJoCo is left out: name an interpreter that has `mujoco` by PINOCCHIO_PYTHON.")
        return
    text = (SCENES / "six_axes.urdf").read_text(encoding="utf-8")
    given = json.dumps({"urdf": text, "step": 1e-4, "steps": round(end / 1e-4), "q": [0.0, 0.35, -0.7]})
    ended = subprocess.run([interpreter, str(WORKER)], input=given, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(f"{interpreter} could not step the arm: {ended.stderr[-2000:]}")
    found = json.loads(ended.stdout)
    beside = f"{found['program']} steps the ideal arm ({found['joints']} coordinates) over {end} s at 1e-4 s"
    say(f"{beside} in {found['seconds']:.4f} s; ours, with play in axis 5, takes {with_one:.2f} s.")


def chain(count: int) -> cj.Mechanism:
    """Bodies one behind the other, each in a sleeve with play on an axis that turns to and fro."""
    bodies, joints = [], []
    for i in range(count):
        centre, drive = cj.Position(0.05, 0.0, 0.02), cj.drives.Harmonic(0.2, 3.0 + i)
        bodies.append(cj.Body(f"b{i}", 1.0, cj.Inertia(0.01, 0.012, 0.015), centre))
        holder, place = (f"b{i - 1}", cj.Position(0.0, 0.0, 0.2)) if i else ("ground", cj.Position())
        joints.append(cj.Revolute(f"j{i}", holder, f"b{i}", place, axis="xyz"[i % 3], motion=cj.Motion(drive)))
    mechanism = cj.Mechanism(tuple(bodies), tuple(joints), gravity=cj.Gravity(0.0, 0.0, -9.81))
    for joint in joints:
        mechanism = mechanism.with_clearance(joint.name, **BARREL)
    return mechanism


def pins(count: int) -> cj.Mechanism:
    """A plane chain that hangs to one side, each link on a pin with play."""
    contact = cj.laws.HuntCrossley(1e9, 0.5)
    bodies = tuple(cj.Body(f"b{i}", 1.0, 0.01, cj.Position(0.1)) for i in range(count))
    joints = []
    for i in range(count):
        holder, place = (f"b{i - 1}", cj.Position(0.2)) if i else ("ground", cj.Position())
        played = cj.RevoluteClearance(1e-4, 0.01, contact)
        joints.append(cj.Revolute(f"j{i}", holder, f"b{i}", place, clearance=played))
    return cj.Mechanism(bodies, tuple(joints), gravity=cj.Gravity(0.0, -9.81))


def chains(end: float, fall: float) -> None:
    """How programs and attempts grow with the bodies of a chain; a chain of pins, which falls first, ends at `fall`."""
    rows = []
    cases = [(f"{count} sleeves", chain(count), end) for count in CHAINS]
    cases += [(f"{count} pins", pins(count), fall) for count in PINS]
    for name, mechanism, last in cases:
        solution, program, _, _, again, a_try = solved(mechanism, last)
        per_try = f"{a_try:.0f}" if tries_of(solution) > TIMED else ""
        size = len(mechanism.free_coordinates()), points(mechanism), form(mechanism)
        rows.append((name, *size, f"{program:.0f}", f"{again:.2f}", tries_of(solution), per_try))
        print(rows[-1], flush=True)
    head = ("chain", "free coordinates", "points", "form", "program [CPU s]", "solve [s]", "tries", "us a try")
    table(head, rows, output("play_in_space_chains.md"))
    say(f"Span of sleeves {end} s, of pins {fall} s, rtol {RTOL}, with energy balance.")


def lanes(end: float) -> None:
    """Batches of arms, beside one alone."""
    rows = []
    for axes in AXES:
        mechanism = arm(axes, BARREL)
        clearances = [f"axis_{axis}.radial_clearance" for axis in axes]

        def solve(radial, mechanism=mechanism, names=clearances):
            found = cj.simulate(
                cj.replace(mechanism, dict.fromkeys(names, radial)), end, rtol=RTOL, energy_balance=False
            )
            return found.final, found.steps + found.rejected

        alone, batch = jax.jit(solve), jax.jit(jax.vmap(solve))
        given = jnp.linspace(0.5, 1.5, BATCH) * BARREL["radial_clearance"]
        several = given[:: BATCH // ALONE]
        clock = time.process_time()
        attempts = batch(given)[1]
        compiled = time.process_time() - clock
        tries = sum(int(alone(x)[1]) for x in several)
        many = seconds(lambda batch=batch, given=given: batch(given), 3)
        one = (
            seconds(lambda alone=alone, several=several: [jax.block_until_ready(alone(x)) for x in several], 3) / ALONE
        )
        whole = int(attempts.sum())
        row = sleeves(axes), len(mechanism.free_coordinates()), points(mechanism), f"{compiled:.0f}"
        rates = f"{BATCH / many:.0f}", f"{1 / one:.0f}", f"{one * BATCH / many:.2f}", f"{1e6 * many / whole:.2f}"
        rows.append((*row, *rates, f"{1e6 * one * ALONE / tries:.2f}", f"{BATCH * int(attempts.max()) / whole:.2f}"))
        print(rows[-1], flush=True)
    head = ("arm", "free coordinates", "points", "first call [CPU s]", f"{BATCH} lanes: lanes a second")
    head = (*head, "alone: solves a second", "ratio", "us a lane and attempt", "us an attempt alone")
    head = (*head, "slowest lane over the mean")
    table(head, rows, output("play_in_space_lanes.md"))
    say(f"Span {end} s, rtol {RTOL}, without energy balance.")


def to_zero(axes: str, halvings: int) -> None:
    """The end's distance from the ideal arm's as all clearances shrink."""
    end, loose, names = 0.02, arm(axes), [f"axis_{axis}" for axis in axes]
    times, known, rows = np.linspace(0.0, end, 81), [], []
    ideal = np.asarray(cj.simulate(loose.ideal(), end, save_at=times, rtol=1e-9)["tcp.position"])
    given = cj.parameters(loose)
    for k in range(halvings + 1):
        scale, numbers = 0.5**k, {}
        for name in names:
            numbers[f"{name}.radial_clearance"] = scale * SLEEVE["radial_clearance"]
            numbers[f"{name}.axial_clearance"] = scale * SLEEVE["axial_clearance"]
            for part in ("pin", "sleeve"):
                modulus = f"{name}.normal.stiffness.{part}_modulus"
                numbers[modulus] = STIFFER * scale**-1.5 * given[modulus].value
        solution = cj.simulate(cj.replace(loose, numbers), end, save_at=times, rtol=RTOL, max_steps=10_000_000)
        off = np.linalg.norm(np.asarray(solution["tcp.position"]) - ideal, axis=-1).max()
        order = f"{np.log2(known[-1] / off):.2f}" if known else ""
        known.append(off)
        rows.append((f"1/{2**k}", f"{1e6 * off:.2f}", order, int(solution.steps), int(solution.rejected)))
    table(("clearances times", "end off [um]", "order", "steps", "rejected"), rows, output("play_in_space_zero.md"))


def stations(counts: tuple[int, ...], best: int) -> None:
    """How the motion converges with the number of stations."""
    mechanism, rows, end = tool_changer(), [], 0.1
    clearance: Any = mechanism.joint("joint5")

    def at_end(count: int):
        changed = dataclasses.replace(clearance.clearance, stations=count)
        solution = cj.simulate(mechanism.with_clearance("joint5", changed), end, rtol=1e-8)
        return np.asarray(solution["end.position"]), np.asarray(solution["joint5.play_y"]), int(solution.steps)

    known = at_end(best)
    for count in counts:
        place, play, steps = at_end(count)
        off = np.linalg.norm(place - known[0])
        rows.append((count, f"{1e6 * off:.4f}", f"{1e6 * abs(float(play - known[1])):.4f}", steps))
    table(("stations", "end off [um]", "pin off [um]", "steps"), rows, output("play_in_space_stations.md"))


def ladder(end: float) -> None:
    """The tool changer's error against its tolerance, and its derivatives against differences."""
    mechanism, rows = tool_changer(), []
    sizes = np.array([float(c.play) for c in mechanism.free_coordinates() if c.play is not None])

    def solution(rtol: float, **numbers) -> cj.Solution:
        return cj.simulate(cj.replace(mechanism, numbers), end, rtol=rtol)

    best = np.asarray(solution(1e-12).final)[: len(sizes)]
    for rtol in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        now = solution(rtol)
        error = np.max(np.abs(np.asarray(now.final)[: len(sizes)] - best) / sizes)
        rows.append((f"{rtol:.0e}", f"{error:.1e}", f"{float(now.energy_residual):.1e}", int(now.steps)))
    table(("rtol", "error over its play", "energy residual", "steps"), rows, output("play_in_space_ladder.md"))

    names = ("joint5.radial_clearance", "joint5.axial_clearance", "joint5.friction.coefficient", "cutter.mass")
    values = {name: jnp.asarray(cj.parameters(mechanism)[name].value) for name in (*names, "grip.at_parent.y")}
    found = jax.jacfwd(lambda numbers: solution(1e-9, **numbers).final[: len(sizes)])(values)
    rows = []
    for name, value in values.items():

        def ended(x, name=name):
            return np.asarray(solution(1e-12, **{name: x}).final)[: len(sizes)]

        step = 1e-4 * value
        far, near = ((ended(value + h) - ended(value - h)) / (2 * h) for h in (step, step / 2))
        exact = (4 * near - far) / 3
        off = np.max(np.abs(np.asarray(found[name]) - exact)) / np.max(np.abs(exact))
        rows.append((name, f"{np.max(np.abs(exact)):.3g}", f"{off:.1e}"))
    table(("by", "largest derivative", "off by, relative to it"), rows, output("play_in_space_derivatives.md"))


def main(quick: bool = False) -> None:
    """Write the tables."""
    fields()
    if quick:
        return
    ladder(0.1)
    arms(0.5)
    chains(0.004, 0.02)
    lanes(BATCH_END)
    to_zero("123456", 4)
    stations((2, 4, 8, 16), 32)


if __name__ == "__main__":
    command(main, __doc__, quick="the fields alone")
