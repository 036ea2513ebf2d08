"""Cases that are difficult for contact solvers: `python -m experiments.hard_cases` writes out/hard_cases.md.

The error is that of the worst state over all saved times, relative to the largest magnitude of this state. If a
reference problem covers the case, the reference is `experiments.reference`: an integrator that locates every event and
shares no code with the library. Otherwise it is this library's Dopri8 at rtol 1e-12 ("own"). Impacts amplify errors.
The column beside the error has the error at a hundredth of the tolerance. It shows whether an error is amplified (it
falls with the tolerance) or is a floor (it does not). "Energy" is the residual of the energy balance.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import SCENES, as_reference, error, joint5, output, slider_crank, table
from experiments.publish import command
from experiments.reference.located import dop853
from experiments.reference.problems import (
    CLEARANCE,
    LAW,
    PROBLEMS,
    STIFFNESS,
    joint5_parameters,
    slider_crank_parameters,
)

RTOL = 1e-8
TIGHTER: dict[str, Any] = {"rtol": 1e-10, "solver": "dopri8"}
SLIDER_MASS = LAW + 5


class Row(NamedTuple):
    """One case: number of states, steps taken, worst relative error, the same at `TIGHTER`, energy residual, and how
    the solve ended.
    """

    case: str
    states: int
    steps: int
    error: float
    tighter: float
    energy: float
    result: str
    remark: str


def ending(solution: cj.Solution) -> str:
    """How a solve (or a batch) ended."""
    if not np.all(np.isfinite(np.asarray(solution.y))):
        return "NOT FINITE"
    return "reached t1" if bool(np.all(np.asarray(solution.succeeded))) else "stopped"


def row(case: str, solution: cj.Solution, errors: tuple[float, float], remark: str, states: int) -> Row:
    residual = float(np.max(np.asarray(solution.energy_residual)))
    return Row(case, states, int(np.sum(solution.steps)), *errors, residual, ending(solution), remark)


def states(mechanism: cj.Mechanism) -> int:
    return 2 * len(mechanism.free_coordinates())


def compared(case: str, mechanism: cj.Mechanism, t, truth, frame, remark: str) -> Row:
    """Solve at both tolerances and compare with `truth`; `frame` takes states to the frame of the truth."""
    loose = cj.simulate(mechanism, t[-1], save_at=t, rtol=RTOL, throw=False)
    tight = cj.simulate(mechanism, t[-1], save_at=t, **TIGHTER, throw=False)
    errors = error(frame(loose.y), truth).max(), error(frame(tight.y), truth).max()
    return row(case, loose, errors, remark, states(mechanism))


def against_located(case: str, kind: str, mechanism: cj.Mechanism, p, t, remark: str) -> Row:
    """Compare with the integrator that locates every switching."""
    truth = dop853(PROBLEMS[kind], t, p)
    remark = f"{len(truth.switchings)} switchings{'; ' if remark else ''}{remark}"
    if kind == "joint5":
        return compared(case, mechanism, t, truth.y, lambda y: np.asarray(y)[:, :4], remark)
    return compared(case, mechanism, t, truth.y, lambda y: crank_frame(y, t, p[LAW]), remark)


def crank_frame(y, t, speed: float) -> np.ndarray:
    """States with the conrod's absolute angle, for any crank speed."""
    return np.asarray(y)[..., :4] + np.stack([speed * t, 0 * t, speed + 0 * t, 0 * t], -1)


def against_own(case: str, mechanism: cj.Mechanism, t, remark: str) -> Row:
    """Compare with Dopri8 at rtol 1e-12."""
    n = states(mechanism)
    truth = np.asarray(cj.simulate(mechanism, t[-1], save_at=t, rtol=1e-12, solver="dopri8").y)[:, :n]
    return compared(case, mechanism, t, truth, lambda y: np.asarray(y)[:, :n], f"own reference; {remark}")


def tiny_clearance(quick: bool) -> Row:
    p = slider_crank_parameters(1e-7)
    t = np.linspace(0, 3e-3 if quick else 12e-3, 201)
    m = cj.replace(slider_crank(), {"wrist.radial_clearance": 1e-7})
    return against_located("clearance 1e-7 m", "slider_crank", m, p, t, "")


def exact_centre(quick: bool) -> Row:
    p = joint5_parameters(1e-4, 0.3)
    t = np.linspace(0, 0.05 if quick else 0.5, 201)
    m = cj.replace(joint5(), {"joint5.friction.coefficient": 0.3})
    return against_located("pin released at the exact centre", "joint5", m, p, t, "joint 5, starts at e = 0, at rest")


