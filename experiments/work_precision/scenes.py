"""The ten scenes: what moves, from which state, for how long, and the reference of each.

Four scenes are written by hand in numba as well (`experiments.reference`), with stored references that share no code
with the library. The reference of the other scenes is the library's own: dopri8 at rtol `OWN_RTOL`. How far tsit5 at
`CHECK_RTOL` is from it says how far it can be trusted.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.tolerances import tolerances
from experiments.common import CRANK_SPEED, SCENES, joint5, slider_crank
from experiments.play_in_space import BARREL, arm

# Read without `experiments.reference`, which needs numba.
DATA = Path(__file__).parents[1] / "reference" / "data"
SAMPLES = 201
OWN_RTOL, CHECK_RTOL, SLOPE_RTOL = 1e-12, 1e-11, 1e-11
SPACE_SLOPE_RTOL = 1e-10
FLOOR = 1e-3
"""A state that never exceeds this share of its unit is judged by the share."""
CRANKS, LINKAGES, RESTING, SPACE = "crank", "linkage", "resting", "space"
CLASSES = {
    CRANKS: "a slider-crank at high speed (plane, many short impacts)",
    LINKAGES: "a linkage with loops and one joint with play (plane)",
    RESTING: "a heavy body whose pin rests and slides in its sleeve (plane)",
    SPACE: "a robot with sleeves (space)",
}


class Scene(NamedTuple):
    """A scene: its class, what it is, until when [s], whose contact force and by which clearance is asked; where it has
    a hand-written twin, that one's problem and case.
    """

    name: str
    of: str
    make: Callable[[], cj.Mechanism]
    t1: float
    joint: str
    clearance: str
    twin: str = ""
    case: str = ""
    start: str = "centre"


def _crank(clearance: float) -> cj.Mechanism:
    return cj.replace(slider_crank(), {"wrist.radial_clearance": clearance})


def _joint5(mu: float) -> cj.Mechanism:
    return cj.replace(joint5(), {"joint5.friction.coefficient": mu})


def _squeezer() -> cj.Mechanism:
    return cj.load(SCENES / "squeezer.toml").with_clearance("knot_4", radial_clearance=5e-5, pin_radius=2e-3)


def _file(name: str) -> Callable[[], cj.Mechanism]:
    return lambda: cj.load(SCENES / f"{name}.toml")


WRIST, PLAY5 = ("wrist", "wrist.radial_clearance"), ("joint5", "joint5.radial_clearance")
TURN = 2 * np.pi / CRANK_SPEED
ALL = (
    Scene("slider-crank, 0.5 mm", CRANKS, lambda: _crank(5e-4), TURN, *WRIST, "slider_crank", "slider_crank_0.5mm"),
    Scene("slider-crank, 0.1 mm", CRANKS, lambda: _crank(1e-4), TURN, *WRIST, "slider_crank", "slider_crank_0.1mm"),
    Scene("slider-crank, two clearances", CRANKS, _file("slider_crank_two_clearances"), TURN, *WRIST),
    Scene("four-bar", LINKAGES, _file("four_bar"), 0.01, "knuckle", "knuckle.radial_clearance"),
    Scene("squeezer", LINKAGES, _squeezer, 8e-3, "knot_4", "knot_4.radial_clearance"),
    Scene("joint 5, no friction", RESTING, lambda: _joint5(0.0), 0.5, *PLAY5, "joint5", "joint5_mu0.0"),
    Scene("joint 5, mu = 0.3", RESTING, lambda: _joint5(0.3), 0.5, *PLAY5, "joint5", "joint5_mu0.3"),
    Scene("tool changer", SPACE, _file("tool_changer"), 0.1, *PLAY5),
    Scene(
        "arm, three sleeves",
        SPACE,
        _file("arm_with_play"),
        0.01,
        "axis_5",
        "axis_5.radial_clearance",
        "",
        "",
        "settled",
    ),
    Scene(
        "arm, six sleeves",
        SPACE,
        lambda: arm("123456", BARREL),
        5e-3,
        "axis_5",
        "axis_5.radial_clearance",
        "",
        "",
        "settled",
    ),
)


def stored(name: str) -> dict[str, np.ndarray]:
    """A stored reference (see `experiments.reference.make`)."""
    with np.load(DATA / f"{name}.npz") as file:
        return dict(file)


class Case:
    """A scene as it is solved: every tool starts from `y0` (n,) and gives the states at `times` (samples,).

    - `turned`: what is added to the library's states to have those of the hand-written twin, (samples, n).
    - `unit`: the states' units, which the absolute tolerances of all tools follow, (n,).
    - `truth`, `peak`, `slope`: states (samples, n), largest contact force at the samples [N], and the derivative of the
      last states by the clearance, (n,); `slope_size`: the largest that each had until then.
    """

    def __init__(self, scene: Scene):
        self.scene, self.mechanism = scene, scene.make()
        self.positions = layout(self.mechanism).q
        self.clearance = float(cj.parameters(self.mechanism)[scene.clearance].value)
        self.stored = stored(scene.case) if scene.case else {}
        times = self.stored.get("t", np.linspace(0, scene.t1, SAMPLES))
        self.times = times[times <= scene.t1 * (1 + 1e-12)]
        first = cj.simulate(self.mechanism, scene.t1 * 1e-6, rtol=1e-6, start=scene.start, energy_balance=False)
        self.template = first
        self.y0 = np.array(first.initial)
        self.turned = np.zeros((len(self.times), len(self.y0)))
        if scene.twin == "slider_crank":
            self.turned[:, 0], self.turned[:, 2] = CRANK_SPEED * self.times, CRANK_SPEED
        prepared = self.mechanism.prepare()
        allowed = tolerances(Problem(prepared), *map(jnp.asarray, (self.y0, 0.0, scene.t1, 1.0)))
        self.unit = np.asarray(allowed.unit)

    def set_truth(self, run: Callable[..., Any], check: Callable[..., Any], sloped: Callable[..., Any]) -> None:
        """The reference, and how far it can be trusted (`trust`, of the worst state; `slope_trust`).

        **Arguments:** solves of this scene as functions of rtol: `run` by dopri8, `check` by tsit5; `sloped` by the
        dearest solver with derivatives.
        """
        if self.stored:
            self.truth = self.stored["y"][: len(self.times)] - self.turned
            self.trust = float(self.stored["agreement"].max())
        else:
            self.truth = np.asarray(run(OWN_RTOL)[0])
            self.trust = float(self.state_errors(np.asarray(check(CHECK_RTOL)[0])).max())
        if self.scene.twin == "slider_crank":
            known = stored(f"{self.scene.case}_variation")
            slopes, self.slope_trust = known["dy"][:, :, 0], float(known["agreement"][:, 0].max())
            self._set_slope(slopes)
        else:
            rtol = SPACE_SLOPE_RTOL if self.scene.of == SPACE else SLOPE_RTOL
            slopes, looser = (np.asarray(sloped(r)[1]) for r in (rtol, 10 * rtol))
            self._set_slope(slopes)
            self.slope_trust = self.slope_error(looser[-1])
        self.peak = self.force(self.truth)

    def _set_slope(self, slopes: np.ndarray) -> None:
        self.slope, self.slope_size = slopes[-1], np.maximum(np.abs(slopes).max(0), 1e-300)

    @cached_property
    def _force(self) -> Callable[[Any], Any]:
        name = f"{self.scene.joint}.contact_force"
        template = self.template

        def of(y):
            seen = dataclasses.replace(template, time=jnp.asarray(self.times), y=y, energy_balance=False, sampled=True)
            return jnp.max(jnp.abs(seen[name]))

        return of

    def force(self, y: np.ndarray) -> float:
        """The largest contact force of states at the samples [N]."""
        return float(self._force(jnp.asarray(y)))

    def state_errors(self, y: np.ndarray) -> np.ndarray:
        """The largest error of each state over the samples, relative to its largest magnitude."""
        size = np.maximum(np.abs(self.truth + self.turned).max(0), FLOOR * self.unit)
        return np.abs(y - self.truth).max(0) / size

    def slope_error(self, slope: np.ndarray) -> float:
        """The largest error of the derivative at the end, relative to each component's largest magnitude over time."""
        return float(np.max(np.abs(slope - self.slope) / self.slope_size))
