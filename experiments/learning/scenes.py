"""Adjoint derivatives on random scenes, beside forward ones: `python -m experiments.learning.scenes` writes
out/learning_scenes.md.

Ten scenes in the plane and two arms with sleeves in space each have ten variants: every number of a body, a play and a
law is drawn within 10 % of its own, and the end of the motion within its last third. The metrics are the place and the
velocity of a point at the end. Their derivatives are by factors on all these numbers. *Forward* are controlled
derivatives. The truth is forward derivatives at an `rtol` of 1e-10; its own error is what they change to 1e-11. An
error is the largest one of a metric's derivatives, over the largest of them. *Covered* are derivatives, by metric and
number, whose error is at most the one that `cj.sensitivities` states beside an adjoint. Those are left out whose error
is not ten times as large as the truth's own. In the four-bar the impacts amplify changes by up to a million, so that
all errors are larger.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from experiments.common import SCENES, output, table
from experiments.publish import command, say

RTOL, TIGHT, TIGHTER = 1e-7, 1e-10, 1e-11
VARIANTS, SPREAD = 10, 0.1
POINTS = {
    "slider_crank": "piston",
    "slider_crank_two_clearances": "piston",
    "four_bar": "tip",
    "four_bar_loaded": "tip",
    "arm": "tip",
    "press": "die",
    "five_bar": "tool",
    "scara": "spindle",
    "governor": "weight",
    "bearing": "shaft",
    "ur5_play": "tool",
    "arm_with_play": "tcp",
}
"""The scenes, each with the point that is looked at."""
SLEEVES = ("ur5_play", "arm_with_play")
"""Those in space: with axial play in one sleeve, with radial play in three."""
MOVED = ("mass", "inertia", "radial_clearance", "axial_clearance", "pin_radius")
MOVED += ("coefficient", "stiffness", "damping", "damping_factor")
"""The last words of the names that are varied."""
LONGEST, LONGEST_OF_SLEEVES = 0.03, 0.01
"""The longest motions [s]."""
REQUIRED = 0.95
"""Share of derivatives that the stated error must cover."""


class Row(NamedTuple):
    """A variant: its scene; how many numbers; by metric the errors of both kinds of derivatives, and of the truth; how
    many derivatives there are, and how many of their errors are covered.
    """

    scene: str
    numbers: int
    adjoint: np.ndarray
    forward: np.ndarray
    truth: np.ndarray
    derivatives: int
    covered: int


@cache
def ends(point: str, axes: str = "xy") -> Callable:
    """Place and velocity of a point at the end, one function for all variants of a scene."""
    names = [f"{point}.{of}.{axis}" for of in ("position", "velocity") for axis in axes]
    return lambda solution: jnp.stack([solution[name] for name in names])


def variant(scene: str, seed: int) -> tuple[Any, dict[str, float], float]:
    """A mechanism, its numbers that are drawn, and the end of the motion."""
    rng, mechanism = np.random.default_rng(seed), cj.load(SCENES / f"{scene}.toml")
    known = {name: leaf for name, leaf in cj.parameters(mechanism).items() if name.split(".")[-1] in MOVED}
    values = {name: float(leaf.value) for name, leaf in known.items() if np.ndim(leaf.value) == 0}
    values = {name: value * rng.uniform(1 - SPREAD, 1 + SPREAD) for name, value in values.items() if value != 0}
    longest = LONGEST_OF_SLEEVES if scene in SLEEVES else LONGEST
    return cj.replace(mechanism, values), values, longest * rng.uniform(2 / 3, 1)


def measured(scene: str, seed: int) -> Row:
    """One variant."""
    moved, values, t1 = variant(scene, seed)
    metric = ends(POINTS[scene], "xyz" if scene in SLEEVES else "xy")

    def solved(mode, rtol):
        return cj.sensitivities(moved, metric, list(values), t1, mode=mode, rtol=rtol, solver="dopri8")

    def scaled(found):
        return np.stack([np.asarray(found[name]) * value for name, value in values.items()], -1)

    backwards = solved("adjoint", RTOL)
    adjoint, stated = scaled(backwards.jacobian), np.abs(scaled(backwards.error))
    forward, truth, finer = (scaled(solved("controlled", rtol).jacobian) for rtol in (RTOL, TIGHT, TIGHTER))
    sizes = np.max(np.abs(truth), axis=1)
    # Axes along which a point cannot move have no derivatives but round-off.
    seen = sizes > 1e-6 * np.max(sizes)
    errors = [np.max(np.abs(one - truth), axis=1)[seen] / sizes[seen] for one in (adjoint, forward, finer)]
    resolved = seen[:, None] & (np.abs(finer - truth) < 0.1 * np.abs(adjoint - truth))
    covered = np.abs(adjoint - truth) <= stated
    return Row(
        scene, len(values), errors[0], errors[1], errors[2], int(np.sum(resolved)), int(np.sum(resolved & covered))
    )


def main(quick: bool = False) -> list[Row]:
    scenes, count = (list(POINTS)[:2], 1) if quick else (list(POINTS), VARIANTS)
    rows = [measured(scene, seed) for scene in scenes for seed in range(count)]
    lines = []
    for scene in scenes:
        own = [row for row in rows if row.scene == scene]
        worst = [max(float(np.max(getattr(row, kind))) for row in own) for kind in ("adjoint", "forward", "truth")]
        middle = float(np.median([np.max(row.adjoint) for row in own]))
        share = f"{sum(row.covered for row in own)} of {sum(row.derivatives for row in own)}"
        lines.append((scene, own[0].numbers, f"{middle:.1e}", *(f"{x:.1e}" for x in worst), share))
    heads = "scene", "numbers", "adjoint, median", "adjoint, largest", "forward, largest", "truth", "covered"
    say(f"Relative errors of derivatives at rtol {RTOL:.0e}, {count} variants of each scene.")
    table(heads, lines, output(f"learning_scenes{'_quick' if quick else ''}.md"))
    derivatives, covered = sum(row.derivatives for row in rows), sum(row.covered for row in rows)
    verdict = "Holds" if covered >= REQUIRED * derivatives else "NOT HELD"
    say(f"{verdict}: the stated error covers {covered} of {derivatives} derivatives; required: {REQUIRED:.0%}.")
    return rows


if __name__ == "__main__":
    command(main, __doc__, "one variant of two scenes")
