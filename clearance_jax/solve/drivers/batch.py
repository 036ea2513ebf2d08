"""`batch`: a function of one lane applied to any number of lanes, on every core, in bounded memory.

The unit of work is a chunk of lanes (`chunk_on`), one call of one compiled program. Threads call it side by side: JAX
releases Python's lock while a program runs. So nothing is pickled, compiled twice, or configured before JAX starts, and
an idle core takes the next chunk. On a CPU larger calls are no faster, and would need filling or a new compilation for
every number of lanes.
"""

import os
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax.errors import ClearanceError, quote, wrong_value
from clearance_jax.solve.drivers.effort import effort
from clearance_jax.solve.drivers.expected import Lanes, as_numbers, cut, pilots, sorted_lanes
from clearance_jax.solve.drivers.lanes import chunk_on


class BatchReport(NamedTuple):
    """Report of a batch. It prints itself.

    - `lanes`, `chunks`, `cores`: their numbers.
    - `order`: the order of the lanes: "given", "learned", or by "cost".
    - `efficiency`: step attempts of the lanes over step attempts of their chunks, between 0 and 1. The rest was spent
      waiting for the slowest lane of each chunk. `None`: the attempts are not known.
    - `compiling`, `running`: how long the two took [s].
    """

    lanes: int
    chunks: int
    cores: int
    order: str
    efficiency: float | None
    compiling: float
    running: float

    def __str__(self) -> str:
        known = "lane efficiency not known" if self.efficiency is None else f"lane efficiency {self.efficiency:.3f}"
        return (
            f"{self.lanes} samples in {self.chunks} chunks on {self.cores} cores: {self.running:.3g} s after "
            f"{self.compiling:.3g} s of compiling, {known} (order: {self.order})"
        )


