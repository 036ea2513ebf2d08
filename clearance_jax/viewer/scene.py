"""What a page shows of a motion, from its dataset: marks, bodies, joints, points; and the numbers that they refer to.

Parts have a `kind` by which the page draws them; a joint with play looks as its outline in the dataset says. What joins
the library later gives its own outline, or a part of one more kind.
"""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError
from clearance_jax.results.first_fall import first_fall_ends
from clearance_jax.results.places import Places, names_of, places
from clearance_jax.results.play import JointPlay, outline_of, play, series
from clearance_jax.viewer.samples import Numbers, between, keep

# Errors that are seen alike, by which samples are chosen: of places over the mechanism's size, of forces over the
# largest one, of the play over its largest.
SEEN, OF_FORCE, OF_PLAY = 2e-3, 2e-2, 1e-2
# Least breadth of a plate over the mechanism's size, as in `report.skeleton`.
PLATE = 0.02


class Fidelity(NamedTuple):
    """Samples that a page keeps `of` all, and the largest distance [m] of lines between them from all samples: of
    places, of errors against the ideal mechanism; the same of the pins in their sleeves, which have step ends too.
    """

    kept: int
    of: int
    place_error: float
    ideal_error: float
    pins_kept: int
    pins_of: int
    play_error: float

    def __str__(self) -> str:
        text = f"Shown: {self.kept} of {self.of} samples; lines between them are at most {self.place_error:.2g} m off"
        if self.ideal_error:
            text += f", in errors against the ideal mechanism {self.ideal_error:.2g} m"
        if self.pins_of:
            text += f". Pins: {self.pins_kept} of {self.pins_of} samples and step ends, {self.play_error:.2g} m off"
        return f"{text}."


class ViewedMotion(NamedTuple):
    """A dataset as the page shows it: `placed` marks, the `error` of each against the ideal mechanism [m] (`None`: not
    known), the page's `numbers`; after `settled` [s] the first falls are over. `kept`: the samples of the page.
    """

    dataset: xr.Dataset
    placed: Places
    error: np.ndarray | None
    numbers: Numbers
    settled: float
    kept: np.ndarray

    def add(self, values: Any, kind: str = "i2") -> int:
        """Keep values at all samples (times, ...) in the page; their index there."""
        return self.numbers.add(values[self.kept], kind)[0]


def motion_of(dataset: xr.Dataset, most: int) -> ViewedMotion:
    """A motion of two samples at least, of which the page keeps `most` at most. **Raises** for another dataset."""
    count = dataset.sizes.get("time", 0)
    if "time" not in dataset.coords or count < 2:
        raise ClearanceError(
            f"There is no motion to view: the result has {count} samples over time, and two are needed at least. View "
            "the result of a simulation with more samples."
        ).about("dataset", count)
    placed, error, settled = places(dataset), None, -np.inf
    columns = [placed.at.reshape(count, -1) / (SEEN * placed.size)]
    if "ideal_mark_position" in dataset and np.all(np.isfinite(dataset["ideal_mark_position"])):
        error = placed.at - dataset["ideal_mark_position"].values
        columns.append(error.reshape(count, -1) / (OF_PLAY * max(np.abs(error).max(), 1e-15)))
    if "step_state" in dataset:
        ends = first_fall_ends(dataset)
        settled = float(np.max(ends[np.isfinite(ends)], initial=-np.inf))
    forces = dataset.get("joint_reaction", xr.DataArray(np.zeros((count, 0)))).values.reshape(count, -1)
    if forces.size:
        columns.append(forces / (OF_FORCE * largest(forces, placed.time > settled)))
    kept = keep(placed.time, np.concatenate(columns, axis=1), most)
    return ViewedMotion(dataset, placed, error, Numbers(), settled, kept)


def largest(values: np.ndarray, late: np.ndarray) -> float:
    """The largest absolute value, of those that are `late` if any is; greater than 0."""
    return max(float(np.abs(values[late] if late.any() else values).max(initial=0.0)), 1e-15)


def describe(motion: ViewedMotion, title: str, most: int) -> tuple[dict[str, Any], Fidelity]:
    """The description of a page, and how true it is to the dataset; `most`: the largest number of samples."""
    data, placed = motion.dataset, motion.placed
    marks, off = _marks(motion)
    contacts, contact_time, pins = _contacts(motion, most)
    fidelity = Fidelity(len(motion.kept), len(placed.time), *off, *pins)
    why = "" if motion.error is not None else str(data.attrs.get("ideal", "the file does not hold it for all times"))
    notes = [str(fidelity)]
    if why and placed.loose:
        notes.append(f"The ideal mechanism is not shown: {why.rstrip('.')}.")
    if data.attrs.get("result", "successful") != "successful":
        notes.append(f"The simulation ended early: {data.attrs['result']}")
    scene = {
        "title": title,
        "software": str(data.attrs.get("software", "")),
        "notes": notes,
        "plane": placed.at.shape[-1] == 2,
        "size": placed.size,
        "settled": motion.settled if np.isfinite(motion.settled) else None,
        "time": motion.add(placed.time, "f8"),
        "contact_time": contact_time,
        "ideal": motion.error is not None,
        "marks": marks,
        "parts": _parts(motion),
        "points": [{"name": name, "mark": mark} for name, mark in placed.points.items()],
        "joints": _joints(motion, contacts),
    }
    return scene, fidelity


