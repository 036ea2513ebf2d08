"""Quantities of a state, all or by name: `POINT.position`, `JOINT.contact_force`, `COORDINATE.velocity`, an energy.

One table of variables with dimensions, units and meanings serves names, datasets and plots.
"""

import functools
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.shapes import TreeShape, tree_shape
from clearance_jax.dynamics.applied import exert_each
from clearance_jax.dynamics.equations import Balance, balance
from clearance_jax.dynamics.field import BALANCE_TERMS, drive_forces, energies, mesh_efforts, read_balance
from clearance_jax.dynamics.gaps import gap_motions
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.reactions import reactions
from clearance_jax.laws._friction import speed_of
from clearance_jax.mechanism._base import AbstractMechanism, ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, actuated_coordinates, effort_sources, layout, parts
from clearance_jax.mechanism.unfolded import unfold
from clearance_jax.spatial import Vector, add, as_array, length_of, rotation_vector, scale


def observe(time: Scalar, y: Array, mechanism: PreparedMechanism) -> dict[str, Array]:
    """Everything reported of one state. Rows follow the mechanism's own order of coordinates, joints and points."""
    mechanism, plan = mechanism.at(time), layout(mechanism)
    state = plan.split(y)
    now = balance(mechanism, time, state)
    out = coordinate_values(mechanism, time, state) | point_motions(mechanism, now)
    out |= contacts(mechanism, now) | in_gaps(mechanism, time, state, now)
    axes = len(axes_of(mechanism))
    exerted = reactions(mechanism, now).values()
    out["joint_reaction"] = jnp.stack([as_array(w.force[:axes]) for w in exerted])
    if axes == 3:
        out["joint_moment"] = jnp.stack([as_array(w.moment) for w in exerted])
    efforts = drive_forces(mechanism, now)
    if efforts:
        out["drive_force"] = as_array([effort for effort, _ in efforts])
    moved = actuated_coordinates(mechanism)
    if moved:
        whole = unfold(mechanism, time, state)
        every = exert_each(whole.mechanism, time, whole.state) if whole.weights else now.efforts
        out["actuator_effort"] = as_array([every[part.v.start] for part in moved])
    if mechanism.couplings:
        out["torque"] = as_array(mesh_efforts(mechanism, time, state, now))
    energy = energies(time, y, mechanism)
    out |= {"kinetic_energy": energy.kinetic, "potential_energy": energy.potential, "elastic_energy": energy.elastic}
    if y.shape[0] > plan.size:
        out |= read_balance(y[plan.size : plan.size + len(BALANCE_TERMS)], energy.contacts)
    return out


def contacts(mechanism: PreparedMechanism, now: Balance) -> dict[str, Array]:
    """By joint with clearance: the pin's place (joints, axes), the normal force, and values at its deepest point."""
    if not now.plays:
        return {}
    plays, actions = [at.relative for at in now.plays.values()], [now.actions[name] for name in now.plays]
    every = [action.points for action in actions]
    points, patterns = [action.deepest for action in actions], {}
    if len(axes_of(mechanism)) == 3:
        joints = [joint.clearance.joint for joint in mechanism.clearance_joints()]
        bearing = [joint.pattern(joint.points(at)) for joint, at in zip(joints, plays, strict=True)]
        # A ball has no axis, and does not lean.
        leans = [any(coordinate.turns is not None for coordinate in joint.play()) for joint in joints]
        tilts = [as_array(at.axis[:2]) if leant else jnp.zeros(2) for at, leant in zip(plays, leans, strict=True)]
        patterns = {"contact_pattern": jnp.stack(bearing), "pin_tilt": jnp.stack(tilts)}
    return patterns | {
        "eccentricity": jnp.stack([as_array(at.place[: len(axes_of(mechanism))]) for at in plays]),
        "penetration": jnp.stack([p.penetration for p in points]),
        "penetration_rate": jnp.stack([p.penetration_rate for p in points]),
        "contact_force": jnp.stack([action.normal_force for action in actions]),
        "contact_power": jnp.stack([jnp.sum(each.normal_force * each.penetration_rate) for each in every]),
        "friction_force": jnp.stack([_friction(mechanism, now, joint) for joint in mechanism.clearance_joints()]),
        "slip_velocity": jnp.stack([p.slip[0] if len(p.slip) == 1 else speed_of(p.slip) for p in points]),
    }


