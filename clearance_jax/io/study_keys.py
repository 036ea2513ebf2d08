"""Keys of study files: top level, metrics, scatter, and the tables of all sections."""

from clearance_jax.io.asking_keys import SOLVING
from clearance_jax.io.calibrate_keys import CALIBRATE_TABLES
from clearance_jax.io.design_keys import DESIGN_TABLES
from clearance_jax.io.kinds import LONGEST_PATH, QuantityKey, Sub, Text, Word
from clearance_jax.io.metric_keys import METRIC_KINDS
from clearance_jax.io.sweep_keys import SWEEP_TABLES
from clearance_jax.io.table import Keys
from clearance_jax.io.wear_keys import WEAR_TABLES
from clearance_jax.parameters import PARAMETER
from clearance_jax.solve.settings import FIDELITIES
from clearance_jax.sweep.scatter import DISTRIBUTIONS

STUDY = Keys(
    "study",
    "Top of a study",
    "What stands in a study file before its first table.",
    (
        Text("name", "name of the study", '"Slider-crank under load"', absent="the file's name"),
        Text(
            "scene",
            "the scene file, from where the study is",
            '"slider_crank.toml"',
            required=True,
            longest=LONGEST_PATH,
        ),
        QuantityKey("t1", "end of the motion", '"105 ms"', unit="s", absent="the scene's"),
        Sub(
            "set",
            "parameters of the scene to change, by name",
            '{ "drive.main.speed" = "3000 rpm" }',
            form="values by name",
        ),
        Sub("solve", "how motions are solved", "{ rtol = 1e-6 }"),
        Sub(
            "metric",
            "what is asked of every motion, by a name of yours",
            '{ peak = { kind = "peak", signal = "position-error", point = "piston" } }',
            form="tables by name",
        ),
        Sub(
            "scatter",
            "how numbers scatter, by their names",
            '{ "slider.mass" = { deviation = "2 percent" } }',
            form="tables by name",
        ),
        Sub("sweep", "metrics over numbers that vary", '{ metrics = ["peak"] }', absent="nothing is swept"),
        Sub("design", "numbers that are looked for, so that limits hold", '{ method = "slsqp" }', absent="no design"),
        Sub("wear", "how a joint wears over its life", '{ joint = "wrist" }', absent="nothing wears"),
        Sub(
            "calibrate",
            "numbers that are found from measured motion",
            '{ data = "arm_measured.csv" }',
            absent="nothing is calibrated",
        ),
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
SOLVE = (
    Keys(
        "solve",
        "How a study is solved",
        "All motions; what is absent is as in the scene.",
        (
            Word(
                "fidelity",
                "the model of the motion: `quasi-static` poses are a screening (see [quasi-static "
                "motions](../quasi_static.md)), `static` bounds an error by play alone",
                '"quasi-static"',
                allowed=FIDELITIES,
                absent="the scene's, or dynamics",
            ),
        ),
        renamed={key: f"design.{key}" for key in ("method", "starts", "most")},
    )
    + SOLVING
)
SCATTER = Keys(
    'scatter."NAME"',
    "Scatter",
    "How a number scatters, by its dotted name (`*` stands for any part of it): normal, and with `lower` or `upper` "
    "normal with what lies beyond sorted out; or of another distribution. Samples of a sweep and yields of a design "
    "ask for it.",
    (
        Word("distribution", "how it scatters", '"normal"', allowed=tuple(DISTRIBUTIONS), default="normal"),
        QuantityKey("mean", "its mean", '"0.14 kg"', unit=PARAMETER, absent="the scene's value, or the design's"),
        QuantityKey(
            "deviation",
            "its standard deviation, as a quantity or in percent of the mean",
            '"2 percent"',
            unit=PARAMETER,
            absent="none of a uniform one; of others it must be there",
        ),
        QuantityKey("lower", "its least value", '"0.13 kg"', unit=PARAMETER, absent="none"),
        QuantityKey("upper", "its greatest value", '"0.15 kg"', unit=PARAMETER, absent="none"),
    ),
    renamed={"law": "distribution", "least": "lower", "greatest": "upper"},
)
STUDY_TABLES = (
    STUDY,
    SOLVE,
    *METRIC_KINDS.values(),
    SCATTER,
    *SWEEP_TABLES,
    *DESIGN_TABLES,
    *WEAR_TABLES,
    *CALIBRATE_TABLES,
)
"""Every table of a study, in the order of the reference."""
