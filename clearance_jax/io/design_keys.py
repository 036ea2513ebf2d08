"""Every key of a study's section `design`. A new key is a line here, and its use."""

from clearance_jax.design.costs import COSTS
from clearance_jax.design.explain import FACTORS
from clearance_jax.design.manufacture import MANUFACTURE
from clearance_jax.design.methods import METHOD_CHOICES
from clearance_jax.design.specification import FIDELITY_CHOICES
from clearance_jax.io.asking_keys import METRIC
from clearance_jax.io.fields import kinds_of
from clearance_jax.io.kinds import (
    LONGEST_PATH,
    Flag,
    Moments,
    Names,
    Quantities,
    QuantityKey,
    Sub,
    Text,
    VectorKey,
    Whole,
    Wholes,
    Word,
)
from clearance_jax.io.table import Keys
from clearance_jax.parameters import PARAMETER
from clearance_jax.solve.settings import MOST_SAMPLES

DESIGN = Keys(
    "design",
    "Design",
    "The largest, or the cheapest, values of numbers that keep every limit.",
    (
        Sub(
            "variable",
            "the clearances (or other numbers) that are looked for, by name; `*` stands for any part of a name",
            '{ "wrist.radial_clearance" = { lower = "10 um", upper = "1 mm" } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "limit",
            "bounds on metrics, by their names",
            '{ piston = { bound = "0.2 mm" } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "condition",
            "in which every limit must hold: numbers by name, for each condition by a name of yours",
            '{ slow = { "drive.main.speed" = "3000 rpm" } }',
            form="tables of values by name",
            absent="the scene as it is",
        ),
        Sub(
            "trajectory",
            "CSV files of trajectories, by names of yours: every condition holds along each",
            '{ pick = "pick.csv", place = "place.csv" }',
            form="paths by name",
            absent="the drives of the scene",
        ),
        Sub(
            "payload",
            "payloads, by names of yours: every condition holds with each",
            '{ light = { body = "slider", mass = "0.5 kg" } }',
            form="tables by name",
            absent="none",
        ),
        Quantities(
            "speed", "factors on the speed of the drives: every condition holds at each", "[0.5, 1]", absent="[1]"
        ),
        Sub("manufacture", "how parts come out of manufacture", '{ kind = "band", least = 0.8 }', absent="as designed"),
        Sub("verify", "how the answer is proved", "{ sweep = 40 }"),
        Sub("tradeoff", "what other bounds would mean", "{ factors = [0.8, 1.25] }", absent="not asked"),
        Text("cost_unit", "what costs are counted in", '"EUR"', absent="cost units", longest=20),
        Word("method", "the method of the search", '"slsqp"', allowed=METHOD_CHOICES, default="slsqp"),
        Whole(
            "starts", "number of starts, the first in the middle of the bounds", "3", least=1, most=10_000, absent="1"
        ),
        Word(
            "fidelity",
            "the model of the motion, in the place of that in `solve`: by poses alone, or searched by poses "
            "and judged by the dynamics (auto)",
            '"auto"',
            allowed=FIDELITY_CHOICES,
            absent="as in `solve`, or dynamics",
        ),
        Whole("most", "evaluations after which the search stops", "500", least=1, absent="1000000"),
    ),
)
TRAJECTORY = Text("trajectory.NAME", "a file of a trajectory", '"pick.csv"', longest=LONGEST_PATH)
PAYLOAD = Keys(
    "design.payload.NAME",
    "Payloads",
    "What a body carries: it becomes heavier, with another centre of mass and another inertia.",
    (
        Text("body", "the body that carries it", '"slider"', required=True),
        QuantityKey("mass", "its mass", '"0.5 kg"', unit="kg", bounds={"least": 0.0}, required=True),
        VectorKey(
            "center_of_mass",
            "its centre of mass in the body's frame",
            '["60 mm", "0 mm"]',
            unit="m",
            absent="the frame's origin",
        ),
        Moments(
            "inertia",
            "its inertia about its centre of mass, along the body's axes",
            '"1e-4 kg*m^2"',
            unit="kg*m^2",
            bounds={"above": 0.0},
            absent="a point mass",
        ),
    ),
)
LIMIT = Keys(
    "design.limit.NAME",
    "Limits",
    "What a metric of the study must not exceed, by the metric's name.",
    (
        QuantityKey("bound", "the bound", '"0.2 mm"', unit=METRIC, bounds={"above": 0.0}, required=True),
        Wholes(
            "cycles",
            "after how many cycles of wear it must hold, with a section `wear`; 0: as new too",
            "[0, 20000]",
            absent="as new only",
        ),
    ),
)

