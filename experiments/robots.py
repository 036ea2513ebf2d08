"""Robots from URDF files, compared with pinocchio: `python -m experiments.robots` writes out/robots.md.

A thousand random states of each robot are compared in these quantities: accelerations of free motion under gravity and
the joints' damping and dry friction (-f tanh(q' / v), added to pinocchio's efforts with the f that pinocchio reads),
the mass matrix, the terms of gravity and of the velocities (Coriolis), the pose of every link's frame, and its
geometric Jacobian. The error of a quantity in a state is the largest error of its numbers, divided by the largest of
these numbers. The table has the largest error of all states.

`PINOCCHIO_PYTHON` names the interpreter of an environment with the packages `pin` and `example-robot-data`, which are
no dependencies of this project (`python -m venv there; there/bin/pip install pin example-robot-data`). Without it, and
in quick mode, the arm of `experiments/scenes` is compared with plain Newton-Euler equations in numpy.
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax._basis.symmetric import Dense
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.forms.frames import Frames
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.io.urdf.bodies import merge
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.mechanism.state import State
from experiments.common import SCENES, output, table
from experiments.publish import command, say
from experiments.reference import rigid_robots

ARM = SCENES / "six_axes.urdf"
WORKER = Path(__file__).parent / "reference" / "pinocchio_robots.py"
ROBOTS = (
    ("panda_description/urdf/panda.urdf", "fixed"),
    ("xarm_description/urdf/xarm7.urdf", "fixed"),
    ("allegro_hand_description/urdf/allegro_right_hand.urdf", "fixed"),
    ("anymal_b_simple_description/robots/anymal.urdf", "free"),
    ("solo_description/robots/solo12.urdf", "free"),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "free"),
    ("talos_data/robots/talos_reduced.urdf", "free"),
)
# Numbers are what is asked here, not speed: fused, a program of thousands of scalars repeats most of its terms, which
# takes the compiler minutes. (The arm of the quick mode is small enough.)
UNFUSED = {"xla_disable_hlo_passes": "fusion,cpu-instruction-fusion"}
COMPARED = ("acceleration", "mass", "gravity", "coriolis", "poses", "jacobians")


class Known(NamedTuple):
    """What a reference says of a robot: its file, names of joints and links in the reference's order, and of random
    states every quantity that is compared.
    """

    path: Path
    names: list[str]
    links: list[str]
    values: dict[str, np.ndarray]


class Row(NamedTuple):
    """A robot, and the largest error of each quantity."""

    robot: str
    base: str
    coordinates: int
    compiled: float
    errors: dict[str, float]


def by_pinocchio(interpreter: str, robot: str, base: str, states: int) -> Known:
    """The reference of a process of another interpreter."""
    return known_by([interpreter, str(WORKER), robot, base, str(states), "0"])


def known_by(words: list[str]) -> Known:
    """What a process found that has, as its last argument, the file to write it to."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "known.npz"
        ended = subprocess.run([*words, str(out)], capture_output=True, text=True, check=False)
        if ended.returncode:
            raise RuntimeError(f"pinocchio could not say anything by {words[2:]}:\n{ended.stderr[-2000:]}")
        with np.load(out) as found:
            values = {key: found[key] for key in found.files}
    return Known(Path(str(values["path"])), list(values["names"]), list(values["frames"]), values)


def by_newton_euler(path: Path, base: str, states: int) -> Known:
    """The reference in numpy."""
    _, robot = read_urdf(path)
    links = [link.name for link in robot.links]
    q, rate = rigid_robots.random_states(robot, base == "free", states, seed=0)
    found = [rigid_robots.of_state(robot, *at, base == "free", links) for at in zip(q, rate, strict=True)]
    values = {key: np.array([one[key] for one in found]) for key in found[0]}
    return Known(path, [joint.name for joint in robot.joints if joint.moves], links, {"q": q, "rate": rate} | values)


def dynamics(robot: cj.Mechanism, without: cj.Mechanism, q: Any, v: Any) -> dict[str, Any]:
    """Everything that is compared, of one state; `without`: the robot without its dampers."""
    mechanism, undamped = robot.prepare(), without.prepare()
    time, y = jnp.zeros(()), jnp.concatenate([q, v])
    state, still = State(tuple(q), tuple(v), {}), State(tuple(q), tuple(jnp.zeros_like(v)), {})
    motion = frames(mechanism, time, state)
    # A load is what stands on the other side of the equations.
    load = numbers(motion.load([]))
    weight = numbers(frames(undamped, time, still).load([]))
    return {
        "acceleration": slope(time, y, mechanism)[len(q) :],
        "mass": whole(motion.mass_matrix({})),
        "gravity": -weight,
        "coriolis": weight - load,
        "poses": jnp.stack([pose(point, motion[point.body]) for point in mechanism.points]),
        "jacobians": jnp.stack([jacobian(point, motion) for point in mechanism.points]),
    }


