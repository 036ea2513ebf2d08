"""A sweep on this machine: its regions one after the other, each on all cores."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from clearance_jax.solve.settings import settings_of
from clearance_jax.sweep.answers import AbstractAnswers, Values
from clearance_jax.sweep.identity import solving
from clearance_jax.sweep.pace import Pace, Tell
from clearance_jax.sweep.pilot import tried
from clearance_jax.sweep.plan import SweepPlan
from clearance_jax.sweep.question import NOT_RUN, Lanes, Question, failed


def plan_of(question: Question, answers: AbstractAnswers, place: str) -> SweepPlan:
    """What is to be done, without how long that will take."""
    cut, missing = answers.partition, answers.missing()
    new = sum(cut.size(region) for region in missing) - sum(answers.kept().values())
    held = min(question.count, int(np.prod(cut.chunk))) * question.bytes_a_lane
    disk = question.count * question.bytes_a_lane if answers.on_disk else 0
    known = question.count - new
    return SweepPlan(question.count, known, cut.count, len(question.functions), None, held, disk, place)


def with_time(todo: SweepPlan, seconds: float | None) -> SweepPlan:
    """The plan with how long it will take at so many seconds a lane."""
    return todo if seconds is None else todo._replace(seconds=seconds * (todo.lanes - todo.known))


def run_here(
    question: Question,
    answers: AbstractAnswers,
    cores: int,
    plan: Callable[[SweepPlan], Any] | None,
    progress: Tell,
) -> None:
    """Answer what is missing. A pilot is run where somebody wants to know the `plan`."""
    todo, missing = plan_of(question, answers, f"{cores} cores"), answers.missing()
    if plan is not None:
        plan(with_time(todo, tried(question, answers, missing, cores)))
    pace = Pace(question, answers, progress)
    for region in missing:
        lanes, values = answers.partition.lanes(region), answers.known(region)
        left = int(np.sum(values["code"] == NOT_RUN))
        new = question.complete(
            lanes,
            values,
            lambda places, some, region=region: answers.keep(region, places, some),
            cores=cores,
            progress=lambda x, left=left: pace.tell(float(x * left)),
        )
        answers.write(region, values)
        pace.ended(region, new, int(failed(values["code"]).sum()))


def run_again(question: Question, answers: AbstractAnswers, options: Mapping[str, Any], cores: int) -> None:
    """Answer lanes that failed by other options of the solves, once."""
    question, said = with_options(question, options)
    for region in answers.failing(said):
        values = rerun(question, answers.partition.lanes(region), answers.read(region), cores)
        answers.write(region, values, again=said)


def rerun(question: Question, lanes: Lanes, values: Values, cores: int) -> Values:
    """The values of lanes with those that failed answered once more."""
    values = {name: np.array(one) for name, one in values.items()}
    wrong = np.flatnonzero(failed(values["code"]))
    times = values["again"][wrong] + 1
    for name, one in question.answer(lanes[wrong], cores).items():
        values[name][wrong] = one
    values["again"][wrong] = times
    return values


def with_options(question: Question, options: Mapping[str, Any]) -> tuple[Question, str]:
    """The same question with other options of the solves, and these in words."""
    functions = []
    for function in question.functions:
        settings = settings_of(function.mechanism, function.t1, options)
        functions.append(dataclasses.replace(function, settings=settings._replace(save_at=function.settings.save_at)))
    question = dataclasses.replace(question, functions=tuple(functions))
    return question, repr(solving(functions[0].settings))