def in_gaps(mechanism: PreparedMechanism, time: Scalar, state: State, now: Balance) -> dict[str, Array]:
    """By gap of a coordinate: the place in it, its contact, and the effort of the flanks."""
    gaps = mechanism.open_gaps()
    if not gaps:
        return {}
    actions = [now.actions[gap.name] for gap in gaps]
    motions = dict(zip((gap.name for gap in mechanism.gaps), gap_motions(mechanism, time, state), strict=True))
    points = [action.points for action in actions]
    places = [motions[gap.name].now.place[0] for gap in gaps]
    return {
        "gap_position": as_array(places),
        "gap_penetration": jnp.stack([action.deepest.penetration for action in actions]),
        "gap_penetration_rate": jnp.stack([action.deepest.penetration_rate for action in actions]),
        "gap_effort": as_array([action.force[0] for action in actions]),
        "gap_contact_force": jnp.stack([action.normal_force for action in actions]),
        "gap_contact_power": jnp.stack([jnp.sum(p.normal_force * p.penetration_rate) for p in points]),
    }


def _friction(mechanism: PreparedMechanism, now: Balance, joint: ClearanceJoint) -> Array:
    """Friction in a joint [N]: with its sign where it has one direction, else the magnitude of all points' together."""
    acted = now.actions[joint.name].points
    if len(acted.traction) == 1:
        return now.actions[joint.name].deepest.traction[0]
    along: Vector = (0.0, 0.0, 0.0)
    tangents = joint.clearance.joint.points(now.plays[joint.name].relative).tangents
    for traction, tangent in zip(acted.traction, tangents, strict=True):
        along = add(along, scale(traction, tangent))
    x, y, z = (jnp.sum(jnp.asarray(term, float)) for term in along)
    return length_of((x, y, z))


def point_motions(mechanism: PreparedMechanism, now: Balance) -> dict[str, Array]:
    """Position, velocity and acceleration of every named point, shape (points, 2), in space (points, 3)."""
    if not mechanism.points:
        return {}
    extra, axes, places, speeds, rates = now.motion.extra(now.acceleration), len(axes_of(mechanism)), [], [], []
    for point in mechanism.points:
        frame = now.motion[point.body]
        at = frame.point(point.at.vector)
        places.append(as_array(at[:axes]))
        speeds.append(as_array(frame.velocity_at(at)[:axes]))
        rates.append(as_array(add(frame.acceleration_at(at), extra.at(point.body, at))[:axes]))
    return {"position": jnp.stack(places), "velocity": jnp.stack(speeds), "acceleration": jnp.stack(rates)}


def coordinate_values(mechanism: PreparedMechanism, time: Scalar, state: State) -> dict[str, Array]:
    """Position and velocity of every coordinate, prescribed ones too; of a ball its rotation vector and spin."""
    mechanism, state, *_ = unfold(mechanism, time, state)
    free = iter(parts(mechanism))
    q, v = [], []
    for coordinate in mechanism.coordinates():
        if coordinate.motion.drive is None:
            part = next(free)
            q += rotation_vector(state.q[part.q]) if coordinate.is_ball else state.q[part.q]
            v += state.v[part.v]
        else:
            now = coordinate.motion.drive(time)
            q.append(now[0])
            v.append(now[1])
    return {"q": as_array(q), "v": as_array(v)}


def axes_of(mechanism: AbstractMechanism) -> tuple[str, ...]:
    """The axes along which a mechanism's vectors are reported."""
    return ("x", "y") if mechanism.is_plane else ("x", "y", "z")


class Variable(NamedTuple):
    """Dimensions after the leading one, SI unit and meaning of a variable. A unit `see NAME` is that of the coordinate
    of this name, for each entry of the first dimension.
    """

    dims: tuple[str, ...]
    unit: str
    meaning: str


