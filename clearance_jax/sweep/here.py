"""A sweep on this machine: one region after the other, each on all cores."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from clearance_jax.solve.settings import settings_of
from clearance_jax.sweep.answers import AbstractAnswers, Values
from clearance_jax.sweep.grid import NOT_RUN, Grid, Lanes, ran_in_vain
from clearance_jax.sweep.identity import solve_words
from clearance_jax.sweep.pace import SweepPace, Tell
from clearance_jax.sweep.pilot import pilot_time
from clearance_jax.sweep.plan import SweepPlan


def plan_of(grid: Grid, answers: AbstractAnswers, place: str) -> SweepPlan:
    """The plan of a sweep, without the expected time."""
    cut, missing = answers.partition, answers.open_regions()
    new = sum(cut.size(region) for region in missing) - sum(answers.partial_counts().values())
    memory = min(grid.count, int(np.prod(cut.chunk))) * grid.bytes_a_lane
    disk = grid.count * grid.bytes_a_lane if answers.on_disk else 0
    known = grid.count - new
    return SweepPlan(grid.count, known, cut.count, len(grid.questions), None, memory, disk, place)


def with_time(todo: SweepPlan, seconds: float | None) -> SweepPlan:
    """The plan with the expected time, at so many seconds a lane."""
    return todo if seconds is None else todo._replace(seconds=seconds * (todo.lanes - todo.known))


def run_here(
    grid: Grid,
    answers: AbstractAnswers,
    cores: int,
    plan: Callable[[SweepPlan], Any] | None,
    progress: Tell,
) -> None:
    """Answer the missing regions. If there is a `plan` callback, a few lanes are timed first."""
    todo, missing = plan_of(grid, answers, f"{cores} cores"), answers.open_regions()
    if plan is not None:
        plan(with_time(todo, pilot_time(grid, answers, missing, cores)))
    pace = SweepPace(grid, answers, progress)
    for region in missing:
        lanes, values = answers.partition.lanes(region), answers.partial_answers(region)
        left = int(np.sum(values["code"] == NOT_RUN))
        new = grid.complete(
            lanes,
            values,
            lambda places, some, region=region: answers.keep(region, places, some),
            cores=cores,
            progress=lambda x, left=left: pace.tell(float(x * left)),
        )
        answers.write(region, values)
        pace.end_region(region, new, int(ran_in_vain(values["code"]).sum()))


def run_again(grid: Grid, answers: AbstractAnswers, options: Mapping[str, Any], cores: int) -> None:
    """Solve failed lanes once more with other options."""
    grid, words = with_options(grid, options)
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
    return grid, repr(solve_words(questions[0].settings))