def many_clearances(quick: bool) -> Row:
    clearances = np.linspace(0.05e-3, 0.5e-3, 10 if quick else 200)
    t = np.linspace(0, 12e-3, 101)
    mechanism = slider_crank()

    def solve(**options):
        def one(c):
            return cj.simulate(cj.replace(mechanism, {"wrist.radial_clearance": c}), t[-1], save_at=t, **options)

        return jax.jit(jax.vmap(one))(jnp.asarray(clearances))

    loose, tight = solve(rtol=RTOL), solve(**TIGHTER)
    errors, located = [], []
    for c, *both in zip(clearances, np.asarray(loose.y), np.asarray(tight.y), strict=True):
        truth = dop853(PROBLEMS["slider_crank"], t, slider_crank_parameters(c))
        errors.append([error(as_reference("slider_crank", y, t), truth.y).max() for y in both])
        located.append(len(truth.switchings))
    at_loose, at_tight = np.transpose(errors)
    remark = (
        f"each against its own reference ({min(located)} to {max(located)} switchings): "
        f"median {np.median(at_loose):.0e}, 90 % below {np.quantile(at_loose, 0.9):.0e}; "
        f"{np.sum(at_loose > 3000 * RTOL)} above 3000 rtol"
    )
    name = f"{clearances.size} clearances, 0.05 to 0.5 mm (batch)"
    return row(name, loose, (at_loose.max(), at_tight.max()), remark, 4)


def stiffness(quick: bool) -> Row:
    p = slider_crank_parameters(5e-4)
    p[STIFFNESS] *= 1e3
    t = np.linspace(0, 3e-3 if quick else 12e-3, 201)
    m = cj.replace(slider_crank(), {"wrist.radial_clearance": 5e-4})
    (wrist,) = (joint.clearance for joint in m.clearance_joints())
    assert wrist is not None
    assert isinstance(wrist.normal, laws.AdamsImpact)
    k = 1e3 * float(m.clearance_joints()[0].clearance.prepare().normal.constants)
    law = laws.AdamsImpact(k, wrist.normal.damping, wrist.normal.full_damping_depth)
    m = m.with_clearance("wrist", cj.RevoluteClearance(5e-4, wrist.pin_radius, law, wrist.friction))
    return against_located("stiffness x 1000", "slider_crank", m, p, t, "")


def friction_corner(quick: bool) -> Row:
    p = joint5_parameters(1e-4, 0.3, corner_speed=1e-5)
    t = np.linspace(0, 0.02 if quick else 0.2, 201)
    values = {"joint5.friction.coefficient": 0.3, "joint5.friction.transition_speed": 1e-5}
    return against_located(
        "friction corner at 1e-5 m/s", "joint5", cj.replace(joint5(), values), p, t, "joint 5, cubic law"
    )


def pin(law, clearance: float, mass: float = 0.14, friction=None) -> cj.Mechanism:
    """A pin that falls in a sleeve at rest."""
    joint = cj.RevoluteClearance(clearance, 0.01, law, friction)
    motion = cj.Motion(cj.drives.ConstantSpeed(0.0))
    return cj.Mechanism(
        bodies=(cj.Body("pin", mass),),
        joints=(cj.Revolute("joint", "ground", "pin", motion=motion, clearance=joint),),
        gravity=cj.Gravity(y=-9.81),
    )


def resting(quick: bool) -> Row:
    law = laws.HuntCrossley(6.61e10, 100.0)
    m, exact = pin(law, 1e-4), (0.14 * 9.81 / 6.61e10) ** (2 / 3)
    end = 2.0 if quick else 60.0
    loose = cj.simulate(m, end, rtol=RTOL, throw=False)
    tight = cj.simulate(m, end, **TIGHTER, throw=False)
    errors = [abs((-float(s["joint.play_y"]) - 1e-4) / exact - 1) for s in (loose, tight)]
    return row(
        "pin resting in the sleeve for 60 s", loose, (errors[0], errors[1]), "penetration against (W/K)^(2/3)", 4
    )


def two_contacts(quick: bool) -> Row:
    m = cj.load(SCENES / "slider_crank_two_clearances.toml")
    t = np.linspace(0, 2e-3 if quick else 12e-3, 201)
    seen = cj.to_dataset(m, cj.simulate(m, t[-1], save_at=t, rtol=RTOL))
    both = float(np.mean(np.all(seen["penetration"].values > 0, axis=1)))
    return against_own("two clearance joints", m, t, f"both in contact in {both:.0%} of the samples")


