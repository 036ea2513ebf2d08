"""The certificate of a design: the results of its verification, in numbers and sentences."""

import dataclasses

import numpy as np

from clearance_jax.design.search.yields import YieldEstimate
from clearance_jax.units import format_quantity

# A limit holds in a fresh simulation if it is violated by at most this share of its bound.
HELD = 1e-6


@dataclasses.dataclass(frozen=True)
class Certificate:
    """The results of the verification of a design. It prints itself in sentences.

    - `names`: the variables, with their units; `x` (n,): their values; `objective`: the cost, or minus the common
      clearance.
    - `worst`: the most violated scaled limit (value over bound, minus 1) in a fresh simulation, by another `solver`
      with a tenth of the `rtol`; `limit`: its name.
    - `scale`: the common factor on all clearances at which a limit is just met, by bisection with that solver (1: the
      design itself; NaN: a bound of a variable is met first).
    - `islands`: intervals of this factor in which the limits hold.
    - `residual`: that of the Karush-Kuhn-Tucker conditions, relative to the gradient of the objective, in logarithms;
      `prices`: for each active limit, the relative change of the objective per relative change of its bound.
    - `price_checks`: name -> (price, price by solving again with the bound 1 % up and down), if asked for.
    - `among`: among which parts each limit is judged at once, in words; then there is no scale and no residual.
    - `optimality`: for chosen classes a statement instead of the residual; `least`: the most violated scaled limit with
      every clearance at the least of its class; `target`: the yield that was asked for.
    - `yield_estimate`: of a `Yield`, on fresh samples; `static`: for each limit on a point's error, how far play alone
      can move the point of the mechanism at rest [m].
    - `starts`: the objectives that other starts led to; `goal`: what a looser bound does, in words.
    """

    names: dict[str, str]
    x: np.ndarray
    worst: float
    limit: str
    scale: float
    islands: tuple[tuple[float, float], ...]
    residual: float
    prices: dict[str, float]
    price_checks: dict[str, tuple[float, float]]
    starts: tuple[float, ...]
    objective: float
    goal: str
    yield_estimate: YieldEstimate | None
    static: dict[str, float]
    solver: str
    rtol: float
    among: str = ""
    optimality: str = ""
    least: float | None = None
    target: float | None = None

    @property
    def holds(self) -> bool:
        """Whether the limits hold in the fresh simulation, to a millionth of their bounds; with chosen classes at both
        ends of these.
        """
        return self.worst <= HELD and (self.least is None or self.least <= HELD)

    @property
    def yields(self) -> bool:
        """Whether the share of fresh samples that hold all limits is at least the target."""
        return self.yield_estimate is None or self.target is None or self.yield_estimate.share >= self.target

    def __str__(self) -> str:
        pairs = zip(self.names.items(), self.x, strict=True)
        at = ", ".join(f"{name} = {format_quantity(value, unit)}" for (name, unit), value in pairs)
        greatest, not_held = self.worst <= HELD, "THE LIMITS DO NOT HOLD"
        met = f"meet it at {self.scale:.9f} times the design"
        if np.isnan(self.scale):
            met = "meet no limit within their bounds" if greatest else "hold at no size within their bounds"
        lines = [
            f"Certificate for {at}",
            f"  {'The limits hold' if greatest else not_held} in a fresh simulation ({self.solver}, rtol "
            f"{self.rtol:.0e}): the closest is {self.limit}, at {1 + self.worst:.9f} of its bound.",
        ]
        if self.least is not None:
            verdict, least = "the limits hold" if self.least <= HELD else not_held, f"{1 + self.least:.9f} of the bound"
            lines.append(f"  With every clearance at the least of its class {verdict}: {least}.")
        if not self.among:
            lines.append(f"  Scaled together, the clearances {met}.")
        spans = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in self.islands) or "none"
        alone = "in one piece" if len(self.islands) == 1 else f"in {len(self.islands)} ISLANDS"
        lines.append(f"  Along that line designs hold {alone}: {spans} times the design.")
        optimal = f"(Karush-Kuhn-Tucker) residual {self.residual:.1e}"
        if self.among or np.isnan(self.residual):
            optimal = f"is not known, as {'slopes say nothing' if self.among else 'no slope was asked for'}"
        lines.append(f"  {self.optimality or f'Optimality {optimal}'}.")
        for name, price in self.prices.items():
            again = f" (re-optimised: {self.price_checks[name][1]:.4g} %)" if name in self.price_checks else ""
            lines.append(f"  A bound 1 % looser on {name} {self.goal} by {price:.4g} %{again}.")
        if self.yield_estimate is not None:
            lines.append(f"  {self.yield_estimate} {self.yield_estimate.against(self.target)}".rstrip())
        for name, value in self.static.items():
            lines.append(
                f"  Limit on {name}: at rest, play alone causes an error of at most {format_quantity(value, 'm', 4)}. "
                "A larger error comes from motion or forces."
            )
        if self.starts:
            others = [s for s in self.starts if s < self.objective - 1e-4 * abs(self.objective)]
            better = (
                f"{len(others)} LED TO A BETTER DESIGN, {min(others):.6g}" if others else "none led to a better one"
            )
            lines.append(f"  {len(self.starts)} other starts: {better}.")
        return "\n".join(lines)
