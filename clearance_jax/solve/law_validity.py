"""Checks of a solved motion: whether contact laws were used where they hold, and whether contacts bear their load."""

import warnings
from collections.abc import Iterator, Mapping

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax.joints import AbstractClearance
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.solution import Solution
from clearance_jax.units import format_quantity

# A pin that sinks in by this part of its radius, and by more than its play, is not borne: no law of a small patch is
# meant there.
SUNK = 0.1


class ValidityWarning(UserWarning):
    """A contact law was used at penetrations at which it does not hold."""


def asked_of_laws(solution: Solution) -> Iterator[tuple[str, Array, Array, str]]:
    """By joint whose law has a limit of validity: its name, the deepest penetration [m], the limit [m], the reason."""
    for joint in solution.mechanism.clearance_joints():
        if not joint.clearance.normal.validity_reason:
            continue
        limit = _limit
        for _ in range(solution.time.ndim - 1):
            limit = jax.vmap(limit)
        bound = limit(joint.clearance)
        if bound is not None:
            yield joint.name, _deepest(solution, joint.name), bound, joint.clearance.normal.validity_reason


def _deepest(solution: Solution, name: str) -> Array:
    """The deepest sampled penetration of a joint [m]."""
    penetration = solution[f"{name}.penetration"]
    return penetration.max(axis=-1) if solution.sampled else penetration


def sunk(mechanism: Mechanism, deepest: Mapping[str, float]) -> str:
    """Names the pins that sink in by more than their play and a part of their radius; `deepest`: by joint [m]."""
    deep_pins = []
    for joint in mechanism.clearance_joints():
        geometry, depth = joint.clearance.geometry(), deepest[joint.name]
        if depth > max(float(geometry.radial_clearance), SUNK * float(geometry.pin_radius)):
            sizes = (format_quantity(float(x), "m", 3) for x in (depth, geometry.radial_clearance))
            deep_pins.append("joint `{}`: {} deep, of a play of {}".format(joint.name, *sizes))
    if not deep_pins:
        return ""
    return (
        f"A pin sinks in by more than its play: {'; '.join(deep_pins)}. The contact is too soft for its load: take a "
        "stiffer or longer contact, or a larger pin."
    )


@eqx.filter_jit
def _limit(clearance: AbstractClearance) -> Array | None:
    """The penetration [m] up to which a joint's normal law holds; `None`: it has no limit."""
    normal = clearance.prepare().normal
    return normal.law.validity(normal.constants)


def invalid(solution: Solution) -> str:
    """Names the laws that a single solve used where they do not hold; empty if there are none."""
    wrong = [
        f"joint `{name}`: {format_quantity(float(deepest), 'm', 3)} is beyond "
        f"{format_quantity(float(limit), 'm', 3)}, {reason}"
        for name, deepest, limit, reason in asked_of_laws(solution)
        if float(deepest) > float(limit)
    ]
    return f"A contact law is used where it does not hold: {'; '.join(wrong)}. Use another law there." if wrong else ""


def warn_of_validity(solution: Solution) -> None:
    """Warn if a single solve used laws where they do not hold."""
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(solution))
    message = "" if traced or np.ndim(solution.code) else invalid(solution)
    if message:
        warnings.warn(message, ValidityWarning, stacklevel=3)
