"""Conditions of a design: their product, and numbers of wear laws in them.

A condition is a set of values by name. All conditions of a product (each trajectory with each payload at each speed)
set the same names, so that one program solves all. Numbers of wear laws are not numbers of the mechanism.
"""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.errors import ClearanceError, unknown_name, wrong_value
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.metrics.measure import AbstractMeasure
from clearance_jax.parameters import lookup, parameters, replace, values_of
from clearance_jax.units import time_power

Values = dict[str, Any]
NONE: Mapping[str, Any] = MappingProxyType({})
# Relative size of a payload's effect below which its body need not have a number for it.
ROUNDED = 1e-12
ENTRIES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
# Fields of courses in time: of drives, loads, and payloads that are picked up.
COURSES = {"drive", "course", "picked_up", "put_down"}


@dataclasses.dataclass(frozen=True)
class Payload:
    """A mass that a body carries: the body is then heavier, with another centre of mass and another inertia.

    **Arguments:** `body`: its name; `mass` [kg], zero for none; `center_of_mass` [m] of the payload, in the body's
    frame; `inertia` [kg m^2] about this centre, along the body's axes: one number (about z), three or six as of a
    `Body`; `None`: a point mass.

    **Raises:** `ClearanceError` for a negative mass.
    """

    body: str
    mass: float
    center_of_mass: Sequence[float | None] = (0.0, 0.0, 0.0)
    inertia: float | Sequence[float] | Inertia | None = None

    def __post_init__(self):
        if not (np.isfinite(self.mass) and self.mass >= 0):
            text = f"The mass of a payload must not be negative, but it is {self.mass} kg."
            raise ClearanceError(text).about("mass", self.mass)

    def values(self, mechanism: Mechanism) -> Values:
        """The numbers of the body with the payload, by name. **Raises** `ClearanceError` if the body lacks one."""
        names = [body.name for body in mechanism.bodies]
        if self.body not in names:
            raise unknown_name(f"There is no body `{self.body}` to carry a payload.", self.body, names)
        body = mechanism.bodies[names.index(self.body)]
        if body.mass is None:
            raise ClearanceError(f"Body `{body.name}` is a massless link, which no payload can change: give it a mass.")
        bare, place = float(body.mass), _three(body.center_of_mass.vector)
        mass, given = bare + self.mass, _three(self.center_of_mass)
        centre = (bare * place + self.mass * given) / mass
        about = _tensor(body.inertia) + _steiner(bare, place - centre)
        about += _tensor(self.inertia) + _steiner(self.mass, given - centre)
        numbers = {"mass": mass} | {f"center_of_mass.{x}": c for x, c in zip("xyz", centre, strict=True)}
        if isinstance(body.inertia, Inertia):
            numbers |= {f"inertia.{name}": float(about[place]) for name, place in ENTRIES.items()}
        else:
            numbers["inertia"] = float(about[2, 2])
        known = {name.removeprefix(f"{body.name}.") for name in parameters(body)}
        moment = self.mass * float(np.max(np.abs([given, place])))
        for name, value in numbers.items():
            if name not in known and abs(value) > ROUNDED * max(moment, 1.0):
                raise ClearanceError(
                    f"The payload on `{body.name}` changes `{body.name}.{name}`, which this body does not have as a "
                    "number: give the body one (it may be zero)."
                ).about(f"{body.name}.{name}")
        return {f"{body.name}.{name}": value for name, value in numbers.items() if name in known}


