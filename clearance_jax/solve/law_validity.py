"""Whether the contact laws of a solved motion were asked where they hold, and whether a contact bears its load."""

import warnings
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax.joints import AbstractClearance
from clearance_jax.solve.solution import Solution
from clearance_jax.units import format_quantity

# A pin that sinks in by this part of its radius, and by more than its play, is not borne: no law of a small patch is
# meant there.
SUNK = 0.1


class ValidityWarning(UserWarning):
    """A contact law was asked for forces at penetrations at which it does not hold, or a pin sank in."""


def asked_of_laws(solution: Solution) -> Iterator[tuple[str, Array, Array, str]]:
    """Of each joint whose law says where it holds: its name, the deepest penetration, its limit, and why."""
    for joint in solution.mechanism.clearance_joints():
        if not joint.clearance.normal.validity_reason:
            continue
        limit = _limit
        for _ in range(solution.time.ndim - 1):
            limit = jax.vmap(limit)
        found = limit(joint.clearance)
        if found is not None:
            yield joint.name, _deepest(solution, joint.name), found, joint.clearance.normal.validity_reason


def _deepest(solution: Solution, name: str) -> Array:
    """The deepest penetration of a joint that was seen [m]."""
    penetration = solution[f"{name}.penetration"]
    return penetration.max(axis=-1) if solution.sampled else penetration


def _sunk(solution: Solution) -> Iterator[str]:
    """The joints of a single solve whose pin sinks in by more than its play and a part of its radius, in words."""
    for joint in solution.mechanism.clearance_joints():
        geometry, deepest = joint.clearance.geometry(), float(_deepest(solution, joint.name))
        if deepest > max(float(geometry.radial_clearance), SUNK * float(geometry.pin_radius)):
            sizes = (format_quantity(float(x), "m", 3) for x in (deepest, geometry.radial_clearance))
            yield "joint `{}`: {} deep, of a play of {}".format(joint.name, *sizes)


@eqx.filter_jit
def _limit(clearance: AbstractClearance) -> Array | None:
    """Up to which penetration [m] a joint's normal law holds; `None`: it does not say."""
    normal = clearance.prepare().normal
    return normal.law.validity(normal.constants)


def invalid(solution: Solution) -> str:
    """Which laws of a single solve were asked where they do not hold, and which pins sank in, in words; empty where
    none did.
    """
    said = [
        f"joint `{name}`: {format_quantity(float(deepest), 'm', 3)} is beyond "
        f"{format_quantity(float(limit), 'm', 3)}, {reason}"
        for name, deepest, limit, reason in asked_of_laws(solution)
        if float(deepest) > float(limit)
    ]
    out = [f"A contact law is used where it does not hold: {'; '.join(said)}. Use another law there."] if said else []
    if sunk := list(_sunk(solution)):
        out.append(
            f"A pin sinks in by more than its play: {'; '.join(sunk)}. The contact is too soft for its load: take a "
            "stiffer or longer contact, or a larger pin."
        )
    return " ".join(out)


def warn_of_validity(solution: Solution) -> None:
    """Warn of a single solve whose laws were asked where they do not hold."""
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(solution))
    said = "" if traced or np.ndim(solution.code) else invalid(solution)
    if said:
        warnings.warn(said, ValidityWarning, stacklevel=3)
