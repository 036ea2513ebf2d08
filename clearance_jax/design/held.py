"""Splines of the conditions of a design: they hold their last value after the end of their tables.

A `Spline` continues with its last cubic after its table. In a faster condition the table ends before the motion does;
there the spline must end at rest and then keeps its last value.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.design.specification import Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion_laws import HeldSpline, Spline
from clearance_jax.parameters import follow, leaves

# A motion ends at rest if its speed at the end is at most this part of its largest one. With few rows a cubic shows
# that only roughly: a quintic from rest to rest over n intervals ends at about 30 / n^3 of its largest speed.
REST, ROUGH, MOST = 0.01, 50.0, 0.25
# A change of a coordinate that is no motion, relative to its size or to 1 rad or 1 m.
STILL = 1e-9


class Course(NamedTuple):
    """A spline of a mechanism: the prefix of its numbers' names ("drive.crank."), and the path to it."""

    begin: str
    path: tuple[str, ...]


def with_held_ends(specification: Specification) -> Specification:
    """The problem with splines that keep their last values after their tables, if a table ends before the motion.

    **Raises:** `ClearanceError` if a table begins after the motion, or ends before it and not at rest.
    """
    t0, t1 = specification.t0, specification.t1
    courses = _courses(specification.mechanism)
    moved = {n: specification.move(specification.mechanism, values) for n, values in specification.conditions.items()}
    speeds: dict[str, dict[str, float]] = {}
    for course in courses:
        ends = {}
        for name, mechanism in moved.items():
            try:
                ends[name] = _end_speed(follow(mechanism, course.path), course.begin[:-1], t0, t1)
            except ClearanceError as error:
                raise ClearanceError(f"In `{name}`: {error}") from None
        if any(rests for _, rests in ends.values()):
            speeds[course.begin] = {name: speed for name, (speed, _) in ends.items()}
    if not speeds:
        return specification
    mechanism = specification.mechanism
    for course in courses:
        if course.begin in speeds:  # any of the speeds: every condition sets its own
            mechanism = _held(mechanism, course, next(iter(speeds[course.begin].values())))
    conditions = {
        name: {**values, **{f"{begin}end_speed": by_condition[name] for begin, by_condition in speeds.items()}}
        for name, values in specification.conditions.items()
    }
    return dataclasses.replace(specification, mechanism=mechanism, conditions=conditions)


def _courses(mechanism: Mechanism) -> list[Course]:
    """Every spline of a mechanism."""
    tables = (leaf for leaf in leaves(mechanism) if leaf.path[-1] == "times" and isinstance(leaf.owners[-1], Spline))
    return [Course(leaf.name.removesuffix("times"), leaf.path[:-1]) for leaf in tables]


def _held(mechanism: Mechanism, course: Course, speed: float) -> Mechanism:
    return eqx.tree_at(lambda m: follow(m, course.path), mechanism, HeldSpline(follow(mechanism, course.path), speed))


def _end_speed(spline: Spline, name: str, t0: float, t1: float) -> tuple[float, bool]:
    """The speed at the end of a table, and whether the spline must rest there as the motion goes further."""
    times, values = np.asarray(spline.times), np.asarray(spline.values)
    hair = 1e-9 * (times[-1] - times[0])
    if t0 < times[0] - hair:
        raise ClearanceError(
            f"the table of `{name}` begins at {times[0]:.6g} s, after the motion, which begins at t0 = {t0:.6g} s. Let "
            "the table begin there, or the motion later."
        )
    law = spline.prepare()
    end = float(law(jnp.asarray(times[-1]))[1])
    if t1 <= times[-1] + hair:
        return end, False
    if np.ptp(values) > STILL * max(1.0, float(np.max(np.abs(values)))):
        largest = float(jnp.max(jnp.abs(jax.vmap(law)(jnp.asarray(times))[1])))
        largest = max(largest, float(np.max(np.abs(np.diff(values) / np.diff(times)))))
        if abs(end) > min(REST + ROUGH / (len(times) - 1) ** 3, MOST) * largest:
            raise ClearanceError(
                f"the table of `{name}` ends at {times[-1]:.6g} s, before t1 = {t1:.6g} s, and not at rest: its speed "
                f"there is {abs(end) / largest:.0%} of its largest. Let the motion end there (`t1`), or give a table "
                "that goes on until t1 or comes to rest (rows that repeat the last value)."
            )
    return 0.0, True
