"""A sweep region after region: on this machine, each on all cores, or each as a task on a dask cluster.

On a cluster a worker solves a region and writes it to the store. Only a few numbers of each task pass the scheduler;
this process writes the journal. If a worker is lost, another one repeats its task and writes the same values to the
same chunks. Workers read the question from a file in the store.
"""

import dataclasses
import functools
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.ask.answers import unpickled, workers_of
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.runs.identity import settings as in_words
from clearance_jax.solve.drivers.lanes import LANES
from clearance_jax.solve.settings import settings_of
from clearance_jax.sweep.answers import Values, ending_counts
from clearance_jax.sweep.grid import NOT_RUN, Grid, Lanes, ran_in_vain
from clearance_jax.sweep.plan import SweepPace, SweepPlan, Tell, choose, keep, pilot_time, time_lanes
from clearance_jax.sweep.store import HANDED_OUT, Answers, Regions, Store, partial_answers
from clearance_jax.sweep.widen import before_of


def plan_of(answers: Answers, place: str, time: Callable[[], float | None]) -> SweepPlan:
    """The plan of a sweep. `time` measures how long a lane takes [s] (`None`: not known)."""
    grid, cut, missing = answers.grid, answers.partition, answers.open_regions()
    new = sum(cut.size(region) for region in missing) - sum(answers.partial_counts().values())
    memory = min(grid.count, int(np.prod(cut.chunk))) * grid.bytes_a_lane
    disk = grid.count * grid.bytes_a_lane if answers.on_disk else 0
    a_lane = time()  # the last thing, as it solves lanes: they must still count as new
    seconds = None if a_lane is None else a_lane * new
    return SweepPlan(grid.count, grid.count - new, cut.count, len(grid.questions), seconds, memory, disk, place)


def run_here(
    answers: Answers,
    cores: int,
    plan: Callable[[SweepPlan], Any] | None,
    progress: Tell,
    again: Mapping[str, Any] | None,
) -> None:
    """Answer the missing regions, then solve failed lanes with the options `again`; for a `plan` a few are timed."""
    missing = answers.open_regions()
    if plan is not None:
        plan(plan_of(answers, f"{cores} cores", lambda: pilot_time(answers, missing, cores)))
    pace = SweepPace(answers, progress)
    for region in missing:
        lanes, values = answers.partition.lanes(region), answers.partial_answers(region)
        left = int(np.sum(values["code"] == NOT_RUN))
        new = answers.grid.complete(
            lanes,
            values,
            lambda places, some, region=region: answers.keep(region, places, some),
            cores=cores,
            progress=lambda x, left=left: pace.tell(float(x * left)),
        )
        answers.write(region, values)
        pace.end_region(region, new, int(ran_in_vain(values["code"]).sum()))
    if again is not None:
        grid, words = with_options(answers.grid, again)
        for region in answers.regions_to_repeat(words):
            values = rerun(grid, answers.partition.lanes(region), answers.read(region), cores)
            answers.write(region, values, again=words)


def rerun(grid: Grid, lanes: Lanes, values: Values, cores: int) -> Values:
    """The values of lanes, with the failed ones solved again."""
    values = {name: np.array(column) for name, column in values.items()}
    wrong = np.flatnonzero(ran_in_vain(values["code"]))
    times = values["again"][wrong] + 1
    for name, column in grid.answer(lanes[wrong], cores).items():
        values[name][wrong] = column
    values["again"][wrong] = times
    return values


def with_options(grid: Grid, options: Mapping[str, Any]) -> tuple[Grid, str]:
    """The grid with other options of the solves, and these in words."""
    questions = []
    for question in grid.questions:
        settings = settings_of(question.model, question.t1, options)
        questions.append(dataclasses.replace(question, settings=settings._replace(save_at=question.settings.save_at)))
    grid = dataclasses.replace(grid, questions=tuple(questions))
    return grid, repr(in_words(questions[0].settings._asdict()))


# Workers on which a few lanes are timed.
PILOTS = 4
# Tasks in the queue of each worker: enough that it never waits, and few for the scheduler.
AHEAD = 3
# How many workers may be killed by one region.
LIVES = 5


def run_on(
    client: Any,
    store: Store,
    cores: int,
    plan: Callable[[SweepPlan], Any] | None,
    progress: Tell,
    again: Mapping[str, Any] | None,
) -> None:
    """As `run_here`, on the workers of a cluster, with `cores` cores for each region."""
    missing, workers = store.open_regions(), len(workers_of(client))
    if missing and not workers:
        raise ClearanceError("The cluster has no workers. Start some, and go on with `resume`.")
    with _hand_out(store, store.grid) as name:
        if plan is not None:
            there = f"{workers} workers ({client.dashboard_link})"
            plan(plan_of(store, there, lambda: _time_lanes(client, store, name, missing, cores)))
        pace = SweepPace(store, progress)
        for region, (digest, endings, new) in _each(client, store, missing, _answer, name, cores):
            store.confirm(region, digest, endings)
            pace.end_region(region, new, sum(endings.values()) - endings.get("0", 0))
    if again is not None:
        grid, words = with_options(store.grid, again)
        regions = store.regions_to_repeat(words)
        with _hand_out(store, grid) as name:
            for region, (digest, endings, _) in _each(client, store, regions, _answer_again, name, cores):
                store.confirm(region, digest, endings, again=words)


