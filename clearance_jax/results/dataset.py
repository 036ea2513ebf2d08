"""Builds labelled datasets of solutions: variables with units and meanings, contact episodes, provenance."""

import dataclasses
import warnings
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from clearance_jax._version import __version__
from clearance_jax.dynamics.quantities import OBSERVED, Variable, labels
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.ideal import freedom
from clearance_jax.parameters import parameters
from clearance_jax.results import blocks, episodes
from clearance_jax.results.blocks import Progress, in_blocks
from clearance_jax.results.episodes import ContactWarning, doubt, restitutions
from clearance_jax.results.first_fall import first_falls_over
from clearance_jax.results.peaks import of_points, peaks
from clearance_jax.results.places import WHEEL, mark_labels, marks, pitch_radii
from clearance_jax.results.play import outline_attributes
from clearance_jax.solve.drivers.trace import Trace
from clearance_jax.solve.solution import Solution

# Fraction of the work for samples and step ends. The rest is that for peaks inside steps.
_LOOKED_AT = 0.9
# Variables at the step ends: of contacts, as in `episodes.StepEnds`, and of pins.
_OF_CONTACTS = ("penetration", "penetration_rate", "contact_force", "force_rate", "contact_power", "power_rate")
_OF_PINS = ("eccentricity", "contact_pattern", "pin_tilt")

VARIABLES = OBSERVED | {
    "contact_state": Variable(("joint",), "1", "0 free, 1 contact, 2 impact"),
    "gap_state": Variable(("gap",), "1", "0 free, 1 contact, 2 impact"),
    "mark_position": Variable(("mark", "axis"), "m", "place of a joint, point or spring on the body `mark_body`"),
    "body_position": Variable(("body", "axis"), "m", "place of a body's frame (in space)"),
    "body_rotation": Variable(("body", "axis", "own_axis"), "1", "axes of a body's frame as columns (in space)"),
    "ideal_mark_position": Variable(("mark", "axis"), "m", "place of the mark on the ideal mechanism"),
    "position_error": Variable(("point",), "m", "distance of a named point from its place on the ideal mechanism"),
}

# Of a trace: what each clearance joint did at every step end, every touch and every separation among them.
STEPS = {
    "step_time": Variable((), "s", "end of an integration step"),
    "step_eccentricity": Variable(("joint", "axis"), "m", "pin centre from sleeve centre at the step ends"),
    "step_force": Variable(("joint",), "N", "normal contact force at the step ends"),
    "step_gap_position": Variable(("gap",), "see gap_unit", "place in the gap at the step ends"),
    "step_gap_effort": Variable(("gap",), "see gap_effort_unit", "effort of the flanks at the step ends"),
    "step_gap_state": Variable(("gap",), "1", "0 free, 1 contact, 2 impact, at the step ends"),
    "step_state": Variable(("joint",), "1", "0 free, 1 contact, 2 impact, at the step ends"),
    "step_pattern": Variable(("joint",), "", "where a pin bears at the step ends, as `contact_pattern` (in space)"),
    "step_tilt": Variable(("joint", "across"), "rad", "how the pin's axis leans at the step ends (in space)"),
}

EPISODES = {
    "episode_joint": Variable((), "1", "which clearance joint (index)"),
    "episode_start": Variable((), "s", "first touch"),
    "episode_end": Variable((), "s", "separation (NaN: still in contact at the end)"),
    "impact_speed": Variable((), "m/s", "approach speed at first touch (NaN: in contact from the start)"),
    "peak_force": Variable((), "N", "largest normal force, within the steps too"),
    "peak_time": Variable((), "s", "when the largest normal force acts"),
    "separation_speed": Variable((), "m/s", "speed at which the pin leaves (NaN: still in contact)"),
    "restitution": Variable(
        (), "1", "root of the work that the contact gave back over the work that it took up (NaN: not known as a whole)"
    ),
}


def _named(begin: str, name: str) -> str:
    """The name of a column of episodes, of gaps with another beginning."""
    return begin + (name.replace("joint", "gap") if begin else name)


_IN_GAP = {"m/s": "rad/s (m/s of a slide)", "N": "N m (N of a slide)"}
GAP_EPISODES = {
    _named("gap_", name): Variable((), _IN_GAP.get(of.unit, of.unit), of.meaning.replace("clearance joint", "gap"))
    for name, of in EPISODES.items()
}
"""The same of gaps, along a dimension of their own: their efforts and speeds have other units."""

