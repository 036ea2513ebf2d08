"""Tables of all variables of a dataset: dimensions, units, meanings."""

from clearance_jax.dynamics.quantities import OBSERVED, Variable

VARIABLES = OBSERVED | {
    "contact_state": Variable(("joint",), "1", "0 free, 1 contact, 2 impact"),
    "mark_position": Variable(("mark", "axis"), "m", "place of a joint, point or spring on the body `mark_body`"),
}

# Of a trace: what each clearance joint did at every step end, every touch and every separation among them.
STEPS = {
    "step_time": Variable((), "s", "end of an integration step"),
    "step_eccentricity": Variable(("joint", "axis"), "m", "pin centre from sleeve centre at the step ends"),
    "step_force": Variable(("joint",), "N", "normal contact force at the step ends"),
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