OBSERVED = {
    "q": Variable(("coordinate",), "see coordinate_unit", "joint coordinate"),
    "v": Variable(("coordinate",), "see rate_unit", "rate of the joint coordinate"),
    "position": Variable(("point", "axis"), "m", "position of a named point"),
    "velocity": Variable(("point", "axis"), "m/s", "velocity of a named point"),
    "acceleration": Variable(("point", "axis"), "m/s^2", "acceleration of a named point"),
    "eccentricity": Variable(("joint", "axis"), "m", "pin centre from sleeve centre, in the sleeve's axes"),
    "penetration": Variable(("joint",), "m", "overlap of pin and sleeve (negative: apart)"),
    "penetration_rate": Variable(("joint",), "m/s", "rate of the penetration (positive: approach)"),
    "contact_force": Variable(("joint",), "N", "normal contact force, of all contact points together"),
    "contact_power": Variable(("joint",), "W", "power taken up by the normal contact force (negative: given back)"),
    "friction_force": Variable(("joint",), "N", "traction on the pin; in space its magnitude, of all points together"),
    "slip_velocity": Variable(
        ("joint",), "m/s", "slip of the pin's surface on the sleeve's where it is deepest; in space its magnitude"
    ),
    "contact_pattern": Variable(
        ("joint",),
        "",
        "where a pin bears: 0 nowhere, 1 at an edge, 2 along a line, 3 at two opposite edges; 4 more on a face",
    ),
    "pin_tilt": Variable(
        ("joint", "across"), "rad", "how the pin's axis leans along the sleeve's x and y (in space); 0 for a ball"
    ),
    "gap_position": Variable(
        ("gap",), "see gap_unit", "place in the gap of a drive, coupling or stop, from its middle"
    ),
    "gap_penetration": Variable(("gap",), "see gap_unit", "how deep a flank is pressed (negative: apart)"),
    "gap_penetration_rate": Variable(("gap",), "see gap_rate_unit", "rate of the penetration (positive: approach)"),
    "gap_effort": Variable(("gap",), "see gap_effort_unit", "effort of the flanks on the link or follower"),
    "gap_contact_force": Variable(("gap",), "see gap_effort_unit", "size of the effort of the flanks"),
    "gap_contact_power": Variable(("gap",), "W", "power taken up by the flanks (negative: given back)"),
    "joint_reaction": Variable(("any_joint", "axis"), "N", "force on the child body, world axes"),
    "joint_moment": Variable(
        ("any_joint", "axis"), "N m", "moment on the child body about the joint's place, world axes (in space)"
    ),
    "drive_force": Variable(("drive",), "see drive_unit", "effort of a prescribed coordinate"),
    "actuator_effort": Variable(("actuated",), "see actuated_unit", "effort of actuators and controllers"),
    "torque": Variable(("coupling",), "see coupling_unit", "what a coupling exerts on its follower"),
    "kinetic_energy": Variable((), "J", "kinetic energy"),
    "potential_energy": Variable((), "J", "potential energy of weight"),
    "elastic_energy": Variable((), "J", "elastic energy of contacts and springs"),
    "drive_work": Variable((), "J", "work of drives and actuators since the start"),
    "damping_loss": Variable((), "J", "energy lost in contact damping and dampers since the start"),
    "friction_loss": Variable((), "J", "energy lost in friction since the start"),
    "exchanged": Variable((), "J", "sum of absolute powers of drives, loads and inertia since the start"),
}
"""The variables that `observe` reports."""
IN_SPACE = ("joint_moment", "contact_pattern", "pin_tilt")
"""Variables of mechanisms that leave the plane only."""
OF_BALANCE = ("drive_work", "damping_loss", "friction_loss", "exchanged")
# A coordinate's value and rate have the names that its initial values have among the parameters.
OF_COORDINATES = {"q": "position", "v": "velocity"}


def labels(mechanism: AbstractMechanism) -> dict[str, tuple[str, list[str]]]:
    """By name: a dimension and the labels of its entries."""
    coordinates = list(mechanism.coordinates())
    followers = [coupling.follower for coupling in mechanism.firm_couplings]
    wheels, gaps = [coupling.follower for coupling in mechanism.couplings], mechanism.open_gaps()
    driven = [c for c in coordinates if not c.motion.is_free and c.name not in followers]
    slides = {c.name for c in coordinates if c.slides is not None}
    moved = actuated_coordinates(mechanism)
    kinds = ["rad" if c.slides is None else "m" for c in coordinates for _ in c.velocities]
    return {
        "across": ("across", ["x", "y"]),
        "axis": ("axis", list(axes_of(mechanism))),
        "coordinate": ("coordinate", [name for c in coordinates for name in c.velocities]),
        "coordinate_unit": ("coordinate", kinds),
        "rate_unit": ("coordinate", [f"{kind}/s" for kind in kinds]),
        "point": ("point", [p.name for p in mechanism.points]),
        "joint": ("joint", [j.name for j in mechanism.clearance_joints()]),
        "any_joint": ("any_joint", [j.name for j in mechanism.all_joints()]),
        "drive": ("drive", [c.name for c in driven]),
        "drive_unit": ("drive", ["N m" if c.slides is None else "N" for c in driven]),
        "coupling": ("coupling", [coupling.name for coupling in mechanism.couplings]),
        "coupling_unit": ("coupling", ["N" if name in slides else "N m" for name in wheels]),
        "gap": ("gap", [gap.name for gap in gaps]),
        "gap_unit": ("gap", ["rad" if gap.turns else "m" for gap in gaps]),
        "gap_rate_unit": ("gap", ["rad/s" if gap.turns else "m/s" for gap in gaps]),
        "gap_effort_unit": ("gap", ["N m" if gap.turns else "N" for gap in gaps]),
        "actuated": ("actuated", [part.coordinate.name for part in moved]),
        "actuated_unit": ("actuated", ["N m" if part.coordinate.slides is None else "N" for part in moved]),
    }


