"""Every key of a study's section `calibrate`. A new key is a line here, and its use."""

from clearance_jax.calibrate.options import FitOptions
from clearance_jax.io.fields import keys_of
from clearance_jax.io.kinds import LONGEST_PATH, QuantityKey, Sub, Text, Word
from clearance_jax.io.metric_keys import OF, SIGNALS
from clearance_jax.io.table import Keys
from clearance_jax.parameters import PARAMETER

SIGNAL = "the signal's"
"""Placeholder for the unit of a deviation, which is the signal's."""

CALIBRATE = Keys(
    "calibrate",
    "Calibration",
    "Numbers of the scene with which its motion is nearest to a measured one.",
    (
        Text(
            "data",
            "the measured data, from where the study is: a CSV file with a header such as `time [s], tip [mm]`, or a "
            "NetCDF file (.nc); empty cells and NaN were not measured",
            '"arm_measured.csv"',
            required=True,
            longest=LONGEST_PATH,
        ),
        Sub(
            "parameter",
            "the numbers that are looked for, by name; the search starts at the scene's values",
            '{ "hip.radial_clearance" = { lower = "10 um", upper = "1 mm" } }',
            form="tables by name",
            required=True,
        ),
        Sub(
            "signal",
            "what the columns of the data are, by the columns' names; columns without a table are not looked at",
            '{ x = { quantity = "tip.position.x", deviation = "20 um" } }',
            form="tables by name",
            absent="each column is the quantity of its name",
        ),
        *keys_of(FitOptions),
    ),
)
PARAMETER_TABLE = Keys(
    'calibrate.parameter."NAME"',
    "Parameters of a calibration",
    "A number that is looked for, by its dotted name; its unit is the parameter's.",
    (
        QuantityKey("lower", "its least value", '"10 um"', unit=PARAMETER, absent="what the number may be at all"),
        QuantityKey("upper", "its greatest value", '"1 mm"', unit=PARAMETER, absent="what the number may be at all"),
    ),
)
SIGNAL_TABLE = Keys(
    'calibrate.signal."COLUMN"',
    "Signals of a calibration",
    "What a column of the data is: a quantity of the motion, or a signal of a point, body or joint.",
    (
        Text("quantity", "the quantity, by its name", '"tip.position.x"', absent="that of the column's name"),
        Word(
            "signal",
            "a signal, instead of a quantity",
            '"position-error"',
            allowed=tuple(word for word in SIGNALS if word != "quantity"),
            absent="a quantity",
        ),
        *OF.values(),
        QuantityKey(
            "deviation",
            "the standard deviation of its noise",
            '"20 um"',
            unit=SIGNAL,
            bounds={"above": 0.0},
            absent="estimated from the residuals",
        ),
    ),
)
CALIBRATE_TABLES = (CALIBRATE, PARAMETER_TABLE, SIGNAL_TABLE)
"""Every table of the section, in the order of the reference."""
