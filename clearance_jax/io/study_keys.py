"""Every key of a study file. A new key is a line here, and its use."""

import dataclasses

from clearance_jax.design.manufacture import MANUFACTURE
from clearance_jax.design.methods import METHOD_CHOICES
from clearance_jax.io.asking_keys import PARAMETER, SET, choosing, heading, solving
from clearance_jax.io.fields import kinds_of
from clearance_jax.io.kinds import Flag, Quantities, Quantity, Sub, Text, Whole, Wholes, Word
from clearance_jax.io.metric_keys import METRIC_KEYS, metric_tables
from clearance_jax.io.table import Keys
from clearance_jax.io.wear_keys import CYCLE, WEARING, WEARING_TABLES
from clearance_jax.solve.settings import MOST_SAMPLES

STUDY = Keys(
    "study",
    "Top of a study",
    "What stands in a study file before its first table.",
    (
        *heading("study", "Slider-crank under load"),
        Quantity("t1", "end of the motion", '"105 ms"', unit="s", absent="the scene's"),
        Text("cost_unit", "what costs are counted in", '"EUR"', absent="cost units", longest=20),
        Sub("solve", "how the problem is solved", '{ method = "slsqp" }'),
        Sub("verify", "how the answer is proved", "{ sweep = 40 }"),
        SET,
        Sub(
            "variable",
            "the clearances (or other numbers) that are looked for, by name",
            '{ "wrist.radial_clearance" = { least = "10 um", greatest = "1 mm" } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "limit",
            "what must hold, by a name of yours",
            '{ piston = { metric = "peak", signal = "position-error", point = "piston", bound = "0.2 mm" } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "condition",
            "in which every limit must hold: parameters by name, for each condition by a name of yours",
            '{ slow = { "drive.main.speed" = "3000 rpm" } }',
            form="tables of values by name",
            absent="the scene as it is",
        ),
        Sub("manufacture", "how parts come out of manufacture", '{ kind = "band", least = 0.8 }', absent="as designed"),
        Sub(
            "life",
            "how a joint wears, where limits have `cycles`",
            '{ joint = "wrist", wear = { law = "reye", coefficient = "1e-13 1/Pa" }, pressure = { kind = "hertz" } }',
            absent="nothing wears",
        ),
    ),
    renamed={"made": "manufacture"},
)

SOLVE = Keys(
    "solve",
    "How a study is solved",
    "The solves and the search.",
    (
        *solving("rtol", "solver", "start"),
        Word("method", "the method of the search", '"slsqp"', allowed=METHOD_CHOICES, default="slsqp"),
        Whole(
            "starts", "number of starts, the first in the middle of the bounds", "3", least=1, most=10_000, absent="1"
        ),
        Whole("most", "evaluations after which the search stops", "500", least=1, absent="1000000"),
    ),
)

VERIFY = Keys(
    "verify",
    "How an answer is proved",
    "By another solver, at a tenth of the tolerance.",
    (
        Whole(
            "sweep",
            "scalings of the design at which the limits are looked at",
            "40",
            least=2,
            most=100_000,
            absent="40",
        ),
        Whole("starts", "random starts of the same method", "3", most=10_000, absent="0"),
        Whole(
            "samples", "fresh samples, where manufacture is a yield", "1000", least=1, most=MOST_SAMPLES, absent="1000"
        ),
        Flag("reoptimise", "whether the prices of the limits are checked by solving again", "true", absent="false"),
    ),
)

VARIABLE = Keys(
    'variable."NAME"',
    "Variables",
    "A number that is looked for, by its dotted name; its unit is the parameter's.",
    (
        Quantity("least", "its lower bound, above zero", '"10 um"', unit=PARAMETER, required=True),
        Quantity("greatest", "its upper bound", '"1 mm"', unit=PARAMETER, required=True),
        Sub(
            "cost",
            "what it costs to make; for all variables or for none",
            '{ law = "reciprocal", factor = "0.2 mm" }',
            absent="the largest clearance is wanted",
        ),
    ),
)

_LAW = Word(
    "law",
    "the law of the cost",
    '"reciprocal"',
    allowed=("reciprocal", "exponential", "exponential-reciprocal", "table"),
    required=True,
)
_POSITIVE = {"above": 0.0}
_FIXED = Quantity("fixed", "cost that no clearance saves", "1.0", default=0.0)
_POWER = Quantity("power", "power of the clearance", "2", default=1.0, bounds=_POSITIVE)
_RATE = Quantity(
    "rate", "rate at which the cost falls", '"1 / (10 um)"', unit=f"1/{PARAMETER}", bounds=_POSITIVE, required=True
)
_FACTOR = Quantity(
    "factor",
    "factor of the clearance-dependent part",
    '"0.04 mm^2"',
    unit=f"{PARAMETER} to the power",
    bounds=_POSITIVE,
    required=True,
)


def _cost(law: str, help: str, *keys) -> Keys:
    return Keys('variable."NAME".cost', f"Cost `{law}`", help, (choosing(_LAW, law), *keys), f'law = "{law}"')


COST_TABLES = {
    "reciprocal": _cost("reciprocal", "fixed + factor / clearance^power.", _FACTOR, _POWER, _FIXED),
    "exponential": _cost(
        "exponential",
        "fixed + factor exp(-rate clearance).",
        dataclasses.replace(_FACTOR, unit="", example="3.0"),
        _RATE,
        _FIXED,
    ),
    "exponential-reciprocal": _cost(
        "exponential-reciprocal",
        "fixed + factor exp(-rate clearance) / clearance^power.",
        _FACTOR,
        _RATE,
        _POWER,
        _FIXED,
    ),
    "table": _cost(
        "table",
        "Costs quoted at some clearances, and in between a curve that does not overshoot.",
        Quantities("clearances", "at least two, increasing", '["10 um", "40 um"]', unit=PARAMETER, required=True),
        Quantities("costs", "a cost for each, falling", "[9, 4]", required=True),
    ),
}

_METRIC = Word("metric", "what of the motion is bounded", '"peak"', allowed=tuple(METRIC_KEYS), required=True)
_CYCLES = Wholes(
    "cycles",
    "after how many cycles of wear it must hold, with a table `life`; 0: as new too",
    "[0, 20000]",
    absent="as new only",
)
LIMIT_TABLES = {
    word: table._replace(keys=(*table.keys, _CYCLES))
    for word, table in metric_tables("limit.NAME", "Limit on", _METRIC, bounded=True).items()
}
LIFE = Keys(
    "life",
    "Wear over the life",
    "How a joint wears, by the keys of a [wear file](wear.md). Numbers of wear (`wear.coefficient`) may be set in "
    "conditions and scatter in manufacture.",
    (dataclasses.replace(CYCLE, absent="the study's t1"), *WEARING),
)

_KIND = Word("kind", "how parts come out of manufacture", '"band"', allowed=tuple(MANUFACTURE), required=True)
MANUFACTURE_TABLES = kinds_of("manufacture", "Manufacture", _KIND, MANUFACTURE)

STUDY_TABLES = (
    STUDY,
    SOLVE,
    VERIFY,
    VARIABLE,
    *COST_TABLES.values(),
    *LIMIT_TABLES.values(),
    *MANUFACTURE_TABLES.values(),
    LIFE,
    *(table._replace(name=f"life.{table.name}") for table in WEARING_TABLES),
)
"""Every table of a study, in the order of the reference."""
