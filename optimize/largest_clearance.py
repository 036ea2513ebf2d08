"""The largest clearance of joint 5 of the tool-changing robot that keeps its end within a bound of where it should be:
`python -m optimize.largest_clearance`. The paper's four speeds are four conditions.
"""

import numpy as np

import clearance_jax as cj
from clearance_jax.design import Design, Limit, ToleranceProblem, time_histories
from clearance_jax.joints import fits
from clearance_jax.metrics import Peak, PositionError
from clearance_jax.report.design_figures import over_time
from clearance_jax.report.figures import save_figure
from experiments.common import SCENES, output
from experiments.publish import command, say

NAME = "joint5.radial_clearance"
BOUND = 2e-4
"""Error of the end point [m]."""
END = {"quick": 0.6, "whole": 9.0}
BEGIN_END = {
    "Velocity_1": ([0.0, 0.5, 1.0], [0.5, 1.0, 1.5]),
    "Velocity_2": ([0.0, 1.0, 2.0], [1.0, 2.0, 3.0]),
    "Velocity_3": ([0.0, 2.0, 4.0], [2.0, 4.0, 6.0]),
    "Velocity_4": ([0.0, 3.0, 6.0], [3.0, 6.0, 8.0]),
}


def problem(quick: bool) -> ToleranceProblem:
    conditions = {
        name: {"drive.joint5.begin": np.array(begin), "drive.joint5.end": np.array(end)}
        for name, (begin, end) in BEGIN_END.items()
    }
    return ToleranceProblem(
        cj.load(SCENES / "joint5_velocity_1.toml"),
        END["quick" if quick else "whole"],
        {NAME: (1e-5, 1e-3)},
        [Limit(Peak(PositionError("end")), BOUND)],
        conditions={"Velocity_1": conditions["Velocity_1"]} if quick else conditions,
    )


def standard_fit(design: Design) -> str:
    """The loosest common fit whose greatest clearance the design allows, and where in its range errors stay bounded."""
    radius = float(cj.parameters(design.mechanism)["joint5.pin_radius"].value)
    clearance = design.clearances[NAME]
    allowed = fits.fits_within(2 * radius, clearance)
    if not allowed:
        return f"No common fit of {2e3 * radius:g} mm has a radial clearance within {clearance * 1e3:.4f} mm."
    return f"Nearest common fit: {allowed[0]}"


def main(quick: bool = False) -> Design:
    design = problem(quick).solve()
    say(design)
    say(standard_fit(design))
    say(design.verify(sweep=8 if quick else 40))
    save_figure(over_time(*time_histories(design)), output(f"largest_clearance{'_quick' if quick else ''}.png"))
    return design


if __name__ == "__main__":
    command(main, __doc__, "one speed, the start only")
