"""Where joints, points and springs are on the bodies of a mechanism, and in a dataset over time, for pictures."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.quantities import axes_of, observe
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND, Point
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree.tree import Revolute
from clearance_jax.spatial import UNIT, ZERO, as_array

# Relative to the mechanism's size: two marks of one name that come further apart belong to a spring or a slide.
APART = 0.02
# The attribute of a dataset with the radius of a gear's pitch circle [m].
WHEEL = "pitch_radius.{}"
# Dataset variables of a picture beside the positions of marks.
SHOWN = "q", "eccentricity", "penetration", "pin_tilt"


class Places(NamedTuple):
    """Places [m] of marks, `at` (times, marks, axes), at `time` [s] (times,); and which of the marks are what:

    - `ground`: what the ground carries, and `bodies`: what each body carries;
    - `joints`: each joint on its child, `points`: each named point;
    - `pairs`: both ends of each spring, and of each joint that slides.

    `slides`: the direction of each joint that slides, (times, axes); `loose`: the joints with clearance; `wheels`: by
    joint the radius of the pitch circle of its gear [m], and its turn [rad], (times,).
    """

    time: np.ndarray
    at: np.ndarray
    ground: list[int]
    bodies: dict[str, list[int]]
    joints: dict[str, int]
    points: dict[str, int]
    pairs: dict[str, list[int]]
    slides: dict[str, np.ndarray]
    loose: frozenset[str]
    wheels: Mapping[str, tuple[float, np.ndarray]] = MappingProxyType({})

    @property
    def rims(self) -> np.ndarray:
        """Corners of the squares around gears [m], (times, corners, axes)."""
        every = [
            self.at[:, self.joints[n]] + side * radius for n, (radius, _) in self.wheels.items() for side in (-1, 1)
        ]
        return np.stack(every, axis=1) if every else self.at[:, :0]

    @property
    def size(self) -> float:
        """The largest extent along an axis [m]."""
        low, high = bounds(self.at)
        return float(max(np.max(high - low), 1e-9))


class Outline(NamedTuple):
    """A mechanism in a still picture: `places` along two axes, at a `sample`; `seen`: the axis of space along which it
    is viewed, x, y or z (in the plane empty).
    """

    places: Places
    sample: int
    seen: str

    @property
    def time(self) -> float:
        """Time of the sample [s]."""
        return float(self.places.time[self.sample])

    @property
    def visible(self) -> np.ndarray:
        """The positions in the picture [m], (n, 2): all marks and gears at the sample, and points at all times."""
        at, rims = self.places.at, self.places.rims
        return np.concatenate(
            [at[self.sample], rims[self.sample], *(at[:, mark] for mark in self.places.points.values())]
        )


def names_of(dataset: xr.Dataset, label: str) -> list[str]:
    """The names along a dimension of a dataset; none where it has no such dimension."""
    return [str(name) for name in dataset[label].values] if label in dataset.coords else []


def bounds(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest coordinates of places (..., axes) [m], (axes,)."""
    every = at.reshape(-1, at.shape[-1])
    return np.nanmin(every, 0), np.nanmax(every, 0)


def places(dataset: xr.Dataset) -> Places:
    """The positions of a motion's marks. **Raises** `ClearanceError` for a dataset without marks."""
    if "mark_position" not in dataset:
        raise ClearanceError(
            "This result does not say where the mechanism's parts are: it was written by an older version. "
            "Simulate again."
        )
    labels = "mark", "mark_body", "any_joint", "point", "joint"
    names, owners, joined, points, loose = (names_of(dataset, label) for label in labels)
    bodies: dict[str, list[int]] = {}
    for mark, owner in enumerate(owners):
        bodies.setdefault(owner, []).append(mark)
    ends = {name: [mark for mark, other in enumerate(names) if other == name] for name in names}
    at = dataset["mark_position"].values
    # A joint has a mark on its parent, then one on its child.
    of_joints, of_points = {name: ends[name][-1] for name in joined}, {name: ends[name][0] for name in points}
    ground, time = bodies.pop(GROUND, []), dataset["time"].values
    placed = Places(time, at, ground, bodies, of_joints, of_points, {}, {}, frozenset(loose))
    apart = {name: np.diff(at[:, pair[:2]], axis=1)[:, 0] for name, pair in ends.items() if len(pair) > 1}
    apart = {name: between for name, between in apart.items() if np.abs(between).max() > APART * placed.size}
    fixed = {name: owners[ends[name][0]] == GROUND for name in apart if name in joined}
    slides = {name: _directions(apart[name], is_fixed) for name, is_fixed in fixed.items()}
    known = names_of(dataset, "coordinate")
    radii = {name: float(dataset.attrs[WHEEL.format(name)]) for name in joined if WHEEL.format(name) in dataset.attrs}
    wheels = {
        name: (radius, dataset["q"].sel(coordinate=name).values) for name, radius in radii.items() if name in known
    }
    return placed._replace(pairs={name: ends[name][:2] for name in apart}, slides=slides, wheels=wheels)


