"""`sweep`: solve a question at many points, into one labelled dataset."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Unpack

import xarray as xr

from clearance_jax.ask.answers import client_of
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.drivers.batch import usual_cores
from clearance_jax.solve.drivers.lanes import LANES, chunk_on
from clearance_jax.solve.settings import SolveOptions
from clearance_jax.sweep.answers import InMemory
from clearance_jax.sweep.grid import LEAST
from clearance_jax.sweep.here import run_here, run_on
from clearance_jax.sweep.plan import SweepPlan, Tell, check_memory, check_room
from clearance_jax.sweep.question import grid_of
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
