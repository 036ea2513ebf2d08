"""Numbers that are no weights: parameters of the slider-crank, and via points of its drive."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from experiments.common import CRANK_SPEED, slider_crank
from experiments.learning.models import END, TIMES

PARAMETERS = (
    "wrist.radial_clearance",
    "wrist.friction.coefficient",
    "slider.mass",
    "wrist.pin_radius",
    "wrist.normal.damping",
    "wrist.normal.full_damping_depth",
    "wrist.friction.transition_speed",
    "wrist.at_parent.x",
    "crankpin.at_parent.x",
    "conrod.mass",
    "conrod.inertia",
    "conrod.center_of_mass.x",
    "drive.main.speed",
)
FEW = 3
VIA = np.linspace(0.0, END, 22)
"""Times of the via points [s]."""

Questions = dict[str, tuple[Callable[[str], Callable], Any, Any]]
"""By title: the loss for a kind of derivatives, as a function of (numbers, rtol, unused); the numbers; their sizes."""


def speeds(mechanism: Any, rtol: Any, derivatives: str) -> Any:
    options: dict[str, Any] = {"energy_balance": False, "throw": False, "derivatives": derivatives}
    s = cj.simulate(mechanism, END, save_at=TIMES, rtol=rtol, solver="dopri8", **options)
    return jnp.mean(s["piston.velocity.x"] ** 2), (s["piston.position.x"][-1], s.steps)


def of_parameters(names: tuple[str, ...]) -> tuple[Callable[[str], Callable], Any, Any]:
    """By factors on parameters."""
    crank = slider_crank()
    known = cj.parameters(crank)
    values = [float(known[name].value) for name in names]

    def loss(derivatives):
        def of(factors, rtol, _):
            moved = {name: value * factors[i] for i, (name, value) in enumerate(zip(names, values, strict=True))}
            return speeds(cj.replace(crank, moved), rtol, derivatives)

        return of

    return loss, jnp.ones(len(names)), 1e-4


def of_via_points(drive: Callable) -> tuple[Callable[[str], Callable], Any, Any]:
    """By the angles of the crank at times."""
    crank = slider_crank()

    def loss(derivatives):
        return lambda angles, rtol, _: speeds(crank.with_drives({"main": drive(VIA, angles)}), rtol, derivatives)

    return loss, jnp.asarray(CRANK_SPEED * VIA), 1e-6


def questions() -> Questions:
    """All of them."""
    return {
        f"{FEW} parameters": of_parameters(PARAMETERS[:FEW]),
        f"{len(PARAMETERS)} parameters": of_parameters(PARAMETERS),
        "22 via points, quintic": of_via_points(cj.drives.Quintic),
        "22 via points, spline": of_via_points(cj.drives.Spline),
    }
