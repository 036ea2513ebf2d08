"""`sweep`: solve a question at many points, into one labelled dataset; its arguments, checked, make its `Grid`."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import xarray as xr

from clearance_jax.ask.answers import client_of
from clearance_jax.ask.question import OPTIONS, Question, shapes_of
from clearance_jax.dynamics.quantities import OBSERVED, labels, quantities
from clearance_jax.errors import ClearanceError, quote, unknown_name
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, MetricForm, as_metric
from clearance_jax.parameters import find, parameters
from clearance_jax.solve.drivers.batch import usual_cores
from clearance_jax.solve.drivers.lanes import LANES, chunk_on
from clearance_jax.solve.settings import SolveOptions, settings_of
from clearance_jax.sweep.answers import InMemory
from clearance_jax.sweep.axes import Dimension, dimensions, models_of, units_of_columns
from clearance_jax.sweep.grid import ENDINGS, LEAST, Grid, Kind, slope_name
from clearance_jax.sweep.here import run_here, run_on
from clearance_jax.sweep.plan import SweepPlan, Tell, check_memory, check_room
from clearance_jax.sweep.widen import open_store

# Least number of chunks of a region for each core, as cores wait at its end for the last chunk.
CHUNKS_A_CORE = 32


def sweep(
    mechanism: Mechanism,
    axes: Mapping[str, Any],
    outputs: Mapping[str, Any],
    t1: Any = None,
    *,
    wrt: Sequence[str] = (),
    derivatives_of: Sequence[str] | None = None,
    times: Any = None,
    again: Mapping[str, Any] | None = None,
    store: str | Path | None = None,
    resume: bool = False,
    cores: int | None = None,
    cluster: Any = None,
    plan: Callable[[SweepPlan], Any] | None = None,
    progress: Tell = None,
    provenance: Mapping[str, Any] | None = None,
    **options: Unpack[SolveOptions],
) -> xr.Dataset:
    """Solve the outputs of a mechanism's motion at many points of its parameters and models, on every core.

    **Arguments:**

    - `mechanism`: what moves.
    - `axes`: the dimensions of the answer. A dotted parameter name -> values [SI], shape (n,); or any name -> `Zipped`,
      `Sampled` or `Choice`. Besides parameters, "t1" [s] and "rtol" may vary.
    - `outputs`: name -> one of `clearance_jax.metrics`, a function `f(solution)` or `f(mechanism, solution)`, or the
      name of a quantity of the solution ("piston.position"), at the end or at `times`.
    - `t1`: end of the motion [s], unless it is an axis; `options`: as `simulate`'s.
    - `wrt`: parameters by which the outputs (or those in `derivatives_of`) are differentiated, in the same solve. The
      derivatives are variables `NAME_derivative` with a last dimension `parameter`.
    - `times`: where quantities and functions get samples: how many, or times [s]. Without it, only the end of each
      motion is kept.
    - `again`: options with which failed lanes are solved once more.
    - `store`: a zarr store to write, which may be far larger than memory. `resume`: go on with a store that is there.
      You may have added values to its axes.
    - `cores`: as `batch`'s.
    - `cluster`: a dask client, or the address of a scheduler. Its workers solve and write the regions of the store,
      each on `cores` cores (1). All of them must reach the store by its path. "local": workers on this machine, for a
      trial.
    - `plan`: called with the `SweepPlan` before the first region; `progress`: called with the `SweepProgress`.
    - `provenance`: texts and numbers to be kept as attributes.

    **Returns:** a dataset with a dimension for each axis. It has, for every lane, the outputs, `code` (0: reached t1),
    `steps`, `rejected`, `energy_residual` (with `energy_balance=True`), and how often the lane was run `again`. Outputs
    of failed lanes are NaN. The attributes say how many lanes failed, and why. A dataset of a store reads the values
    when you use them.

    **Raises:** `ClearanceError` for what cannot be asked, and for a store that cannot be written, that another process
    is writing, or that belongs to another question. Ctrl-C leaves a store that can be resumed.
    """
    if "save_at" in options:
        raise ClearanceError("A sweep is given `times` instead of `save_at`.").about("save_at")
    grid = grid_of(mechanism, axes, outputs, t1, wrt, derivatives_of, times, options)
    side_by_side, provenance = cores or usual_cores(), provenance or {}
    repeat = None if again is None else {**options, **again}
    needed = grid.count * grid.bytes_a_lane
    if store is None:
        if cluster is not None:
            text = "On a cluster each worker writes its own part: give a `store` that all of them reach."
            raise ClearanceError(text).about("store")
        check_memory(2 * needed)
        answers = InMemory(grid, provenance)
        run_here(answers, side_by_side, plan, progress, repeat)
        return answers.dataset()
    if not Path(store).exists():
        check_room(Path(store), needed)
    with ExitStack() as stack:
        client = None if cluster is None else stack.enter_context(client_of(cluster, cores or 1))
        cores_of_a_region = side_by_side if client is None else cores or 1
        least = max(LEAST, LANES * CHUNKS_A_CORE * cores_of_a_region)
        if client is None:  # the workers of a cluster may have other chunks
            least = max(least, chunk_on())
        answers = open_store(store, grid, provenance, resume=resume, least=least)
        stack.callback(answers.close)
        if client is None:
            run_here(answers, side_by_side, plan, progress, repeat)
        else:
            run_on(client, answers, cores_of_a_region, plan, progress, repeat)
        return answers.dataset()


def grid_of(
    mechanism: Mechanism,
    axes: Mapping[str, Any],
    outputs: Mapping[str, Any],
    t1: Any,
    wrt: Sequence[str] = (),
    derivatives_of: Sequence[str] | None = None,
    times: Any = None,
    options: Mapping[str, Any] | None = None,
) -> Grid:
    """The grid of the arguments of `sweep`. **Raises** `ClearanceError` for what cannot be answered."""
    dims = dimensions(axes)
    models = models_of(mechanism, dims)
    every = [units_of_columns(model, dims) for model in models]
    units = every[0]
    first = {name: values[0] for dimension in dims for name, values in dimension.columns.items()}
    t1 = _end(t1, first, times)
    wrt = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    differentiated = _derivative_names(outputs, wrt, derivatives_of)
    questions = []
    for model in models:
        settings = settings_of(model, t1, {**(options or {}), "save_at": times})
        for dimension, name in itertools.product(dims, OPTIONS):
            least = settings.t0 if name == "t1" else 0
            if name in dimension.columns and np.min(dimension.columns[name]) <= least:
                axis = f"the axis `{dimension.name}`"
                raise ClearanceError(f"`{name}` must be greater than its least, but {axis} is not.")
        known = parameters(model) if wrt else {}
        for name in wrt:
            leaf, entry = find(known, name)
            if entry is None and np.ndim(leaf.value):
                raise ClearanceError(f"`wrt` wants numbers, but `{name}` is an array. Name its entries, `{name}.0`.")
        # The name of a quantity becomes a metric of the solution.
        asked = ((name, Named(of) if isinstance(of, str) else of) for name, of in _outputs(outputs).items())
        metrics = {str(name): as_metric(of) for name, of in asked}
        questions.append(Question(model, metrics, t1, settings, wrt, differentiated))
    shapes = [shapes_of(question, sorted(first)) for question in questions]
    if any(shape != shapes[0] for shape in shapes):
        raise ClearanceError("The outputs must be alike in all models of a `Choice`, but their shapes differ.")
    kinds, coordinates = _kinds(models[0], questions[0], outputs, shapes[0], dims)
    return Grid(dims, units, tuple(questions), kinds, coordinates)


def _end(t1: Any, first: Mapping[str, Any], times: Any) -> float:
    if "t1" not in first:
        if t1 is None:
            raise ClearanceError("`t1` is missing: until when is the motion looked at [s]?")
        return t1
    if t1 is not None:
        raise ClearanceError("`t1` is an axis and an argument. Take one of the two away.")
    if isinstance(times, int | np.integer):
        raise ClearanceError("Where `t1` differs from sample to sample `times` must be times [s], not their number.")
    return first["t1"]


def _outputs(outputs: Any) -> Mapping[str, Any]:
    if not isinstance(outputs, Mapping) or not outputs:
        raise ClearanceError('`outputs` must be metrics by name, such as `{"peak": Peak(PositionError("piston"))}`.')
    return outputs


class Named(NamedTuple):
    """A function that gives a quantity of a solution by its name, at the end or at the times of `save_at`."""

    quantity: str

    def __call__(self, solution: Any) -> Any:
        return solution[self.quantity]


def _derivative_names(outputs: Any, wrt: tuple[str, ...], given: Sequence[str] | None) -> tuple[str, ...]:
    if not wrt:
        if given:
            raise ClearanceError("`derivatives_of` names outputs, but `wrt` no parameters by which.")
        return ()
    names = tuple(_outputs(outputs)) if given is None else (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in outputs:
            raise unknown_name(f"`derivatives_of`: there is no output `{name}`.", str(name), outputs)
    return tuple(sorted(names))


def _kinds(
    model: Mechanism, question: Question, outputs: Mapping[str, Any], shapes: Any, dims: Sequence[Dimension]
) -> tuple[dict[str, Kind], dict[str, tuple[str, Any]]]:
    """The kinds of all variables, and the coordinates of dimensions that are not the sweep's."""
    kinds, settings = {name: ENDINGS[name] for name in ENDINGS if name in (*shapes.ending, "again")}, question.settings
    coordinates = {} if settings.save_at is None else {"time": ("time", np.asarray(settings.save_at))}
    # Only if needed: it takes as long as the lanes of a small sweep.
    by_name = any(isinstance(given, str) for given in outputs.values())
    named, known = quantities(model, bool(settings.energy_balance)) if by_name else {}, {}
    varied = [name for dimension in dims for name in (dimension.name, *dimension.columns)]
    # Size and labels by dimension; `None`: a name that outputs must not use for dimensions of theirs.
    along: dict[str, Any] = dict.fromkeys((*varied, "time", "parameter", "parameter_unit"))
    for name, given in outputs.items():
        if not hasattr(shapes.values[name], "shape"):
            raise ClearanceError(f"The output `{name}` must be a number or an array: take one entry of its record.")
        form = question.metrics[name].form(model)
        shape, unit, meaning = shapes.values[name].shape, form.unit or str(getattr(given, "unit", "")), ""
        axes = _axes(name, form, shape, along)
        coordinates |= {dim: (dim, list(along[dim][1])) for dim in axes if along[dim][1]}
        if isinstance(given, str):
            quantity = named[given]
            unit, meaning = quantity.unit, OBSERVED[quantity.variable].meaning if quantity.place is None else given
            axes = OBSERVED[quantity.variable].dims[len(quantity.index) :] if quantity.place is None else ()
            axes = (*(("time",) if settings.save_at is not None else ()), *axes)
            known = known or (labels(model) if axes else {})
            coordinates |= {dim: (dim, known[dim][1]) for dim in axes if dim in known}
            axes = axes if len(axes) == len(shape) else tuple(f"{name}_{i}" for i in range(len(shape)))
        kinds[name] = Kind(axes, shape, "f8", unit, meaning or _words(given), type(question.metrics[name]).__name__)
    if question.by:
        units = [find(parameters(model), parameter)[0].unit for parameter in question.by]
        coordinates["parameter"] = "parameter", list(question.by)
        coordinates["parameter_unit"] = "parameter", units
        by = units[0] if len(set(units)) == 1 else "see parameter_unit"
        for name in question.differentiated:
            of = kinds[name]
            shape, unit = (*of.shape, len(question.by)), f"({of.unit or '1'})/({by or '1'})"
            kinds[slope_name(name)] = Kind((*of.dims, "parameter"), shape, "f8", unit, f"derivatives of {name}")
    taken = {*varied, *coordinates, *ENDINGS, *(dim for kind in kinds.values() for dim in kind.dims)}
    for name in (*outputs, *(slope_name(name) for name in question.differentiated)):
        if not isinstance(name, str) or not name.isprintable() or "/" in name or not name.strip("."):
            text = f"An output cannot be called {quote(name)}: it must be a word. Choose another."
            raise ClearanceError(text).about(name)
        if name in taken:
            text = f"An output cannot be called {quote(name)}: the name is taken. Choose another."
            raise ClearanceError(text).about(name)
        taken.add(name)
    return kinds, coordinates


def _axes(name: str, form: MetricForm, shape: tuple[int, ...], along: dict[str, Any]) -> tuple[str, ...]:
    """The names of an output's dimensions, as its metric calls them; with the output's name in front if a name is taken
    by another dimension. `along`: size and labels by dimension, to which these are added.
    """
    named = form.axes if len(form.axes) == len(shape) else [(str(i), ()) for i in range(len(shape))]
    dims = []
    for (axis, words), size in zip(named, shape, strict=True):
        free = not axis.isdecimal() and along.setdefault(axis, (size, words)) == (size, words)
        dims.append(axis if free else f"{name}_{axis}")
        along[dims[-1]] = size, words
    return tuple(dims)


def _words(given: Any) -> str:
    """A metric in words."""
    signal = getattr(given, "signal", None) if isinstance(given, AbstractMetric) else None
    of = "" if signal is None else f" of {type(signal).__name__}"
    return getattr(given, "__name__", type(given).__name__) + of
