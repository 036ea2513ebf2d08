"""Every key of a study's section `sweep`. A new key is a line here, and its use."""

from clearance_jax.io.asking_keys import SOLVING
from clearance_jax.io.fields import kind_of
from clearance_jax.io.kinds import Key, Names, Quantities, QuantityKey, Sub, Whole, Word
from clearance_jax.io.table import Keys
from clearance_jax.parameters import PARAMETER
from clearance_jax.solve.settings import MOST_SAMPLES
from clearance_jax.sweep.axes import METHODS

SWEEP = Keys(
    "sweep",
    "Sweep",
    "Metrics of many motions, over axes.",
    (
        Sub(
            "axis",
            "the dimensions, by the name of what is varied (`t1` and `rtol` too); along `zipped`, `sampled`, "
            "`sensitivity` and `scenes` by a name of yours",
            '{ "slider.mass" = { kind = "values", values = ["0.1 kg", "0.2 kg"] } }',
            form="tables by name",
            required=True,
        ),
        Names("metrics", "those that are asked", '["peak"]', absent="all of the study"),
        Names(
            "quantities",
            "numbers that a solution gives by name, at the end or at the samples",
            '["piston.position"]',
            absent="none",
        ),
        Whole(
            "samples",
            "samples in time that quantities are given at, both ends included",
            "101",
            least=2,
            most=MOST_SAMPLES,
            absent="the end alone",
        ),
        Names("by", "numbers by which answers are differentiated", '["wrist.radial_clearance"]', absent="none"),
        Names("derivatives_of", "the metrics and quantities that are differentiated", '["peak"]', absent="all of them"),
        Sub("again", "how samples that failed are solved once more", '{ solver = "dopri8" }', absent="they are not"),
    ),
)
AGAIN = (
    Keys(
        "sweep.again",
        "How samples that failed are solved once more",
        "Those alone; what is absent is as in `solve`.",
        (),
    )
    + SOLVING
)

_KIND = Word(
    "kind",
    "what stands along the dimension",
    '"range"',
    allowed=("range", "values", "zipped", "sampled", "sensitivity", "scenes"),
    required=True,
)


def _axis(kind: str, help: str, *keys: Key) -> Keys:
    return kind_of('sweep.axis."NAME"', "Axis", _KIND, kind, help, *keys)


def _count(example: str) -> Key:
    help = "how many, of `sensitivity` a power of two"
    return Whole("count", help, example, least=1, most=MOST_SAMPLES, required=True)


_OF = Names("of", "the numbers, which scatter as `scatter` says", '["slider.mass"]', absent="all that scatter")
_SEED = Whole("seed", "of the drawing", "1", default=0)
AXIS_TABLES = {
    "range": _axis(
        "range",
        "Values of a parameter from one to another.",
        QuantityKey("from", "the first", '"0.1 mm"', unit=PARAMETER, required=True),
        QuantityKey("to", "the last", '"0.5 mm"', unit=PARAMETER, required=True),
        _count("200"),
        Word("spacing", "equal differences, or equal ratios", '"log"', allowed=("linear", "log"), default="linear"),
    ),
    "values": _axis(
        "values",
        "Values of a parameter.",
        Quantities("values", "the values", '["0.1 mm", "0.2 mm", "1 mm"]', unit=PARAMETER, required=True),
    ),
    "zipped": _axis(
        "zipped",
        "Several parameters that change together.",
        Sub(
            "values",
            "lists of one length, by the parameters' names",
            '{ "slider.mass" = ["0.1 kg", "0.2 kg"], "conrod.mass" = ["0.2 kg", "0.3 kg"] }',
            form="lists by name",
            required=True,
        ),
    ),
    "sampled": _axis(
        "sampled",
        "Parameters that scatter.",
        _OF,
        _count("1024"),
        Word("method", "how they are drawn", '"random"', allowed=METHODS, default="sobol"),
        _SEED,
        Sub(
            "correlation",
            "correlations of two of them, by names of yours",
            '{ masses = { between = ["slider.mass", "conrod.mass"], value = 0.5 } }',
            form="tables by name",
            absent="none",
        ),
    ),
    "sensitivity": _axis(
        "sensitivity",
        "Parameters that scatter independently, drawn so that Sobol's sensitivity indices follow: for d of them there "
        "are `count` (d + 2) samples.",
        _OF,
        _count("256"),
        _SEED,
    )._replace(renamed={"samples": "count"}),
    "scenes": _axis(
        "scenes",
        "Scenes instead of the sweep's own, for instance with other laws or drives.",
        Sub(
            "scenes", "scene files by labels of yours", '{ rough = "rough.toml" }', form="paths by name", required=True
        ),
    ),
}
CORRELATION = Keys(
    'sweep.axis."NAME".correlation.NAME',
    "Correlations",
    "Of the normal scores of two numbers that scatter: of normal ones it is their own.",
    (
        Names("between", "the two", '["slider.mass", "conrod.mass"]', required=True),
        QuantityKey("value", "the correlation", "0.5", bounds={"above": -1.0, "below": 1.0}, required=True),
    ),
)

SWEEP_TABLES = (SWEEP, AGAIN, *AXIS_TABLES.values(), CORRELATION)
"""Every table of the section, in the order of the reference."""
