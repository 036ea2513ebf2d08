"""The search for the cheapest tolerance classes that hold every limit, from the continuous design.

It is branch and bound (Land and Doig 1960) for the cheapest point whose variables take values of lists. A node is a
box: a range of neighbouring values of every listed variable. Its relaxation is the continuous problem in this box,
whose optimum is a lower bound of the cost of every combination in the box. The node with the least bound is split next,
where a variable lies between two values. The optima are local ones, so bounds are as good as the method that finds
them.
"""

import dataclasses
import functools
import heapq
import itertools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import ChosenClasses, ToleranceClass, least_ends
from clearance_jax.design.search.evaluate import most_violated
from clearance_jax.design.search.program import SLACK, BudgetSpent, Evaluation, Program
from clearance_jax.design.search.run import INTERRUPTED, SPENT, run

# A node is not split where it can save no more than this part of the cost.
GAP = 1e-6
# The largest number of combinations of a node whose costs are summed one by one.
MOST_SUMS = 1_000_000
# Relative tolerance of a value of a list.
MET = 1e-6


class Node(NamedTuple):
    """A box: the places `low` to `high` in the list of each variable; `start` (n,): where its search begins;
    `tighter`: whether the smaller values were split off.
    """

    low: tuple[int, ...]
    high: tuple[int, ...]
    start: np.ndarray
    tighter: bool = False


class BoundedOptimum(NamedTuple):
    """The result of a search: the `best` feasible point of the lists (`None`: none was found), a lower `bound` of its
    cost, and the optimum `relaxed` of the continuous problem between the ends of the lists; how many relaxations
    (`nodes`) were solved; why the search stopped early (`stop_reason`, or empty), and why relaxations did (`doubts`).
    """

    best: Evaluation | None
    bound: float
    relaxed: Evaluation | None
    nodes: int
    stop_reason: str
    doubts: tuple[str, ...]


