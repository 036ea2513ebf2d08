"""A design problem as numbers: what a solver sees of it, and what is kept of every point that it asks for.

Variables are positive lengths of very different size, so solvers work in their logarithms. Limits are scaled: a limit
is (value / bound - 1), held where it is not positive.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.identity import differences, fingerprint, refusal

# What the first line of a record has beside names: the problem, by names.
PROBLEM = "problem"
# A limit counts as held if it is violated by no more than this share of its bound: a solver ends on the limit itself.
SLACK = 1e-9


class Evaluation(NamedTuple):
    """An evaluated design: variables `x` (n,), objective, scaled limits (m,); their gradients by x, (n,) and (m, n),
    where they were asked for.
    """

    x: np.ndarray
    objective: float
    limits: np.ndarray
    gradient: np.ndarray | None = None
    jacobian: np.ndarray | None = None

    @property
    def worst(self) -> float:
        """The most violated limit (minus infinity where there is none); infinite where a value is not a number."""
        if not math.isfinite(self.objective) or not np.all(np.isfinite(self.limits)):
            return math.inf
        return float(np.max(self.limits, initial=-math.inf))

    @property
    def feasible(self) -> bool:
        """Whether every limit is held."""
        return self.worst <= SLACK


class BudgetSpent(Exception):
    """The solver has used up its evaluations."""


class Program:
    """Minimise an objective under limits and bounds, remembering every point.

    **Arguments:**

    - `evaluate`: `(x, with_gradient) -> Evaluation`.
    - `names`, `lower`, `upper`: of the variables, positive; `limit_names`: of the limits.
    - `groups`: of each limit, which of the designer's limits it belongs to (default: itself).
    - `record`: a file (JSON lines) to which every point is added, and from which a run that was stopped goes on, if the
      `identity` recorded in it (the problem by names) is the same.
    - `most`: evaluations after which a solver is stopped with the best so far.
    - `progress`: called with each new point.
    - `known`: points evaluated before.
    - `fresh`: `(x, samples, seed) -> Evaluation`, the same by so many fresh samples of manufacture, with gradients.
    - `several`: `(points) -> Evaluations`, without gradients, where many at once are cheaper than one by one.
    """

    def __init__(
        self,
        evaluate: Callable[[np.ndarray, bool], Evaluation],
        names: Sequence[str],
        lower: np.ndarray,
        upper: np.ndarray,
        limit_names: Sequence[str],
        groups: Sequence[str] | None = None,
        record: str | Path | None = None,
        identity: Mapping[str, Any] | None = None,
        most: int = 1_000_000,
        progress: Callable[[Evaluation], None] | None = None,
        known: Sequence[Evaluation] = (),
        fresh: Callable[[np.ndarray, int, int], Evaluation] | None = None,
        several: Callable[[list[np.ndarray]], list[Evaluation]] | None = None,
    ):
        self.names, self.limit_names = tuple(names), tuple(limit_names)
        self.groups, self._problem = tuple(groups or limit_names), dict(identity or {})
        self._identity, self._headed = fingerprint(self._problem), False
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not 0 < low < high < math.inf:
                raise ClearanceError(f"The bounds of `{name}` contradict each other: 0 < {low:g} < {high:g} must hold.")
        self._evaluate, self._fresh, self._several = evaluate, fresh, several
        self._most, self._progress = most, progress
        self._file = None if record is None else Path(record)
        if self._file is not None and not self._file.parent.is_dir():
            raise ClearanceError(f"There is no folder `{self._file.parent}` for the record.")
        self.history: list[Evaluation] = []
        self._known: dict[bytes, Evaluation] = {}
        self.evaluations = self.gradients = 0
        for point in known:
            self._keep(point)
        if self._file is not None and self._file.exists():
            self._load()

    def at(self, x: np.ndarray, gradient: bool = False) -> Evaluation:
        """The point at `x`, from memory where it is known."""
        x = np.clip(np.asarray(x, float), self.lower, self.upper)
        known = self._known.get(x.tobytes())
        if known is not None and (known.gradient is not None or not gradient):
            return known
        self._spend()
        return self._found(self._evaluate(x, gradient))

    def at_each(self, points: Sequence[np.ndarray]) -> list[Evaluation]:
        """`at` of each point, without gradients; those not known are evaluated together where there is a way."""
        points = [np.clip(np.asarray(x, float), self.lower, self.upper) for x in points]
        new = {x.tobytes(): x for x in points if x.tobytes() not in self._known}
        if self._several is not None and new:
            self._spend()
            for point in self._several(list(new.values())):
                self._found(point)
        return [self.at(x) for x in points]

    def _found(self, point: Evaluation) -> Evaluation:
        """Count, keep, record and tell of a new point."""
        self.gradients += point.gradient is not None
        self.evaluations += point.gradient is None
        self._keep(point)
        if self._file is not None:
            self._record(point)
        if self._progress is not None:
            self._progress(point)
        return point

    def _record(self, point: Evaluation) -> None:
        """Add a point to the file, below the problem. **Raises** `ClearanceError` where the disk refuses it."""
        assert self._file is not None
        lines = [] if self._headed else [{"names": self.names, PROBLEM: self._problem}]
        lines.append({"names": self.names, "identity": self._identity, **_entry(point)})
        try:
            with self._file.open("a") as file:
                file.write("".join(json.dumps(line) + "\n" for line in lines))
        except OSError as error:
            raise ClearanceError(
                f"Cannot write the record `{self._file}`: {error.strerror or error}. See to that, and go on with it."
            ) from error
        self._headed = True

    def fresh(self, x: np.ndarray, samples: int, seed: int) -> Evaluation:
        """The point at `x` by fresh samples, with gradients; not kept, for the next ones say something else.

        **Raises:** `ClearanceError` where nothing is sampled.
        """
        if self._fresh is None:
            raise ClearanceError(
                "Only a problem with `manufacture=Yield(...)` has samples to be drawn afresh. Take another method."
            )
        self._spend()
        self.gradients += 1
        return self._fresh(np.clip(np.asarray(x, float), self.lower, self.upper), samples, seed)

    def _spend(self) -> None:
        if self.evaluations + self.gradients >= self._most:
            raise BudgetSpent

    @property
    def best(self) -> Evaluation | None:
        """The feasible point with the least objective."""
        held = [p for p in self.history if p.feasible]
        return min(held, key=lambda p: p.objective, default=None)

    @property
    def nearest(self) -> Evaluation | None:
        """The point with the least violation."""
        return min(self.history, key=lambda p: p.worst, default=None)

    def with_bound(self, group: str, factor: float) -> "Program":
        """The same program with the bounds of one of the designer's limits times a factor; it evaluates, and
        remembers, through this one.
        """

        def moved(point: Evaluation) -> Evaluation:
            limits = (point.limits + 1) * shrink - 1
            jacobian = None if point.jacobian is None else point.jacobian * shrink[:, None]
            return point._replace(limits=limits, jacobian=jacobian)

        shrink = np.where([name == group for name in self.groups], 1 / factor, 1.0)
        names = self.names, self.lower, self.upper, self.limit_names, self.groups
        known = [moved(point) for point in self.history]
        fresh = None if self._fresh is None else lambda x, samples, seed: moved(self.fresh(x, samples, seed))
        return Program(lambda x, gradient: moved(self.at(x, gradient)), *names, known=known, fresh=fresh)

    def most_violated(self, point: Evaluation) -> str:
        """The most violated limit of a point in words."""
        if not len(point.limits):
            return "no limit"
        bad = ~np.isfinite(point.limits)
        if np.any(bad):
            return f"{self.limit_names[int(np.argmax(bad))]} is not a number"
        k = int(np.argmax(point.limits))
        return f"{self.limit_names[k]} is {1 + point.limits[k]:.6g} times its bound"

    def _keep(self, point: Evaluation) -> None:
        self.history.append(point)
        self._known[point.x.tobytes()] = point

    def _load(self) -> None:
        assert self._file is not None
        try:
            text = self._file.read_text()
            entries = _recorded(text)
            heads, entries = ([e for e in entries if (PROBLEM in e) == is_head] for is_head in (True, False))
            found = {k: v for head in heads for k, v in differences(head[PROBLEM], self._problem, "there").items()}
            known = [(tuple(e.pop("names")), e.pop("identity"), len(e["limits"])) for e in entries]
        except (OSError, ValueError, AttributeError, KeyError, TypeError):
            raise ClearanceError(f"`{self._file}` is no record of designs. Choose another file.") from None
        if found:
            raise ClearanceError(refusal(self._file, found, "records another problem", "Choose another file"))
        if any(one != (self.names, self._identity, len(self.limit_names)) for one in known):
            raise ClearanceError(f"`{self._file}` records another problem. Choose another file.")
        self._headed = bool(heads)
        if text and not text.endswith("\n"):
            with self._file.open("a") as file:
                file.write("\n")
        for entry in entries:
            arrays = {k: None if v is None else np.asarray(v, float) for k, v in entry.items() if k != "objective"}
            self._keep(Evaluation(objective=float(entry["objective"]), **arrays))


def _recorded(text: str) -> list[dict]:
    """The entries of a record. **Raises** `ValueError` for a line that is none, nor was being written when it ended."""
    entries, begin = [], '{"names": '
    for line in text.splitlines():
        try:
            entries.append(json.loads(line))
        except json.JSONDecodeError:
            if not (line.startswith(begin) or begin.startswith(line)):
                raise
    return entries


def _entry(point: Evaluation) -> dict:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in point._asdict().items()}
