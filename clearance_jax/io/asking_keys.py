"""Keys that scenes and studies share: accuracy and solver."""

from clearance_jax.io.kinds import QuantityKey, Whole, Word
from clearance_jax.io.table import Keys
from clearance_jax.solve.attempt import STARTS
from clearance_jax.solve.settings import MAX_STEPS, SOLVER_WORDS
from clearance_jax.solve.tolerances import SMALLEST

METRIC = "the metric's"
"""Placeholder for the unit of a bound, which is the metric's."""
SOLVING = Keys(
    "solve",
    "Accuracy and solver",
    "The same in a scene and in a study.",
    (
        QuantityKey(
            "rtol",
            "accuracy: the relative tolerance of the solve",
            "1e-8",
            bounds={"least": SMALLEST, "below": 1.0},
            absent="1e-8",
        ),
        Word(
            "solver",
            "the solver: `dopri8` for rtol of 1e-6 or less, or `auto`, which chooses by rtol",
            '"dopri8"',
            allowed=SOLVER_WORDS,
            absent="tsit5",
        ),
        Word(
            "start",
            "where pins start: in the middle of their sleeves, or at the walls where the joints' forces press them",
            '"settled"',
            allowed=STARTS,
            absent="centre",
        ),
        Whole("max_steps", "steps after which a solve gives up", "100000", least=1, absent=str(MAX_STEPS)),
    ),
)