# Of a trace: what `after` [s] is the start or the end of the first falls.
EXTREMES = {
    f"largest_{name}{ending}": Variable(("point",), unit, meaning)
    for name, of in (("speed", "m/s"), ("acceleration", "m/s^2"))
    for ending, unit, meaning in (
        ("", of, f"largest {name} from the instant `after` on, within the steps too"),
        ("_time", "s", f"when the {name} is largest"),
    )
}


def attributes(variable: Variable, labelled: dict[str, tuple[str, list[str]]]) -> dict[str, str]:
    """A variable's attributes: its unit where that is one for all its entries, and what it means."""
    unit = variable.unit
    if unit.startswith("see "):
        units = set(labelled[unit.removeprefix("see ")][1])
        unit = units.pop() if len(units) == 1 else unit
    return {"units": unit, "long_name": variable.meaning}


def to_dataset(
    mechanism: Mechanism,
    solution: Solution | Trace,
    *,
    ideal: Solution | None = None,
    progress: Progress | None = None,
    **provenance: Any,
) -> xr.Dataset:
    """Everything observable of a solution as an `xarray.Dataset`, each variable with its unit.

    A `Trace` also gives contact episodes, the contact state at every step end, and the largest speed and acceleration
    of each named point (`largest_speed`, `largest_acceleration`), inside the steps too. If joints of a settled start
    begin at relative rest, the attribute `start` says so. With play, `position_error` is the distance of each named
    point from its place on the ideal mechanism; where that is not known, the attribute `ideal` says why.

    **Arguments:** `mechanism`; `solution`: a `Solution` or a `Trace` of its motion; `ideal`: the motion of
    `mechanism.intended()` at the same times, where drives do not prescribe it; `progress`: called with the fraction
    done; `provenance`: anything to be kept as attributes, beside version, result and counts.
    """
    joints, gaps = len(mechanism.clearance_joints()), len(mechanism.open_gaps())
    shown = joints or gaps or mechanism.points
    traced = solution if isinstance(solution, Trace) and shown and solution.time.size > 1 else None
    solved = solution.solution if isinstance(solution, Trace) else solution
    if solved.time.ndim != 1:
        raise ClearanceError(
            f"A dataset holds one solve, but this is a batch of shape {solved.time.shape[:-1]}. Take one motion: "
            "`jax.tree.map(lambda x: x[i], solution)`."
        )
    reached = np.isfinite(np.asarray(solved.time))
    time, y = np.asarray(solved.time)[reached], np.asarray(solved.y)[reached]
    share = 1.0 if traced is None else _LOOKED_AT * time.size / (time.size + traced.time.size)
    alone = traced is None or not (joints or gaps) or time.size > blocks.SHARED
    program = blocks.observed if alone else blocks.observed_with_rates
    seen = in_blocks(program, mechanism, time, y, progress=_part(progress, 0.0, share))
    seen = {name: values for name, values in seen.items() if name not in blocks.RATES.values()}
    told = _Traced({}, {}, {}, {}, [episodes.NO_IMPACTS] * joints, [episodes.NO_IMPACTS] * gaps)
    if traced is not None:
        told = _of_trace(mechanism, traced, told, _part(progress, share, 1.0))
    if joints:
        seen["contact_state"] = _states(time, seen["penetration"], told.impacts)
    if gaps:
        seen["gap_state"] = _states(time, seen["gap_penetration"], told.gap_impacts)
        seen = {name: values for name, values in seen.items() if name not in ("gap_contact_force", "gap_contact_power")}
    errors, unknown = against_ideal(mechanism, time, y, seen, ideal)
    seen |= errors
    labelled = labels(mechanism) | mark_labels(mechanism)
    after = told.extremes.pop("after", None)
    data = _variables("time", seen, VARIABLES, labelled) | _variables("step", told.steps, STEPS, labelled)
    data |= _variables("gap_episode", told.gap_table, GAP_EPISODES, labelled)
    data |= _variables("episode", told.table, EPISODES, labelled)
    data |= _variables("after", told.extremes, EXTREMES, labelled)
    used = {dim for dims, _, _ in data.values() for dim in dims}
    coords: dict[str, Any] = {"time": ("time", time, {"units": "s"})}
    coords |= {name: label for name, label in labelled.items() if label[0] in used}
    if after is not None:
        coords["after"] = ("after", after, {"units": "s"})
    attrs: dict[str, Any] = {"software": f"clearance_jax {__version__}", "mechanism": mechanism.name}
    attrs |= {"result": solution.message or "successful", "accepted_steps": int(solved.steps)}
    attrs |= {"rejected_steps": int(solved.rejected), "cut_steps": int(solved.cuts)}
    attrs |= {"energy_residual": float(solved.energy_residual)}
    attrs |= _numbers(mechanism)
    validity = "" if solved.validity is None else str(solved.validity)
    more = {"notes": "; ".join(mechanism.notes), "start": solved.rests, "validity": validity, "ideal": unknown}
    return xr.Dataset(data, coords, attrs | {name: text for name, text in more.items() if text} | provenance)


