"""Every key of a study's section `wear`. A new key is a line here, and its use."""

import dataclasses

from clearance_jax.io.keys.declare import family, keys_of, kind, kinds, optional, summary, table
from clearance_jax.io.keys.kinds import Key, Sub, Text, Whole, path, quantity
from clearance_jax.io.keys.metric import METRIC
from clearance_jax.joints.bore import FEWEST
from clearance_jax.laws import Material
from clearance_jax.wear.laws import COEFFICIENT, Archard, Graded, Reye, RunningIn, Threshold
from clearance_jax.wear.pressure import Foundation, HertzLine, Uniform
from clearance_jax.wear.worn import MOST

OF_THE_JOINT = "the joint's own"

WEAR = table(
    "wear",
    "Wear",
    "How a joint wears, cycle by cycle, and how long it lasts. Limits of a design that have `cycles` hold as it wears.",
    joint=Text("the joint that wears: a revolute joint with clearance, in the plane", '"wrist"', required=True),
    law=Sub("the law of wear", '{ kind = "archard", coefficient = "6e-5 mm^3/(N*m)" }', required=True),
    pressure=Sub(
        "how a force spreads over the sleeve", '{ kind = "foundation", stiffness = "2e13 Pa/m" }', required=True
    ),
    cycle=quantity("when a cycle ends, from the scene's t0 on", '"12 ms"', "s", "the study's t1"),
    cycles=Whole(
        "how many cycles it lives, if nothing ends its life before",
        "100000",
        "no life is asked for: the section says how limits wear",
        least=1,
    ),
    length=quantity("length of the contact along the pin", '"20 mm"', "m", OF_THE_JOINT, above=0.0),
    pin_material=Sub("for Hertz's width", '{ modulus = "206 GPa" }', OF_THE_JOINT),
    sleeve_material=Sub("for Hertz's width", '{ modulus = "110 GPa" }', OF_THE_JOINT),
    sectors=Whole(
        "of the sleeve, around it",
        "720",
        "as many as the patch needs, at least 360; in a design that of the scene's own numbers",
        least=FEWEST,
        most=MOST,
    ),
    tolerance=quantity(
        "what a block of cycles may be off by, as a part of the largest depth",
        "1e-2",
        default=1e-3,
        above=0.0,
        below=1.0,
    ),
    longest=Whole("the most cycles that are jumped over at once", "1000", "as the tolerance has it", least=1),
    until=Sub(
        "what ends its life: a bound on a metric of a cycle, on the depth, on the speed of impacts",
        '{ kind = "depth", bound = "50 um" }',
        "it lives all its cycles",
    ),
    journal=path(
        "the file that keeps what is done, from where the study is",
        '"wear.journal"',
        "beside the result, with its name",
    ),
)

COEFFICIENT_UNIT = f"{COEFFICIENT}, or none beside a hardness"
_CHANGES: dict[str, Key] = {
    "least_pressure": dataclasses.replace(keys_of(Threshold)["least"], required=False, absent="none"),
    "graded": Sub(
        "how the coefficient goes with pressure and speed",
        '{ pressure = "10 MPa", speed = "0.1 m/s" }',
        "it is constant",
    ),
    "running_in": Sub("wears faster at first", '{ factor = 5.0, duration = "1 h" }', "it does not"),
}
_OF_ARCHARD = {
    "coefficient": quantity(
        "coefficient of wear: depth by pressure and way, volume by force and way; or Archard's number, with a "
        "`hardness`",
        '"6e-5 mm^3/(N*m)"',
        COEFFICIENT_UNIT,
        least=0.0,
        required=True,
    ),
    "hardness": quantity("of the softer surface", '"1.3 GPa"', "Pa", "in the coefficient", above=0.0),
}
LAW_TABLES = family(
    "wear.law",
    "Law of wear",
    "kind",
    "the law of wear",
    kinds({"archard": Archard, "reye": Reye}, {"archard": _OF_ARCHARD | _CHANGES, "reye": _CHANGES}),
)
GRADED = table("wear.law.graded", "Graded coefficient", summary(Graded), **keys_of(Graded))
RUNNING_IN = table("wear.law.running_in", "Running in", summary(RunningIn), **keys_of(RunningIn))

_LAYER = "of the layer that the foundation is, instead of the stiffness"
_OF_FOUNDATION = {
    **optional(keys_of(Foundation), stiffness="from a layer"),
    "thickness": quantity(f"thickness {_LAYER}", '"2 mm"', "m", above=0.0),
    "material": Sub(f"material {_LAYER}", '{ modulus = "3 GPa", poisson_ratio = 0.4 }'),
}
PRESSURE_TABLES = family(
    "wear.pressure",
    "Pressure",
    "kind",
    "how a force spreads",
    kinds({"foundation": Foundation, "hertz": HertzLine, "uniform": Uniform}, {"foundation": _OF_FOUNDATION}),
)
MATERIAL = table("wear.pin_material", "Materials", "Of pin, sleeve or layer: elastic.", **keys_of(Material))


def _bound(unit: str, example: str) -> Key:
    return quantity("where it ends", example, unit, above=0.0, required=True)


UNTIL_TABLES = family(
    "wear.until",
    "End of a life",
    "kind",
    "what ends its life",
    {
        "metric": kind(
            "A metric of the study, of the motion of a cycle, on the worn sleeve.",
            metric=Text("its name", '"piston"', required=True),
            bound=_bound(METRIC, '"0.2 mm"'),
        ),
        "depth": kind("The largest depth of wear.", bound=_bound("m", '"50 um"')),
        "impact-speed": kind(
            "The largest speed at which the joint's surfaces meet in a cycle.", bound=_bound("m/s", '"0.2 m/s"')
        ),
    },
)
