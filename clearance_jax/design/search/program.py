"""A design problem as a nonlinear program, with a memory and a record of every evaluated point.

Variables are positive lengths of very different size, so solvers work in their logarithms. A limit is (value / bound -
1), and holds if it is not positive.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.runs.journal import Journal
from clearance_jax.solve.settings import DYNAMICS

# A limit counts as held if it is violated by at most this share of its bound, as solvers end on the limit itself.
SLACK = 1e-9


class Evaluation(NamedTuple):
    """An evaluated design.

    - `x` (n,): the variables; `objective`; `limits` (m,): value over bound, minus 1, of each limit.
    - `gradient` (n,) of the objective and `jacobian` (m, n) of the limits by x; `None`: not asked for.
    - `fidelity`: the model of the motion by which it was evaluated.
    """

    x: np.ndarray
    objective: float
    limits: np.ndarray
    gradient: np.ndarray | None = None
    jacobian: np.ndarray | None = None
    fidelity: str = DYNAMICS

    @property
    def worst(self) -> float:
        """The most violated limit; minus infinity without limits, infinite if a number is not finite."""
        if not math.isfinite(self.objective) or not np.all(np.isfinite(self.limits)):
            return math.inf
        return float(np.max(self.limits, initial=-math.inf))

    @property
    def feasible(self) -> bool:
        """Whether every limit is held."""
        return self.worst <= SLACK


def _plain(value: Any) -> Any:
    """A value for JSON: numbers that are not finite as text."""
    value = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def evaluation_of(record: Mapping[str, Any]) -> Evaluation:
    """The design of a record."""
    arrays = ("x", "limits", "gradient", "jacobian")
    values = {k: None if record[k] is None else np.asarray(record[k], float) for k in arrays}
    return Evaluation(objective=float(record["objective"]), fidelity=record["fidelity"], **values)


# Points whose variables differ by less than this, relative, are the same.
ROUND_OFF = 1e-14
# Relative difference of objectives that solves do not resolve.
TIE = 1e-8
# The least distance of an active limit to its bound, as a share of the bound.
INSIDE = 1e-10


class BudgetSpent(Exception):
    """The solver has used up its evaluations."""


class Program:
    """A minimisation under limits and bounds that keeps every evaluated point.

    **Arguments:**

    - `evaluate`: `(x, with_gradient) -> Evaluation`.
    - `names`, `lower`, `upper`: of the variables, positive; `limit_names`: of the limits.
    - `groups`: of each limit, which of the designer's limits it belongs to (default: itself).
    - `record`: a file (a `Journal`) to which every point is added, and from which a run that was stopped goes on if the
      problem is the same (`identity`: by names). Two runs may add to one record at a time.
    - `most`: evaluations after which a solver is stopped with the best so far.
    - `progress`: called with each new point.
    - `known`: points evaluated before.
    - `several`: `(points) -> Evaluations`, without gradients, where many at once are cheaper than one by one.
    - `fidelity`: the model of the motion that evaluates; a record may hold points of several.
    - `cheap`: the same problem by a cheaper model, whose points are counted by themselves (`None`: there is none).
    - `inside`: the share of its bound by which an active limit is to stay inside: more than solves differ by.
    - `leaders`: for each limit the index of the limit of another model to compare it with: that of the highest peak of
      its motion (default: its own).
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
        several: Callable[[list[np.ndarray]], list[Evaluation]] | None = None,
        fidelity: str = DYNAMICS,
        cheap: "Program | None" = None,
        leaders: np.ndarray | None = None,
        inside: float = INSIDE,
    ):
        self.names, self.limit_names = tuple(names), tuple(limit_names)
        self.groups = tuple(groups or limit_names)
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not 0 < low < high < math.inf:
                text = f"The bounds of `{name}` contradict each other: 0 < {low:g} < {high:g} must hold."
                raise ClearanceError(text).about(name, (float(low), float(high)))
        self._evaluate, self._several = evaluate, several
        self._most, self._progress, self.fidelity, self.cheap, self.inside = most, progress, fidelity, cheap, inside
        self.leaders = np.arange(len(self.limit_names)) if leaders is None else leaders
        self._record = None if record is None else Journal(record)
        if self._record is not None:
            self._record.ask({**(identity or {}), "variables": list(names), "limits": list(limit_names)})
        self.history: list[Evaluation] = []
        self.asked: list[Evaluation] = []
        """The points that a solver asked for, new and known ones."""
        self._known: dict[bytes, Evaluation] = {}
        self.evaluations = self.gradients = 0
        read = () if self._record is None else map(evaluation_of, self._record.records)
        for point in (*known, *read):
            if point.fidelity == fidelity:
                self._keep(point)

    @property
    def record(self) -> Path | None:
        """The file with every point, if there is one."""
        return None if self._record is None else self._record.path

    def at(self, x: np.ndarray, gradient: bool = False) -> Evaluation:
        """The evaluation at `x` (n,), from memory if it is known."""
        x = np.clip(np.asarray(x, float), self.lower, self.upper)
        known = self._recall(x)
        if known is None or (known.gradient is None and gradient):
            self._spend()
            known = self._note(self._evaluate(x, gradient))
        self.asked.append(known)
        return known

    def _recall(self, x: np.ndarray) -> Evaluation | None:
        """The known evaluation of a point, or of one that differs by round-off, if possible with a gradient. A search
        that is repeated from its record so takes the same steps, although its points have other last digits.
        """
        known = self._known.get(x.tobytes())
        if known is not None:
            return known
        near = [point for point in self.history if np.all(np.abs(point.x - x) <= ROUND_OFF * x)]
        return next((point for point in near if point.gradient is not None), near[0] if near else None)

    def at_each(self, points: Sequence[np.ndarray]) -> list[Evaluation]:
        """`at` of each point, without gradients; unknown points are evaluated together if `several` is given."""
        points = [np.clip(np.asarray(x, float), self.lower, self.upper) for x in points]
        new = {x.tobytes(): x for x in points if self._recall(x) is None}
        if self._several is not None and new:
            self._spend()
            for point in self._several(list(new.values())):
                self._note(point)
        return [self.at(x) for x in points]

    def _note(self, point: Evaluation) -> Evaluation:
        """Count, keep, record and report a new point."""
        self.gradients += point.gradient is not None
        self.evaluations += point.gradient is None
        self._keep(point)
        if self._record is not None:
            self._record.add(**{name: _plain(value) for name, value in point._asdict().items()})
        if self._progress is not None:
            self._progress(point)
        return point

    def _spend(self) -> None:
        if self.solves >= self._most:
            raise BudgetSpent

    @property
    def points(self) -> list[Evaluation]:
        """All points by both models."""
        return self.history + ([] if self.cheap is None else self.cheap.history)

    @property
    def best(self) -> Evaluation | None:
        """The feasible point with the least objective; of several within `TIE` the latest, where a search has ended."""
        return _best(self.history)

    @property
    def found(self) -> Evaluation | None:
        """As `best`, but only of the points that this search has asked for: other points of a record must not change
        its way.
        """
        return _best(self.asked)

    @property
    def nearest(self) -> Evaluation | None:
        """The point with the least violation."""
        return min(self.history, key=lambda p: p.worst, default=None)

    def with_bound(self, group: str, factor: float) -> "Program":
        """The same program with the bound of a designer's limit times a factor; it evaluates through this one."""

        def shift(point: Evaluation) -> Evaluation:
            limits = (point.limits + 1) * shrink - 1
            jacobian = None if point.jacobian is None else point.jacobian * shrink[:, None]
            return point._replace(limits=limits, jacobian=jacobian)

        shrink = np.where([name == group for name in self.groups], 1 / factor, 1.0)
        cheap = None if self.cheap is None else self.cheap.with_bound(group, factor)
        return self._seen_through(shift, lambda x: x, self.history, (self.names, self.lower, self.upper), cheap)

    def within(self, lower: np.ndarray, upper: np.ndarray) -> "Program":
        """The same program in a box (n,), without the variables that it fixes; it evaluates through this one."""
        free = lower < upper

        def whole(x: np.ndarray) -> np.ndarray:
            full = np.array(lower)
            full[free] = x
            return full

        def part(point: Evaluation) -> Evaluation:
            gradient = None if point.gradient is None else point.gradient[free]
            jacobian = None if point.jacobian is None else point.jacobian[:, free]
            return point._replace(x=point.x[free], gradient=gradient, jacobian=jacobian)

        hair = ROUND_OFF * lower
        inside = [p for p in self.history if np.all(p.x >= lower - hair) and np.all(p.x <= upper + hair)]
        names = [name for name, is_free in zip(self.names, free, strict=True) if is_free]
        cheap = None if self.cheap is None else self.cheap.within(lower, upper)
        return self._seen_through(part, whole, inside, (names, lower[free], upper[free]), cheap)

    def _seen_through(
        self,
        shown: Callable[[Evaluation], Evaluation],
        whole: Callable[[np.ndarray], np.ndarray],
        known: Sequence[Evaluation],
        variables: tuple[Sequence[str], np.ndarray, np.ndarray],
        cheap: "Program | None",
    ) -> "Program":
        """A program that evaluates through this one, with other limits or other `variables` (names, least and greatest
        values). `whole` converts its points to this program's, `shown` converts evaluations back.
        """
        return Program(
            lambda x, gradient: shown(self.at(whole(x), gradient)),
            *variables,
            self.limit_names,
            self.groups,
            known=[shown(point) for point in known],
            fidelity=self.fidelity,
            cheap=cheap,
            leaders=self.leaders,
            inside=self.inside,
        )

    @property
    def solves(self) -> int:
        """The number of evaluations, with and without gradients."""
        return self.evaluations + self.gradients

    def worst_violation(self, point: Evaluation) -> str:
        """The most violated limit of a point, in words."""
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


def _best(points: Sequence[Evaluation]) -> Evaluation | None:
    feasible = [p for p in points if p.feasible]
    least = min((p.objective for p in feasible), default=0.0)
    return next((p for p in reversed(feasible) if p.objective <= least + TIE * abs(least)), None)
