"""The slider-crank with one clearance, at its extremes. Reference: the hand-written equations, switchings located."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import slider_crank
from experiments.hard.amplification import amplified
from experiments.hard.case import Row, Solved, batched, compared, examine, options, worst
from experiments.reference.located import Solution, dop853
from experiments.reference.problems import CLEARANCE, LAW, PROBLEMS, STIFFNESS, slider_crank_parameters

RADIUS, LENGTH, SLIDER_MASS = LAW + 1, LAW + 2, LAW + 5
PROBLEM = PROBLEMS["slider_crank"]


def truth_of(t: np.ndarray, p: np.ndarray) -> tuple[Solution, float]:
    """The reference and its amplification; its longest step is as the crank's speed allows."""
    scale = PROBLEM.scale(p)
    return amplified(
        PROBLEM, t, p, np.array([p[CLEARANCE] / p[LENGTH], p[CLEARANCE], scale[2], scale[3]]), np.asarray, 1e-3 / p[LAW]
    )


def frame(t: np.ndarray, speed: float) -> Callable:
    """Takes states to the conrod's absolute angle."""
    turned = np.stack([speed * t, 0 * t, speed + 0 * t, 0 * t], -1)
    return lambda y: np.asarray(y)[..., :4] + turned


def against_located(case: str, mechanism: cj.Mechanism, p: np.ndarray, t: np.ndarray, remark: str = "") -> Row:
    truth, amplification = truth_of(t, p)
    said = f"{len(truth.switchings)} switchings{'; ' if remark else ''}{remark}"
    return compared(case, mechanism, t, truth.y, frame(t, p[LAW]), said, amplification=amplification)


def with_values(p: np.ndarray, values: dict[str, Any] | None = None) -> cj.Mechanism:
    return cj.replace(slider_crank(), {"wrist.radial_clearance": p[CLEARANCE], **(values or {})})


def tiny_clearance(quick: bool) -> Row:
    p = slider_crank_parameters(1e-7)
    t = np.linspace(0, 3e-3 if quick else 12e-3, 201)
    return against_located("clearance 1e-7 m", with_values(p), p, t)


def mass_ratio(quick: bool) -> Row:
    p = slider_crank_parameters(5e-4)
    p[LAW] /= 100
    p[SLIDER_MASS] = 0.21e5
    t = np.linspace(0, 0.1 if quick else 1.2, 201)
    m = with_values(p, {"drive.main.speed": p[LAW], "slider.mass": p[SLIDER_MASS]})
    return against_located("mass ratio 1e5 (slider over conrod)", m, p, t, "50 rpm")


def stiffer(factor: float, end: float) -> Callable[[bool], Row]:
    """A case: the stiffness of the scene times a factor, until `end` [s]."""

    def stiffness(quick: bool) -> Row:
        p = slider_crank_parameters(5e-4)
        p[STIFFNESS] *= factor
        t = np.linspace(0, 3e-3 if quick else end, 201)
        m = with_values(p)
        (joint,) = m.clearance_joints()
        given = joint.clearance
        assert given is not None
        assert isinstance(given.normal, laws.AdamsImpact)
        law = laws.AdamsImpact(p[STIFFNESS], given.normal.damping, given.normal.full_damping_depth)
        m = m.with_clearance("wrist", cj.RevoluteClearance(5e-4, given.pin_radius, law, given.friction))
        return against_located(f"stiffness x {factor:g}", m, p, t, f"until {1e3 * end:g} ms")

    return stiffness


def fast(quick: bool) -> Row:
    p = slider_crank_parameters(5e-4)
    p[LAW] *= 4
    turns = 2 if quick else 40
    t = np.linspace(0, turns * 2 * np.pi / p[LAW], 50 * turns + 1)
    m = with_values(p, {"drive.main.speed": p[LAW]})
    row = against_located("crank at 20 000 rpm", m, p, t, f"{turns} turns")
    return row._replace(remark=f"{row.remark}; {'CHAOTIC' if row.chaotic else 'not chaotic'}")


def folded(quick: bool) -> Row:
    p = slider_crank_parameters(2e-4)
    p[RADIUS] = p[LENGTH] = 0.1
    p[LAW] /= 5
    t = np.linspace(0, 0.01 if quick else 0.02, 201)
    values = {
        "drive.main.speed": p[LAW],
        "crankpin.at_parent.x": p[RADIUS],
        "wrist.at_parent.x": p[LENGTH],
        "conrod.center_of_mass.x": p[LENGTH] / 2,
        "guide.position": p[RADIUS] + p[LENGTH],
    }
    return against_located(
        "a singular pose: crank as long as conrod", with_values(p, values), p, t, "folds at 90 deg, after 15 ms"
    )


def touches(c: float, t: np.ndarray) -> int:
    """How often the pin of the reference touches or leaves the wall."""
    return int(np.sum(dop853(PROBLEM, t, slider_crank_parameters(c)).switchings[:, 1] == 0))


def grazing_clearance(t: np.ndarray, low: float, high: float) -> float:
    """A clearance at which one more touch just happens, by bisection to 1e-10 of it."""
    few = touches(low, t)
    while high - low > 1e-10 * low:
        middle = (low + high) / 2
        low, high = (middle, high) if touches(middle, t) == few else (low, middle)
    return low if touches(low, t) > touches(high, t) else high


def grazing(quick: bool) -> Row:
    t = np.linspace(0, 6e-3 if quick else 12e-3, 201)
    low, high = 1.0e-4, 1.3e-4
    c = grazing_clearance(t, low, high)
    p = slider_crank_parameters(c)
    return against_located("grazing", with_values(p), p, t, f"the touch vanishes within 1e-10 of c = {c:.6g} m")


def many_clearances(quick: bool) -> Row:
    clearances = np.linspace(0.05e-3, 0.5e-3, 10 if quick else 200)
    t = np.linspace(0, 12e-3, 101)
    mechanism = slider_crank()
    truths = [dop853(PROBLEM, t, slider_crank_parameters(c)) for c in clearances]
    at_middle: list[np.ndarray] = []

    def solve(rtol):
        def one(c):
            return cj.simulate(cj.replace(mechanism, {"wrist.radial_clearance": c}), t[-1], save_at=t, **options(rtol))

        solution = batched(one, jnp.asarray(clearances))
        states = frame(t, slider_crank_parameters(5e-4)[LAW])(solution.y)
        errors = np.array([worst(y, truth.y) for y, truth in zip(states, truths, strict=True)])
        at_middle.append(errors)
        return Solved(solution, float(errors.max()))

    counts = [len(truth.switchings) for truth in truths]
    row = examine(f"{clearances.size} clearances, 0.05 to 0.5 mm (batch)", 4, solve, "")
    middle = at_middle[1]
    said = (
        f"{min(counts)} to {max(counts)} switchings, each against its own reference; at rtol {row.rtols[1]:g} the "
        f"median is {np.median(middle):.0e}, 90 % are below {np.quantile(middle, 0.9):.0e}"
    )
    return row._replace(remark=said + row.remark)


CASES = (
    tiny_clearance,
    many_clearances,
    stiffer(1e3, 12e-3),
    stiffer(1e4, 6e-3),
    grazing,
    mass_ratio,
    fast,
    folded,
)
