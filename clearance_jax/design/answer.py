"""A solver's answer to a tolerance problem, as a designer reads it."""

import dataclasses
from typing import Any

import numpy as np

from clearance_jax.design.evaluate import fresh_yield
from clearance_jax.design.made import Yielded
from clearance_jax.design.methods import Method
from clearance_jax.design.program import Point, Program
from clearance_jax.design.specification import Specification
from clearance_jax.design.verify import Certificate, certify
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism, replace
from clearance_jax.units import shown


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design:
    """A solver's answer: `clearances` by name, `objective`, whether it is `feasible`; prints as a designer reads it.

    It has what was asked (`specification`), the `program` with every evaluated point, the `method`, the best `point`,
    why the solver `stopped` early, and a `note` on the choice of the method (both may be empty).
    """

    specification: Specification
    program: Program
    method: Method
    point: Point
    stopped: str
    note: str

    @property
    def clearances(self) -> dict[str, float]:
        """The variables by name."""
        return self.specification.clearances(self.point.x)

    @property
    def units(self) -> dict[str, str]:
        """The variables' units by name."""
        return self.specification.units

    @property
    def objective(self) -> float:
        """The cost, or minus the common clearance."""
        return self.point.objective

    @property
    def feasible(self) -> bool:
        """Whether every limit is held."""
        return self.point.feasible

    @property
    def active(self) -> list[str]:
        """The limits that decide: those met to a thousandth."""
        return [n for n, g in zip(self.program.limit_names, self.point.limits, strict=True) if g > -1e-3]

    def yielded(self, samples: int = 10_000, seed: int = 12345) -> Yielded:
        """The yield on fresh samples, of a problem with `made=Yield(...)`."""
        return fresh_yield(self.specification, self.point.x, samples, seed)

    def verify(self, **options: Any) -> Certificate:
        """A certificate by another solver and a tenfold tighter tolerance; `options` as `design.verify.certify`'s.

        **Raises:** `ClearanceError` where the design is not feasible.
        """
        if not self.feasible:
            raise ClearanceError(f"There is no feasible design to verify: {self.program.most_violated(self.point)}.")
        return certify(self.specification, self.method, self.point, **options)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with the designed clearances."""
        return replace(self.specification.mechanism, self.clearances)

    def __str__(self) -> str:
        lines = [
            "Design" if self.feasible else f"NO FEASIBLE DESIGN: {self.program.most_violated(self.point)}",
            *(
                f"  {name} = {shown(value, unit)}"
                for (name, unit), value in zip(self.units.items(), self.clearances.values(), strict=True)
            ),
        ]
        if not self.specification.common:
            lines.append(f"  cost {self.objective:.6g}")
        lines += [f"  decided by: {name}" for name in self.active]
        if self.feasible and not self.active:
            at = np.isclose(self.point.x, self.program.lower) | np.isclose(self.point.x, self.program.upper)
            who = "the bounds of the variables do" if np.any(at) else "the solver stopped short of one"
            lines.append(f"  no limit decides: {who}")
        counts = f"{self.program.gradients} evaluations with gradients, {self.program.evaluations} without"
        lines.append(f"  {self.method.name}: {counts}")
        lines += [f"  {text}" for text in (self.stopped, self.note) if text]
        return "\n".join(lines)
