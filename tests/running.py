"""Three small runs that go on after a kill: a sweep into a store, a life with its journal, a search with its record."""

import contextlib
import importlib
import os
import resource
import stat
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from places import SCENES

import clearance_jax as cj
from clearance_jax import design, laws, wear
from clearance_jax.design.asked import formulation
from clearance_jax.design.asked.costs import AbstractCost
from clearance_jax.runs.journal import Journal
from clearance_jax.sweep.grid import Grid
from clearance_jax.sweep.store import Regions
from clearance_jax.wear.model import WearModel

Told = Callable[[int], None] | None
"""Called with how much is done after each step of a run, or of a life with how many steps it has gone."""
Answer = dict[str, np.ndarray]

# A pendulum, of which lanes take the least to trace.
REGIONS, LANES = 4, 512


def once(solution):
    return solution["pivot"]


def twice(solution):
    return 2 * solution["pivot"]


def swept(
    path: Path,
    told: Told = None,
    gravity: float = -9.81,
    metric: Any = cj.metrics.Rms,
    function: Any = once,
    grown: int = 0,
    **options: Any,
) -> Answer:
    """A sweep of a pendulum over mass and inertia."""
    rod = cj.Body("rod", mass=1.0, inertia=0.1, center_of_mass=cj.Position(0.5, 0.0))
    pivot = cj.Revolute("pivot", "ground", "rod", motion=cj.Motion(position=1.0))
    pendulum = cj.Mechanism((rod,), (pivot,), gravity=cj.Gravity(0.0, gravity))
    masses = np.linspace(1.0, 2.0, LANES // 16)
    between = 0.5 * (masses[:-1] + masses[1:])
    axes = {"rod.mass": np.union1d(masses, between[:grown]), "rod.inertia": np.linspace(0.1, 0.2, 16)}
    outputs = {"angle": function, "force": metric(cj.metrics.JointReaction("pivot"))}
    progress = None if told is None else lambda found: told(found.done)
    asked: Any = {"rtol": 1e-6, **options}
    found = cj.sweep(pendulum, axes, outputs, 0.1, store=path, resume=True, cores=1, progress=progress, **asked)
    return {name: found[name].values for name in ("angle", "force", "code", "steps")}


def lanes_kept(path: Path) -> tuple[int, int]:
    """Lanes of a store's journal, and of its partial results."""
    found = Regions(path)
    partial = sum(found.partial.count(region) for region in found.partial.parts() if region not in found.records)
    return sum(map(found.partition.size, found.records)), partial


# A disc that turns under its weight, and how many cycles are computed of its life.
CYCLES = 24


def deepest(depth):
    return depth.max() - 1e-6


def mean(depth):
    return depth.mean() - 1e-6


def lived(
    path: Path,
    told: Told = None,
    play: float = 1e-4,
    law: Any = wear.Archard,
    function: Any = deepest,
    values: Any = None,
    **options: Any,
) -> Answer:
    """A life whose every cycle wears off what a closed form says (see `install`), or one for each of the values."""
    clearance = cj.RevoluteClearance(play, 25e-3, laws.HuntCrossley(1e10, 50.0), length=0.05)
    pin = cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.ConstantSpeed(3.0)), clearance=clearance)
    disc = cj.Mechanism(bodies=(cj.Body("disc", 20.0, 0.1),), joints=(pin,), gravity=cj.Gravity(y=-9.81))
    blocks = iter(range(1, 1000))
    progress = None if told is None else lambda _: told(next(blocks))
    given = wear.WearModel(disc, "pin", law(1e-13), wear.Uniform(0.2), 0.05), 10**6
    asked: Any = {"tolerance": 1e-2, "rtol": 1e-6, "until": function, "sectors": 20, "journal": path, **options}
    if values is not None:
        return {"end": wear.service_lives(*given, {"wear.coefficient": values}, **asked).end}
    found = wear.simulate_wear(*given, progress=progress, **asked)
    return {"cycles": found.cycles, "depth": found.depth, "end": np.array(found.end)}


def _worn(self: WearModel, stack: np.ndarray, *_: Any) -> np.ndarray:
    return 1e-9 * np.cos(np.linspace(-1, 1, stack.shape[1])) / (1 + stack / 2e-6)


# Clearances of a slider-crank.
DESIGNS = np.geomspace(3e-5, 4e-4, 12)


class Cheap(AbstractCost):
    def __call__(self, clearance):
        return 1e-4 / clearance


class Dear(AbstractCost):
    def __call__(self, clearance):
        return 2e-4 / clearance


def searched(
    path: Path,
    told: Told = None,
    bound: float = 1e-4,
    metric: Any = cj.metrics.Rms,
    function: Any = Cheap,
    count: int = len(DESIGNS),
    **options: Any,
) -> Answer:
    """Designs one after the other, evaluated by a closed form (see `install`)."""
    limit = design.Limit(metric(cj.metrics.PositionError("piston")), bound)
    variables = {"wrist.radial_clearance": (2e-5, 5e-4)}
    scene = cj.load(SCENES / "slider_crank.toml")
    problem = design.ToleranceProblem(scene, 1e-3, variables, [limit], function(), **options)
    progress = None if told is None else lambda _: told(len(program.history))
    program = formulation.formulate(problem.specification, record=path, progress=progress)
    found = [program.at(np.array([clearance]), gradient=True) for clearance in DESIGNS[:count]]
    return {
        "x": np.array([one.x for one in found]),
        "objective": np.array([one.objective for one in found]),
        "limits": np.array([one.limits for one in found]),
        "jacobian": np.array([one.jacobian for one in found]),
    }


