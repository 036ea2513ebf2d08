"""The grid of a sweep: what varies, what is asked at each of its points, and the answers at any of them."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from clearance_jax.ask.lanes import lanes as answered
from clearance_jax.ask.question import Answer, Question
from clearance_jax.solve.batch import BatchReport
from clearance_jax.solve.codes import Result
from clearance_jax.solve.lanes import chunk_on
from clearance_jax.solve.validity import WORDS as LEVELS
from clearance_jax.sweep.axes import Dimension

Lanes = Int[np.ndarray, " _"]
# A lane that has not been run; kept as a code of its own, so that a store says what is still missing.
NOT_RUN = -1


class Kind(NamedTuple):
    """What a variable of the answer is: dimensions and shape after those of the sweep, type, unit, meaning; the class
    of the metric that it is.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    unit: str
    meaning: str
    metric: str = ""

    @property
    def attributes(self) -> dict[str, str]:
        """What the variable says of itself."""
        about = {"units": self.unit, "long_name": self.meaning}
        return about | ({"metric": self.metric} if self.metric else {})

    @property
    def missing(self) -> Any:
        """What stands where there is no answer yet."""
        return math.nan if self.dtype.startswith("f") else NOT_RUN


ENDINGS = {
    "code": Kind(
        (), (), "i1", "1", f"how the solve ended ({', '.join(f'{r.value} {r.name.lower()}' for r in Result)})"
    ),
    "steps": Kind((), (), "i4", "1", "integration steps"),
    "rejected": Kind((), (), "i4", "1", "steps tried in vain"),
    "energy_residual": Kind((), (), "f8", "1", "energy missing in the balance over energy exchanged"),
    "validity": Kind(
        (), (), "i1", "1", f"whether poses can be believed ({', '.join(f'{k} {w}' for k, w in enumerate(LEVELS))})"
    ),
    "again": Kind((), (), "i1", "1", "how often the sample was solved again with other settings"),
}


@dataclasses.dataclass(frozen=True)
class Grid:
    """What is asked: the `dims` with what varies along them and its `units`; of each structure (combination of choices)
    its question; what every variable of the answer is (`kinds`); further coordinates, by name their dimension and
    values.
    """

    dims: tuple[Dimension, ...]
    units: dict[str, str]
    questions: tuple[Question, ...]
    kinds: dict[str, Kind]
    coordinates: dict[str, tuple[str, Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        """The sizes of the sweep's dimensions."""
        return tuple(dimension.size for dimension in self.dims)

    @property
    def count(self) -> int:
        """How many lanes there are."""
        return math.prod(self.shape)

    @property
    def bytes_a_lane(self) -> int:
        """What a lane's answer takes, uncompressed."""
        return sum(np.dtype(kind.dtype).itemsize * math.prod(kind.shape) for kind in self.kinds.values())

    def numbers(self, lanes: Lanes) -> dict[str, np.ndarray]:
        """What varies, at lanes by their place in the order of C."""
        places = np.unravel_index(lanes, self.shape)
        return {
            name: values[place]
            for dimension, place in zip(self.dims, places, strict=True)
            for name, values in dimension.columns.items()
        }

    def program(self, lanes: Lanes) -> np.ndarray:
        """Which of the questions each lane is of."""
        places, index = np.unravel_index(lanes, self.shape), np.zeros(len(lanes), int)
        for dimension, place in zip(self.dims, places, strict=True):
            if dimension.models:
                index = index * dimension.size + place
        return index

    def blank(self, count: int) -> dict[str, np.ndarray]:
        """Every variable of so many lanes that have not been run."""
        return {name: np.full((count, *kind.shape), kind.missing, kind.dtype) for name, kind in self.kinds.items()}

    def answer(
        self,
        lanes: Lanes,
        cores: int | None = None,
        progress: Callable[[float], Any] | None = None,
        ready: Callable[[Lanes, dict[str, np.ndarray]], Any] | None = None,
        report: Callable[[BatchReport], Any] | None = None,
    ) -> dict[str, np.ndarray]:
        """Every variable of these lanes, shape (lanes, ...); what failed is NaN. `cores`, `progress`, `ready`, `report`
        as those of `batch`, which is called once for each structure.
        """
        out = {name: np.full((len(lanes), *kind.shape), kind.missing, kind.dtype) for name, kind in self.kinds.items()}
        programs, done = self.program(lanes), 0

        for program in np.unique(programs):
            members = np.flatnonzero(programs == program)

            def part(share, done=done, size=len(members)):
                if progress is not None:
                    progress((done + share * size) / len(lanes))

            def some(places, values, members=members):
                if ready is not None:
                    ready(members[places], values)

            question, how = self.questions[program], {"cores": cores, "progress": part, "report": report}
            solved = self._solve(question, lanes[members], some, **how)
            for name, values in solved.items():
                out[name][members] = values
            done += len(members)
        return out

    def complete(
        self,
        lanes: Lanes,
        values: dict[str, np.ndarray],
        keep: Callable[[Lanes, dict[str, np.ndarray]], Any],
        **how: Any,
    ) -> int:
        """Answer those of the lanes whose `values` are not known yet, in place; how many. `keep`: called with places
        among the lanes and their values, chunk by chunk; `how`: as `answer`.
        """
        rest = np.flatnonzero(values["code"] == NOT_RUN)
        if rest.size:
            answers = self.answer(lanes[rest], ready=lambda places, some: keep(rest[places], some), **how)
            for name, column in answers.items():
                values[name][rest] = column
        return int(rest.size)

    def _solve(self, question: Question, lanes: Lanes, ready: Callable, **how: Any) -> dict[str, np.ndarray]:
        points = self.numbers(lanes)
        if not points:  # models alone: something must say how many lanes there are
            points = {"rtol": np.full(len(lanes), float(question.settings.rtol))}
        # As many lanes as a chunk has, or all that there are of this structure: an answer is the same in any company.
        width = min(chunk_on(), self.count // len(self.questions))

        def some(places, answer):
            ready(places, self._values(answer))

        return self._values(answered(question, points, width=width, ready=some, **how))

    def _values(self, answer: Answer) -> dict[str, np.ndarray]:
        """Every variable of the lanes of an answer."""
        variables = {**answer.ending, **answer.values, **{slope_name(k): v for k, v in answer.slopes.items()}}
        variables = {name: np.array(values, self.kinds[name].dtype) for name, values in variables.items()}
        for name, values in variables.items():
            if name not in ENDINGS:
                values[ran_in_vain(variables["code"])] = np.nan
        return variables | {"again": np.zeros(len(variables["code"]), "i1")}


def slope_name(name: str) -> str:
    """What the derivatives of an output are called."""
    return f"{name}_derivative"


def ran_in_vain(codes: np.ndarray) -> np.ndarray:
    """Which lanes have been run in vain, by their result codes."""
    return (codes != int(Result.REACHED_END)) & (codes != NOT_RUN)
