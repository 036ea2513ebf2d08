"""The cheapest clearances of a slider-crank's two pins that keep the piston within 0.2 mm of where it should be:
`python -m optimize.allocate_slider_crank`. Solvers with and without gradients, from several starts, and a certificate.
"""

import argparse
from typing import NamedTuple

import clearance_jax as cj
from clearance_jax.design import Design, Limit, Reciprocal, ToleranceProblem
from clearance_jax.metrics import Peak, PositionError
from experiments.common import SCENES, output, table

COSTS = {"crankpin.radial_clearance": 2e-4, "wrist.radial_clearance": 1e-4}
"""Cost times clearance [m]: the crankpin is dearer to make."""
BOUND = 2e-4
SPEED = 60.0
"""Of the crank [rad/s]."""
METHODS = ("slsqp", "augmented-lagrangian", "cobyqa")
STARTS = 3


class Row(NamedTuple):
    """What a method found."""

    method: str
    design: Design


def problem(quick: bool) -> ToleranceProblem:
    mechanism = cj.replace(cj.load(SCENES / "slider_crank_two_clearances.toml"), {"drive.main.speed": SPEED})
    revolution = 2 * 3.141592653589793 / SPEED
    return ToleranceProblem(
        mechanism,
        0.1 * revolution if quick else revolution,
        dict.fromkeys(COSTS, (1e-5, 5e-4)),
        [Limit(Peak(PositionError("piston")), BOUND)],
        cost={name: Reciprocal(factor) for name, factor in COSTS.items()},
    )


def main(quick: bool = False) -> list[Row]:
    asked = problem(quick)
    rows = []
    for method in METHODS[:1] if quick else METHODS:
        rows.append(Row(method, asked.solve(method, starts=1 if quick else STARTS)))
        print(rows[-1].design, flush=True)
    table(
        ("method", *COSTS, "cost", "evaluations with gradients", "without"),
        [
            (
                r.method,
                *(f"{1e3 * r.design.clearances[name]:.5f} mm" for name in COSTS),
                f"{r.design.objective:.6f}",
                r.design.program.gradients,
                r.design.program.evaluations,
            )
            for r in rows
        ],
        output(f"allocate_slider_crank{'_quick' if quick else ''}.md"),
    )
    best = min(rows, key=lambda r: r.design.objective)
    print(best.design.verify(sweep=8 if quick else 40, reoptimise=not quick))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of a revolution, one solver")
    cj.configure(cache=True)
    main(parser.parse_args().quick)
