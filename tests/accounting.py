"""Where the suite's time goes: `pytest -n 2 --account` writes out/suite.md, by file and by test.

JAX says when it has traced, lowered and compiled something, and how long that took. What lies within another of these
counts once: an interval's own time is its length less that of the intervals within it. The rest of a test's time runs
programs, or Python of ours. CPU seconds are those of the process and of the children that it has waited for.
"""

import json
import os
import resource
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import jax
import pytest

KINDS = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
}
COLUMNS = ("wall", "cpu", *KINDS.values(), "programs")
# So many tests are listed by name.
LISTED = 60


class Intervals:
    """Nested intervals of which only the ends are told: own time by kind."""

    def __init__(self):
        self.own: dict[str, float] = defaultdict(float)
        self.ended: list[tuple[float, float]] = []

    def end(self, kind: str, duration: float, now: float) -> None:
        """An interval ends `now`; those within it have ended before."""
        began, within = now - duration, 0.0
        while self.ended and self.ended[-1][0] >= began:
            within += self.ended.pop()[1]
        self.ended.append((began, duration))
        self.own[kind] += max(duration - within, 0.0)


class Accounting:
    """Of every process of the suite: a line for each test."""

    def __init__(self, folder: Path):
        self.intervals, self.folder, self.began = Intervals(), folder, time.perf_counter()
        self.worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
        if self.worker == "main":
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob("suite_*.jsonl"):
                old.unlink()
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    def _listen(self, event: str, duration: float, **_: object) -> None:
        kind = KINDS.get(event)
        if kind is not None:
            self.intervals.end(kind, duration, time.perf_counter())
            self.intervals.own["programs"] += kind == "compiling"

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        before, began, spent = dict(self.intervals.own), time.perf_counter(), cpu()
        yield
        row = {kind: self.intervals.own[kind] - before.get(kind, 0.0) for kind in COLUMNS[2:]}
        row |= {"test": item.nodeid, "wall": time.perf_counter() - began, "cpu": cpu() - spent, "memory": largest()}
        with (self.folder / f"suite_{self.worker}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    def pytest_sessionfinish(self):
        if self.worker == "main":
            write(self.folder, time.perf_counter() - self.began)


def cpu() -> float:
    """CPU seconds of this process and the children that it has waited for."""
    of = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in of)


def largest() -> float:
    """The most memory that this process has held [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def write(folder: Path, wall: float) -> None:
    """The page of all processes' lines."""
    kept = [path.read_text(encoding="utf-8").splitlines() for path in sorted(folder.glob("suite_*.jsonl"))]
    workers = [[json.loads(line) for line in lines] for lines in kept if lines]
    rows = [row for lines in workers for row in lines]
    files: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        files[row["test"].split("::")[0]].append(row)
    whole = summed(rows)
    memory = max(row["memory"] for row in rows)
    spent = whole["cpu"] / 60
    head = f"{len(rows)} tests in {wall / 60:.1f} min, {spent:.1f} min of CPU; largest process {memory:.1f} GB."
    by_file = [(name, len(lines), summed(lines)) for name, lines in files.items()]
    by_test = [(row["test"], 1, row) for row in rows]
    parts = [head, _table("file", [("all", len(rows), whole), *_dear_first(by_file)])]
    parts += [_table("test", _dear_first(by_test)[:LISTED])]
    (folder / "suite.md").write_text("\n\n".join(["# Where the suite's time goes", *parts]) + "\n", encoding="utf-8")


def summed(rows: Iterable[dict]) -> dict[str, float]:
    """Column by column."""
    rows = list(rows)
    return {name: sum(row[name] for row in rows) for name in COLUMNS}


def _dear_first(rows: list[tuple]) -> list[tuple]:
    return sorted(rows, key=lambda row: -row[2]["cpu"])


def _table(what: str, rows: list[tuple]) -> str:
    lines = [f"| {what} | tests | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 2) + "|"]
    for name, tests, of in rows:
        seconds = " | ".join(f"{of[column]:.1f}" for column in COLUMNS[:-1])
        lines.append(f"| {name} | {tests} | {seconds} | {of['programs']:.0f} |")
    return "\n".join(lines)