class BranchAndBound:
    """The search for the cheapest point of a `program` with values of lists.

    **Arguments:** `lists`: increasing values by the index of the variable, within the program's bounds; `relax`: a
    search of a program from a start, which returns why it stopped early; `holds`: whether a point (n,) of the lists
    that is feasible in the program meets all other conditions; `costs`: the costs of the values by index, if every
    variable has a list and the objective is their sum: a node then costs at least the least sum above its bound;
    `gradients`: whether slopes may be used; `resolution`: relative accuracy of the optima of relaxations.
    """

    def __init__(
        self,
        program: Program,
        lists: Mapping[int, np.ndarray],
        relax: Callable[[Program, np.ndarray], str],
        holds: Callable[[np.ndarray], bool] = lambda x: True,
        costs: Mapping[int, np.ndarray] | None = None,
        gradients: bool = True,
        resolution: float = GAP,
    ):
        self._gradients, self._resolution = gradients, resolution
        self.program, self._relax, self._holds = program, relax, holds
        self._places, self._lists = tuple(lists), tuple(np.asarray(values, float) for values in lists.values())
        self._costs = None if costs is None else tuple(np.asarray(costs[i], float) for i in lists)
        self.best: Evaluation | None = None
        self._nodes, self._doubts, self._refused = 0, [], set[bytes]()

    def search(self, start: np.ndarray) -> BoundedOptimum:
        """Search from a point (n,). An interrupted search returns its result so far."""
        sizes = tuple(len(values) - 1 for values in self._lists)
        order, relaxed, stop_reason, least = itertools.count(), None, "", -np.inf
        heap = [(least, next(order), Node((0,) * len(sizes), sizes, np.asarray(start, float)))]
        try:
            while heap and not self._cut(heap[0][0]):
                least, _, node = heap[0]
                optimum, ahead = self._look(node)
                heapq.heappop(heap)
                relaxed = optimum if self._nodes == 1 else relaxed
                reached = -np.inf if optimum is None else optimum.objective - self._resolution * abs(optimum.objective)
                if ahead is None or self._cut(reached):
                    continue
                for child in self._split(node, ahead):
                    bound = self._raised(child, max(least, reached))
                    if bound < np.inf:
                        heapq.heappush(heap, (bound, next(order), child))
        except KeyboardInterrupt:
            stop_reason = INTERRUPTED
        except BudgetSpent:
            stop_reason = SPENT
        bound = min(heap[0][0] if heap else np.inf, np.inf if self.best is None else self.best.objective)
        return BoundedOptimum(self.best, bound, relaxed, self._nodes, stop_reason, tuple(dict.fromkeys(self._doubts)))

    def _cut(self, bound: float) -> bool:
        """Whether a node with this bound cannot improve on the best point."""
        return self.best is not None and bound >= self.best.objective - GAP * abs(self.best.objective)

    def _raised(self, node: Node, bound: float) -> float:
        """A higher lower bound of the cost of a node: the least of the costs of its combinations that reach `bound`;
        infinite if none reaches it.
        """
        sizes = [high - low + 1 for low, high in zip(node.low, node.high, strict=True)]
        if self._costs is None or np.prod(sizes, dtype=float) > MOST_SUMS:
            return bound
        parts = [c[low : high + 1] for c, low, high in zip(self._costs, node.low, node.high, strict=True)]
        sums = functools.reduce(np.add.outer, parts)
        # Round-off differs from the objective's.
        return float(np.min(sums[sums >= bound - GAP * abs(bound)], initial=np.inf))

    def _look(self, node: Node) -> tuple[Evaluation | None, np.ndarray | None]:
        """Solve the relaxation of a node, and try the combination of the values just below its optimum.

        Returns the optimum (`None`: not found), and the point at which the node is to be split (`None`: not at all).
        """
        self._nodes += 1
        lower, upper = self.program.lower.copy(), self.program.upper.copy()
        for i, values, low, high in zip(self._places, self._lists, node.low, node.high, strict=True):
            lower[i], upper[i] = values[low], values[high]
        if node.tighter and self._hopeless(lower, upper):
            return None, None
        optimum = self._optimum(lower, upper, np.clip(node.start, lower, upper))
        ahead = None if optimum is None else optimum.x
        if optimum is None:
            self.program.at(lower)
            feasible = [point for point in self._known(lower, upper) if point.feasible]
            if feasible:
                self._doubts.append("found nothing in a box, in which a point holds")
                ahead = min(feasible, key=lambda point: point.objective).x
        if ahead is not None:
            below = ahead.copy()
            for k, i in enumerate(self._places):
                below[i] = self._lists[k][self._place(node, k, below[i])]
            self._try(below)
        return optimum, ahead

    def _hopeless(self, lower: np.ndarray, upper: np.ndarray) -> bool:
        """Whether the smallest values violate a limit with positive slopes, of which no known point has less."""
        if not self._gradients:
            return False
        point = self.program.at(lower, True)
        if point.feasible or not np.isfinite(point.worst) or point.jacobian is None:
            return False
        k = int(np.argmax(point.limits))
        least = point.limits[k] - SLACK
        return bool(np.all(point.jacobian[k] >= 0)) and all(p.limits[k] >= least for p in self._known(lower, upper))

    def _known(self, lower: np.ndarray, upper: np.ndarray) -> list[Evaluation]:
        """The evaluated points in a box."""
        return [p for p in self.program.history if np.all(p.x >= lower) and np.all(p.x <= upper)]

    def _optimum(self, lower: np.ndarray, upper: np.ndarray, start: np.ndarray) -> Evaluation | None:
        free = lower < upper
        if not np.any(free):
            point = self.program.at(lower)
            return point if point.feasible else None
        box = self.program.within(lower, upper)
        stop_reason = self._relax(box, start[free])
        if stop_reason == INTERRUPTED:
            raise KeyboardInterrupt
        if stop_reason == SPENT:
            raise BudgetSpent
        # A search may fail for the very reason that nothing in its box holds.
        if stop_reason and not self._hopeless(lower, upper):
            self._doubts.append(stop_reason)
        # A search that stopped early has an optimum only if it reached a feasible point itself: others are from before.
        if box.best is None or (stop_reason and not any(point.feasible for point in box.asked)):
            return None
        x = lower.copy()
        x[free] = box.best.x
        return self.program.at(x)

    def _place(self, node: Node, k: int, value: float) -> int:
        """The place in list `k` of the greatest value that is not above `value`, within the node."""
        place = int(np.searchsorted(self._lists[k], value * (1 + MET), side="right")) - 1
        return min(max(place, node.low[k]), node.high[k])

    def _try(self, x: np.ndarray) -> None:
        point = self.program.at(x)
        if not point.feasible or self._cut(point.objective) or x.tobytes() in self._refused:
            return
        if self._holds(x):
            self.best = point
        else:
            self._refused.add(x.tobytes())

    def _split(self, node: Node, x: np.ndarray) -> list[Node]:
        """Split a node in two, at the variable that lies farthest from the values of its list, or at one of these."""
        apart = []
        for k, i in enumerate(self._places):
            place, values = self._place(node, k, x[i]), self._lists[k]
            if node.low[k] == node.high[k]:
                apart.append((-1.0, k, place))
                continue
            place = min(place, node.high[k] - 1)
            low, high = values[place], values[place + 1]
            share = np.clip(np.log(x[i] / low) / np.log(high / low), 0.0, 1.0)
            apart.append((min(share, 1 - share), k, place))
        far, k, place = max(apart)
        if far < 0:
            return []
        high, low = list(node.high), list(node.low)
        high[k], low[k] = place, place + 1
        return [Node(node.low, tuple(high), x), Node(tuple(low), node.high, x, tighter=True)]


