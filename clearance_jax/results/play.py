"""A clearance joint from a dataset: its sizes, when it bears how, and the motion of its pin in its sleeve."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.joints import JointOutline
from clearance_jax.joints.bore import finer
from clearance_jax.results.episodes import SHORTEST
from clearance_jax.results.places import names_of

# Added to a contact pattern while a face bears.
FACE = 4


def outline_attributes(joint: str, outline: JointOutline | None) -> dict[str, Any]:
    """The attributes of a dataset, `outline.JOINT.NUMBER`, that keep an outline."""
    numbers = {} if outline is None else {name: x for name, x in outline._asdict().items() if x is not None}
    # NetCDF has no flags (they are 0 or 1), and no arrays of one number.
    return {f"outline.{joint}.{name}": 1 * np.asarray(x).squeeze() for name, x in numbers.items()}


def outline_of(dataset: xr.Dataset, joint: str) -> JointOutline | None:
    """A joint's outline, `depth` refined, (1 or heights, sectors), zero for a round wall; `None`: not known."""
    given = {name: dataset.attrs.get(f"outline.{joint}.{name}") for name in JointOutline._fields}
    numbers: dict[str, Any] = {name: _plain(name, x) for name, x in given.items() if x is not None}
    if not {"radius", "clearance"} <= numbers.keys():
        return None
    outline = JointOutline(**numbers)
    depth = np.zeros((1, 1)) if outline.depth is None else np.atleast_2d(finer(jnp.asarray(outline.depth, float)))
    return outline._replace(depth=depth, heights=np.atleast_1d(outline.heights))


def _plain(name: str, number: Any) -> Any:
    """A number or a flag as Python's, an array as it is."""
    if np.ndim(number):
        return number
    return bool(number) if isinstance(JointOutline._field_defaults.get(name), bool) else np.asarray(number).item()


class BearingSpans(NamedTuple):
    """Time spans [s] of constant contact pattern (in the plane 0 apart, 1 in contact), shape (spans,) each."""

    begin: np.ndarray
    end: np.ndarray
    pattern: np.ndarray

    def share(self, chosen: np.ndarray) -> float:
        """The fraction of the whole time in the chosen spans."""
        lasts = self.end - self.begin
        return float(np.sum(lasts[chosen]) / np.sum(lasts))


def require_joint(dataset: xr.Dataset, joint: str) -> str:
    """The name of a clearance joint. **Raises** `ClearanceError` where there is no such joint."""
    known = names_of(dataset, "joint")
    if joint not in known:
        raise unknown_name(f"There is no clearance joint `{joint[:100]}` in this result.", joint, known)
    return joint


def kind(dataset: xr.Dataset, joint: str) -> str:
    """The `kind` of a clearance joint's class; empty for a user's own class."""
    return str(dataset.attrs.get(f"clearance.{joint}", ""))


def spans(dataset: xr.Dataset, joint: str) -> BearingSpans:
    """The spans of constant contact pattern of a joint. A pattern holds from one step end to the next, since every
    touch and separation is a step end. Without step ends (a `Solution`) the samples are used.
    """
    name = "contact_pattern" if "contact_pattern" in dataset else "contact_state"
    time, patterns = at_steps(dataset, require_joint(dataset, joint), name)
    codes = patterns.astype(int)
    if "contact_pattern" not in dataset:
        codes = np.minimum(codes, 1)  # an impact is a contact
    if len(time) < 2:
        raise ClearanceError("A motion needs two instants at least, but this result has fewer.")
    codes, begin, end = codes[:-1], time[:-1], time[1:]
    # What lasts for less is round-off.
    lasting = end - begin >= SHORTEST
    codes, begin = codes[lasting], begin[lasting]
    first = np.flatnonzero(np.concatenate([[True], codes[1:] != codes[:-1]]))
    begin = begin[first]
    return BearingSpans(begin, np.append(begin[1:], time[-1]), codes[first])


