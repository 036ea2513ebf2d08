"""The largest radial clearance of joint 5 of the tool-changing robot in space that keeps its end within 0.2 mm, and
within 0.5 mm, with 0.1 mm of axial play: `python -m optimize.tool_changer`.

The sleeve is 60 mm long. The end of the robot lies 177 mm from its axis, so a tilt of the pin moves the end too. The
pin starts at rest at its wall; the span is that of the first and fastest swing (Velocity_1 of the paper's Table 2).
`clearance run` with `optimize/studies/tool_changer.toml` solves the same problem for 0.2 mm.
"""

import dataclasses
from pathlib import Path

from clearance_jax.design import Design, ToleranceProblem, findings, static_weights
from clearance_jax.design.judge.static import static_error
from clearance_jax.io.study.study import Study, load_study
from clearance_jax.parameters import replace
from clearance_jax.report.design_figures import over_time, pin_in_sleeve
from clearance_jax.report.figures import save_figure
from clearance_jax.report.html import write_report
from experiments.common import output
from experiments.publish import command, say

STUDY = Path(__file__).parent / "studies" / "tool_changer.toml"
NAME = "joint5.radial_clearance"
# A fine bound on the end's error and a coarse one [m].
BOUNDS = (2e-4, 5e-4)


def static_bound(design: Design) -> str:
    """What the geometry of the play alone allows at the designed clearance."""
    mechanism, asked = replace(design.mechanism, design.clearances), design.specification
    weights = static_weights(mechanism, "end", asked.t1, samples=11)
    parts = ", ".join(f"{name}: {weight:.4f}" for name, weight in weights.items())
    moved = 1e3 * static_error(mechanism, weights)
    return f"Of the end, per clearance: {parts}; so play alone may move it by {moved:.4f} mm."


def within(asked: ToleranceProblem, bound: float) -> ToleranceProblem:
    """The same question with another bound of its limit [m]."""
    known = asked.specification
    (limit,) = known.limits
    limits = [dataclasses.replace(limit, bound=bound)]
    return ToleranceProblem(
        known.mechanism, known.t1, known.variables, limits, fidelity=known.fidelity, **known.options
    )


def report(design: Design, verify: dict, bound: float, study: Study) -> None:
    """Its certificate, the nearest fit, a page and figures."""
    certificate = design.verify(**verify)
    say(certificate)
    found = findings(design, certificate, lambda step: print(step, flush=True))
    if found.fits is not None:
        say(found.fits)
    name = f"tool_changer_{1e3 * bound:g}mm"
    write_report(found, output(f"{name}.html"), study.name, study.text)
    save_figure(over_time(found.time_histories[0]), output(f"{name}_error.png"))
    save_figure(pin_in_sleeve(found.motions[""], "joint5"), output(f"{name}_pin.png"))


def main(quick: bool = False) -> list[Design]:
    study, designs = load_study(STUDY), []
    asked = study.design
    assert asked is not None
    for bound in BOUNDS[:1] if quick else BOUNDS:
        print(f"The end within {1e3 * bound:g} mm:", flush=True)
        design = within(asked.problem, bound).solve(**asked.solve)
        say(f"The end within {1e3 * bound:g} mm.", design)
        say(static_bound(design))
        if not quick:
            report(design, asked.verify, bound, study)
        designs.append(design)
    return designs


if __name__ == "__main__":
    command(main, __doc__, "the design alone")