def _evaluated(specification: Any, x: np.ndarray, *_: Any) -> design.Evaluation:
    limits = np.array([np.nan if x[0] > 3e-4 else np.sin(1e4 * x[0])])
    return design.Evaluation(x, float(1 / x[0]), limits, -1 / x**2, np.array([[-np.inf]]))


class Run(NamedTuple):
    """One of the three: `ask` runs it at a path; where its `journal` lies; how many lanes, cycles or designs it has in
    all, and how many of them are `kept`; whether it has one `writer` at a time; how it `changes` by each kind of
    difference, with the words of the refusal; how it is asked where it is `small` and `grown`, and by how much.
    """

    ask: Callable[..., Answer]
    journal: Callable[[Path], Path]
    every: int
    kept: Callable[[Path], int]
    writer: bool
    changes: Mapping[str, tuple[dict[str, Any], str]]
    small: dict[str, Any]
    grown: dict[str, Any]
    more: int


def _computed(path: Path) -> int:
    records = Journal(path).records
    return records[-1]["evaluations"] if records else 0


OPTION = {"rtol": 1e-7}
RUNS = {
    "sweep": Run(
        swept,
        lambda path: path / "journal.jsonl",
        LANES,
        lambda path: sum(lanes_kept(path)),
        True,
        {
            "a number": ({"gravity": -9.0}, r"`gravity\.y` is -9\.0 here and -9\.81 there"),
            "an option": (OPTION, "`option rtol` is 1e-07 here and 1e-06 there"),
            "a metric": ({"metric": cj.metrics.Peak}, r"\(output force\)` is .* here and .* there"),
            "a function": ({"function": twice}, r"`code of once \(output angle\)` is absent here"),
        },
        {},
        {"grown": 8},
        8 * 16,
    ),
    "life": Run(
        lived,
        lambda path: path,
        CYCLES,
        _computed,
        True,
        {
            "a number": ({"play": 2e-4}, r"`pin\.radial_clearance` is 0\.0002 here and 0\.0001 there"),
            "an option": (OPTION, "`rtol` is 1e-07 here and 1e-06 there"),
            "a law": ({"law": wear.Reye}, r"`structure of the model \(law of wear\)` is Reye .* here and Archard"),
            "a function": ({"function": mean}, r"`code of deepest \(until\)` is absent here"),
        },
        {"values": [1e-13]},
        {"values": [1e-13, 2e-13]},
        CYCLES,
    ),
    "search": Run(
        searched,
        lambda path: path,
        len(DESIGNS),
        lambda path: len(Journal(path).records),
        False,
        {
            "a number": ({"bound": 2e-4}, r"`bound \(.*\)` is 0\.0002 here and 0\.0001 there"),
            "an option": ({"max_steps": 100}, "`option max_steps` is 100 here"),
            "a metric": ({"metric": cj.metrics.Peak}, r"`structure of the model \(limit Rms .*\)` is absent here"),
            "a function": ({"function": Dear}, r"`code of Cheap \(cost of .*\)` is absent here"),
        },
        {"count": 5},
        {},
        len(DESIGNS) - 5,
    ),
}


def install(change: Callable[[Any, str, Any], None] = setattr) -> list[int]:
    """Let cycles wear off, and designs be, what closed forms say; regions be small, and partial results not wait.
    Returns what grows by how many lanes, cycles or designs are computed.
    """
    work: list[int] = []
    answer = Grid.answer

    def counted(compute: Callable, size: Callable = lambda *_: 1) -> Callable:
        def computed(*args: Any, **options: Any) -> Any:
            work.append(size(*args))
            return compute(*args, **options)

        return computed

    change(WearModel, "cycle_wears", counted(_worn))
    change(formulation, "_evaluate", counted(_evaluated))
    change(Grid, "answer", counted(answer, lambda _, lanes, *rest: len(lanes)))
    change(importlib.import_module("clearance_jax.sweep.run"), "LEAST", LANES // REGIONS)
    change(importlib.import_module("clearance_jax.sweep.run"), "CHUNKS_A_CORE", 0)
    change(importlib.import_module("clearance_jax.runs.partial"), "PATIENCE", 0.0)
    return work


@contextlib.contextmanager
def no_longer_than(size):
    """The system refuses longer files."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def somebody():
    """As one whom the system may refuse to write: not as root."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


def allow(path, writable):
    """Everybody to read what is at a path; to write it or not."""
    for one in (path, *path.rglob("*")):
        own = stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH if one.is_dir() else 0
        one.chmod((0o666 if writable else 0o444) | own)


# What a process of its own takes most of its time to import. One server of processes has it, and they begin with it.
IMPORTED = ["clearance_jax.sweep.run", "clearance_jax.design", "clearance_jax.wear", "zarr", "dask.array"]


def victim(name: str, path: Path, plain: bool, pipe: Connection) -> None:
    """A run in a process of its own, to be killed: it says how far it is, and waits for an answer each time."""
    jax.config.update("jax_disable_most_optimizations", plain)
    cj.configure(cache=True)
    install()

    def in_step(done: int) -> None:
        pipe.send(done)
        pipe.recv()

    RUNS[name].ask(path, in_step)
    pipe.send("ended")