def at_steps(dataset: xr.Dataset, joint: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and values of a variable in a joint, or "gap_..." in a gap: at the step ends if the dataset has them,
    else at the samples.
    """
    time, known = ("step_time", at_step(name)) if at_step(name) in dataset else ("time", name)
    return dataset[time].values, dataset[known].sel({"gap" if name.startswith("gap_") else "joint": joint}).values


def at_step(name: str) -> str:
    """The name of a variable at the step ends."""
    return f"step_{name.removeprefix('contact_').removeprefix('pin_')}"


class JointPlay(NamedTuple):
    """Motion and `outline` of a clearance joint: over the samples the `place` of the pin in its sleeve [m], (times, 2
    or 3), its `tilt`, components of its axis across the sleeve, (times, 2), and its `turn` [rad], (times,), if known.
    `factor`: by which the play is magnified.
    """

    place: np.ndarray
    tilt: np.ndarray
    turn: np.ndarray | None
    outline: JointOutline
    factor: float = 1.0

    @property
    def wall(self) -> float:
        """The radius of the sleeve as drawn [m]."""
        return self.outline.radius + self.factor * self.outline.clearance

    def around(self, angle: np.ndarray, station: int = 0) -> np.ndarray:
        """Points of the wall at angles [rad], at one height, as drawn [m], (2, angles)."""
        depth = self.wear_depth(station)
        sectors = 2 * np.pi * np.arange(depth.size) / depth.size
        far = self.wall + self.factor * np.interp(angle, sectors, depth, period=2 * np.pi)
        return far * np.stack([np.cos(angle), np.sin(angle)])

    def wear_depth(self, station: int) -> np.ndarray:
        """Depth of wear at one height [m], (sectors,)."""
        return self.outline.depth[station % len(self.outline.depth)]

    def centres(self, heights: np.ndarray) -> np.ndarray:
        """The pin's centre at heights along the sleeve [m], (times, heights, 2)."""
        if self.outline.length is None:
            return np.repeat(self.place[:, None, :2], len(heights), axis=1)
        return along_sleeve(self.place, self.tilt, heights, self.outline.through)


def pin_travel(clearance: float, depth: np.ndarray) -> np.ndarray:
    """What a pin's centre can reach in its sleeve [m], (2, points): a circle, wider by wear `depth` [m], (sectors,)."""
    around = np.linspace(0, 2 * np.pi, max(361, depth.size + 1))
    far = np.full(around.shape, clearance)
    if np.any(depth > 0):
        # The wall of each sector is a half-plane to the centre of a round pin.
        ahead = np.cos(around[:, None] - 2 * np.pi * np.arange(depth.size) / depth.size)
        far = np.where(ahead > 0, (clearance + depth) / np.where(ahead > 0, ahead, 1.0), np.inf).min(axis=1)
    return far * np.stack([np.cos(around), np.sin(around)])


def penetration(places: np.ndarray, clearance: float, depth: np.ndarray) -> np.ndarray:
    """Penetration [m] of a pin centred at `places` [m], (..., 2), by clearance and wear `depth` [m], (..., sectors)."""
    if not np.any(depth > 0):
        return np.hypot(places[..., 0], places[..., 1]) - clearance
    angle = 2 * np.pi * np.arange(depth.shape[-1]) / depth.shape[-1]
    return np.max(places @ np.stack([np.cos(angle), np.sin(angle)]) - depth, axis=-1) - clearance


def play(dataset: xr.Dataset, joint: str) -> JointPlay | None:
    """The `JointPlay` of a joint; `None` if its outline or its tilt is unknown."""
    outline = outline_of(dataset, joint)
    tilt = None if outline is None else _tilt(dataset, joint, outline)
    if outline is None or tilt is None:
        return None
    turns = outline.height is None and joint in dataset["coordinate"].values
    turn = dataset["q"].sel(coordinate=joint).values if turns else None
    return JointPlay(dataset["eccentricity"].sel(joint=joint).values, tilt, turn, outline)


def _tilt(dataset: xr.Dataset, joint: str, outline: JointOutline) -> np.ndarray | None:
    """The pin's axis across the sleeve, (times, 2); `None` for a plane block that closes a loop."""
    if "pin_tilt" in dataset:
        return dataset["pin_tilt"].sel(joint=joint).values
    tilt, turn = np.zeros((dataset.sizes["time"], 2)), f"{joint}.tilt_y"
    if outline.height is not None:
        if turn not in dataset["coordinate"].values:
            return None
        tilt[:, 0] = np.sin(dataset["q"].sel(coordinate=turn).values)
    return tilt


class PinPath(NamedTuple):
    """The path of a pin's centre in its sleeve, in the sleeve's axes [m]: its `places` (times, 2) at `time` [s], there
    the contact `state` (0 free, 1 contact, 2 impact), how far it can go (`travel`, (2, points), where that is known),
    at which `height` along the sleeve, and the `penetration` there [m] (times,).
    """

    joint: str
    height: float
    time: np.ndarray
    places: np.ndarray
    state: np.ndarray
    travel: np.ndarray | None
    penetration: np.ndarray = np.zeros(0)

    def share(self, state: int) -> float:
        """The fraction of the time in a contact state. A state holds until the next instant."""
        lasts = np.diff(self.time)
        return float(np.sum(lasts[self.state[:-1] == state]) / max(np.sum(lasts), np.finfo(float).tiny))


def series(dataset: xr.Dataset, joint: str, *names: str) -> tuple[np.ndarray, ...]:
    """Times [s] and values in a joint at samples and known step ends (an impact may lie between samples)."""
    here, rows = dataset.sel(joint=joint), [("time", *names)]
    if "step_time" in dataset:
        rows.append(("step_time", *(at_step(name) for name in names)))
    time, *values = (np.concatenate([here[name].values for name in column]) for column in zip(*rows, strict=True))
    time, order = np.unique(time, return_index=True)
    return time, *(value[order] for value in values)


def middle_path(dataset: xr.Dataset, joint: str) -> PinPath:
    """The path in the middle of the sleeve, with the contact state of the whole joint."""
    time, places, state = series(dataset, require_joint(dataset, joint), "eccentricity", "contact_state")
    outline, travel = outline_of(dataset, joint), None
    if outline is not None and outline.height is not None:
        travel = outline.clearance * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
    elif outline is not None:
        travel = pin_travel(outline.clearance, outline.depth[0])
    return PinPath(joint, 0.0, time, places[:, :2], state, travel)


def is_pin(outline: JointOutline | None) -> bool:
    """Whether it is that of a pin in a sleeve, not of a ball or a block."""
    return outline is not None and outline.height is None and not outline.ball


def station_paths(dataset: xr.Dataset, joint: str) -> list[PinPath]:
    """The path at every station of a sleeve, with free and contact there (one, if it cannot tilt). **Raises** else."""
    pin = play(dataset, require_joint(dataset, joint))
    if pin is None or not is_pin(pin.outline):
        raise ClearanceError(f"`{joint}` has no pin in a sleeve: it is a {kind(dataset, joint) or 'joint unknown'}.")
    tilts = pin.outline.length is not None and "pin_tilt" in dataset
    time, *at = series(dataset, joint, "eccentricity", *(["pin_tilt"] if tilts else []))
    centres = pin._replace(**dict(zip(("place", "tilt"), at, strict=False))).centres(pin.outline.heights)
    out = []
    for k, height in enumerate(pin.outline.heights):
        places, wall = centres[:, k], (pin.outline.clearance, pin.wear_depth(k))
        deep = penetration(places, *wall)
        state = (deep > 0).astype(int)
        out.append(PinPath(joint, float(height), time, places, state, pin_travel(*wall), deep))
    return out


def loads_by_direction(dataset: xr.Dataset, joint: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], contact forces [N] of a pin, and in which direction [rad] in the sleeve's axes it is deepest in the
    wall. **Raises** as `station_paths`.
    """
    time, force = series(dataset, joint, "contact_force")
    paths = station_paths(dataset, joint)
    deepest = np.argmax([path.penetration for path in paths], axis=0)
    x, y = np.stack([path.places for path in paths])[deepest, np.arange(len(time))].T
    return time, force, np.arctan2(y, x)


def along_sleeve(place: np.ndarray, tilt: np.ndarray, heights: np.ndarray, through: bool) -> np.ndarray:
    """The pin's centre at heights [m], (times, heights, 2), along the sleeve, or if not `through` along the pin."""
    if not through:
        return place[:, None, :2] + tilt[:, None] * heights[:, None]
    slope = tilt / np.sqrt(1 - np.sum(tilt**2, axis=1, keepdims=True))
    return place[:, None, :2] + slope[:, None] * (heights - place[:, 2:])[..., None]
