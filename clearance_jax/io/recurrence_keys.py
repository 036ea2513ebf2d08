"""Keys and reader of Poincare sections and Lyapunov exponents."""

from clearance_jax.io.kinds import Names, QuantityKey, Text, Whole
from clearance_jax.metrics.recurrence import FEWEST, LyapunovExponent, PoincareSection
from clearance_jax.solve.settings import MOST_SAMPLES

SECTION, EXPONENT = "poincare-section", "lyapunov-exponent"
_PERIOD = (
    QuantityKey("period", "the period", '"12 ms"', unit="s", bounds={"above": 0.0}, absent="a turn of `speed`"),
    Text(
        "speed",
        "instead of it the name of a speed of which a turn is a period, an axis too",
        '"drive.main.speed"',
        absent="`period`",
    ),
)
_COUNT = "how many periods, the last ones"
RECURRENCES = {SECTION: PoincareSection, EXPONENT: LyapunovExponent}
RECURRENCE_KEYS = {
    SECTION: (
        Names(
            "quantities",
            "what is looked at once a period: numbers that a solution gives by name",
            '["piston.velocity.x", "wrist.eccentricity.x"]',
            required=True,
        ),
        *_PERIOD,
        Whole("count", _COUNT, "100", least=1, most=MOST_SAMPLES, default=64),
        QuantityKey("phase", "after the beginning of a period", '"3 ms"', unit="s", absent="at the beginning"),
    ),
    EXPONENT: (*_PERIOD, Whole("count", _COUNT, "100", least=FEWEST, most=MOST_SAMPLES, default=50)),
}
"""Keys by kind of metric."""
