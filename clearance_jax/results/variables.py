"""The tables of what can appear in a dataset: dimensions, units, meanings. Plots know nothing else."""

from typing import NamedTuple

from clearance_jax.mechanism.mechanism import Mechanism


class Variable(NamedTuple):
    """Dimensions after the leading one, SI unit, meaning.

    A unit `see NAME` stands in the coordinate of that name, one for each entry of the variable's first dimension.
    """

    dims: tuple[str, ...]
    unit: str
    meaning: str


VARIABLES = {
    "q": Variable(("coordinate",), "see coordinate_unit", "joint coordinate"),
    "v": Variable(("coordinate",), "see rate_unit", "rate of the joint coordinate"),
    "position": Variable(("point", "axis"), "m", "position of a named point"),
    "velocity": Variable(("point", "axis"), "m/s", "velocity of a named point"),
    "acceleration": Variable(("point", "axis"), "m/s^2", "acceleration of a named point"),
    "eccentricity": Variable(("joint", "axis"), "m", "pin centre from sleeve centre, in the sleeve's axes"),
    "penetration": Variable(("joint",), "m", "overlap of pin and sleeve (negative: apart)"),
    "penetration_rate": Variable(("joint",), "m/s", "rate of the penetration (positive: approach)"),
    "contact_force": Variable(("joint",), "N", "normal contact force"),
    "friction_force": Variable(("joint",), "N", "traction on the pin"),
    "slip_velocity": Variable(("joint",), "m/s", "slip of the pin's surface on the sleeve's"),
    "contact_state": Variable(("joint",), "1", "0 free, 1 contact, 2 impact"),
    "joint_reaction": Variable(("any_joint", "axis"), "N", "force on the child body, world axes"),
    "drive_force": Variable(("drive",), "see drive_unit", "effort of a prescribed coordinate"),
    "kinetic_energy": Variable((), "J", "kinetic energy"),
    "potential_energy": Variable((), "J", "potential energy of weight"),
    "elastic_energy": Variable((), "J", "elastic energy of contacts and springs"),
    "drive_work": Variable((), "J", "work of drives and actuators since the start"),
    "damping_loss": Variable((), "J", "energy lost in contact damping and dampers since the start"),
    "friction_loss": Variable((), "J", "energy lost in friction since the start"),
    "exchanged": Variable((), "J", "sum of absolute powers of drives and inertia since the start"),
}

# Of a trace: what each clearance joint did at every step end, every touch and every separation among them.
STEPS = {
    "step_time": Variable((), "s", "end of an integration step"),
    "step_eccentricity": Variable(("joint", "axis"), "m", "pin centre from sleeve centre at the step ends"),
    "step_force": Variable(("joint",), "N", "normal contact force at the step ends"),
    "step_state": Variable(("joint",), "1", "0 free, 1 contact, 2 impact, at the step ends"),
}

EPISODES = {
    "episode_joint": Variable((), "1", "which clearance joint (index)"),
    "episode_start": Variable((), "s", "first touch"),
    "episode_end": Variable((), "s", "separation (NaN: still in contact at the end)"),
    "impact_speed": Variable((), "m/s", "approach speed at first touch"),
    "peak_force": Variable((), "N", "largest normal force, within the steps too"),
    "peak_time": Variable((), "s", "when the largest normal force acts"),
    "restitution": Variable((), "1", "separation speed over impact speed (NaN: still in contact)"),
}


def labels(mechanism: Mechanism) -> dict[str, tuple[str, list[str]]]:
    """What labels the entries of every dimension: by name its dimension and its values."""
    coordinates = list(mechanism.coordinates())
    driven = [c for c in coordinates if not c.motion.is_free]
    kinds = ["rad" if c.slides is None else "m" for c in coordinates]
    return {
        "axis": ("axis", ["x", "y"]),
        "coordinate": ("coordinate", [c.name for c in coordinates]),
        "coordinate_unit": ("coordinate", kinds),
        "rate_unit": ("coordinate", [f"{kind}/s" for kind in kinds]),
        "point": ("point", [p.name for p in mechanism.points]),
        "joint": ("joint", [j.name for j in mechanism.clearance_joints()]),
        "any_joint": ("any_joint", [j.name for j in mechanism.all_joints()]),
        "drive": ("drive", [c.name for c in driven]),
        "drive_unit": ("drive", ["N m" if c.slides is None else "N" for c in driven]),
    }


def attributes(variable: Variable, labelled: dict[str, tuple[str, list[str]]]) -> dict[str, str]:
    """A variable's attributes: its unit where that is one for all its entries, and what it means."""
    unit = variable.unit
    if unit.startswith("see "):
        own = set(labelled[unit.removeprefix("see ")][1])
        unit = own.pop() if len(own) == 1 else unit
    return {"units": unit, "long_name": variable.meaning}
