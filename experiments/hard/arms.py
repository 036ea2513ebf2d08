"""An arm with play in all of its joints, at rest: it starts in its equilibrium, and has to stay there."""

import numpy as np

import clearance_jax as cj
from experiments.common import SCENES
from experiments.hard.case import Row, Solved, count_states, examine, options

SLEEVE = {"kind": "sleeve", "radial_clearance": 5e-5, "length": 0.04, "pin_radius": 0.015, "axial_clearance": 1e-4}
RTOLS = (1e-4, 1e-6, 1e-8)


def arm() -> cj.Mechanism:
    """Six axes with a sleeve each; its drives hold it."""
    robot = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")
    posture = {"axis_1": 0.0, "axis_2": 0.5, "axis_3": 1.0, "axis_4": 0.0, "axis_5": 0.5, "axis_6": 0.0}
    drives = {name: cj.drives.Constant(value) for name, value in posture.items()}
    robot = robot.with_drives(drives | {finger: cj.drives.Constant(0.0) for finger in ("finger_left", "finger_right")})
    for name in posture:
        robot = robot.with_clearance(name, **SLEEVE)
    return robot


def resting(quick: bool) -> Row:
    robot, end = arm(), (0.01 if quick else 1.0)
    coordinates = robot.free_coordinates()
    sizes = np.array([float(c.play) for c in coordinates if c.play is not None])

    def solve(rtol):
        solution = cj.simulate(robot, end, save_at=11, start="settled", **options(rtol))
        y = np.asarray(solution.y)[:, : len(sizes)]
        return Solved(solution, float(np.max(np.abs(y - y[0]) / sizes)))

    return examine(
        f"arm with play in six joints at rest for {end:g} s",
        count_states(robot),
        solve,
        "starts settled; how far it leaves its place, over the play",
        rtols=RTOLS,
    )


CASES = (resting,)
