"""The grid of a sweep: dimensions, questions and their description, regions of lanes (points), and solves of lanes."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from clearance_jax.ask.question import OPTIONS, Answer, Question
from clearance_jax.ask.question import lanes as answered
from clearance_jax.parameters import replace
from clearance_jax.runs.identity import digest, numbers, versions
from clearance_jax.runs.identity import settings as in_words
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers.batch import BatchReport
from clearance_jax.solve.drivers.lanes import chunk_on
from clearance_jax.solve.validity import WORDS as LEVELS
from clearance_jax.sweep.axes import Dimension

# Least number of lanes of a region: smaller regions would make too many files of a large sweep.
LEAST = 4096


class Partition(NamedTuple):
    """The regions of a grid of `shape`: blocks of the shape `chunk` (smaller at the far ends), numbered in C order."""

    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @property
    def grid(self) -> tuple[int, ...]:
        """The number of regions along each dimension."""
        return tuple(-(-size // step) for size, step in zip(self.shape, self.chunk, strict=True))

    @property
    def count(self) -> int:
        """The number of regions."""
        return math.prod(self.grid)

    def slices(self, region: int) -> tuple[slice, ...]:
        """The slices of a region in the grid."""
        places = np.unravel_index(region, self.grid)
        ends = zip(places, self.chunk, self.shape, strict=True)
        return tuple(slice(int(p) * step, min((int(p) + 1) * step, size)) for p, step, size in ends)

    def extent(self, region: int) -> tuple[int, ...]:
        """The number of lanes of a region along each dimension."""
        return tuple(part.stop - part.start for part in self.slices(region))

    def size(self, region: int) -> int:
        """The number of lanes of a region."""
        return math.prod(self.extent(region))

    def lanes(self, region: int) -> Int[np.ndarray, " lanes"]:
        """The lanes of a region by their index in the whole grid, in C order within the region."""
        ranges = [np.arange(part.start, part.stop) for part in self.slices(region)]
        return np.ravel_multi_index(np.meshgrid(*ranges, indexing="ij"), self.shape).ravel()

    def of(self, lanes: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """The regions of lanes, and the places of lanes within their regions."""
        places, here = np.unravel_index(lanes, self.shape), np.zeros(len(lanes), int)
        regions = np.ravel_multi_index([p // step for p, step in zip(places, self.chunk, strict=True)], self.grid)
        for at, step, size in zip(places, self.chunk, self.shape, strict=True):
            inside, extent = at % step, np.minimum(step, size - at // step * step)  # the last region may be smaller
            here = here * extent + inside
        return regions, here


def partition(shape: Sequence[int], apart: Sequence[bool], least: int = LEAST) -> Partition:
    """Even regions of at least `least` lanes (or all). Dimensions that stay `apart` (models) are cut everywhere."""
    chunk, so_far = [1] * len(shape), 1
    for i in reversed(range(len(shape))):
        if not apart[i]:
            pieces = max(1, shape[i] // -(-least // so_far))
            chunk[i] = -(-shape[i] // pieces)
            so_far *= chunk[i]
    return Partition(tuple(shape), tuple(chunk))


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


_CODES = ", ".join(f"{code.value} {code.name.lower()}" for code in Result)
_LEVELS = ", ".join(f"{k} {level}" for k, level in enumerate(LEVELS))
ENDINGS = {
    "code": Kind((), (), "i1", "1", f"how the solve ended ({_CODES})"),
    "steps": Kind((), (), "i4", "1", "integration steps"),
    "rejected": Kind((), (), "i4", "1", "steps tried in vain"),
    "energy_residual": Kind((), (), "f8", "1", "energy missing in the balance over energy exchanged"),
    "validity": Kind((), (), "i1", "1", f"whether poses can be believed ({_LEVELS})"),
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
        pairs = zip(self.dims, places, strict=True)
        return {name: values[place] for dimension, place in pairs for name, values in dimension.columns.items()}

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

            def some(places, answer, members=members):
                if ready is not None:
                    ready(members[places], self._values(answer))

            question, points = self.questions[program], self.numbers(lanes[members])
            # Models alone: a column must give the number of lanes.
            points = points or {"rtol": np.full(len(members), float(question.settings.rtol))}
            # Always a chunk of the same width, so that an answer does not depend on which lanes are solved together.
            how = {"width": min(chunk_on(), self.count // len(self.questions)), "cores": cores, "report": report}
            solved = self._values(answered(question, points, progress=part, ready=some, **how))
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


AXIS = "axis "


def description(grid: Grid) -> dict[str, Any]:
    """The description of a question: numbers and short texts by name."""
    described: dict[str, Any] = versions()
    for dimension in grid.dims:
        drawn = [f"{k} {v}" for k, v in dimension.sampling.items() if k in ("method", "seed")]
        pairs = dimension.columns.items()
        columns = [f"{name}: {len(v)} from {v[0]:.9g} to {v[-1]:.9g}, {digest(v)}" for name, v in pairs]
        described[f"{AXIS}{dimension.name}"] = ", ".join(dimension.models) or "; ".join([*drawn, *columns])
    varied = {name: np.nan for dimension in grid.dims for name in dimension.columns}
    for label, question in zip(labels(grid), grid.questions, strict=True):
        model = replace(question.model, {k: v for k, v in varied.items() if k not in OPTIONS})
        described |= numbers(model, label)
    question = grid.questions[0]
    for name, metric in question.metrics.items():
        described |= {f"{what} (output {name})": value for what, value in numbers(metric).items()}
    described["wrt"] = list(question.by)
    described["derivatives_of"] = list(question.differentiated)
    if "t1" not in varied:
        described["t1"] = float(question.t1)
    described |= {f"option {name}": value for name, value in in_words(question.settings._asdict()).items()}
    return described


def labels(grid: Grid) -> list[str]:
    """A suffix for the names of each model's numbers; empty for a single model."""
    suffixes = [""]
    for dimension in grid.dims:
        if dimension.models:
            suffixes = [f"{before} ({dimension.name}: {label})" for before in suffixes for label in dimension.models]
    return suffixes
