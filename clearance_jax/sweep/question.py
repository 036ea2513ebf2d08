"""A sweep's question, read and checked: what its answer will look like, and the answer for any of its lanes."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from clearance_jax.analysis.measure import AbstractMetric, Form, Function, as_metric
from clearance_jax.dynamics.quantities import OBSERVED, labels, quantities
from clearance_jax.errors import ClearanceError, quoted, suggest
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import find, parameters
from clearance_jax.solve.batch import BatchReport, batch
from clearance_jax.solve.codes import Result
from clearance_jax.solve.lanes import chunk_on
from clearance_jax.solve.settings import Settings, settings_of
from clearance_jax.sweep.axes import OPTIONS, Dimension, dimensions, models_of, units_of_columns
from clearance_jax.sweep.lane import Answer, Lane, shapes_of

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
        said = {"units": self.unit, "long_name": self.meaning}
        return said | ({"metric": self.metric} if self.metric else {})

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
    "energy_residual": Kind((), (), "f8", "1", "energy missing in the books over energy exchanged"),
    "again": Kind((), (), "i1", "1", "how often the lane was run again with other settings"),
}


@dataclasses.dataclass(frozen=True)
class Question:
    """What is asked: the `dims` with what varies along them and its `units`; of each structure (combination of
    choices) its `lanes` function; what every variable of the answer is (`kinds`); further coordinates, by name their
    dimension and values.
    """

    dims: tuple[Dimension, ...]
    units: dict[str, str]
    functions: tuple[Lane, ...]
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
        """Which of the functions each lane is of."""
        places, found = np.unravel_index(lanes, self.shape), np.zeros(len(lanes), int)
        for dimension, place in zip(self.dims, places, strict=True):
            if dimension.models:
                found = found * dimension.size + place
        return found

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
            own = np.flatnonzero(programs == program)

            def part(share, done=done, size=len(own)):
                if progress is not None:
                    progress((done + share * size) / len(lanes))

            def some(places, values, own=own):
                if ready is not None:
                    ready(own[places], values)

            found = self._solved(self.functions[program], lanes[own], some, cores=cores, progress=part, report=report)
            for name, values in found.items():
                out[name][own] = values
            done += len(own)
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
            for name, one in answers.items():
                values[name][rest] = one
        return int(rest.size)

    def _solved(self, function: Lane, lanes: Lanes, ready: Callable, **how: Any) -> dict[str, np.ndarray]:
        numbers = self.numbers(lanes)
        if not numbers:  # models alone: something must say how many lanes there are
            numbers = {"rtol": np.full(len(lanes), float(function.settings.rtol))}
        # As many lanes as a chunk has, or all that the question has of this structure: another number would be another
        # program, with other last digits.
        width = min(chunk_on(), self.count // len(self.functions))
        lacking = max(0, width - len(lanes))
        numbers = {name: np.pad(values, (0, lacking), mode="edge") for name, values in numbers.items()}

        def chunk(places, answer):
            wanted = places < len(lanes)
            ready(places[wanted], self._values(answer, wanted))

        return self._values(batch(function, numbers, ready=chunk, **how), slice(len(lanes)))

    def _values(self, answer: Answer, wanted: Any) -> dict[str, np.ndarray]:
        """Every variable of the lanes `wanted` of an answer."""
        found = {**answer.ending, **answer.values, **{_slope(k): v for k, v in answer.slopes.items()}}
        found = {name: np.array(values[wanted], self.kinds[name].dtype) for name, values in found.items()}
        for name, values in found.items():
            if name not in ENDINGS:
                values[failed(found["code"])] = np.nan
        return found | {"again": np.zeros(len(found["code"]), "i1")}


def failed(codes: np.ndarray) -> np.ndarray:
    """Which lanes have been run in vain, by their result codes."""
    return (codes != int(Result.REACHED_END)) & (codes != NOT_RUN)


def ask(
    mechanism: Mechanism,
    axes: Mapping[str, Any],
    outputs: Mapping[str, Any],
    t1: Any,
    wrt: Sequence[str] = (),
    derivatives_of: Sequence[str] | None = None,
    times: Any = None,
    options: Mapping[str, Any] | None = None,
) -> Question:
    """A question as it is given to `sweep`, read. **Raises** `ClearanceError` for what cannot be answered."""
    dims = dimensions(axes)
    models = models_of(mechanism, dims)
    every = [units_of_columns(model, dims) for model in models]
    units = every[0]
    first = {name: values[0] for dimension in dims for name, values in dimension.columns.items()}
    t1 = _end(t1, first, times)
    wrt = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    differentiated = _differentiated(outputs, wrt, derivatives_of)
    functions = []
    for model in models:
        settings = _settings(model, t1, dims, {**(options or {}), "save_at": times})
        _check_wrt(model, wrt)
        metrics = {str(name): _metric(name, given) for name, given in _outputs(outputs).items()}
        functions.append(Lane(model, metrics, jnp.asarray(t1, float), settings, wrt, differentiated))
    shapes = [shapes_of(function, sorted(first)) for function in functions]
    if any(shape != shapes[0] for shape in shapes):
        raise ClearanceError("The outputs must be alike in all models of a `Choice`, but their shapes differ.")
    kinds, coordinates = _kinds(models[0], functions[0], outputs, shapes[0], dims)
    return Question(dims, units, tuple(functions), kinds, coordinates)


def _end(t1: Any, first: Mapping[str, Any], times: Any) -> float:
    if "t1" not in first:
        if t1 is None:
            raise ClearanceError("`t1` is missing: until when is the motion looked at [s]?")
        return t1
    if t1 is not None:
        raise ClearanceError("`t1` is an axis and an argument. Take one of the two away.")
    if isinstance(times, int | np.integer):
        raise ClearanceError("Where `t1` differs from lane to lane `times` must be times [s], not their number.")
    return first["t1"]


def _settings(model: Mechanism, t1: Any, dims: Sequence[Dimension], options: Mapping[str, Any]) -> Settings:
    settings = settings_of(model, t1, options)
    for dimension in dims:
        for name in OPTIONS:
            if name in dimension.columns and np.min(dimension.columns[name]) <= (settings.t0 if name == "t1" else 0):
                raise ClearanceError(
                    f"`{name}` must be greater than its least, but the axis `{dimension.name}` is not."
                )
    return settings


def _check_wrt(model: Mechanism, wrt: Sequence[str]) -> None:
    known = parameters(model) if wrt else {}
    for name in wrt:
        leaf, entry = find(known, name)
        if entry is None and np.ndim(leaf.value):
            raise ClearanceError(f"`wrt` wants numbers, but `{name}` is an array. Name its entries, `{name}.0`.")


# What comes out ------------------------------------------------------------------------------------------------------


def _outputs(outputs: Any) -> Mapping[str, Any]:
    if not isinstance(outputs, Mapping) or not outputs:
        raise ClearanceError('`outputs` must be metrics by name, such as `{"peak": Peak(PositionError("piston"))}`.')
    return outputs


def _metric(name: str, given: Any) -> AbstractMetric:
    """A metric; a quantity by its name as a metric of the solution."""
    return Function(Named(given)) if isinstance(given, str) else as_metric(given)


class Named(NamedTuple):
    """A quantity of a solution, by its name; at the end, or at the times that samples were asked for."""

    quantity: str

    def __call__(self, solution: Any) -> Any:
        return solution[self.quantity]


def _differentiated(outputs: Any, wrt: tuple[str, ...], given: Sequence[str] | None) -> tuple[str, ...]:
    if not wrt:
        if given:
            raise ClearanceError("`derivatives_of` names outputs, but `wrt` no parameters by which.")
        return ()
    found = tuple(_outputs(outputs)) if given is None else (given,) if isinstance(given, str) else tuple(given)
    for name in found:
        if name not in outputs:
            raise ClearanceError(f"`derivatives_of`: there is no output `{name}`. {suggest(str(name), outputs)}")
    return tuple(sorted(found))


def _slope(name: str) -> str:
    """What the derivatives of an output are called."""
    return f"{name}_derivative"


def _kinds(
    model: Mechanism, function: Lane, outputs: Mapping[str, Any], shapes: Any, dims: Sequence[Dimension]
) -> tuple[dict[str, Kind], dict[str, tuple[str, Any]]]:
    """What every variable is, and the coordinates of dimensions that are not the sweep's."""
    kinds, coordinates = {name: ENDINGS[name] for name in ENDINGS if name in (*shapes.ending, "again")}, {}
    settings = function.settings
    if settings.save_at is not None:
        coordinates["time"] = "time", np.asarray(settings.save_at)
    # Looked up where somebody asks: for a small sweep it takes as long as the lanes.
    by_name = any(isinstance(given, str) for given in outputs.values())
    named, known = quantities(model, bool(settings.books)) if by_name else {}, {}
    along = {name: None for dimension in dims for name in (dimension.name, *dimension.columns)}
    along |= dict.fromkeys(("time", "parameter", "parameter_unit"))
    for name, given in outputs.items():
        if not hasattr(shapes.values[name], "shape"):
            raise ClearanceError(f"The output `{name}` must be a number or an array: take one entry of its record.")
        form = function.metrics[name].form(model)
        shape, unit, meaning = shapes.values[name].shape, form.unit or str(getattr(given, "unit", "")), ""
        own = _axes(name, form, shape, along)
        coordinates |= {dim: (dim, list(along[dim][1])) for dim in own if along[dim][1]}
        if isinstance(given, str):
            found = named[given]
            unit, meaning = found.unit, OBSERVED[found.variable].meaning if found.place is None else given
            own = OBSERVED[found.variable].dims[len(found.index) :] if found.place is None else ()
            own = (*(("time",) if settings.save_at is not None else ()), *own)
            known = known or (labels(model) if own else {})
            coordinates |= {dim: (dim, known[dim][1]) for dim in own if dim in known}
            own = own if len(own) == len(shape) else tuple(f"{name}_{i}" for i in range(len(shape)))
        kinds[name] = Kind(own, shape, "f8", unit, meaning or _words(given), type(function.metrics[name]).__name__)
    if function.wrt:
        units = [find(parameters(model), one)[0].unit for one in function.wrt]
        coordinates["parameter"] = "parameter", list(function.wrt)
        coordinates["parameter_unit"] = "parameter", units
        by = units[0] if len(set(units)) == 1 else "see parameter_unit"
        for name in function.differentiated:
            of = kinds[name]
            shape, unit = (*of.shape, len(function.wrt)), f"({of.unit or '1'})/({by or '1'})"
            kinds[_slope(name)] = Kind((*of.dims, "parameter"), shape, "f8", unit, f"derivatives of {name}")
    taken = {*(name for dimension in dims for name in (dimension.name, *dimension.columns)), *coordinates, *ENDINGS}
    taken |= {dim for kind in kinds.values() for dim in kind.dims}
    for name in (*outputs, *(_slope(name) for name in function.differentiated)):
        if not isinstance(name, str) or not name.isprintable() or "/" in name or not name.strip("."):
            raise ClearanceError(f"An output cannot be called {quoted(name)}: it must be a word. Choose another.")
        if name in taken:
            raise ClearanceError(f"An output cannot be called {quoted(name)}: the name is taken. Choose another.")
        taken.add(name)
    return kinds, coordinates


def _axes(name: str, form: Form, shape: tuple[int, ...], along: dict[str, Any]) -> tuple[str, ...]:
    """The dimensions of an output beside the lanes', as its metric calls them; with the output's name in front where
    something else is called so. `along`: what stands along each dimension, size and labels, to which they are added.
    """
    named = form.axes if len(form.axes) == len(shape) else [(str(i), ()) for i in range(len(shape))]
    found = []
    for (axis, words), size in zip(named, shape, strict=True):
        free = not axis.isdecimal() and along.setdefault(axis, (size, words)) == (size, words)
        found.append(axis if free else f"{name}_{axis}")
        along[found[-1]] = size, words
    return tuple(found)


def _words(given: Any) -> str:
    """A metric in words."""
    if isinstance(given, AbstractMetric):
        signal = getattr(given, "signal", None)
        of = "" if signal is None else f" of {type(signal).__name__}"
        return f"{type(given).__name__}{of}"
    return getattr(given, "__name__", type(given).__name__)
