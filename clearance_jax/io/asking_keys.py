"""What the modules of keys of a study share: which scene, how it is changed, how it is solved."""

import dataclasses

from clearance_jax.io.kinds import LONGEST_PATH, Key, Quantity, Sub, Text, Whole, Word
from clearance_jax.solve.attempt import STARTS
from clearance_jax.solve.settings import FIDELITIES, SOLVERS

PARAMETER = "the parameter's"
"""The unit of a number, which the parameter's name decides."""
METRIC = "the metric's"
"""The unit of a bound, which the metric decides."""
_SOLVING = {
    "rtol": Quantity(
        "rtol",
        "accuracy: the relative tolerance of the solves",
        "1e-8",
        bounds={"above": 0.0, "below": 1.0},
        absent="the scene's, or 1e-8",
    ),
    "solver": Word("solver", "the solver", '"dopri8"', allowed=tuple(SOLVERS), absent="the scene's, or tsit5"),
    "start": Word("start", "where pins start", '"settled"', allowed=STARTS, absent="the scene's, or centre"),
    "fidelity": Word(
        "fidelity",
        "the model of the motion: `quasi-static` poses are a screening, see [quasi-static motions](../quasi_static.md)",
        '"quasi-static"',
        allowed=FIDELITIES,
        absent="the scene's, or dynamics",
    ),
    "max_steps": Whole("max_steps", "steps after which a solve gives up", "100000", least=1, absent="10000000"),
}
SET = Sub(
    "set", "parameters of the scene to change, by name", '{ "drive.main.speed" = "3000 rpm" }', form="values by name"
)


def heading(title: str) -> tuple[Key, ...]:
    """The name and the scene of a study, with a name for example."""
    return (
        Text("name", "name of the study", f'"{title}"', absent="the file's name"),
        Text(
            "scene",
            "the scene file, from where the study is",
            '"slider_crank.toml"',
            required=True,
            longest=LONGEST_PATH,
        ),
    )


def solving(*names: str) -> tuple[Key, ...]:
    """The keys of that name of how a scene is solved."""
    return tuple(_SOLVING[name] for name in names)


def choosing(word: Word, choice: str) -> Word:
    """The word that chooses a table, with that choice as its example."""
    return dataclasses.replace(word, example=f'"{choice}"')
