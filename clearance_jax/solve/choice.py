"""`solver="auto"`: the solver for a tolerance and a kind of scene.

The rule follows docs/benchmarks/work_precision.md: the solver of order eight takes longer steps, and is faster below a
tolerance that depends on what limits the steps of a scene.
"""

from typing import Any

from jax.core import Tracer

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism

AUTO = "auto"
LOW, HIGH = "tsit5", "dopri8"
"""The solvers of order five and eight."""
SMOOTH, PLANE, SPACE = "without play", "plane", "space"
LIMITS = {SMOOTH: 1e-6, PLANE: 1e-6, SPACE: 1e-6}
"""By kind of scene the largest rtol at which the solver of order eight is chosen. Near it the two take about the same
time for the same error. The page found the same limit in the plane and in space; it has no scene without play."""


def kind_of(model: Any) -> str:
    """The kind of a mechanism, or of a model's mechanism, for the choice of a solver: without play, or with play in the
    plane or in space.
    """
    mechanism = model if isinstance(model, Mechanism) else model.mechanism
    if not mechanism.clearance_joints():
        return SMOOTH
    return PLANE if mechanism.is_plane else SPACE


def choose_solver(model: Any, rtol: Any) -> str:
    """The name of the solver for a mechanism, or a model that has one, at a relative tolerance.

    **Raises:** `ClearanceError` for an `rtol` that is not known while the program is made.
    """
    if isinstance(rtol, Tracer):
        raise ClearanceError(
            f'`solver="{AUTO}"` chooses by `rtol`, but its number is not known here (it is traced by JAX). Name the '
            f'solver: "{LOW}" or "{HIGH}".'
        )
    return HIGH if float(rtol) <= LIMITS[kind_of(model)] else LOW