def condition_product(
    mechanism: Mechanism,
    trajectories: Mapping[str, Mapping[str, AbstractMotionLaw]] | None = None,
    payloads: Mapping[str, Payload] | None = None,
    speeds: Mapping[str, float] | Sequence[float] | None = None,
    others: Mapping[str, Values] | None = None,
) -> dict[str, Values]:
    """Conditions of a `ToleranceProblem`: each trajectory with each payload at each speed.

    **Arguments:**

    - `mechanism`: that of the problem.
    - `trajectories`: drives by the names of coordinates, by a name for each trajectory. They must be of the kinds that
      the mechanism has there, with as many points: drive it by one of them first (`mechanism.with_drives`).
    - `payloads`: by a name for each.
    - `speeds`: factors on all speeds, by name or not: the motion of twice the speed takes half the time. Drives,
      courses of loads and times of payloads scale together.
    - `others`: further conditions, values by name, to go with each of these.

    **Returns:** values by name, of conditions that are called by what they are made of: "pick, light, speed 0.5".

    **Raises:** `ClearanceError` for unknown names, trajectories of another form, and speeds that are not positive.
    """
    faster = speeds if isinstance(speeds, Mapping) else {f"speed {s:g}": s for s in speeds or ()}
    given = {name: _trajectory(name, drives, mechanism) for name, drives in (trajectories or {}).items()}
    loads = {name: payload.values(mechanism) for name, payload in (payloads or {}).items()}
    axes = [list(axis.items()) or [("", {})] for axis in (given, loads, dict(others or {}))]
    conditions = {}
    for parts in itertools.product(*axes):
        values: Values = {}
        for name, part in parts:
            for number in part:
                if sets(values, number):
                    raise ClearanceError(
                        f"`{name}` sets `{number}`, which another part of the same condition sets too."
                    )
            values |= part
        for name, factor in faster.items() or [("", 1.0)]:
            scaled = _scaled(mechanism, values, float(factor), name) if faster else {}
            # A scaled array replaces its entries.
            kept = {n: value for n, value in values.items() if n.rpartition(".")[0] not in scaled}
            conditions[", ".join(n for n in (*(n for n, _ in parts), name) if n) or "as given"] = kept | scaled
    return conditions


def _trajectory(name: str, drives: Mapping[str, AbstractMotionLaw], mechanism: Mechanism) -> Values:
    """The numbers of a trajectory's drives, by name."""
    moved = mechanism.with_drives(drives)
    numbers, known = parameters(moved), parameters(mechanism)
    alike = jax.tree.structure(moved) == jax.tree.structure(mechanism) and numbers.keys() == known.keys()
    if not alike or any(np.shape(numbers[n].value) != np.shape(known[n].value) for n in known):
        raise ClearanceError(
            f"The drives of trajectory `{name}` have another form than the mechanism's: give all trajectories as "
            "drives of the same kinds with as many points, and drive the mechanism by one of them first "
            "(`with_drives`)."
        )
    begins = tuple(f"drive.{coordinate}." for coordinate in drives)
    return {n: np.asarray(leaf.value, float) for n, leaf in numbers.items() if n.startswith(begins)}


def _scaled(mechanism: Mechanism, values: Values, factor: float, name: str) -> Values:
    """The numbers of all courses in time, for a motion `factor` times as fast with the values of a condition."""
    if not (np.isfinite(factor) and factor > 0):
        raise wrong_value(f"`{name}`: a speed", "a positive number", factor, shown=str(factor))
    if mechanism.controllers:
        raise ClearanceError("Speeds scale drives, and controllers follow references of their own: set their numbers.")
    scaled, unscaled = {}, replace(mechanism, values)
    for n, leaf in parameters(unscaled).items():
        power = time_power(leaf.unit) if COURSES & set(leaf.path) else 0
        if power:
            scaled[n] = np.asarray(leaf.value, float) * factor**-power
    _check_scaled(unscaled, replace(unscaled, scaled), factor, name)
    return scaled