def choose_classes(
    design: Design, classes: Mapping[str, tuple[ToleranceClass, ...]], place: Any, **options: Any
) -> Design:
    """The cheapest combination of `classes` that holds every limit, by branch and bound from a continuous design. A
    combination holds if the limits of the problem hold with every clearance at the greatest of its class, and those of
    parts as designed hold with every clearance at its least. `classes`: by variable, the tightest first; `options`: of
    the design's method.
    """
    program, places = design.program, {name: i for i, name in enumerate(design.program.names)}
    lists = {places[name]: np.array([entry.greatest for entry in listed]) for name, listed in classes.items()}
    before = program.solves
    # A combination must also hold with every clearance at the least of its class.
    violated, tried = most_violated(design.specification.as_designed(), program.gradients > 0, place), 0

    def relax(box: Program, start: np.ndarray) -> str:
        return run(box, design.method, start, **options)

    def holds(x: np.ndarray) -> bool:
        nonlocal tried
        tried += 1
        return violated(least_ends(program.names, x, _names(program, classes, x))) <= SLACK

    costs, laws = None, design.specification.costs
    if len(lists) == len(program.names):
        costs = {i: np.array([float(laws[i](value)) for value in values]) for i, values in lists.items()}
    # Without a tolerance the resolution is that to which the method meets limits.
    how = {"gradients": design.method.gradients, "resolution": options.get("tolerance", design.method.slack)}
    outcome = BranchAndBound(program, lists, relax, holds, costs, **how).search(design.evaluation.x)
    chosen = {} if outcome.best is None else _names(program, classes, outcome.best.x)
    result = ChosenClasses(
        chosen,
        np.nan if outcome.best is None else outcome.best.objective,
        outcome.bound,
        np.nan if outcome.relaxed is None else outcome.relaxed.objective,
        outcome.nodes,
        program.solves - before + tried,
        int(np.prod([len(listed) for listed in classes.values()])),
        outcome.doubts,
    )
    return _design(design, result, outcome, lists)


def _names(program: Program, classes: Mapping[str, tuple[ToleranceClass, ...]], x: np.ndarray):
    sizes = dict(zip(program.names, x, strict=True))
    return {n: min(listed, key=lambda entry: abs(entry.greatest - sizes[n])) for n, listed in classes.items()}


def _design(design: Design, result: ChosenClasses, outcome: BoundedOptimum, lists: Mapping[int, np.ndarray]) -> Design:
    """The design with the chosen classes; if no combination holds, the tightest one with a note."""
    stopped = {"stop_reason": design.stop_reason or outcome.stop_reason, "classes": result}
    if outcome.best is not None:
        return dataclasses.replace(design, evaluation=outcome.best, **stopped)
    if outcome.stop_reason:
        return without_classes(design, result, outcome.stop_reason)
    x = design.evaluation.x.copy()
    for i, values in lists.items():
        x[i] = values[0]
    tightest = design.program.at(x, design.method.gradients)
    return design.with_note(_refusal(design, tightest, lists, outcome.doubts), evaluation=tightest, **stopped)


def without_classes(design: Design, result: ChosenClasses, stop_reason: str) -> Design:
    """The continuous design, if the search was stopped before it had found a feasible combination."""
    note = "stopped before any class was chosen: the clearances are those of a continuous design"
    return design.with_note(note, stop_reason=design.stop_reason or stop_reason, classes=result)


def _refusal(design: Design, tightest: Evaluation, lists: Mapping[int, np.ndarray], doubts: tuple[str, ...]) -> str:
    """A note on why no combination of classes holds, and what would help."""
    program, cost = design.program, f"{design.objective:.6g} {design.specification.cost_unit}"
    none = "no combination of the classes holds every limit"
    if doubts:
        none = "no combination of the classes was found that holds every limit (searches failed, so there may be one)"
    if tightest.feasible:
        return (
            f"{none}. With all clearances at their least the tightest ones do not hold. Choose classes with larger "
            "least clearances, or add some"
        )
    worst = program.worst_violation(tightest)
    text = f"{none}: with the tightest of each, {worst}. Without classes the design costs {cost}. "
    if tightest.jacobian is None or not np.isfinite(tightest.worst):
        return text + "Add tighter classes, or loosen the bound"
    slopes = tightest.jacobian[int(np.argmax(tightest.limits))] * tightest.x
    name = program.names[max(lists, key=lambda i: slopes[i])]
    return text + f"A tighter class of `{name}` helps most, or a looser bound"