def batch(
    function: Any,
    lanes: Any,
    *,
    cores: Any = None,
    chunk: Any = None,
    cost: Any = "learned",
    progress: Callable[[float], Any] | None = None,
    ready: Callable[[Lanes, Any], Any] | None = None,
    report: Callable[[BatchReport], Any] | None = None,
) -> Any:
    """`function` of every lane, as `jax.vmap(function)(lanes)` gives it, but on every core and in bounded memory.

    Call it from ordinary Python code, not inside jit, vmap or derivatives. Beside the results it keeps one chunk of
    lanes for each core in memory. The program is compiled at the first call with a function; later calls use it for any
    number of lanes above that of a chunk. Numbers that a function holds as leaves of a tree (`jax.tree_util.Partial`,
    an `equinox.Module`) may change without a new compilation. A lane that fails has a result code and NaN, as under
    `jax.vmap`, and does not affect the others.

    **Arguments:**

    - `function`: takes one lane, a tree of numbers, and returns a tree of arrays: quantities, metrics, a whole
      `Solution`.
    - `lanes`: a tree of arrays of shape (N, ...): the first axis counts the lanes. The units are those of the function.
    - `cores`: how many chunks run at the same time; by default all that this process may use, on a GPU one. They are
      fewer than XLA's threads (`configure` gives it enough): a process without `configure` leaves one core free.
    - `chunk`: lanes of a chunk, by default 64. If JAX has a GPU, it is 65 536: there thousands of lanes take as long as
      one.
    - `cost`: how lanes are sorted, because lanes with equally many step attempts fill a chunk best. "learned": the
      first chunks run in the given order, and the others are sorted by what those took, if this promises fuller chunks;
      no solve is spent on it. An array (N,): sorted by these expected costs, in any unit. `None`: in the given order.
    - `progress`: called with the fraction done.
    - `ready`: called with the indices of a chunk's lanes and their values, as soon as these are there.
    - `report`: called with the `BatchReport` at the end: `print` shows it, the `append` of a list keeps it.

    **Returns:** the function's tree, as NumPy arrays of shape (N, ...), in the order of `lanes`.

    **Raises:** `ClearanceError` if there are no lanes, or if the arrays in `lanes` have different first axes; and
    whatever the function raises. Ctrl-C stops the batch when the running chunks have ended.
    """
    leaves, count = _leaves(function, lanes)
    cores, costs = min(_whole("cores", cores, usual_cores()), side_by_side()), _costs(cost, count)
    chunk = _whole("chunk", chunk, chunk_on())
    started = time.perf_counter()
    work = _Work(function, leaves, jax.tree.structure(lanes), min(count, chunk), ready)
    compiled = time.perf_counter()
    chunks, order = cut(np.arange(count), work.width), "given"
    cores = min(cores, len(chunks))
    if costs is not None:
        chunks, order = cut(np.argsort(-costs, kind="stable"), work.width), "cost"
    elif cost is not None:
        first, chunks = pilots(chunks)
        work.run(first, cores, progress)
        longest_first = work.sort(first, chunks)
        if longest_first is not None:
            chunks, order = cut(longest_first, work.width), "learned"
    work.run(chunks, cores, progress)
    if report is not None:
        took = compiled - started, time.perf_counter() - compiled
        report(BatchReport(count, -(-count // work.width), cores, order, work.efficiency, *took))
    return work.values


def _each(function: Callable, lanes: Any) -> Any:
    """The value of every lane, and the step attempts of its solves (`None`: not known)."""

    def counted(lane):
        with effort() as seen:
            value = function(lane)
        return value, seen.known

    return jax.vmap(counted)(lanes)


_program: Any = eqx.filter_jit(_each)


class _Work:
    """The compiled program of a batch, and the results so far."""

    def __init__(
        self, function: Callable, leaves: list[np.ndarray], structure: Any, width: int, ready: Callable | None
    ):
        self.function, self.leaves, self.structure, self.width = function, leaves, structure, width
        self.ready = ready
        self.count, self.done = len(leaves[0]), 0
        self.values: Any = None
        self.attempts = np.zeros(self.count)
        self._own, self._ran = 0.0, 0.0
        # Compiled here and not in a thread: the caller may have configured JAX for this thread only. JAX keeps the
        # program of a function for the next batch.
        self.program = _program.lower(function, self._inputs(np.arange(width))).compile()

    def run(self, chunks: list[Lanes], cores: int, progress: Callable | None) -> None:
        """Run chunks, each on the next free core."""
        waiting = iter(chunks)
        with ThreadPoolExecutor(cores) as pool:

            def begin(count: int) -> set[Future]:
                return {pool.submit(self._call, chunk, self._inputs(chunk)) for chunk in islice(waiting, count)}

            # Two a core: one runs, one is ready; all at once would be a second copy of the lanes.
            running = begin(2 * cores)
            try:
                while running:
                    ended, running = wait(running, return_when=FIRST_COMPLETED)
                    running |= begin(len(ended))
                    for call in ended:
                        self._keep(*call.result())
                    if progress is not None:
                        progress(self.done / self.count)
            except BaseException:  # an interruption too: what has not begun is not to begin
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def sort(self, tried: list[Lanes], others: list[Lanes]) -> Lanes | None:
        """The other lanes sorted by what the tried ones took; `None`: keep the order."""
        if self.efficiency is None or not others:
            return None
        numbers = as_numbers(self.leaves, self.count)
        lanes = np.concatenate(tried), np.concatenate(others)
        return sorted_lanes(numbers, self.attempts, *lanes, self.efficiency, self.width)

    @property
    def efficiency(self) -> float | None:
        """Attempts of the lanes so far over those that their chunks ran; `None` where they are not known."""
        return self._own / self._ran if self._ran else None

    def _inputs(self, chunk: Lanes) -> Any:
        """The lanes of a chunk, filled up with its last one because another shape would be another program."""
        full = np.pad(chunk, (0, self.width - len(chunk)), mode="edge")
        return jax.tree.unflatten(self.structure, [jnp.asarray(leaf[full]) for leaf in self.leaves])

    def _call(self, chunk: Lanes, inputs: Any) -> tuple[Lanes, Any, Any]:
        return chunk, *jax.tree.map(np.asarray, self.program(self.function, inputs))

    def _keep(self, chunk: Lanes, values: Any, attempts: list[np.ndarray] | None) -> None:
        if self.values is None:
            self.values = jax.tree.map(lambda x: np.empty((self.count, *x.shape[1:]), x.dtype), values)
        for whole, x in zip(jax.tree.leaves(self.values), jax.tree.leaves(values), strict=True):
            whole[chunk] = x[: len(chunk)]
        if self.ready is not None:
            self.ready(chunk, jax.tree.map(lambda x: x[: len(chunk)], values))
        self.done += len(chunk)
        for solve in attempts or []:
            self.attempts[chunk] += solve[: len(chunk)]
            self._own += solve[: len(chunk)].sum()
            self._ran += solve.max() * self.width


# Input checks -------------------------------------------------------------------------------------------------------


def _leaves(function: Any, lanes: Any) -> tuple[list[np.ndarray], int]:
    """The arrays of `lanes`, and how many lanes there are."""
    if not callable(function):
        raise wrong_value("`function`", "a function of one lane", function)
    paths, _ = jax.tree_util.tree_flatten_with_path(lanes)
    if not paths:
        raise ClearanceError("`lanes` must be a tree of arrays whose first axis are the lanes, but it has no array.")
    if any(isinstance(leaf, Tracer) for _, leaf in paths):
        raise ClearanceError("`batch` is called from Python; inside jit, vmap or a derivative use `jax.vmap`.")
    leaves = {f"lanes{jax.tree_util.keystr(path)}": _array(leaf) for path, leaf in paths}
    for (name, leaf), (_, given) in zip(leaves.items(), paths, strict=True):
        if leaf.ndim == 0 or leaf.dtype.kind not in "biufc":
            raise ClearanceError(
                f"Every leaf of `lanes` must be an array of numbers whose first axis are the lanes, but `{name}` is "
                f"{quote(given)}. (A list is a tree of its entries: make it an array.)"
            ).about(name, given, "numbers")
    sizes = {name: len(leaf) for name, leaf in leaves.items()}
    count = min(sizes.values())
    if count != max(sizes.values()):
        few, many = min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
        raise ClearanceError(
            f"Every leaf of `lanes` must have as many lanes, but `{few}` has {sizes[few]} and `{many}` has "
            f"{sizes[many]}."
        ).about(few, sizes[few])
    if count == 0:
        raise ClearanceError("There are no lanes: the first axis of `lanes` is empty.").about("lanes", 0)
    return list(leaves.values()), count


def _array(leaf: Any) -> np.ndarray:
    try:
        return np.asarray(leaf)
    except TypeError:  # random keys of JAX's own type
        return np.asarray(None)


def cores_here() -> int:
    """How many cores the process may use; on a shared machine often not all."""
    here = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(here, side_by_side())


def side_by_side() -> int:
    """How many programs may run side by side on the CPU: fewer than XLA has threads, or kernels that share work among
    threads wait for ever (`configure` gives XLA more threads than there are cores).
    """
    threads = os.environ.get("PJRT_NPROC") or os.environ.get("NPROC") or os.cpu_count() or 1
    return max(1, int(threads) - 1)


def usual_cores() -> int:
    """How many chunks run side by side: one for each core; on a GPU one, which fills its memory."""
    return cores_here() if jax.default_backend() == "cpu" else 1


def _whole(name: str, given: Any, usual: int) -> int:
    """A whole number as given, or `usual`."""
    if given is None:
        return usual
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or given < 1:
        raise wrong_value(f"`{name}`", "a whole number, at least 1", given)
    return int(given)


def _costs(cost: Any, count: int) -> np.ndarray | None:
    """The expected cost of each lane, if given."""
    if cost is None or (isinstance(cost, str) and cost == "learned"):
        return None
    costs = None if isinstance(cost, str) else np.asarray(cost)
    if costs is None or costs.shape != (count,) or not np.issubdtype(costs.dtype, np.number):
        text = f'`cost` must be "learned", an array of {count} numbers, one a lane, or `None`, but it is {quote(cost)}.'
        raise ClearanceError(text).about("cost", cost)
    return costs.astype(float)
