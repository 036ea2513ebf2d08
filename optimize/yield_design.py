"""The largest designed clearance of joint 5 at which 99 % of the robots that are made keep their end within 0.2 mm:
`python -m optimize.yield_design`. Clearances, stiffnesses and payloads scatter from one robot to the next.
"""

import time

import clearance_jax as cj
from clearance_jax.design import Design, Limit, ToleranceProblem, Yield, YieldEstimate
from clearance_jax.metrics import Peak, PositionError
from clearance_jax.report.design_figures import convergence
from clearance_jax.report.figures import save_figure
from experiments.common import SCENES, output
from experiments.publish import command, say

NAME = "joint5.radial_clearance"
BOUND = 2e-4
END = 0.3
"""The end falls into its bearing and swings: the largest error comes early [s]."""
SCATTER = {NAME: 0.05, "joint5.normal.stiffness": 0.1, "payload.mass": 0.02}
TARGET = 0.99
FRESH = {"quick": 1000, "whole": 10_000}


def problem() -> ToleranceProblem:
    return ToleranceProblem(
        cj.load(SCENES / "joint5_velocity_1.toml"),
        END,
        {NAME: (1e-5, 1e-3)},
        [Limit(Peak(PositionError("end")), BOUND)],
        manufacture=Yield(SCATTER, TARGET),
    )


def main(quick: bool = False) -> tuple[Design, YieldEstimate]:
    clock = time.perf_counter()
    design = problem().solve()
    say(design)
    say(f"{time.perf_counter() - clock:.0f} s")
    clock = time.perf_counter()
    found = design.yield_estimate(FRESH["quick" if quick else "whole"])
    say(found)
    say(f"{time.perf_counter() - clock:.0f} s")
    save_figure(convergence(design), output(f"yield_design{'_quick' if quick else ''}.png"))
    if not quick:
        say(design.verify(sweep=8))
    return design, found


if __name__ == "__main__":
    command(main, __doc__, "fewer samples")
