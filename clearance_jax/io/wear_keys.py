"""Every key of a study's section `wear`. A new key is a line here, and its use."""

import dataclasses

from clearance_jax.io.asking_keys import METRIC
from clearance_jax.io.fields import keys_of, kind_of, kinds_of, summary
from clearance_jax.io.kinds import LONGEST_PATH, Key, QuantityKey, Sub, Text, Whole, Word
from clearance_jax.io.table import Keys
from clearance_jax.joints.bore import FEWEST
from clearance_jax.laws import Material
from clearance_jax.wear.laws import COEFFICIENT, Archard, Graded, Reye, RunningIn, Threshold
from clearance_jax.wear.pressure import Foundation, HertzLine, Uniform
from clearance_jax.wear.sectors import MOST

WEAR = Keys(
    "wear",
    "Wear",
    "How a joint wears, cycle by cycle, and how long it lasts. Limits of a design that have `cycles` hold as it wears.",
    (
        Text("joint", "the joint that wears: a revolute joint with clearance, in the plane", '"wrist"', required=True),
        Sub("law", "the law of wear", '{ kind = "archard", coefficient = "6e-5 mm^3/(N*m)" }', required=True),
        Sub(
            "pressure",
            "how a force spreads over the sleeve",
            '{ kind = "foundation", stiffness = "2e13 Pa/m" }',
            required=True,
        ),
        QuantityKey("cycle", "when a cycle ends, from the scene's t0 on", '"12 ms"', unit="s", absent="the study's t1"),
        Whole(
            "cycles",
            "how many cycles it lives, if nothing ends its life before",
            "100000",
            least=1,
            absent="no life is asked for: the section says how limits wear",
        ),
        QuantityKey(
            "length",
            "length of the contact along the pin",
            '"20 mm"',
            unit="m",
            bounds={"above": 0.0},
            absent="the joint's own",
        ),
        Sub("pin_material", "for Hertz's width", '{ modulus = "206 GPa" }', absent="the joint's own"),
        Sub("sleeve_material", "for Hertz's width", '{ modulus = "110 GPa" }', absent="the joint's own"),
        Whole(
            "sectors",
            "of the sleeve, around it",
            "720",
            least=FEWEST,
            most=MOST,
            absent="as many as the patch needs, at least 360; in a design that of the scene's own numbers",
        ),
        QuantityKey(
            "tolerance",
            "what a block of cycles may be off by, as a part of the largest depth",
            "1e-2",
            bounds={"above": 0.0, "below": 1.0},
            default=1e-3,
        ),
        Whole(
            "longest", "the most cycles that are jumped over at once", "1000", least=1, absent="as the tolerance has it"
        ),
        Sub(
            "until",
            "what ends its life: a bound on a metric of a cycle, on the depth, on the speed of impacts",
            '{ kind = "depth", bound = "50 um" }',
            absent="it lives all its cycles",
        ),
        Text(
            "journal",
            "the file that keeps what is done, from where the study is",
            '"wear.journal"',
            longest=LONGEST_PATH,
            absent="beside the result, with its name",
        ),
    ),
)

COEFFICIENT_UNIT = f"{COEFFICIENT}, or none beside a hardness"
_LAW = Word("kind", "the law of wear", '"archard"', allowed=("archard", "reye"), required=True)
_CHANGES = (
    dataclasses.replace(keys_of(Threshold, "least")[0], name="least_pressure", required=False, absent="none"),
    Sub(
        "graded",
        "how the coefficient goes with pressure and speed",
        '{ pressure = "10 MPa", speed = "0.1 m/s" }',
        absent="it is constant",
    ),
    Sub("running_in", "wears faster at first", '{ factor = 5.0, duration = "1 h" }', absent="it does not"),
)
_OF_ARCHARD = (
    QuantityKey(
        "coefficient",
        "coefficient of wear: depth by pressure and way, volume by force and way; or Archard's number, with a "
        "`hardness`",
        '"6e-5 mm^3/(N*m)"',
        unit=COEFFICIENT_UNIT,
        bounds={"least": 0.0},
        required=True,
    ),
    QuantityKey(
        "hardness", "of the softer surface", '"1.3 GPa"', unit="Pa", bounds={"above": 0.0}, absent="in the coefficient"
    ),
)
LAW_TABLES = kinds_of(
    "wear.law",
    "Law of wear",
    _LAW,
    {"archard": Archard, "reye": Reye},
    {"archard": (*_OF_ARCHARD, *_CHANGES), "reye": _CHANGES},
)
GRADED = Keys("wear.law.graded", "Graded coefficient", summary(Graded), keys_of(Graded))
RUNNING_IN = Keys("wear.law.running_in", "Running in", summary(RunningIn), keys_of(RunningIn))

_KIND = Word("kind", "how a force spreads", '"hertz"', allowed=("foundation", "hertz", "uniform"), required=True)
_LAYER = "of the layer that the foundation is, instead of the stiffness"
PRESSURE_TABLES = kinds_of(
    "wear.pressure",
    "Pressure",
    _KIND,
    {"foundation": Foundation, "hertz": HertzLine, "uniform": Uniform},
    {
        "foundation": (
            *(dataclasses.replace(key, required=False, absent="from a layer") for key in keys_of(Foundation)),
            QuantityKey("thickness", f"thickness {_LAYER}", '"2 mm"', unit="m", bounds={"above": 0.0}),
            Sub("material", f"material {_LAYER}", '{ modulus = "3 GPa", poisson_ratio = 0.4 }'),
        )
    },
)
MATERIAL = Keys("wear.pin_material", "Materials", "Of pin, sleeve or layer: elastic.", keys_of(Material))

_END = Word("kind", "what ends its life", '"depth"', allowed=("metric", "depth", "impact-speed"), required=True)


def _until(kind: str, help: str, unit: str, example: str, *keys: Key) -> Keys:
    bound = QuantityKey("bound", "where it ends", example, unit=unit, bounds={"above": 0.0}, required=True)
    return kind_of("wear.until", "End of a life", _END, kind, help, *keys, bound)


UNTIL_TABLES = {
    "metric": _until(
        "metric",
        "A metric of the study, of the motion of a cycle, on the worn sleeve.",
        METRIC,
        '"0.2 mm"',
        Text("metric", "its name", '"piston"', required=True),
    ),
    "depth": _until("depth", "The largest depth of wear.", "m", '"50 um"'),
    "impact-speed": _until(
        "impact-speed", "The largest speed at which the joint's surfaces meet in a cycle.", "m/s", '"0.2 m/s"'
    ),
}
WEAR_TABLES = (
    WEAR,
    *LAW_TABLES.values(),
    GRADED,
    RUNNING_IN,
    *PRESSURE_TABLES.values(),
    MATERIAL,
    *UNTIL_TABLES.values(),
)
"""Every table of the section, in the order of the reference."""