class _Traced(NamedTuple):
    """What a trace tells beyond its samples: variables of the step ends, tables of episodes of joints and of gaps,
    extremes of points, and the begins and ends of impacts of each joint and of each gap [s].
    """

    steps: dict[str, Any]
    table: dict[str, Any]
    gap_table: dict[str, Any]
    extremes: dict[str, Any]
    impacts: list
    gap_impacts: list


def _of_trace(mechanism: Mechanism, trace: Trace, told: _Traced, progress: Progress | None) -> _Traced:
    """What a trace tells, in the place of the empty `told`."""
    ends = _step_ends(mechanism, trace, _part(progress, 0.0, _LOOKED_AT))
    falls_over = -np.inf
    if told.impacts:
        steps, table, impacts = _of_contacts(mechanism, trace, ends)
        falls_over = max(falls_over, *first_falls_over(trace.time, steps["step_state"]))
        told = told._replace(steps=steps, table=table, impacts=impacts)
    if told.gap_impacts:
        steps, table, impacts = _of_contacts(mechanism, trace, ends, "gap_")
        told = told._replace(steps=told.steps | steps, gap_table=table, gap_impacts=impacts)
    if mechanism.points:
        told = told._replace(extremes=of_points(mechanism, trace, ends, falls_over))
    if progress is not None:
        progress(1.0)
    return told


def picture_dataset(mechanism: Mechanism, time: np.ndarray, picture: dict[str, Any]) -> xr.Dataset:
    """The variables of pictures (`places.picture`) at times [s], as a dataset for figures."""
    labelled = labels(mechanism) | mark_labels(mechanism)
    if "penetration" in picture:
        picture = picture | {"contact_state": (picture["penetration"] > 0).astype(int)}
    coords: dict[str, Any] = {name: label for name, label in labelled.items() if label[1]}
    coords["time"] = ("time", time, {"units": "s"})
    return xr.Dataset(_variables("time", picture, VARIABLES, labelled), coords, _numbers(mechanism))


# Where errors against the ideal mechanism are not known, why.
FREE = (
    "the ideal mechanism moves freely, and its motion is not known: give it, "
    "`to_dataset(..., ideal=simulate(mechanism.intended(), t1, save_at=...))`"
)


def against_ideal(
    mechanism: Mechanism, time: np.ndarray, y: np.ndarray, seen: dict[str, Any], ideal: Solution | None
) -> tuple[dict[str, np.ndarray], str]:
    """The variables of a dataset that refer to the ideal mechanism, at the times [s] of states `y`; if there are none,
    why.

    **Arguments:** `seen`: the other variables; `ideal`: the motion of `mechanism.intended()` at these times, where it
    moves freely.

    **Raises:** `ClearanceError` for an `ideal` at other times.
    """
    at, reason = _ideal_places(mechanism, time, y, ideal)
    if at is None:
        return {}, reason
    names = [mark.name for mark in marks(mechanism)]
    out = {"ideal_mark_position": at}
    if mechanism.points:
        apart = seen["position"] - at[:, [names.index(point.name) for point in mechanism.points]]
        out["position_error"] = np.linalg.norm(apart, axis=-1)
    return out, ""


def _ideal_places(mechanism: Mechanism, time: np.ndarray, y: np.ndarray, ideal: Solution | None) -> tuple[Any, str]:
    """The places of all marks on the ideal mechanism [m], (times, marks, axes); or `None`, and why."""
    if not mechanism.has_play:
        return None, "the mechanism is ideal itself"
    if ideal is not None:
        if np.shape(ideal.time) != time.shape or not np.array_equal(np.asarray(ideal.time), time):
            text = "`ideal` has other times than the solution. Solve it with the same `save_at`."
            raise ClearanceError(text).about("ideal")
        return in_blocks(blocks.mark_places, mechanism.intended(), time, np.asarray(ideal.y)), ""
    try:
        if freedom(mechanism.intended()) > 0:
            return None, FREE
    except ClearanceError as error:
        return None, str(error)
    return in_blocks(blocks.ideal_mark_places, mechanism, time, y), ""


