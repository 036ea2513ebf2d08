"""Every key of a sweep file. A new key is a line here, and its use."""

from clearance_jax.io.asking_keys import PARAMETER, SET, choosing, heading, solving
from clearance_jax.io.kinds import Names, Quantities, Quantity, Sub, Text, Whole, Word
from clearance_jax.io.metric_keys import METRIC_KEYS, metric_tables
from clearance_jax.io.recurrence_keys import RECURRENCE_KEYS
from clearance_jax.io.table import Keys
from clearance_jax.solve.settings import MOST_SAMPLES
from clearance_jax.sweep.axes import METHODS

SWEEP = Keys(
    "sweep",
    "Top of a sweep",
    "What stands in a sweep file before its first table.",
    (
        *heading("sweep", "Clearance and speed"),
        Quantity("t1", "end of the motion, unless it is an axis", '"12 ms"', unit="s", absent="the scene's"),
        Whole(
            "samples",
            "samples in time that quantities are given at, both ends included",
            "101",
            least=2,
            most=MOST_SAMPLES,
            absent="the end alone",
        ),
        Names(
            "wrt",
            "parameters by which outputs are differentiated",
            '["wrist.radial_clearance"]',
            absent="no derivatives",
        ),
        Names("derivatives_of", "the outputs that are differentiated", '["peak"]', absent="all of them"),
        Sub("solve", "how the lanes are solved", "{ rtol = 1e-6 }"),
        Sub("again", "how lanes that failed are solved once more", '{ solver = "dopri8" }', absent="they are not"),
        SET,
        Sub(
            "axis",
            "the dimensions, by the name of what is varied; along `zipped`, `sampled`, `sensitivity` and `scenes` by a "
            "name of yours",
            '{ "slider.mass" = { kind = "values", values = ["0.1 kg", "0.2 kg"] } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "output",
            "what is asked of every motion, by a name of yours",
            '{ peak = { metric = "peak", signal = "position-error", point = "piston" } }',
            form="tables by name",
            required=True,
        ),
    ),
)


_HOW = solving("rtol", "solver", "max_steps")
SOLVE = Keys("solve", "How lanes are solved", "All of them, at first.", (*_HOW, *solving("start")))
AGAIN = Keys(
    "again", "How lanes that failed are solved once more", "Those alone; what is absent is as in `solve`.", _HOW
)

_KIND = Word(
    "kind",
    "what stands along the dimension",
    '"range"',
    allowed=("range", "values", "zipped", "sampled", "sensitivity", "scenes"),
    required=True,
)


def _axis(kind: str, help: str, *keys) -> Keys:
    return Keys('axis."NAME"', f"Axis `{kind}`", help, (choosing(_KIND, kind), *keys), f'kind = "{kind}"')


_SCATTER = Sub(
    "scatter",
    "how each scatters, by the parameters' names",
    '{ "slider.mass" = { law = "normal", mean = "0.14 kg", deviation = "1 g" } }',
    form="tables by name",
    required=True,
)
AXIS_TABLES = {
    "range": _axis(
        "range",
        "Values of a parameter from one to another.",
        Quantity("from", "the first", '"0.1 mm"', unit=PARAMETER, required=True),
        Quantity("to", "the last", '"0.5 mm"', unit=PARAMETER, required=True),
        Whole("count", "how many", "200", least=1, most=MOST_SAMPLES, required=True),
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
        _SCATTER,
        Whole("count", "how many samples", "1024", least=1, most=MOST_SAMPLES, required=True),
        Word("method", "how they are drawn", '"random"', allowed=METHODS, default="sobol"),
        Whole("seed", "of the drawing", "1", default=0),
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
        "are `samples` (d + 2) lanes.",
        _SCATTER,
        Whole("samples", "how many, a power of two", "256", least=2, most=MOST_SAMPLES, required=True),
        Whole("seed", "of the drawing", "1", default=0),
    ),
    "scenes": _axis(
        "scenes",
        "Scenes instead of the sweep's own, for instance with other laws or drives.",
        Sub(
            "scenes", "scene files by labels of yours", '{ rough = "rough.toml" }', form="paths by name", required=True
        ),
    ),
}
_LAWS = "normal", "log-normal", "uniform", "truncated-normal"
_LAW = Word("law", "how it scatters", '"normal"', allowed=_LAWS, required=True)
_MEAN = Quantity("mean", "its mean", '"0.14 kg"', unit=PARAMETER, required=True)
_DEVIATION = Quantity(
    "deviation", "its standard deviation", '"1 g"', unit=PARAMETER, bounds={"above": 0.0}, required=True
)
_LEAST = Quantity("least", "its least value", '"0.13 kg"', unit=PARAMETER, required=True)
_GREATEST = Quantity("greatest", "its greatest value", '"0.15 kg"', unit=PARAMETER, required=True)


def _scatter(law: str, help: str, *keys) -> Keys:
    name = 'axis."NAME".scatter."NAME"'
    return Keys(name, f"Scatter `{law}`", help, (choosing(_LAW, law), *keys), f'law = "{law}"')


SCATTER_TABLES = {
    "normal": _scatter("normal", "Normal.", _MEAN, _DEVIATION),
    "log-normal": _scatter("log-normal", "Log-normal: never negative, however wide.", _MEAN, _DEVIATION),
    "uniform": _scatter("uniform", "Uniform from the least to the greatest.", _LEAST, _GREATEST),
    "truncated-normal": _scatter(
        "truncated-normal", "Normal, of which what lies outside is sorted out.", _MEAN, _DEVIATION, _LEAST, _GREATEST
    ),
}
CORRELATION = Keys(
    'axis."NAME".correlation.NAME',
    "Correlations",
    "Of the normal scores of two numbers that scatter: of normal ones it is their own.",
    (
        Names("between", "the two", '["slider.mass", "conrod.mass"]', required=True),
        Quantity("value", "the correlation", "0.5", bounds={"above": -1.0, "below": 1.0}, required=True),
    ),
)

_METRIC = Word("metric", "what is asked", '"peak"', allowed=(*METRIC_KEYS, *RECURRENCE_KEYS, "quantity"), required=True)
OUTPUT_TABLES = {
    **metric_tables("output.NAME", "Output", _METRIC, {**METRIC_KEYS, **RECURRENCE_KEYS}),
    "quantity": Keys(
        "output.NAME",
        "Output `quantity`",
        "Whatever a solution gives by name, at the end or at the samples.",
        (choosing(_METRIC, "quantity"), Text("of", "its name", '"piston.position"', required=True)),
        'metric = "quantity"',
    ),
}
SWEEP_TABLES = (
    SWEEP,
    SOLVE,
    AGAIN,
    *AXIS_TABLES.values(),
    *SCATTER_TABLES.values(),
    CORRELATION,
    *OUTPUT_TABLES.values(),
)
"""Every table of a sweep, in the order of the reference."""