VERIFY = Keys(
    "design.verify",
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
            "samples",
            "fresh samples, where manufacture is a yield",
            "1000",
            least=1,
            most=MOST_SAMPLES,
            absent="20 / (1 - target)",
        ),
        Flag("reoptimise", "whether the prices of the limits are checked by solving again", "true", absent="false"),
    ),
)

TRADEOFF = Keys(
    "design.tradeoff",
    "Trade-off",
    "What other bounds of a limit would mean: the problem is solved again for each.",
    (
        Text("limit", "the limit", '"tip"', absent="that nearest to its bound"),
        Quantities("factors", "on its bound", "[0.8, 1, 1.25]", absent=f"{list(FACTORS)}"),
    ),
)

VARIABLE = Keys(
    'design.variable."NAME"',
    "Variables",
    "A number that is looked for, by its dotted name; its unit is the parameter's.",
    (
        QuantityKey("lower", "its lower bound, above zero", '"10 um"', unit=PARAMETER, required=True),
        QuantityKey("upper", "its upper bound", '"1 mm"', unit=PARAMETER, required=True),
        Sub(
            "cost",
            "what it costs to make; for all variables or for none",
            '{ law = "reciprocal", factor = "0.2 mm" }',
            absent="the largest clearance is wanted",
        ),
        Names(
            "classes",
            "the ISO 286 fits that it can be made in, of which the cheapest combination is chosen",
            '["H7/g6", "H7/f7", "H8/e8"]',
            absent="any value",
        ),
        Quantities(
            "class_costs",
            "what each of the `classes` costs to make",
            "[9, 6, 4]",
            absent="as `cost` says of the greatest clearance",
        ),
    ),
    renamed={"least": "lower", "greatest": "upper"},
)

_LAW = Word("law", "the law of the cost", '"reciprocal"', allowed=tuple(COSTS), required=True)
COST_TABLES = kinds_of(
    'design.variable."NAME".cost',
    "Cost",
    _LAW,
    COSTS,
    {
        "table": (
            Quantities("clearances", "at least two, increasing", '["10 um", "40 um"]', unit=PARAMETER, required=True),
            Quantities("costs", "a cost for each, falling", "[9, 4]", required=True),
        )
    },
)

_KIND = Word("kind", "how parts come out of manufacture", '"band"', allowed=tuple(MANUFACTURE), required=True)
# The table `scatter` describes the distributions; here the numbers are only named.
_OF = Names(
    "of",
    "the numbers, which scatter as `scatter` says: normal, log-normal from 20 percent on",
    '["slider.mass"]',
    absent="all that scatter",
)
MANUFACTURE_TABLES = {
    word: table._replace(keys=tuple(_OF if key.name == "scatter" else key for key in table.keys))
    for word, table in kinds_of("design.manufacture", "Manufacture", _KIND, MANUFACTURE).items()
}
DESIGN_TABLES = (
    DESIGN,
    VARIABLE,
    *COST_TABLES.values(),
    PAYLOAD,
    LIMIT,
    *MANUFACTURE_TABLES.values(),
    VERIFY,
    TRADEOFF,
)
"""Every table of the section, in the order of the reference."""