def bouncing(quick: bool) -> Row:
    impacts = 5 if quick else 100
    clearance = 1e-3
    m = pin(laws.Hertz(6.61e10), clearance)
    # From the centre the pin falls through the clearance and comes back: one impact every 2 sqrt(2 c / g).
    end = 2 * np.sqrt(2 * clearance / 9.81) * (impacts + 0.25)

    def drift(result):
        y = np.asarray(result.solution.y)
        d = np.maximum(-y[:, 1] - clearance, 0)
        total = 0.14 * (0.5 * y[:, 3] ** 2 + 9.81 * y[:, 1]) + 6.61e10 * d**2.5 / 2.5
        return np.abs(total - total[0]).max() / (0.14 * 9.81 * clearance)

    loose, tight = (cj.trace(m, end, save_at=101, **o) for o in ({"rtol": RTOL}, TIGHTER))
    count = cj.to_dataset(m, tight).sizes["episode"]
    remark = f"change of energy over m g c; {count} impacts counted"
    return row(f"undamped bouncing, {impacts} impacts", loose.solution, (drift(loose), drift(tight)), remark, 4)


def mass_ratio(quick: bool) -> Row:
    p = slider_crank_parameters(5e-4)
    p[LAW] /= 100
    p[SLIDER_MASS] = 0.21e5
    t = np.linspace(0, 0.1 if quick else 1.2, 201)
    values = {"wrist.radial_clearance": p[CLEARANCE], "drive.main.speed": p[LAW], "slider.mass": p[SLIDER_MASS]}
    m = cj.replace(slider_crank(), values)
    return against_located("mass ratio 1e5 (slider over conrod)", "slider_crank", m, p, t, "50 rpm")


def chaos(quick: bool) -> Row:
    speed = 20_000 * 2 * np.pi / 60
    lanes, turns = (4, 4) if quick else (32, 40)
    mechanism = cj.replace(slider_crank(), {"drive.main.speed": speed})
    t = np.linspace(0, turns * 2 * np.pi / speed, 50 * turns + 1)
    clearances = 5e-4 * (1 + 1e-6 * np.linspace(-1, 1, lanes))
    means, last = [], None
    for solver in ("tsit5", "dopri8"):

        def solve(c, solver=solver):
            changed = cj.replace(mechanism, {"wrist.radial_clearance": c})
            return cj.simulate(changed, t[-1], save_at=t, rtol=RTOL, solver=solver)

        last = jax.jit(jax.vmap(solve))(jnp.asarray(clearances))
        y = crank_frame(last.y, t, speed)
        crank = speed * t
        ex = y[..., 1] - 0.05 * np.cos(crank) - 0.12 * np.cos(y[..., 0])
        ey = -0.05 * np.sin(crank) - 0.12 * np.sin(y[..., 0])
        # Samples of one turn depend on each other, turns after the first few hardly: one mean per lane.
        means.append(np.hypot(ex, ey)[:, 50 * (turns // 4) :].mean(1) / 5e-4)
        spread = np.ptp(y[:, -1, 1]) / 5e-4
    (a, b), n = means, lanes
    sigma = np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / n)
    assert last is not None
    remark = (
        f"{'CHAOTIC' if spread > 1e-3 else 'not chaotic here'}: clearances 1e-6 apart end {spread:.1g} c apart after "
        f"{turns} turns; the error is that of the mean eccentricity, Tsit5 against "
        f"Dopri8, {abs(a.mean() - b.mean()) / sigma:.1f} standard errors"
    )
    return row("crank at 20 000 rpm", last, (abs(a.mean() - b.mean()) / a.mean(), np.nan), remark, 4)


CASES: tuple[Callable[[bool], Row], ...] = (
    tiny_clearance,
    exact_centre,
    many_clearances,
    stiffness,
    friction_corner,
    resting,
    two_contacts,
    bouncing,
    mass_ratio,
    chaos,
)


def main(quick: bool = False, cases: Any = None) -> list[Row]:
    rows = []
    for case in CASES if cases is None else cases:
        rows.append(case(quick))
        print(f"{rows[-1].case}: error {rows[-1].error:.1e}", flush=True)
    table(
        ("case", "states", "steps", "error", "error at rtol 1e-10", "energy", "result", "remark"),
        [
            (r.case, r.states, r.steps, *(f"{x:.1e}" for x in (r.error, r.tighter, r.energy)), r.result, r.remark)
            for r in rows
        ],
        output(f"hard_cases{'_quick' if quick else ''}.md"),
    )
    return rows


if __name__ == "__main__":
    command(main, __doc__)