def _directions(between: np.ndarray, fixed: bool) -> np.ndarray:
    """Directions of vectors (times, axes), of short ones that of the last long one, if `fixed` all of the longest."""
    length = np.linalg.norm(between, axis=1)
    long = length >= (1.0 if fixed else 0.1) * length.max()
    last = np.maximum.accumulate(np.where(long & (not fixed), np.arange(len(long)), np.argmax(long)))
    return between[last] / length[last, None]


def outline(dataset: xr.Dataset) -> Outline:
    """A still view of a motion along the axis along which it is thinnest, at the sample at which the mechanism is least
    stretched out: joints in a line hide each other. **Raises** `ClearanceError` as `places`.
    """
    placed, axes, seen = places(dataset), [0, 1], ""
    if placed.at.shape[-1] == 3:
        low, high = bounds(placed.at)
        along = int(np.argmin(high - low))
        axes, seen = [k for k in range(3) if k != along], "xyz"[along]
    flat = places(dataset.isel(axis=axes))
    # The thickness of a set of points is their smaller singular value about the mean.
    thickness = np.linalg.svd(flat.at - flat.at.mean(axis=1, keepdims=True), compute_uv=False)[:, -1]
    return Outline(flat, int(np.argmax(thickness)), seen)


def pitch_radii(mechanism: AbstractMechanism) -> dict[str, float]:
    """The radii of the pitch circles of gears with backlash on the ground, in the plane, by joint [m]: they follow from
    the ratio and the distance of the pins.
    """
    pins = {j.name: j for j in mechanism.joints if isinstance(j, Revolute) and j.is_plane and j.parent == GROUND}
    radii = {}
    for gear in mechanism.couplings:
        ratio = float(gear.ratio)
        if gear.backlash is None or gear.second is not None or not {gear.leader, gear.follower} <= pins.keys():
            continue
        first, second = (np.asarray(as_array(pins[name].at_parent.vector)) for name in (gear.leader, gear.follower))
        distance = float(np.linalg.norm(second - first))
        if distance > 0 and ratio != 1:
            radius = distance / abs(1 - ratio)
            radii |= {gear.follower: radius, gear.leader: abs(ratio) * radius}
    return radii


def marks(mechanism: AbstractMechanism) -> Iterator[Point]:
    """The marks of the ground and of every body: points that are called by what is there, a joint or a spring (on two
    bodies each), or a named point. A body with one mark has its centre of mass, under its own name, as a second one.
    """
    joints, springs = mechanism.all_joints(), mechanism.springs
    for body in (GROUND, *(b.name for b in mechanism.bodies)):
        carried = [Point(j.name, body, j.at_child) for j in joints if j.child == body]
        carried += [Point(j.name, body, j.at_parent) for j in joints if j.parent == body]
        carried += [Point(p.name, body, p.at) for p in mechanism.points if p.body == body]
        carried += [Point(s.name, body, s.at_a) for s in springs if s.body_a == body]
        carried += [Point(s.name, body, s.at_b) for s in springs if s.body_b == body]
        if len(carried) == 1:
            carried += [Point(body, body, b.center_of_mass) for b in mechanism.bodies if b.name == body]
        yield from carried


def mark_labels(mechanism: Mechanism) -> dict[str, tuple[str, list[str]]]:
    """The labels of marks and bodies in a dataset: names of marks and their bodies, of bodies and their axes."""
    drawn = list(marks(mechanism))
    named = {"mark": ("mark", [m.name for m in drawn]), "mark_body": ("mark", [m.body for m in drawn])}
    return named | {"body": ("body", [b.name for b in mechanism.bodies]), "own_axis": ("own_axis", ["x", "y", "z"])}


def mark_positions(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Float[Array, "marks axes"]:
    """World places of all marks [m] at one state."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, layout(mechanism).split(y))
    axes = len(axes_of(mechanism))
    return jnp.stack([as_array(motion[m.body].point(m.at.vector)[:axes]) for m in marks(mechanism)])


def body_poses(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, Array]:
    """In space the place of every body's frame [m], (bodies, 3), and its axes as columns (bodies, 3, 3)."""
    if len(axes_of(mechanism)) < 3:
        return {}
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, layout(mechanism).split(y))
    every = [motion[body.name] for body in mechanism.bodies]
    turns = [jnp.stack([as_array(frame.rotation.apply(axis)) for axis in UNIT], axis=1) for frame in every]
    return {"body_position": jnp.stack([as_array(f.point(ZERO)) for f in every]), "body_rotation": jnp.stack(turns)}


def picture(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, Array]:
    """The variables of a picture at one state of a prepared mechanism, by their names in a dataset."""
    seen = observe(time, y[: layout(mechanism).size], mechanism)
    shown = {name: seen[name] for name in SHOWN if name in seen}
    return shown | {"mark_position": mark_positions(mechanism, time, y)}
