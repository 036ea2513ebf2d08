"""What a case is: a scene solved at three tolerances, its errors, and the bounds that it has to keep."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

import clearance_jax as cj
from clearance_jax.solve.codes import Result

RTOLS = (1e-6, 1e-8, 1e-10)
STANDARD, MULTIPLE = 3000.0, 10.0
"""The error may be so many rtol; in a scene that amplifies, so many times its amplification."""
CHAOTIC = 1e7
"""A scene that amplifies a change by more than this has no states that mean anything at rtol 1e-8."""
FLOOR = 1e-12
"""Errors and residuals below this are round-off: they need not fall with the tolerance."""
ENERGY = 10.0
"""The residual of the energy balance may be so many rtol."""


class Row(NamedTuple):
    """One case at its tolerances.

    - `steps`: at the middle tolerance; `errors`: at each; `energy`: the residual at the tightest.
    - `broken`: which bounds it breaks, in words; `seconds`: of the processor, with compiling.
    """

    case: str
    states: int
    steps: int
    rtols: tuple[float, ...]
    errors: tuple[float, ...]
    energy: float
    result: str
    broken: tuple[str, ...]
    remark: str
    chaotic: bool = False
    seconds: float = 0.0

    @property
    def falls(self) -> bool:
        """Whether the error falls with the tolerance, down to round-off."""
        pairs = zip(self.errors[:-1], self.errors[1:], strict=True)
        return all(b <= 0.5 * a or b <= FLOOR for a, b in pairs)


class Solved(NamedTuple):
    """One solve (or batch) and its error."""

    solution: cj.Solution
    error: float


def options(rtol: float) -> dict[str, Any]:
    """How a case is solved at a tolerance: the solver that the library advises for it."""
    return {"rtol": rtol, "solver": "tsit5" if rtol >= 1e-8 else "dopri8", "max_steps": 50_000_000, "throw": False}


def count_states(mechanism: cj.Mechanism) -> int:
    return 2 * len(mechanism.free_coordinates())


def ending(solution: cj.Solution) -> str:
    """How a solve ended, in a word of its result code; of a batch the worst lane."""
    if not np.all(np.isfinite(np.asarray(solution.final))):
        return "NOT FINITE"
    code = Result(int(np.max(np.asarray(solution.code))))
    return "reached t1" if code == Result.REACHED_END else code.name.lower().replace("_", " ")


def examine(
    case: str,
    states: int,
    solve: Callable[[float], Solved],
    remark: str,
    *,
    rtols: Sequence[float] = RTOLS,
    amplification: float = 1.0,
    bound: Callable[[float], float] | None = None,
    checks: Sequence[tuple[str, bool]] = (),
) -> Row:
    """Solve at every tolerance and judge.

    **Arguments:** `bound`: the largest error allowed at a tolerance; by default that of `allowed`. `checks`: further
    criteria in words, and whether each of them holds.
    """
    began = time.process_time()
    found = [solve(rtol) for rtol in rtols]
    bound = bound or (lambda rtol: allowed(rtol, amplification))
    residuals = [float(np.max(np.asarray(one.solution.energy_residual))) for one in found]
    endings = [ending(one.solution) for one in found]
    chaotic = amplification > CHAOTIC
    broken = [f"{end} at rtol {rtol:g}" for end, rtol in zip(endings, rtols, strict=True) if end != "reached t1"]
    for rtol, one, residual in zip(rtols, found, residuals, strict=True):
        if not chaotic and not one.error <= bound(rtol):
            broken.append(f"error {one.error:.1e} at rtol {rtol:g} (allowed {bound(rtol):.1e})")
        if not residual <= max(ENERGY * rtol, FLOOR):
            broken.append(f"energy {residual:.1e} at rtol {rtol:g} (allowed {ENERGY * rtol:.1e})")
    broken += [words for words, holds in checks if not holds]
    if amplification > STANDARD / MULTIPLE:
        remark += f"; amplifies {amplification:.0e}"
    return Row(
        case,
        states,
        int(np.sum(np.asarray(found[len(found) // 2].solution.steps))),
        tuple(rtols),
        tuple(one.error for one in found),
        residuals[-1],
        endings[-1],
        tuple(broken),
        remark,
        chaotic,
        time.process_time() - began,
    )


def allowed(rtol: float, amplification: float) -> float:
    """The error that a scene may have that amplifies by so much."""
    return max(STANDARD, MULTIPLE * amplification) * rtol + FLOOR


def compared(
    case: str, mechanism: cj.Mechanism, t: np.ndarray, truth: np.ndarray, frame: Callable, remark: str, **given: Any
) -> Row:
    """Examine one mechanism: `frame` takes the library's states at times `t` to those of the `truth`."""
    start = {name: given.pop(name) for name in ("y0", "start") if name in given}

    def solve(rtol):
        solution = cj.simulate(mechanism, t[-1], save_at=t, **start, **options(rtol))
        return Solved(solution, worst(frame(np.asarray(solution.y)), truth))

    return examine(case, count_states(mechanism), solve, remark, **given)


def worst(y: np.ndarray, truth: np.ndarray) -> float:
    """The error of the worst state, relative to its largest magnitude; a state that is zero must be exactly so."""
    magnitude = np.abs(truth).max(0)
    errors = np.abs(y - truth).max(0)
    return float(np.max(np.where(magnitude > 0, errors / np.where(magnitude > 0, magnitude, 1.0), 1e300 * errors)))


def batched(solve: Callable, lanes: Any) -> cj.Solution:
    return jax.jit(jax.vmap(solve))(lanes)
