"""The result of a tolerance problem: the design, its limits, its verification."""

import dataclasses
from typing import Any

import numpy as np

from clearance_jax.ask.answers import place_of
from clearance_jax.design.asked.classes import ChosenClasses, least_ends
from clearance_jax.design.asked.specification import Specification
from clearance_jax.design.judge.verify import Certificate, certify, judge_of, moved_inside
from clearance_jax.design.search.evaluate import fresh_yield
from clearance_jax.design.search.methods import Method
from clearance_jax.design.search.program import Evaluation, Program
from clearance_jax.design.search.yields import YieldEstimate
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import DYNAMICS, QUASI_STATIC
from clearance_jax.units import format_quantity


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Design:
    """The result of a design problem. It prints itself.

    - `specification`: what was asked; `program`: every point that was evaluated; `method`: the optimiser.
    - `evaluation`: the best point; `stop_reason`: why the search stopped early, or empty; `note`: on the choice of the
      method, or empty.
    - `before`: where the search went by smoothed laws first, their widths [m] and designs.
    - `classes`: the classes of the clearances, whose greatest ones `evaluation` has; `None`: none were asked for.
    """

    specification: Specification
    program: Program
    method: Method
    evaluation: Evaluation
    stop_reason: str
    note: str
    classes: ChosenClasses | None = None
    before: tuple[tuple[float, "Design"], ...] = ()

    @property
    def clearances(self) -> dict[str, float]:
        """The variables by name."""
        return self.specification.clearances(self.evaluation.x)

    @property
    def units(self) -> dict[str, str]:
        """The variables' units by name."""
        return self.specification.units

    @property
    def objective(self) -> float:
        """The cost, or minus the common clearance."""
        return self.evaluation.objective

    @property
    def feasible(self) -> bool:
        """Whether every limit holds, and classes were chosen if they were asked for."""
        return not self.lack

    @property
    def lack(self) -> str:
        """Why the design is not feasible, in words; empty if it is."""
        if not self.evaluation.feasible:
            return self.program.worst_violation(self.evaluation)
        return "no classes were chosen" if self.classes is not None and not self.classes.chosen else ""

    @property
    def active(self) -> list[str]:
        """The active limits: those at their bounds within the slack of the method."""
        pairs = zip(self.program.limit_names, self.evaluation.limits, strict=True)
        return [name for name, limit in pairs if limit > -self.method.slack]

    @property
    def deciders(self) -> tuple[str, ...]:
        """Sentences on what decides the design: active limits, or the bounds of the variables."""
        feasible = self.evaluation.feasible
        if self.active or not feasible or self.classes is not None:
            return tuple(f"{'decided by' if feasible else 'not held'}: {name}" for name in self.active)
        at = np.isclose(self.evaluation.x, self.program.lower) | np.isclose(self.evaluation.x, self.program.upper)
        who = "the bounds of the variables do" if np.any(at) else "the solver stopped short of one"
        return (f"no limit decides: {who}",)

    @property
    def counts(self) -> str:
        """The number of evaluations by each model of the motion, in words."""
        cheap = self.program.cheap
        by = "" if cheap is None and self.program.fidelity == DYNAMICS else f" by {self.program.fidelity}"
        return _counted(self.program) + by + ("" if cheap is None else f"; {_counted(cheap)} by {cheap.fidelity} poses")

    def yield_estimate(self, samples: int = 10_000, seed: int = 12345, cluster: Any = None) -> YieldEstimate:
        """The yield on fresh samples, of a problem with `manufacture=Yield(...)`; `cluster` as
        `ToleranceProblem.solve`'s.
        """
        with place_of(cluster) as place:
            return fresh_yield(self.specification, self.evaluation.x, samples, seed, place)

    def verify(self, cluster: Any = None, **options: Any) -> Certificate:
        """A certificate by another solver and a tenfold tighter tolerance; `cluster` as `ToleranceProblem.solve`'s,
        `options` as `design.judge.verify.certify`'s.

        **Raises:** `ClearanceError` where the design is not feasible.
        """
        with place_of(cluster) as place:
            return self._certificate(place, **options)

    def certified(self, cluster: Any = None, **options: Any) -> tuple["Design", Certificate]:
        """The design and its certificate. A design whose limits exceed their bounds in the fresh simulation by no more
        than two solves differ is first moved inside, until they hold there too; its note then says by how much. A
        design that is judged among neighbours is moved whatever they are exceeded by.

        Arguments, and what it raises, as of `verify`. A design of chosen classes, or by quasi-static poses, stays.
        """
        asked = self.specification
        fixed = self.classes is not None or asked.fidelity == QUASI_STATIC
        with place_of(cluster) as place:
            if fixed or not self.feasible:
                return self, self._certificate(place, **options)
            fresh = judge_of(asked, options.get("solver"), place, options.get("progress"))
            point, tightened = moved_inside(self.program, self.method, self.evaluation, fresh, asked.manufacture.among)
            parts = ", ".join(f"{name} by {part:.1e} of its bound" for name, part in tightened.items())
            moved = f"moved inside, as another solver judges: {parts}" * bool(parts)
            # A limit that was tightened still counts as active.
            method = self.method._replace(slack=self.method.slack + max(tightened.values(), default=0.0))
            design = self.with_note(moved, evaluation=point, method=method)
            return design, design._certificate(place, fresh=fresh, **options)

    def _certificate(self, place: Any, **options: Any) -> Certificate:
        if not self.feasible:
            raise ClearanceError(f"There is no feasible design to verify: {self.lack}.")
        if self.classes is not None and (options.get("starts") or options.get("reoptimise")):
            raise ClearanceError("Of chosen classes neither other starts nor prices are looked for: leave these out.")
        asked = self.specification, self.method, self.evaluation
        if self.classes is None:
            return certify(*asked, place=place, **options)
        least = least_ends(self.program.names, self.evaluation.x, self.classes.chosen)
        certificate = certify(*asked, least=least, place=place, **options)
        return dataclasses.replace(certificate, optimality=self.classes.optimality)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with the designed clearances."""
        return replace(self.specification.mechanism, self.clearances)

    def __str__(self) -> str:
        chosen = {} if self.classes is None else self.classes.chosen
        lines = [
            "Design" if self.feasible else f"NO FEASIBLE DESIGN: {self.lack}",
            *(
                f"  {name} = {format_quantity(value, unit)}" + (f" ({chosen[name]})" if name in chosen else "")
                for (name, unit), value in zip(self.units.items(), self.clearances.values(), strict=True)
            ),
        ]
        if not self.specification.common:
            lines.append(f"  cost {self.objective:.6g} {self.specification.cost_unit}")
        lines += [f"  {text}" for text in self.deciders]
        lines.append(f"  {self.method.name}: {self.counts}")
        lines += [f"  before, with laws smoothed over {width:g} m: {design.counts}" for width, design in self.before]
        if self.classes is not None:
            lines += [f"  {text}" for text in self.classes.sentences]
        lines += [f"  {text}" for text in (self.stop_reason, self.note) if text]
        return "\n".join(lines)

    def with_note(self, note: str, **changes: Any) -> "Design":
        """The design with a further note, unless that is empty, and other changed fields."""
        return dataclasses.replace(self, note="; ".join(text for text in (self.note, note) if text), **changes)


def _counted(program: Program) -> str:
    return f"{program.gradients} evaluations with gradients, {program.evaluations} without"