def _step_ends(mechanism: Mechanism, trace: Trace, progress: Progress | None) -> dict[str, np.ndarray]:
    """Variables at the step ends by name, shape (step ends, ...)."""
    program = blocks.observed_with_rates if mechanism.contacts() else blocks.observed

    def some(*given):
        seen = program(*given)  # more variables than are kept of so many states
        in_gaps = ("gap_position", "gap_effort", *(f"gap_{name}" for name in _OF_CONTACTS))
        kept = (*_OF_CONTACTS, *_OF_PINS, *in_gaps, *blocks.OF_POINTS)
        return {name: seen[name] for name in kept if name in seen}

    return in_blocks(some, mechanism, np.asarray(trace.time), np.asarray(trace.y), progress=progress)


def _of_contacts(
    mechanism: Mechanism, trace: Trace, seen: dict[str, np.ndarray], begin: str = ""
) -> tuple[dict, dict, list]:
    """The variables of the step ends, the table of episodes, and of each joint the begins and ends of impacts [s];
    `begin`: of the names ("gap_" of gaps).
    """
    t, y = np.asarray(trace.time), np.asarray(trace.y)
    touching = mechanism.open_gaps() if begin else mechanism.clearance_joints()
    tables, impacts = [], []
    for joint, owner in enumerate(touching):
        ends = episodes.StepEnds(t, *(seen[begin + name][:, joint] for name in _OF_CONTACTS))
        spans = episodes.spans(t, ends.penetration)

        def inside(step, s, joint=joint):
            contact = blocks.inside_steps(mechanism, t, y, step, s)[f"{begin}contact"]
            return episodes.Inside(*(values[:, joint] for values in contact))

        top, restitution = peaks(ends, spans, inside), restitutions(ends, spans, inside)
        if message := doubt(owner.name, restitution):
            warnings.warn(message, ContactWarning, stacklevel=3)
        columns = {"episode_joint": np.full(top.time.size, joint), "peak_force": top.value, "peak_time": top.time}
        tables.append(columns | episodes.table(ends, spans) | {"restitution": restitution})
        impacts.append((t[spans.first], episodes.impact_ends(t, ends.penetration_rate, spans)))
    states = _states(t, seen[f"{begin}penetration"], impacts)
    if begin:
        steps = {"step_gap_position": seen["gap_position"], "step_gap_effort": seen["gap_effort"]}
        steps |= {"step_time": t, "step_gap_state": states}
    else:
        steps = {"step_time": t, "step_eccentricity": seen["eccentricity"], "step_force": seen["contact_force"]}
        steps["step_state"] = states
    if not begin and "pin_tilt" in seen:
        steps |= {"step_pattern": seen["contact_pattern"], "step_tilt": seen["pin_tilt"]}
    return steps, {_named(begin, name): np.concatenate([rows[name] for rows in tables]) for name in EPISODES}, impacts


def _states(time: np.ndarray, penetration: np.ndarray, impacts: list) -> np.ndarray:
    return np.stack([episodes.contact_states(time, penetration[:, j], *ends) for j, ends in enumerate(impacts)], axis=1)


def _numbers(mechanism: Mechanism) -> dict[str, Any]:
    """All numbers of the mechanism; of every clearance joint its kind, static options, and outline (`outline.NAME`)."""
    numbers: dict[str, Any] = {f"parameter.{n}": np.asarray(leaf.value) for n, leaf in parameters(mechanism).items()}
    # Half of every gap of backlash and between two stops [rad or m], which pictures show.
    numbers |= {f"gap.{gap.name}": float(gap.size) for gap in mechanism.gaps if gap.is_play}
    numbers |= {f"stops.{gap.name}": float(gap.size) for gap in mechanism.gaps if gap.is_between_stops}
    numbers |= {WHEEL.format(joint): radius for joint, radius in pitch_radii(mechanism).items()}
    for joint in mechanism.clearance_joints():
        numbers[f"clearance.{joint.name}"] = joint.clearance.kind
        for field in dataclasses.fields(joint.clearance):
            value = getattr(joint.clearance, field.name)
            if field.metadata.get("static", False) and isinstance(value, int | float | str):
                numbers[f"clearance.{joint.name}.{field.name}"] = value
        numbers |= outline_attributes(joint.name, joint.clearance.outline())
    return numbers


def _part(progress: Progress | None, begin: float, end: float) -> Progress | None:
    return None if progress is None else lambda fraction: progress(begin + fraction * (end - begin))


def _variables(first: str, values: dict[str, Any], described: dict[str, Variable], labelled) -> dict[str, tuple]:
    """Xarray's (dimensions, values, attributes) of every value; `first` is the leading dimension."""
    about = {name: (described[name].dims, attributes(described[name], labelled)) for name in values}
    return {name: ((first, *dims), values[name], told) for name, (dims, told) in about.items()}
