"""Joint 5 of the paper: friction with sharp corners, the exact centre, a drive whose acceleration jumps. Reference: the
hand-written equations, switchings located.
"""

from typing import Any

import numpy as np

import clearance_jax as cj
from experiments.common import joint5
from experiments.hard.amplification import amplified
from experiments.hard.case import Row, compared
from experiments.reference.problems import PROBLEMS, joint5_parameters

PROBLEM = PROBLEMS["joint5"]


def against_located(case: str, end: float, remark: str, corner: float = 1e-2) -> Row:
    p, t = joint5_parameters(1e-4, 0.3, corner_speed=corner), np.linspace(0, end, 201)
    values: dict[str, Any] = {"joint5.friction.coefficient": 0.3, "joint5.friction.transition_speed": corner}
    truth, amplification = amplified(PROBLEM, t, p, PROBLEM.scale(p), np.asarray)
    return compared(
        case,
        cj.replace(joint5(), values),
        t,
        truth.y,
        lambda y: y[:, :4],
        f"joint 5; {len(truth.switchings)} switchings{remark}",
        amplification=amplification,
    )


def exact_centre(quick: bool) -> Row:
    return against_located("pin released at the exact centre", 0.05 if quick else 0.5, "; starts at e = 0, at rest")


def drive_jumps(quick: bool) -> Row:
    return against_located("drive's acceleration jumps in contact", 0.05 if quick else 1.05, "; jumps at 0.5 s and 1 s")


def friction_corner(quick: bool) -> Row:
    return against_located("friction corner at 1e-5 m/s", 0.02 if quick else 0.2, "; cubic law", 1e-5)


def stick_slip(quick: bool) -> Row:
    return against_located("stick and slip, corner at 1e-6 m/s", 0.005 if quick else 0.05, "; cubic law", 1e-6)


CASES = (exact_centre, drive_jumps, friction_corner, stick_slip)
