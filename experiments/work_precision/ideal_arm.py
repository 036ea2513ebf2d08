"""MuJoCo's time per step of an ideal arm, beside ours; and what was not measured."""

import json
import subprocess
import sys

import jax

import clearance_jax as cj
from experiments.common import SCENES, output, table
from experiments.play_in_space import WORKER
from experiments.work_precision import peers
from experiments.work_precision.points import best

STEP, STEPS, END = 1e-4, 200, 0.02


def by_mujoco() -> dict:
    """What its process says: program, seconds, joints."""
    text = (SCENES / "six_axes.urdf").read_text(encoding="utf-8")
    given = json.dumps({"urdf": text, "step": STEP, "steps": STEPS, "q": [0.0, 0.35, -0.7]})
    ended = subprocess.run([sys.executable, str(WORKER)], input=given, capture_output=True, text=True, check=True)
    return json.loads(ended.stdout)


def by_us() -> tuple[float, int, int]:
    """Seconds of a solve of the same arm in free fall without play, attempted steps, coordinates."""
    robot = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")

    @jax.jit
    def run(rtol):
        s = cj.simulate(robot, END, rtol=rtol, energy_balance=False)
        return s.final, s.steps + s.rejected

    jax.block_until_ready(run(1e-6))
    (_, attempts), took = best(lambda: jax.block_until_ready(run(1e-6)), 20)
    return took, int(attempts), len(robot.free_coordinates())


def main(suffix: str) -> None:
    """The table of steps; nothing without MuJoCo."""
    if not peers.installed("MuJoCo"):
        return
    found, (took, attempts, free) = by_mujoco(), by_us()
    rows = [
        (
            f"{found['program']}, its default integrator",
            found["joints"],
            STEPS,
            f"{1e6 * found['seconds'] / STEPS:.1f}",
        ),
        ("clearance_jax, tsit5 at rtol 1e-6 (six evaluations a step)", free, attempts, f"{1e6 * took / attempts:.1f}"),
    ]
    table(
        ("ideal arm of six axes, falling", "coordinates", "steps", "us a step"),
        rows,
        output(f"work_precision_steps{suffix}.md"),
    )
