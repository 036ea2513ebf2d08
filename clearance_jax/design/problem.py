"""The question a designer asks: which clearances, so that errors and forces stay within bounds, at the least cost."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from clearance_jax.ask.place import place_of
from clearance_jax.design.answer import Design
from clearance_jax.design.costs import AbstractCost
from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.manufacture import AbstractManufacture, AsDesigned
from clearance_jax.design.methods import Method
from clearance_jax.design.search import search
from clearance_jax.design.specification import Limit, Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.settings import SolveOptions


class ToleranceProblem:
    """Clearances by name, bounds on them, limits on the motion, and what clearances cost.

    **Arguments:**

    - `mechanism`, `t1`: the motion, from `t0` to `t1` [s].
    - `variables`: name -> (least, greatest), positive, in the parameter's unit.
    - `limits`: `Limit`s.
    - `cost`: one cost function for all variables, or name -> cost function; `None`: the largest clearance is wanted,
      common to all variables where there are several.
    - `conditions`: name of the condition -> values by parameter name (speeds, loads, friction, phases), or a sequence
      of such values; every limit must hold in each. None: the mechanism as it is.
    - `manufacture`: how parts come out of manufacture, a `Band`, a `Yield` or a model of your own; None: as designed.
    - `options`: `simulate`'s `t0`, `rtol`, `solver`, `start`, `max_steps`.
    - `cost_unit`: what costs are counted in, such as "EUR".

    All of it in one form is its `specification`.

    **Raises:** `ClearanceError` for unknown names or options, limits of one title, numbers that are not finite or out
    of bounds.
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
        self.specification = Specification(
            mechanism,
            float(t1),
            {name: (float(low), float(high)) for name, (low, high) in variables.items()},
            tuple(limits),
            _costs(cost, tuple(variables)),
            _conditions(conditions),
            manufacture or AsDesigned(),
            options,
            cost_unit,
        )

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
    ) -> Design:
        """The best design found, which holds its limits in a simulation of its own (see `Design.feasible`).

        **Arguments:**

        - `method`: one of `METHODS`, or a `Method` of your own; "auto" asks `gradient_report` at the start whether
          gradients are worth having, and else takes "cobyqa".
        - `start`: values by name (default: the geometric middle of the bounds); `starts`: so many in all, the others at
          random between the bounds (impacts make many local optima), by `seed`.
        - `record`: a file with every evaluated point, from which an interrupted run goes on.
        - `most` evaluations; `progress`: called with each.
        - `cluster`: a dask client, or the address of a scheduler ("local": this machine), on whose workers a design's
          simulations are solved where there are several (samples, conditions, points of a band), as lanes of a sweep.
        """
        with place_of(cluster) as place:
            return search(self.specification, method, start, starts, seed, record, most, progress, place)


def _costs(cost, names) -> tuple[Callable, ...]:
    if cost is None:
        return ()
    if not isinstance(cost, Mapping):
        return (cost,) * len(names)
    missing = [name for name in names if name not in cost]
    if missing:
        raise ClearanceError(f"There is no cost for `{missing[0]}`. Give one for every variable.")
    return tuple(cost[name] for name in names)


def _conditions(conditions) -> dict[str, dict[str, Any]]:
    conditions = conditions or [{}]
    if not isinstance(conditions, Mapping):
        conditions = {f"condition {i + 1}": values for i, values in enumerate(conditions)}
    return {name: dict(values) for name, values in conditions.items()}
