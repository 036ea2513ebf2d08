"""Two designs that a solver alone would answer wrongly: `python -m optimize.treacherous`.

Docking: only the error at one instant counts, and how far the pin has bounced by then turns with the clearance: designs
that hold come in islands. Rattling: the motion is chaotic, and its derivatives grow without meaning.
"""

from typing import NamedTuple

import clearance_jax as cj
from clearance_jax.design import Certificate, Design, Limit, ToleranceProblem
from clearance_jax.metrics import At, Peak, PositionError
from experiments.common import SCENES
from experiments.publish import command, say

INSTANT, BOUND = 2e-3, 1e-4
SPEED, RATTLE, RATTLE_BOUND = 60.0, 0.05, 2e-4
"""Of the crank [rad/s]; end time [s]; of the largest error [m]."""
STARTS = 4


def docking() -> ToleranceProblem:
    return ToleranceProblem(
        cj.load(SCENES / "slider_crank.toml"),
        INSTANT,
        {"wrist.radial_clearance": (2e-5, 1e-3)},
        [Limit(At(PositionError("piston"), [INSTANT]), BOUND, "piston at the instant of docking")],
    )


def rattling() -> ToleranceProblem:
    mechanism = cj.load(SCENES / "slider_crank_two_clearances.toml")
    names = ("crankpin.radial_clearance", "wrist.radial_clearance")
    return ToleranceProblem(
        cj.replace(mechanism, {"drive.main.speed": SPEED}),
        RATTLE,
        dict.fromkeys(names, (1e-5, 5e-4)),
        [Limit(Peak(PositionError("piston")), RATTLE_BOUND, "piston")],
    )


class Found(NamedTuple):
    """The docking design with its certificate, and the rattling one (not in quick mode)."""

    docking: Design
    certificate: Certificate
    rattling: Design | None


def main(quick: bool = False) -> Found:
    design = docking().solve(starts=1 if quick else STARTS)
    say(design)
    certificate = design.verify(sweep=24 if quick else 80)
    say(certificate)
    if quick:
        return Found(design, certificate, None)
    # What is found without gradients holds in its own simulation; another solver's motion parts from it all the same.
    chaotic = rattling().solve("auto")
    say(chaotic)
    say(chaotic.verify())
    return Found(design, certificate, chaotic)


if __name__ == "__main__":
    command(main, __doc__, "the docking only, one start, a coarse sweep")
