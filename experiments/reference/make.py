"""Compute the reference solutions with both integrators: `python -m experiments.reference.make` (ten minutes).

The states of every case, then the derivatives of the slider-cranks. Both store what extrapolation in extended precision
gives, rounded to double, together with how well another method agrees with it.
"""

import time
from pathlib import Path

import numpy as np

from experiments.reference.located import dop853, gbs
from experiments.reference.problems import LAW, PROBLEMS, Array, joint5_parameters, slider_crank_parameters
from experiments.reference.variational import force_jumps, solve_differences, solve_double, solve_extended, split

DATA = Path(__file__).parent / "data"
REVOLUTION = 2 * np.pi / slider_crank_parameters(1e-3)[LAW]

# name -> (problem, output times, parameters)
CASES: dict[str, tuple[str, Array, Array]] = {
    **{
        f"slider_crank_{c}mm": ("slider_crank", np.linspace(0, REVOLUTION, 201), slider_crank_parameters(c * 1e-3))
        for c in (0.5, 0.2, 0.1)
    },
    **{
        f"joint5_mu{mu}": ("joint5", np.linspace(0, 3, 3001), joint5_parameters(clearance=1e-4, mu=mu))
        for mu in (0.0, 0.3, 0.5)
    },
}


def load(name: str) -> dict[str, Array]:
    """One case: `t`, `y` (row k at t[k]), `params`, `switchings` (rows: time, margin that ended, contact state after)
    and `agreement`, the largest difference between the two integrators over the largest magnitude, per state.
    """
    with np.load(DATA / f"{name}.npz") as file:
        return dict(file)


VARIATIONS = tuple(name for name, (kind, _, _) in CASES.items() if kind == "slider_crank")


def load_variation(name: str) -> dict[str, Array]:
    """Derivatives of one slider-crank: `t`, `y` (row k at t[k]), `dy` (time, state, parameter), the parameters being
    clearance [m], friction and stiffness [N/m^1.5] in this order, `params`, and `agreement` (state, parameter): largest
    difference over time to the extrapolated central differences, over the entry's largest magnitude over time.
    """
    with np.load(DATA / f"{name}_variation.npz") as file:
        return dict(file)


def make(name: str) -> None:
    """Solve one case twice, write the solution in extended precision rounded to double, print how well they agree."""
    kind, t, p = CASES[name]
    clock = time.perf_counter()
    double = dop853(PROBLEMS[kind], t, p)
    middle = time.perf_counter()
    extended = gbs(PROBLEMS[kind], t, p)
    end = time.perf_counter()
    agreement = np.max(np.abs(double.y - extended.y), axis=0) / np.max(np.abs(extended.y), axis=0)
    if len(double.switchings) != len(extended.switchings):
        raise RuntimeError(
            f"{name}: {len(double.switchings)} switchings by DOP853, but {len(extended.switchings)} by extrapolation."
        )
    np.savez_compressed(
        DATA / f"{name}.npz", t=t, y=extended.y, params=p, switchings=extended.switchings, agreement=agreement
    )
    apart = np.max(np.abs(double.switchings[:, 0] - extended.switchings[:, 0]))
    print(
        f"{name:20s} switchings {len(extended.switchings):3d} (apart by {apart:.0e} s)   "
        f"agreement {' '.join(f'{a:.0e}' for a in agreement)}   "
        f"DOP853 {double.steps} steps {middle - clock:.1f} s, GBS {extended.steps} steps {end - middle:.1f} s",
        flush=True,
    )
    print(f"{'':20s} y(T) = {' '.join(f'{v:.17g}' for v in extended.y[-1])}", flush=True)


def make_variation(name: str) -> None:
    """Derivatives of one case in three ways. Stored is extrapolation on the variational equations, extended precision.

    In double, the round-off of d = |e| - c (1e-17 m against some 1e-6) reaches the force's gradient and leaves 1e-9;
    differences divide the state's error by their step. They are the check, for they never see those equations.
    """
    _, t, p = CASES[name]
    clock = time.perf_counter()
    double, extended = solve_double(t, p), solve_extended(t, p)
    middle = time.perf_counter()
    differences = solve_differences(t, p)
    end = time.perf_counter()
    y, dy = split(extended.y)
    largest = np.max(np.abs(dy), axis=0)
    agreement = np.max(np.abs(differences - dy), axis=0) / largest
    in_double = np.max(np.abs(split(double.y)[1] - dy), axis=0) / largest
    at_end = np.abs(differences - dy)[-1] / largest
    np.savez_compressed(DATA / f"{name}_variation.npz", t=t, y=y, dy=dy, params=p, agreement=agreement)
    print(
        f"{name:20s} derivatives by c, mu, K   force jumps {max(force_jumps(p).values()):.0e}   "
        f"equations {extended.steps} steps {middle - clock:.1f} s, differences {end - middle:.1f} s"
    )
    for label, error in (("differences", agreement), ("at the end", at_end), ("DOP853", in_double)):
        print(f"{'':20s} {label:12s} {'  '.join(f'{e:.0e}' for e in np.max(error, axis=0))}")
    for column, values in zip(("c", "mu", "K"), dy[-1].T, strict=True):
        print(f"{'':20s} dy/d{column:3s} = {' '.join(f'{v:.17g}' for v in values)}", flush=True)


def main() -> None:
    """All cases."""
    DATA.mkdir(exist_ok=True)
    for name in CASES:
        make(name)
    for name in VARIATIONS:
        make_variation(name)


if __name__ == "__main__":
    main()
