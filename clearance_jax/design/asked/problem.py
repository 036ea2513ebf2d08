"""The tolerance problem: the cheapest or largest clearances that keep errors and forces within bounds."""

import dataclasses
import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.patterns import expand
from clearance_jax.ask.answers import place_of
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import Candidates
from clearance_jax.design.asked.costs import AbstractCost
from clearance_jax.design.asked.manufacture import AbstractManufacture, AsDesigned
from clearance_jax.design.asked.specification import Limit, Specification
from clearance_jax.design.search.methods import Method
from clearance_jax.design.search.program import Evaluation
from clearance_jax.design.search.search import SearchOptions, continued, search
from clearance_jax.design.search.yields import YieldWarning
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.motion_laws import HeldSpline, Spline
from clearance_jax.parameters import follow, leaves, parameters
from clearance_jax.solve.settings import DYNAMICS, SolveOptions


class ToleranceProblem:
    """A tolerance design problem: clearances, their bounds, limits on the motion, and what the clearances cost.

    **Arguments:**

    - `mechanism`, `t1`: the motion, from `t0` to `t1` [s].
    - `variables`: name -> (least, greatest) value, positive, in the parameter's SI unit. A name may have a star:
      "*.radial_clearance" is that of every joint.
    - `limits`: a list of `Limit`.
    - `cost`: one cost function for all variables, or name -> cost function, names with a star too. `None`: the
      largest clearance is wanted, the same for all variables.
    - `conditions`: name of the condition -> values by parameter name (speeds, loads, friction, phases), or a list of
      such values. Every limit must hold in each condition. `None`: the mechanism as it is. A spline whose table ends
      before t1 in a condition must end at rest, and keeps its last value.
    - `manufacture`: which parts are made: a `Band`, a `Yield` or a model of your own; `None`: parts as designed.
    - `options`: `simulate`'s `t0`, `rtol`, `solver`, `start`, `max_steps`, and `fidelity`: by which model of the motion
      designs are judged: "dynamics"; "quasi-static": by poses, without swinging and impacts (fast, and no proof);
      "auto": searched by poses and judged by the dynamics, with few solves.
    - `cost_unit`: what costs are counted in, such as "EUR".

    Its `specification` holds all of this in one form.

    **Raises:** `ClearanceError` for unknown names or options, two limits of one title, numbers that are not finite or
    out of bounds, and tables of motions that begin after `t0`, or end before `t1` and not at rest.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        t1: float,
        variables: Mapping[str, tuple[float, float]],
        limits: Sequence[Limit],
        cost: AbstractCost | Mapping[str, AbstractCost] | None = None,
        conditions: Mapping[str, Mapping[str, Any]] | Sequence[Mapping[str, Any]] | None = None,
        manufacture: AbstractManufacture | None = None,
        cost_unit: str = "cost units",
        **options: Unpack[SolveOptions],
    ):
        fidelity, known = options.pop("fidelity", DYNAMICS), parameters(mechanism)
        variables = expand(variables, known)
        cost = expand(cost, known) if isinstance(cost, Mapping) else cost
        conditions = conditions or [{}]
        if not isinstance(conditions, Mapping):
            conditions = {f"condition {i + 1}": values for i, values in enumerate(conditions)}
        asked = Specification(
            mechanism,
            float(t1),
            {name: (float(low), float(high)) for name, (low, high) in variables.items()},
            tuple(limit.known(mechanism) for limit in limits),
            _costs(cost, tuple(variables)),
            {name: dict(values) for name, values in conditions.items()},
            manufacture or AsDesigned(),
            options,
            cost_unit,
            fidelity,
        )
        self.specification = with_held_ends(asked)

    def solve(
        self,
        method: str | Method = "slsqp",
        start: Mapping[str, float] | None = None,
        starts: int = 1,
        seed: int = 0,
        record: str | Path | None = None,
        most: int = 1_000_000,
        progress: Callable[[Evaluation], None] | None = None,
        cluster: Any = None,
        fidelity: str | None = None,
        classes: Candidates | None = None,
        diameters: Mapping[str, float] | None = None,
        smoothing: Sequence[float | int] = (0.0,),
    ) -> Design:
        """Search for the best design. `Design.feasible` says whether it holds every limit.

        **Arguments:**

        - `method`: one of `METHODS`, or a `Method` of your own. "auto" asks `gradient_report` at the start whether
          gradients can be trusted, and otherwise takes "cobyqa".
        - `start`: values by name; by default the geometric mean of the bounds. `starts`: how many starting points there
          are in all, the others at random between the bounds (impacts make many local optima), by `seed`.
        - `record`: a file with every evaluated point, from which an interrupted run goes on.
        - `most`: the largest number of evaluations, without those of poses; `progress`: called with each of them, also
          with those of poses.
        - `fidelity`: another one than the problem's.
        - `cluster`: a dask client, or the address of a scheduler ("local": this machine). Its workers solve the
          simulations of a design if there are several (samples, conditions, points of a band).
        - `classes`: by variable the classes that it can be made in: names of ISO 286 fits, fits with their costs, or
          `ToleranceClass`es. The answer is the cheapest combination that holds the limits, by branch and bound, with
          every clearance at the greatest of its class. `diameters`: nominal ones by variable [m], by default twice the
          joint's pin radius.
        - `smoothing`: widths [m] of smoothed normal laws (see `law.smoothed`) by which the search goes, such as (1e-6,
          1e-7, 0): each from the answer of the one before, and with up to `most` evaluations. The last one must be 0:
          the answer is that of the laws themselves. `Design.before` has the others.

        **Warns:** `YieldWarning` where the samples of a `Yield` are too few to support it.

        **Raises:** `ClearanceError` for classes that say nothing or have no cost, and for widths that do not fall to 0.
        """
        if doubt := self.specification.manufacture.doubt:
            warnings.warn(doubt, YieldWarning, stacklevel=2)
        with place_of(cluster) as place:
            specification = self.specification if fidelity is None else self.specification.judged_by(fidelity)
            how = SearchOptions(method, start, starts, seed, record, most, progress, place, classes, diameters)
            widths = tuple(map(float, smoothing))
            return search(specification, how) if widths == (0.0,) else continued(specification, widths, how)


def _costs(cost, names) -> tuple[Callable, ...]:
    if cost is None:
        return ()
    if not isinstance(cost, Mapping):
        return (cost,) * len(names)
    for name in names:
        if name not in cost:
            raise ClearanceError(f"There is no cost for `{name}`. Give one for every variable.")
    return tuple(cost[name] for name in names)


# A table of n intervals ends at rest if its speed at the end, over its largest one, is at most REST + ROUGH / n^3, and
# at most MOST. The cubics through the rows of a motion that does end at rest (a quintic) end at about 30 / n^3.
REST, ROUGH, MOST = 0.01, 50.0, 0.25
# A change of a coordinate that is no motion, relative to its size or to 1 rad or 1 m.
STILL = 1e-9


def with_held_ends(specification: Specification) -> Specification:
    """The problem with a `HeldSpline`, which keeps its last value, for each `Spline` whose table ends before the motion
    in a condition: a `Spline` would continue with its last cubic. **Raises** `ClearanceError` if a table begins after
    the motion, or ends before it and not at rest.
    """
    t0, t1, mechanism = specification.t0, specification.t1, specification.mechanism
    tables = (leaf for leaf in leaves(mechanism) if leaf.path[-1] == "times" and isinstance(leaf.owners[-1], Spline))
    # The prefix of the names of a spline's numbers ("drive.crank."), and the path to it.
    courses = {leaf.name.removesuffix("times"): leaf.path[:-1] for leaf in tables}
    moved = {n: specification.move(specification.mechanism, values) for n, values in specification.conditions.items()}
    speeds: dict[str, dict[str, float]] = {}
    for begin, path in courses.items():
        ends = {}
        for name, condition in moved.items():
            try:
                ends[name] = _end_speed(follow(condition, path), begin[:-1], t0, t1)
            except ClearanceError as error:
                raise error.at(f"In `{name}`") from None
        if any(rests for _, rests in ends.values()):
            speeds[begin] = {name: speed for name, (speed, _) in ends.items()}
    if not speeds:
        return specification
    for begin, by_condition in speeds.items():
        any_speed = next(iter(by_condition.values()))  # every condition sets its own
        spline = HeldSpline(follow(mechanism, courses[begin]), any_speed)
        mechanism = eqx.tree_at(functools.partial(follow, path=courses[begin]), mechanism, spline)
    conditions = {
        name: {**values, **{f"{begin}end_speed": by_condition[name] for begin, by_condition in speeds.items()}}
        for name, values in specification.conditions.items()
    }
    return dataclasses.replace(specification, mechanism=mechanism, conditions=conditions)


def _end_speed(spline: Spline, name: str, t0: float, t1: float) -> tuple[float, bool]:
    """The speed at the end of a table, and whether the spline must rest there as the motion goes further."""
    times, values = np.asarray(spline.times), np.asarray(spline.values)
    hair = 1e-9 * (times[-1] - times[0])
    if t0 < times[0] - hair:
        raise ClearanceError(
            f"the table of `{name}` begins at {times[0]:.6g} s, after the motion, which begins at t0 = {t0:.6g} s. Let "
            "the table begin there, or the motion later."
        ).about(name, float(times[0]))
    law = spline.prepare()
    end = float(law(jnp.asarray(times[-1]))[1])
    if t1 <= times[-1] + hair:
        return end, False
    if np.ptp(values) > STILL * max(1.0, float(np.max(np.abs(values)))):
        largest = float(jnp.max(jnp.abs(jax.vmap(law)(jnp.asarray(times))[1])))
        largest = max(largest, float(np.max(np.abs(np.diff(values) / np.diff(times)))))
        if abs(end) > min(REST + ROUGH / (len(times) - 1) ** 3, MOST) * largest:
            raise ClearanceError(
                f"the table of `{name}` ends at {times[-1]:.6g} s, before t1 = {t1:.6g} s, and not at rest: its speed "
                f"there is {abs(end) / largest:.0%} of its largest. Let the motion end there (`t1`), or give a table "
                "that goes on until t1 or comes to rest (rows that repeat the last value)."
            ).about(name, float(times[-1]))
    return 0.0, True
