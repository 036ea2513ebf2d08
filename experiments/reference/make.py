"""Compute the reference solutions with both integrators: `python -m experiments.reference.make` (about 3 minutes)."""

import time
from pathlib import Path

import numpy as np

from experiments.reference.located import dop853, gbs
from experiments.reference.problems import LAW, PROBLEMS, Array, joint5_parameters, slider_crank_parameters

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


def main() -> None:
    """All cases."""
    DATA.mkdir(exist_ok=True)
    for name in CASES:
        make(name)


if __name__ == "__main__":
    main()