def _marks(motion: ViewedMotion) -> tuple[list[dict[str, Any]], tuple[float, float]]:
    """The marks, and the largest distance of places and of errors from all samples [m]."""
    placed, kept, marks, worst = motion.placed, motion.kept, [], (0.0, 0.0)
    for mark, name in enumerate(names_of(motion.dataset, "mark")):
        at, error, shown = placed.at[:, mark], None, np.zeros(placed.at.shape[::2])
        away = shown if motion.error is None else motion.error[:, mark]
        if motion.error is not None:
            error, values = motion.numbers.add(away[kept], "i2")
            shown = between(placed.time, kept, values)
        ideal, values = motion.numbers.add((at - away)[kept])
        off = between(placed.time, kept, values) + shown - at, shown - away
        worst = tuple(max(w, float(np.linalg.norm(each, axis=1).max())) for w, each in zip(worst, off, strict=True))
        marks.append({"name": name, "ideal": ideal, "error": error})
    return marks, (worst[0], worst[1])


def _parts(motion: ViewedMotion) -> list[dict[str, Any]]:
    placed, names = motion.placed, names_of(motion.dataset, "mark")
    parts: list[dict[str, Any]] = [
        {"kind": "support", "mark": mark}
        for mark in placed.ground
        if names[mark] not in placed.slides and names[mark] not in placed.points
    ]
    for name, marks in placed.bodies.items():
        away, plate = placed.at[0, marks] - placed.at[0, marks].mean(axis=0), False
        if away.shape[-1] == 2 and np.linalg.svd(away, compute_uv=False)[1] > PLATE * placed.size:
            # In the order in which they lie around their middle.
            marks, plate = [marks[k] for k in np.argsort(np.arctan2(away[:, 1], away[:, 0]))], True
        parts.append({"kind": "body", "name": name, "marks": marks, "plate": plate})
    for name, pair in placed.pairs.items():
        part: dict[str, Any] = {"kind": "spring", "marks": pair}
        if name in placed.slides:
            ahead = placed.slides[name]
            along = np.sum((placed.at[:, pair[1]] - placed.at[:, pair[0]]) * ahead, axis=1)
            part = {"kind": "slide", "mark": pair[1], "parent": pair[0], "direction": motion.add(ahead)}
            part["reach"] = [float(along.min()), float(along.max())] if pair[0] in placed.ground else None
        parts.append(part)
    return parts


def _joints(motion: ViewedMotion, contacts: dict[str, dict]) -> list[dict[str, Any]]:
    joints, data = [], motion.dataset
    for name, mark in motion.placed.joints.items():
        reaction, outline = data.get("joint_reaction"), outline_of(data, name)
        entry = {
            "name": name,
            "mark": mark,
            "parent": names_of(data, "mark").index(name),
            "contact": contacts.get(name),
        }
        entry |= {"reaction": None if reaction is None else motion.add(reaction.sel(any_joint=name).values, "f4")}
        entry |= {"clearance": None if outline is None else outline.clearance, "loose": name in motion.placed.loose}
        joints.append(entry)
    return joints


def _contacts(motion: ViewedMotion, most: int) -> tuple[dict[str, dict], int | None, tuple[int, int, float]]:
    """By joint with play what its picture needs; the index of the contacts' times; how many of how many, and the
    largest distance of a pin's centre from all samples [m].
    """
    data, contacts, columns, worst = motion.dataset, {}, [], 0.0
    loose = names_of(data, "joint") if "contact_force" in data else []
    if not loose:
        return {}, None, (0, 0, 0.0)
    time = series(data, loose[0], "contact_force")[0]
    for name in loose:
        _, place, force = series(data, name, "eccentricity", "contact_force")
        size, top = largest(place, time >= 0), largest(force, time > motion.settled)
        columns += [place / (OF_PLAY * size), np.minimum(force, 2 * top)[:, None] / (OF_FORCE * top)]
    kept = keep(time, np.concatenate(columns, axis=1), most)
    for name in loose:
        _, place, force, state = series(data, name, "eccentricity", "contact_force", "contact_state")
        (index, shown), pin, turn, tilt = motion.numbers.add(place[kept], "i2"), play(data, name), None, None
        worst = max(worst, float(np.linalg.norm(between(time, kept, shown) - place, axis=1).max()))
        if pin is not None:
            turn = None if pin.turn is None else motion.add(pin.turn, "f4")
            leans = [np.interp(time, motion.placed.time, column) for column in pin.tilt.T]
            tilt = series(data, name, "pin_tilt")[1] if "pin_tilt" in data else np.stack(leans, axis=1)
            tilt = motion.numbers.add(tilt[kept], "i2")[0] if np.any(tilt) else None
        known = {"place": index, "turn": turn, "tilt": tilt, "peak": _peak(data, name)}
        known |= {"force": motion.numbers.add(force[kept])[0], "state": motion.numbers.add(state[kept], "u1")[0]}
        contacts[name] = known | {"outline": None if pin is None else _plain(pin)}
    return contacts, motion.numbers.add(time[kept], "f8")[0], (len(kept), len(time), worst)


def _peak(dataset: xr.Dataset, name: str) -> dict[str, float] | None:
    """The largest force [N] in a joint and when it acts [s], within the steps too."""
    if "peak_force" not in dataset:
        return None
    here = np.flatnonzero(dataset["episode_joint"].values == names_of(dataset, "joint").index(name))
    best = here[np.argmax(dataset["peak_force"].values[here])] if here.size else None
    return None if best is None else {key: float(dataset[f"peak_{key}"][best]) for key in ("force", "time")}


def _plain(pin: JointPlay) -> dict[str, Any]:
    """The numbers that a joint's outline has; `depth` only where it is worn."""
    numbers = {name: np.asarray(x).tolist() for name, x in pin.outline._asdict().items() if x is not None}
    return numbers if np.any(pin.outline.depth) else {name: x for name, x in numbers.items() if name != "depth"}