def _each(
    client: Any, store: Store, regions: list[int], task: Callable, grid: str, cores: int
) -> Iterator[tuple[int, Any]]:
    """Each region with the result of its task, as they are done."""
    from distributed import as_completed

    lives, waiting = dict.fromkeys(regions, LIVES), iter(regions)
    running: dict[Any, int] = {}

    def begin(region: int) -> Any:
        # A new name each time, as the scheduler remembers failed tasks.
        name = f"sweep-{grid}-{region}-{lives[region]}"
        future = client.submit(task, str(store.path.absolute()), grid, region, cores, key=name, pure=False)
        running[future] = region
        return future

    ending = as_completed([begin(region) for region in islice(waiting, AHEAD * max(1, len(workers_of(client))))])
    try:
        for future in ending:
            region = running.pop(future)
            error = future.exception()
            if error is None:
                yield region, future.result()
                # The number of workers may have grown.
                more = islice(waiting, max(0, AHEAD * len(workers_of(client)) - len(running)))
            else:
                lives[region] -= 1
                if type(error).__name__ != "KilledWorker" or lives[region] == 0:
                    raise ClearanceError(
                        f"Region {region} of `{store.path}` failed on the cluster: {quote(str(error))}. What was "
                        "written before is kept: go on with `resume`."
                    ) from error
                more = [region]
            for following in more:
                ending.add(begin(following))
    finally:
        client.cancel(list(running), force=True)


def _time_lanes(client: Any, store: Store, grid: str, missing: list[int], cores: int) -> float | None:
    """The time of a lane with all workers running [s], measured on a few of them; `None`: not known."""
    workers = list(workers_of(client))
    few = workers[:PILOTS]
    lanes = choose(store.partition, missing, LANES * cores * len(few))
    if len(lanes) == 0:
        return None
    path = str(store.path.absolute())
    each = functools.partial(client.submit, _try, path, grid, pure=False, allow_other_workers=True)
    tasks = [each(lanes[i :: len(few)], cores, workers=worker) for i, worker in enumerate(few)]
    try:
        took = client.gather(tasks)
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        return None
    return float(np.mean(took)) / len(workers)


@contextmanager
def _hand_out(store: Store, grid: Grid) -> Iterator[str]:
    """A context with the question in a file of the store, for the workers; gives the name of the file."""
    import cloudpickle

    place = store.path / f"{HANDED_OUT}{uuid.uuid4().hex}"
    try:
        place.write_bytes(cloudpickle.dumps(grid))
        yield place.name
    finally:
        place.unlink(missing_ok=True)


# On a worker ---------------------------------------------------------------------------------------------------------


def _answer(path: str, name: str, region: int, cores: int) -> tuple[str, dict[str, int], int]:
    """Solve and write a region. Returns its digest, the counts of its result codes, and how many lanes were solved."""
    grid, regions, before = _open(path, name)
    values = partial_answers(grid, regions, before, region)
    keep = functools.partial(regions.partial.add, region)
    new = grid.complete(regions.partition.lanes(region), values, keep, cores=cores)
    return regions.write(region, values), ending_counts(values["code"]), new


def _answer_again(path: str, name: str, region: int, cores: int) -> tuple[str, dict[str, int], int]:
    """Solve the failed lanes of a region again, and return as `_answer` does."""
    grid, regions, _ = _open(path, name)
    old = regions.read(region)
    values = rerun(grid, regions.partition.lanes(region), old, cores)
    return regions.write(region, values, old), ending_counts(values["code"]), int(ran_in_vain(old["code"]).sum())


def _try(path: str, name: str, lanes: Lanes, cores: int) -> float:
    """The time of a lane on this worker [s], measured with some lanes whose answers are kept."""
    grid, regions, _ = _open(path, name)
    seconds, values = time_lanes(grid, lanes, cores)
    keep(regions.partition, regions.partial.add, lanes, values)
    regions.partial.flush()  # another worker may get these regions
    return seconds / len(lanes)


@functools.lru_cache(maxsize=4)
def _open(path: str, name: str) -> tuple[Any, Regions, Any]:
    """The question, its store and the narrower store, read once by each worker."""
    grid = unpickled((Path(path) / name).read_bytes())
    return grid, Regions(Path(path)), before_of(Path(path), grid)