class QuantityEntry(NamedTuple):
    """An entry of a `variable` of `OBSERVED`, or a `place` in the state vector, with its unit."""

    variable: str
    index: tuple[int, ...]
    unit: str
    place: int | None = None


def quantities(mechanism: AbstractMechanism, energy_balance: bool) -> Mapping[str, QuantityEntry]:
    """All quantities by name; `energy_balance`: whether states contain the energy balance."""
    # Names follow from the structure. Making them takes longer than some solves, so they are kept.
    return _quantities(tree_shape(mechanism), energy_balance)


@functools.lru_cache(maxsize=256)
def _quantities(frame: TreeShape, energy_balance: bool) -> Mapping[str, QuantityEntry]:
    """`quantities` of a mechanism without its numbers."""
    with jax.ensure_compile_time_eval():  # what is kept must hold no tracers, whatever is being traced
        mechanism = frame.fill(jnp.asarray(np.ones(shape.shape)) for shape in frame.shapes)
    labelled, out = labels(mechanism), dict(_states(mechanism))
    for variable, described in OBSERVED.items():
        if variable in IN_SPACE and mechanism.is_plane:
            continue
        if not described.dims and (energy_balance or variable not in OF_BALANCE):
            out[variable] = QuantityEntry(variable, (), described.unit)
        for name, quantity in _entries(variable, described, labelled):
            out.setdefault(name, quantity)  # of a coordinate that is a state the place in it is known already
    return MappingProxyType(out)


def _entries(variable: str, described: Variable, labelled: dict) -> Iterator[tuple[str, QuantityEntry]]:
    """The entries of a variable with dimensions, by name, and the components of vectors."""
    if not described.dims:
        return
    first, *rest = described.dims
    for i, label in enumerate(labelled[first][1]):
        unit = described.unit
        unit = labelled[unit.removeprefix("see ")][1][i] if unit.startswith("see ") else unit
        name = f"{label}.{OF_COORDINATES.get(variable, variable.removeprefix('gap_'))}"
        yield name, QuantityEntry(variable, (i,), unit)
        if variable == "q":
            yield label, QuantityEntry(variable, (i,), unit)
        for k, axis in enumerate(labelled[rest[0]][1] if rest else ()):
            yield f"{name}.{axis}", QuantityEntry(variable, (i, k), unit)


def _states(mechanism: AbstractMechanism) -> Iterator[tuple[str, QuantityEntry]]:
    """Quantities that are entries of the state: free coordinates, their rates, and the laws' memory."""
    plan = layout(mechanism)
    for c, q, v in parts(mechanism):
        unit = "rad" if c.slides is None else "m"
        if not c.is_ball:  # an orientation is reported by its rotation vector, which is not in the state
            yield c.name, QuantityEntry("state", (), unit, q.start)
            yield f"{c.name}.position", QuantityEntry("state", (), unit, q.start)
        for i, name in enumerate(c.velocities):
            yield f"{name}.velocity", QuantityEntry("state", (), f"{unit}/s", plan.v.start + v.start + i)
    for joint, names in plan.memories:
        for name in names:
            yield f"{joint}.{name}", QuantityEntry("state", (), "", plan.index(joint, name))
    kinds = {c.name: "N m" if c.slides is None else "N" for c in mechanism.moved_coordinates()}
    for source in effort_sources(mechanism):
        if source.integrates:
            unit = "rad s" if kinds[source.coordinates[0]] == "N m" else "m s"
            yield f"{source.name}.integral", QuantityEntry("state", (), unit, plan.index(source.name, "integral"))
    for holder, names in plan.efforts:
        for name in names:
            yield f"{holder}.{name}", QuantityEntry("state", (), kinds[name], plan.index(holder, name))


def evaluate(variable: str, time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """One variable of `OBSERVED` in one state, without computing the others where that is possible."""
    if variable in ("position", "velocity"):
        motion, axes, out = frames(mechanism, time, layout(mechanism).split(y)), len(axes_of(mechanism)), []
        for point in mechanism.points:
            frame = motion[point.body]
            at = frame.point(point.at.vector)
            out.append(as_array((at if variable == "position" else frame.velocity_at(at))[:axes]))
        return jnp.stack(out)
    if variable in OF_COORDINATES:
        return coordinate_values(mechanism, time, layout(mechanism).split(y))[variable]
    if variable.removesuffix("_energy") in ("kinetic", "potential", "elastic"):
        return jnp.asarray(getattr(energies(time, y, mechanism), variable.removesuffix("_energy")), float)
    return observe(time, y, mechanism)[variable]