def numbers(terms) -> Any:
    return jnp.stack([jnp.asarray(term, float) for term in terms])


def whole(factored: Any) -> Any:
    """A matrix from its factors, L D L^T or L L^T (those of a mass matrix that is written down)."""
    if isinstance(factored, Dense):
        return factored.lower @ factored.lower.T
    n = len(factored.inverse_diagonal)
    lower = jnp.stack([numbers([*factored.lower[i], 1.0, *[0.0] * (n - 1 - i)]) for i in range(n)])
    return lower @ jnp.diag(1.0 / numbers(factored.inverse_diagonal)) @ lower.T


def pose(point: cj.Point, frame: Any) -> Any:
    """Rotation and place of a named frame, shape (3, 4)."""
    at = frame.move_origin(point.at.vector)
    rotation = at.rotation if point.orientation is None else at.rotate(point.orientation.rotation).rotation
    return jnp.stack([numbers([*row, x]) for row, x in zip(rotation.rows, at.position, strict=True)])


def jacobian(point: cj.Point, motion: Frames) -> Any:
    """Velocity of a named frame's origin, and its spin, by the rates of the free coordinates, shape (6, n)."""
    at = motion[point.body].point(point.at.vector)
    return jnp.concatenate([motion.velocities(point.body, at).array, motion.spins(point.body).array], axis=1).T


def in_our_order(known: Known, base: str) -> tuple[np.ndarray, np.ndarray]:
    """Of each of our positions, and of each of our rates, its place in the reference."""
    own = [known.names.index(joint.name) for joint in merge(read_urdf(known.path)[1]).joints]
    q, v = (7, 6) if base == "free" else (0, 0)
    return np.array([*range(q), *(q + i for i in own)]), np.array([*range(v), *(v + i for i in own)])


def compared(known: Known, base: str, options: dict[str, Any] = UNFUSED) -> Row:
    """Our errors on a robot, of a program that was compiled with these options."""
    mechanism = cj.load_urdf(known.path, base=base, mimic="independent", end_effector=known.links)
    places, rates = in_our_order(known, base)
    values = dict(known.values)
    for key, axes in {"rate": 1, "acceleration": 1, "gravity": 1, "coriolis": 1, "mass": 2, "jacobians": 1}.items():
        for axis in range(axes):
            values[key] = np.take(values[key], rates, axis=-1 - axis)
    dampers = {name: 0.0 for name in cj.parameters(mechanism) if name.endswith("damping")}
    run = jax.jit(jax.vmap(dynamics, in_axes=(None, None, 0, 0)))
    arguments = (
        mechanism,
        cj.replace(mechanism, dampers),
        jnp.asarray(values["q"][:, places]),
        jnp.asarray(values["rate"]),
    )
    clock = time.perf_counter()
    compiled = run.lower(*arguments).compile(compiler_options=options)
    clock = time.perf_counter() - clock
    found = compiled(*arguments)
    errors = {key: worst(np.asarray(found[key]), values[key]) for key in COMPARED}
    return Row(known.path.stem, base, len(rates), clock, errors)


def worst(found: np.ndarray, known: np.ndarray) -> float:
    """The largest error of any state, relative to the largest of its numbers (which may all be zero, in both)."""
    axes = tuple(range(1, known.ndim))
    sizes = np.maximum(np.abs(known).max(axes), np.finfo(float).tiny)
    return float((np.abs(found - known).max(axes) / sizes).max())


def main(quick: bool = False) -> list[Row]:
    """Write the table."""
    interpreter = os.environ.get("PINOCCHIO_PYTHON")
    if quick or not interpreter:
        say("Against plain Newton-Euler equations; name an interpreter by PINOCCHIO_PYTHON for robots by pinocchio.")
        known = [(by_newton_euler(ARM, base, 20 if quick else 200), base) for base in ("fixed", "free")]
    else:
        known = [(by_pinocchio(interpreter, robot, base, 1000), base) for robot, base in ((str(ARM), "fixed"), *ROBOTS)]
        say(f"pinocchio {known[0][0].values['version']}, 1000 states of each robot")
    found = []
    for one in known:
        found.append(compared(*one, {} if quick else UNFUSED))
        print(found[-1], flush=True)
    cells = [
        (row.robot, row.base, row.coordinates, f"{row.compiled:.1f}", *(f"{row.errors[key]:.1e}" for key in COMPARED))
        for row in found
    ]
    head = ("robot", "base", "coordinates", "compile [s]", *COMPARED)
    table(head, cells, output(f"robots{'_quick' if quick else ''}.md"))
    return found


if __name__ == "__main__":
    command(main, __doc__)
