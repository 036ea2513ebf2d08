"""Every key of a study's section `design`. A new key is a line here, and its use."""

from clearance_jax.design.asked.costs import COSTS
from clearance_jax.design.asked.manufacture import MANUFACTURE
from clearance_jax.design.asked.specification import FIDELITY_CHOICES
from clearance_jax.design.judge.explain import FACTORS
from clearance_jax.design.search.methods import METHOD_CHOICES
from clearance_jax.io.keys.declare import family, kinds, table
from clearance_jax.io.keys.kinds import (
    Flag,
    Moments,
    Names,
    OneOrSeveral,
    Quantities,
    Sub,
    Text,
    VectorKey,
    Whole,
    Wholes,
    Word,
    path,
    quantity,
    tables,
)
from clearance_jax.io.keys.metric import METRIC
from clearance_jax.parameters import PARAMETER
from clearance_jax.solve.settings import MOST_SAMPLES

DESIGN = table(
    "design",
    "Design",
    "The largest, or the cheapest, values of numbers that keep every limit.",
    variable=tables(
        "the clearances (or other numbers) that are looked for, by name; `*` stands for any part of a name",
        '{ "wrist.radial_clearance" = { lower = "10 um", upper = "1 mm" } }',
        required=True,
    ),
    limit=tables("bounds on metrics, by their names", '{ piston = { bound = "0.2 mm" } }', required=True),
    condition=Sub(
        "in which every limit must hold: numbers by name, for each condition by a name of yours",
        '{ slow = { "drive.main.speed" = "3000 rpm" } }',
        "the scene as it is",
        kind="tables of values by name",
    ),
    trajectory=Sub(
        "CSV files of trajectories, by names of yours: every condition holds along each",
        '{ pick = "pick.csv", place = "place.csv" }',
        "the drives of the scene",
        kind="paths by name",
    ),
    payload=tables(
        "payloads, by names of yours: every condition holds with each",
        '{ light = { body = "slider", mass = "0.5 kg" } }',
        "none",
    ),
    speed=Quantities("factors on the speed of the drives: every condition holds at each", "[0.5, 1]", "[1]"),
    manufacture=Sub("how parts come out of manufacture", '{ kind = "band", least = 0.8 }', "as designed"),
    verify=Sub("how the answer is proved", "{ sweep = 40 }"),
    tradeoff=Sub("what other bounds would mean", "{ factors = [0.8, 1.25] }", "not asked"),
    cost_unit=Text("what costs are counted in", '"EUR"', "cost units", longest=20),
    method=Word("the method of the search", '"slsqp"', allowed=METHOD_CHOICES, default="slsqp"),
    starts=Whole("number of starts, the first in the middle of the bounds", "3", "1", least=1, most=10_000),
    fidelity=Word(
        "the model of the motion, in the place of that in `solve`: by poses alone, or searched by poses and judged by "
        "the dynamics (auto)",
        '"auto"',
        "as in `solve`, or dynamics",
        allowed=FIDELITY_CHOICES,
    ),
    most=Whole("evaluations after which the search stops", "500", "1000000", least=1),
)
TRAJECTORY = path("a file of a trajectory", '"pick.csv"')
PAYLOAD = table(
    "design.payload.NAME",
    "Payloads",
    "What a body carries: it becomes heavier, with another centre of mass and another inertia.",
    body=Text("the body that carries it", '"slider"', required=True),
    mass=quantity("its mass", '"0.5 kg"', "kg", least=0.0, required=True),
    center_of_mass=VectorKey(
        "its centre of mass in the body's frame", '["60 mm", "0 mm"]', "the frame's origin", unit="m"
    ),
    inertia=Moments(
        "its inertia about its centre of mass, along the body's axes",
        '"1e-4 kg*m^2"',
        "a point mass",
        unit="kg*m^2",
        bounds={"above": 0.0},
    ),
)
LIMIT = table(
    "design.limit.NAME",
    "Limits",
    "What a metric of the study must not exceed, by the metric's name.",
    bound=quantity("the bound", '"0.2 mm"', METRIC, above=0.0, required=True),
    cycles=Wholes(
        "after how many cycles of wear it must hold, with a section `wear`; 0: as new too", "[0, 20000]", "as new only"
    ),
)
VERIFY = table(
    "design.verify",
    "How an answer is proved",
    "By another solver, at a tenth of the tolerance.",
    sweep=Whole("scalings of the design at which the limits are looked at", "40", "40", least=2, most=100_000),
    starts=Whole("random starts of the same method", "3", "0", most=10_000),
    samples=Whole(
        "fresh samples, where manufacture is a yield", "1000", "20 / (1 - target)", least=1, most=MOST_SAMPLES
    ),
    reoptimise=Flag("whether the prices of the limits are checked by solving again", "true", "false"),
)
TRADEOFF = table(
    "design.tradeoff",
    "Trade-off",
    "What other bounds of a limit would mean: the problem is solved again for each.",
    limit=Text("the limit", '"tip"', "that nearest to its bound"),
    factors=Quantities("on its bound", "[0.8, 1, 1.25]", f"{list(FACTORS)}"),
)
VARIABLE = table(
    'design.variable."NAME"',
    "Variables",
    "A number that is looked for, by its dotted name; its unit is the parameter's.",
    lower=quantity("its lower bound, above zero", '"10 um"', PARAMETER, required=True),
    upper=quantity("its upper bound", '"1 mm"', PARAMETER, required=True),
    cost=Sub(
        "what it costs to make; for all variables or for none",
        '{ law = "reciprocal", factor = "0.2 mm" }',
        "the largest clearance is wanted",
    ),
    classes=Names(
        "the ISO 286 fits that it can be made in, of which the cheapest combination is chosen; with `gears` classes of "
        "DIN 3967, with `class_least` and `class_greatest` names of yours",
        '["H7/g6", "H7/f7", "H8/e8"]',
        "any value",
    ),
    gears=Sub(
        "the pair of gears whose `classes` are given, by the backlash at the wheel",
        '{ module = "1 mm", teeth = [20, 40] }',
        "the `classes` are fits",
    ),
    class_least=Quantities(
        "the least value of each of the `classes`, which are then your own", '["0 arcmin", "1 arcmin"]', unit=PARAMETER
    ),
    class_greatest=Quantities(
        "the greatest value of each of the `classes`, which are then your own",
        '["1 arcmin", "3 arcmin"]',
        unit=PARAMETER,
    ),
    class_costs=Quantities(
        "what each of the `classes` costs to make", "[9, 6, 4]", "as `cost` says of the greatest clearance"
    ),
    renamed={"least": "lower", "greatest": "upper"},
)
GEARS = table(
    'design.variable."NAME".gears',
    "Classes of gears",
    "A pair of spur gears, whose `classes` are those of DIN 3967: cd25, or cd25/c24 of pinion and wheel.",
    module=quantity("module of the teeth", '"1 mm"', "m", required=True, above=0.0),
    teeth=Quantities("numbers of teeth, of pinion and wheel", "[20, 40]", required=True),
    internal=Flag("whether the wheel is a ring with teeth inside", "true", default=False),
    centre_distance=quantity("distance of the axes", '"30 mm"', "m", "that of unshifted gears", above=0.0),
    centre_tolerance=OneOrSeveral(
        "deviation of the distance to both sides, or the lower and the upper one; with the play of both bearings",
        '["-20 um", "20 um"]',
        "0 um",
        unit="m",
    ),
    pressure_angle=quantity("pressure angle of the teeth", '"20 deg"', "rad", "20 deg", above=0.0),
    profile_shift=quantity("sum of the coefficients of profile shift of both gears", "0.3", default=0.0),
)
_OF_TABLE = {
    "clearances": Quantities("at least two, increasing", '["10 um", "40 um"]', unit=PARAMETER, required=True),
    "costs": Quantities("a cost for each, falling", "[9, 4]", required=True),
}
COST_TABLES = family(
    'design.variable."NAME".cost', "Cost", "law", "the law of the cost", kinds(COSTS, {"table": _OF_TABLE})
)
# The table `scatter` describes the distributions; here the numbers are only named.
_OF = Names(
    "the numbers, which scatter as `scatter` says: normal, log-normal from 20 percent on",
    '["slider.mass"]',
    "all that scatter",
    name="of",
)
_KINDS = {
    word: member._replace(keys=tuple(_OF if key.name == "scatter" else key for key in member.keys))
    for word, member in kinds(MANUFACTURE).items()
}
MANUFACTURE_TABLES = family("design.manufacture", "Manufacture", "kind", "how parts come out of manufacture", _KINDS)
del _KINDS
