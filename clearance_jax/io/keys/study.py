"""Every key of a study file but those of metrics, `design` and `wear`. A new key is a line here, and its use."""

from clearance_jax.calibrate.options import FitOptions
from clearance_jax.io.keys.declare import family, keys_of, kind, table
from clearance_jax.io.keys.kinds import Key, Names, Quantities, Sub, Text, Whole, Word, path, quantity, tables
from clearance_jax.io.keys.metric import OF, OF_SIGNAL, SIGNALS
from clearance_jax.io.keys.scene import SOLVING
from clearance_jax.parameters import PARAMETER
from clearance_jax.solve.settings import FIDELITIES, MOST_SAMPLES
from clearance_jax.sweep.axes import DISTRIBUTIONS, METHODS

STUDY = table(
    "study",
    "Top of a study",
    "What stands in a study file before its first table.",
    name=Text("name of the study", '"Slider-crank under load"', "the file's name"),
    scene=path("the scene file, from where the study is", '"slider_crank.toml"', required=True),
    t1=quantity("end of the motion", '"105 ms"', "s", "the scene's"),
    set=Sub("parameters of the scene to change, by name", '{ "drive.main.speed" = "3000 rpm" }', kind="values by name"),
    solve=Sub("how motions are solved", "{ rtol = 1e-6 }"),
    metric=tables(
        "what is asked of every motion, by a name of yours",
        '{ peak = { kind = "peak", signal = "position-error", point = "piston" } }',
    ),
    scatter=tables("how numbers scatter, by their names", '{ "slider.mass" = { deviation = "2 percent" } }'),
    sweep=Sub("metrics over numbers that vary", '{ metrics = ["peak"] }', "nothing is swept"),
    design=Sub("numbers that are looked for, so that limits hold", '{ method = "slsqp" }', "no design"),
    wear=Sub("how a joint wears over its life", '{ joint = "wrist" }', "nothing wears"),
    calibrate=Sub(
        "numbers that are found from measured motion", '{ data = "arm_measured.csv" }', "nothing is calibrated"
    ),
    renamed={
        "output": "metric",
        "wrt": "sweep.by",
        "life": "wear",
        **{key: f"sweep.{key}" for key in ("axis", "again", "samples", "derivatives_of")},
        **{key: f"design.{key}" for key in ("variable", "limit", "condition", "manufacture", "verify", "cost_unit")},
        **{key: f"wear.{key}" for key in ("joint", "cycle", "cycles", "pressure", "until", "length", "sectors")},
    },
)
SOLVE = table(
    "solve",
    "How a study is solved",
    "All motions; what is absent is as in the scene.",
    SOLVING,
    fidelity=Word(
        "the model of the motion: `quasi-static` poses are a screening (see [quasi-static "
        "motions](../quasi_static.md)), `static` bounds an error by play alone",
        '"quasi-static"',
        "the scene's, or dynamics",
        allowed=FIDELITIES,
    ),
    renamed={key: f"design.{key}" for key in ("method", "starts", "most")},
)
SCATTER = table(
    'scatter."NAME"',
    "Scatter",
    "How a number scatters, by its dotted name (`*` stands for any part of it): normal, and with `lower` or `upper` "
    "normal with what lies beyond sorted out; or of another distribution. Samples of a sweep and yields of a design "
    "ask for it.",
    distribution=Word("how it scatters", '"normal"', allowed=tuple(DISTRIBUTIONS), default="normal"),
    mean=quantity("its mean", '"0.14 kg"', PARAMETER, "the scene's value, or the design's"),
    deviation=quantity(
        "its standard deviation, as a quantity or in percent of the mean",
        '"2 percent"',
        PARAMETER,
        "none of a uniform one; of others it must be there",
    ),
    lower=quantity("its least value", '"0.13 kg"', PARAMETER, "none"),
    upper=quantity("its greatest value", '"0.15 kg"', PARAMETER, "none"),
    renamed={"law": "distribution", "least": "lower", "greatest": "upper"},
)


SWEEP = table(
    "sweep",
    "Sweep",
    "Metrics of many motions, over axes.",
    axis=tables(
        "the dimensions, by the name of what is varied (`t1` and `rtol` too); along `zipped`, `sampled`, `sensitivity` "
        "and `scenes` by a name of yours",
        '{ "slider.mass" = { kind = "values", values = ["0.1 kg", "0.2 kg"] } }',
        required=True,
    ),
    metrics=Names("those that are asked", '["peak"]', "all of the study"),
    quantities=Names(
        "numbers that a solution gives by name, at the end or at the samples", '["piston.position"]', "none"
    ),
    samples=Whole(
        "samples in time that quantities are given at, both ends included",
        "101",
        "the end alone",
        least=2,
        most=MOST_SAMPLES,
    ),
    by=Names("numbers by which answers are differentiated", '["wrist.radial_clearance"]', "none"),
    derivatives_of=Names("the metrics and quantities that are differentiated", '["peak"]', "all of them"),
    again=Sub("how samples that failed are solved once more", '{ solver = "dopri8" }', "they are not"),
)
AGAIN = table(
    "sweep.again",
    "How samples that failed are solved once more",
    "Those alone; what is absent is as in `solve`.",
    SOLVING,
)
_OF = Names("the numbers, which scatter as `scatter` says", '["slider.mass"]', "all that scatter")
_SEED = Whole("of the drawing", "1", default=0)


