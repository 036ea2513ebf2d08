"""The grid of a sweep: its dimensions, its questions, and the solves of any of its lanes (points)."""

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
# The result code of a lane that has not been solved.
NOT_RUN = -1


class Kind(NamedTuple):
    """The form of a variable of the answer: dimensions and shape after those of the sweep, type, unit, meaning, and the
    class name of its metric.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    unit: str
    meaning: str
    metric: str = ""

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes of the variable in a dataset."""
        about = {"units": self.unit, "long_name": self.meaning}
        return about | ({"metric": self.metric} if self.metric else {})

    @property
    def missing(self) -> Any:
        """The value where there is no answer yet."""
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
    """The question of a sweep: its `dims` and the `units` of what varies along them; `questions`, one for each
    combination of models; the `kinds` of the variables of the answer by name; further `coordinates` by name, with
    their dimension and values.
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
        """The number of lanes."""
        return math.prod(self.shape)

    @property
    def bytes_a_lane(self) -> int:
        """The size of a lane's answer [bytes], uncompressed."""
        return sum(np.dtype(kind.dtype).itemsize * math.prod(kind.shape) for kind in self.kinds.values())

    def numbers(self, lanes: Lanes) -> dict[str, np.ndarray]:
        """The varied numbers of lanes, which are given by their index in C order."""
        places = np.unravel_index(lanes, self.shape)
        return {
            name: values[place]
            for dimension, place in zip(self.dims, places, strict=True)
            for name, values in dimension.columns.items()
        }

    def program(self, lanes: Lanes) -> np.ndarray:
        """The index of each lane's question."""
        places, index = np.unravel_index(lanes, self.shape), np.zeros(len(lanes), int)
        for dimension, place in zip(self.dims, places, strict=True):
            if dimension.models:
                index = index * dimension.size + place
        return index

    def blank(self, count: int) -> dict[str, np.ndarray]:
        """Every variable of `count` lanes that have not been solved."""
        return {name: np.full((count, *kind.shape), kind.missing, kind.dtype) for name, kind in self.kinds.items()}

    def answer(
        self,
        lanes: Lanes,
        cores: int | None = None,
        progress: Callable[[float], Any] | None = None,
        ready: Callable[[Lanes, dict[str, np.ndarray]], Any] | None = None,
        report: Callable[[BatchReport], Any] | None = None,
    ) -> dict[str, np.ndarray]:
        """Solve lanes: every variable, shape (lanes, ...), NaN for failed lanes. `cores`, `progress`, `ready`,
        `report` as those of `batch`, which is called once for each question.
        """
        out, programs, done = self.blank(len(lanes)), self.program(lanes), 0

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
        """Solve the lanes whose `values` are not known yet, in place; returns how many. `keep`: called after each
        chunk with places among the lanes and their values; `how`: as `answer`.
        """
        rest = np.flatnonzero(values["code"] == NOT_RUN)
        if rest.size:
            answers = self.answer(lanes[rest], ready=lambda places, some: keep(rest[places], some), **how)
            for name, column in answers.items():
                values[name][rest] = column
        return int(rest.size)

    def _solve(self, question: Question, lanes: Lanes, ready: Callable, **how: Any) -> dict[str, np.ndarray]:
        points = self.numbers(lanes)
        if not points:  # models alone: a column must give the number of lanes
            points = {"rtol": np.full(len(lanes), float(question.settings.rtol))}
        # Always a chunk of the same width, so that an answer does not depend on which lanes are solved together.
        width = min(chunk_on(), self.count // len(self.questions))

        def some(places, answer):
            ready(places, self._values(answer))

        return self._values(answered(question, points, width=width, ready=some, **how))

    def _values(self, answer: Answer) -> dict[str, np.ndarray]:
        """Every variable of the lanes of an answer, by its name."""
        variables = {**answer.ending, **answer.values, **{slope_name(k): v for k, v in answer.slopes.items()}}
        variables = {name: np.array(values, self.kinds[name].dtype) for name, values in variables.items()}
        for name, values in variables.items():
            if name not in ENDINGS:
                values[ran_in_vain(variables["code"])] = np.nan
        return variables | {"again": np.zeros(len(variables["code"]), "i1")}


def slope_name(name: str) -> str:
    """The name of the variable with the derivatives of an output."""
    return f"{name}_derivative"


def ran_in_vain(codes: np.ndarray) -> np.ndarray:
    """Whether lanes have failed, by their result codes."""
    return (codes != int(Result.REACHED_END)) & (codes != NOT_RUN)