def _check_scaled(unscaled: Mechanism, scaled: Mechanism, factor: float, name: str) -> None:
    """Raise `ClearanceError` if a course in time changes otherwise than in speed."""
    laws = [[c.motion.drive for c in m.coordinates()] + [w.course for w in m.wrenches] for m in (unscaled, scaled)]
    end = max(np.asarray(drive_breaks(unscaled)).tolist(), default=0.0)
    # Compare at a few times of no particular meaning, so that no table has a row there.
    times = np.array([0.13, 0.37, 0.61, 0.89]) * (end if end > 0 else 1.0)
    for law, other in zip(*laws, strict=True):
        if law is None or other is None:
            continue
        for time in times:
            before, after = float(law(jnp.asarray(time))[0]), float(other(jnp.asarray(time / factor))[0])
            if not np.isclose(before, after, rtol=1e-9, atol=1e-9 * (1 + abs(before))):
                raise ClearanceError(
                    f"`{name}`: a drive of the kind {type(law).__name__} does not say which of its numbers are "
                    "times, so its speed cannot be scaled: set its numbers in a condition of your own, or take another "
                    "drive."
                )


# Masses --------------------------------------------------------------------------------------------------------------


def _three(vector: Sequence[Any]) -> np.ndarray:
    numbers = [0.0 if x is None else float(x) for x in vector]
    return np.array([*numbers, *[0.0] * (3 - len(numbers))])


def _steiner(mass: float, arm: np.ndarray) -> np.ndarray:
    """The inertia tensor (3, 3) of a point mass at `arm` [m]."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def _tensor(inertia: Any) -> np.ndarray:
    """The inertia tensor (3, 3) of an `Inertia`, of three or six numbers, of one number (about z), or of `None`."""
    if isinstance(inertia, Inertia):
        tensor = inertia.symmetric
        return np.array([[float(tensor.entry(i, j)) for j in range(3)] for i in range(3)])
    numbers = np.atleast_1d(np.asarray([] if inertia is None else inertia, float))
    if len(numbers) < 2:
        return np.diag([0.0, 0.0, *numbers]) if len(numbers) else np.zeros((3, 3))
    return _tensor(Inertia(*numbers))


def without_wear(
    mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]
) -> dict[str, Any]:
    """The values that are not of wear: those of the mechanism, and unknown ones."""
    if not values:
        return {}
    known = parameters(mechanism)
    models = [parameters(measure.model(mechanism)) for measure in measures]

    def of_wear(name: str) -> bool:
        return lookup(known, name)[0] is None and any(lookup(model, name)[0] for model in models)

    return {name: value for name, value in values.items() if not of_wear(name)}


def values_for(
    measure: AbstractMeasure, mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]
) -> dict[str, Any]:
    """The values that a measure's model takes: all but those of the wear of other measures."""
    known, kept = parameters(measure.model(mechanism)), without_wear(mechanism, measures, values)
    return {name: value for name, value in values.items() if name in kept or lookup(known, name)[0]}


def sets(values: Mapping[str, Any], name: str) -> bool:
    """Whether `values` set a number `name`: itself, its array, or an entry of it."""
    return any(name == given or _within(name, given) or _within(given, name) for given in values)


def worth(mechanism: Mechanism, measures: Iterable[AbstractMeasure], name: str, given: Mapping[str, Any] = NONE) -> Any:
    """The value of a number of the mechanism or of wear, after some numbers are set to `given` values. **Raises**
    `ClearanceError` for an unknown number, and if limits do not agree about it.
    """

    def as_given(model: Any) -> Any:
        known = parameters(model)
        return replace(model, {n: value for n, value in given.items() if lookup(known, n)[0]})

    models = [as_given(measure.model(mechanism)) for measure in measures]
    having = [model for model in models if lookup(parameters(model), name)[0]] or [as_given(mechanism)]
    values = [values_of(model, [name])[name] for model in having]
    if not all(np.array_equal(value, values[0]) for value in values):
        raise ClearanceError(f"The limits do not agree about `{name}`: give them the same law and pressure.")
    return values[0]


def _within(entry: str, array: str) -> bool:
    """Whether a name is an entry `array.i` of an array."""
    head, _, tail = entry.rpartition(".")
    return head == array and tail.isdecimal()