def _count(example: str) -> Key:
    return Whole("how many, of `sensitivity` a power of two", example, least=1, most=MOST_SAMPLES, required=True)


AXIS_TABLES = family(
    'sweep.axis."NAME"',
    "Axis",
    "kind",
    "what stands along the dimension",
    {
        "range": kind(
            "Values of a parameter from one to another.",
            **{"from": quantity("the first", '"0.1 mm"', PARAMETER, required=True)},
            to=quantity("the last", '"0.5 mm"', PARAMETER, required=True),
            count=_count("200"),
            spacing=Word("equal differences, or equal ratios", '"log"', allowed=("linear", "log"), default="linear"),
        ),
        "values": kind(
            "Values of a parameter.",
            values=Quantities("the values", '["0.1 mm", "0.2 mm", "1 mm"]', unit=PARAMETER, required=True),
        ),
        "zipped": kind(
            "Several parameters that change together.",
            values=Sub(
                "lists of one length, by the parameters' names",
                '{ "slider.mass" = ["0.1 kg", "0.2 kg"], "conrod.mass" = ["0.2 kg", "0.3 kg"] }',
                kind="lists by name",
                required=True,
            ),
        ),
        "sampled": kind(
            "Parameters that scatter.",
            of=_OF,
            count=_count("1024"),
            method=Word("how they are drawn", '"random"', allowed=METHODS, default="sobol"),
            seed=_SEED,
            correlation=tables(
                "correlations of two of them, by names of yours",
                '{ masses = { between = ["slider.mass", "conrod.mass"], value = 0.5 } }',
                "none",
            ),
        ),
        "sensitivity": kind(
            "Parameters that scatter independently, drawn so that Sobol's sensitivity indices follow: for d of them "
            "there are `count` (d + 2) samples.",
            of=_OF,
            count=_count("256"),
            seed=_SEED,
            renamed={"samples": "count"},
        ),
        "scenes": kind(
            "Scenes instead of the sweep's own, for instance with other laws or drives.",
            scenes=Sub(
                "scene files by labels of yours", '{ rough = "rough.toml" }', kind="paths by name", required=True
            ),
        ),
    },
)
CORRELATION = table(
    'sweep.axis."NAME".correlation.NAME',
    "Correlations",
    "Of the normal scores of two numbers that scatter: of normal ones it is their own.",
    between=Names("the two", '["slider.mass", "conrod.mass"]', required=True),
    value=quantity("the correlation", "0.5", above=-1.0, below=1.0, required=True),
)


CALIBRATE = table(
    "calibrate",
    "Calibration",
    "Numbers of the scene with which its motion is nearest to a measured one.",
    data=path(
        "the measured data, from where the study is: a CSV file with a header such as `time [s], tip [mm]`, or a "
        "NetCDF file (.nc); empty cells and NaN were not measured",
        '"arm_measured.csv"',
        required=True,
    ),
    parameter=tables(
        "the numbers that are looked for, by name; the search starts at the scene's values",
        '{ "hip.radial_clearance" = { lower = "10 um", upper = "1 mm" } }',
        required=True,
    ),
    signal=tables(
        "what the columns of the data are, by the columns' names; columns without a table are not looked at",
        '{ x = { quantity = "tip.position.x", deviation = "20 um" } }',
        "each column is the quantity of its name",
    ),
    **keys_of(FitOptions),
)
PARAMETER_TABLE = table(
    'calibrate.parameter."NAME"',
    "Parameters of a calibration",
    "A number that is looked for, by its dotted name; its unit is the parameter's.",
    lower=quantity("its least value", '"10 um"', PARAMETER, "what the number may be at all"),
    upper=quantity("its greatest value", '"1 mm"', PARAMETER, "what the number may be at all"),
)
SIGNAL_TABLE = table(
    'calibrate.signal."COLUMN"',
    "Signals of a calibration",
    "What a column of the data is: a quantity of the motion, or a signal of a point, body or joint.",
    quantity=Text("the quantity, by its name", '"tip.position.x"', "that of the column's name"),
    signal=Word(
        "a signal, instead of a quantity",
        '"position-error"',
        "a quantity",
        allowed=tuple(word for word in SIGNALS if word != "quantity"),
    ),
    **OF,
    deviation=quantity(
        "the standard deviation of its noise", '"20 um"', OF_SIGNAL, "estimated from the residuals", above=0.0
    ),
)
