"""How a sleeve wears over its life: blocks of cycles, each of which jumps over most of its cycles.

What one cycle wears off, f(h), depends on the worn profile h slowly. So one cycle stands for many: from h a block
goes two single jumps of A cycles, h1 = h + A f(h) and h2 = h1 + A f(h1), and one double jump, h + 2 A f(h). The two
differ by the error of the single ones, which decides about A.

The block keeps an extrapolation of both, h + f(h) + (2 A - 1) f(h1), for n = 2 A cycles. It is exact where the wear of
a cycle grows evenly: cycle j = 0 .. n - 1 then wears off f + j f' f, in sum n f + n (n - 1) / 2 f' f. The double jump
has nothing in place of the second part, and the single jumps have A^2 f' f. At A = 1 nothing is jumped over, and the
extrapolation is the two cycles themselves. (The midpoint rule h + 2 A f(h1) is for an integral. Depths are a sum over
cycles, which differs from it by half of the change of a cycle's wear, however short jumps are.)
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Float

from clearance_jax.errors import ClearanceError, WornThrough, wrong_value
from clearance_jax.parameters import values_of
from clearance_jax.runs.identity import numbers, settings, versions
from clearance_jax.runs.journal import Journal
from clearance_jax.solve.settings import SolveOptions, with_solver
from clearance_jax.units import format_quantity
from clearance_jax.wear.criteria import AbstractCriterion, criterion_of, end_slopes
from clearance_jax.wear.model import WearModel

Profile = Float[np.ndarray, "*stack sectors"]
Rate = Callable[[Profile, int], Profile]
"""What one cycle wears off a profile [m], after a number of cycles; for a stack a stack."""
# Largest and least ratio of jumps of successive blocks; the fraction of the allowed jump that is used.
GROWS, SHRINKS, USED = 4.0, 0.1, 0.8


class WearHistory(NamedTuple):
    """How the profile of a sleeve wore.

    - `cycles` (blocks + 1,), and `depth` (blocks + 1, sectors) [m]: the profile after so many cycles.
    - `evaluations`: how many cycles were computed; `end`: the cycle at which the criterion `until` was reached, `None`:
      it was not.
    - `beyond` (blocks + 1,): how far beyond its bound the criterion was; `None`: there was no criterion.

    With derivatives by the numbers in `names`: `slopes` (blocks + 1, names, sectors) of the depths, and `end_slopes`
    (names,) of the end.
    """

    cycles: np.ndarray
    depth: np.ndarray
    evaluations: int
    end: float | None
    beyond: np.ndarray | None = None
    until: AbstractCriterion | None = None
    names: tuple[str, ...] = ()
    slopes: np.ndarray | None = None
    end_slopes: np.ndarray | None = None

    @property
    def saved(self) -> float:
        """Cycles lived by cycles computed."""
        return float(self.cycles[-1]) / max(self.evaluations, 1)

    @property
    def by(self) -> Mapping[str, float]:
        """The derivatives of the end by name [cycles by the number's unit]; none if there are none."""
        slopes = () if self.end_slopes is None else self.end_slopes.tolist()
        return dict(zip(self.names, slopes, strict=False))

    def __str__(self) -> str:
        deepest = float(self.depth[-1].max())
        depth = f"worn off by {format_quantity(deepest, 'm')} at most" if deepest > 0 else "nothing worn off"
        end = "" if self.end is None else f"; the criterion was reached at cycle {self.end:.6g}"
        slopes = [f"  d life / d {name} = {slope:.6g}" for name, slope in self.by.items()]
        head = f"{self.cycles[-1]} cycles by {self.evaluations} of them: {depth}{end}"
        return "\n".join([head, *slopes])


class WearBlock(NamedTuple):
    """A completed block: `cycles` at its end, the next `jump`, the profile or stack `depth`, and `evaluations` so far;
    `beyond`: the criterion minus its bound; if life ended in the block, its `end` [cycles], and `ending`: the stack
    then, and as last row the wear of a cycle.
    """

    cycles: int
    jump: int
    depth: list
    evaluations: int
    beyond: float | None = None
    end: float | None = None
    ending: list | None = None


def march(
    rate: Rate,
    depth: Profile,
    cycles: int,
    *,
    tolerance: float = 1e-3,
    longest: int | None = None,
    until: Callable[[Profile], float] | None = None,
    journal: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> WearHistory:
    """Wear a profile for so many `cycles`, by a function that says what one cycle wears off.

    **Arguments:**

    - `rate`: `rate(profile, cycles)`: the depth that one cycle wears off a profile [m], shape (sectors,), after so many
      cycles.
    - `depth`: the profile at first, shape (sectors,); or a stack of shape (1 + n, sectors): the profile, and below it
      its derivatives by n numbers. Then `rate` takes and gives stacks. The jumps are chosen for the profile alone, so
      it wears as it does without derivatives.
    - `tolerance`: largest error of the single jumps of a block, as a share of the largest depth (and of the largest
      derivative); `longest`: the most cycles of a jump (1: every cycle is computed).
    - `until`: a function of the profile. The life ends when it is no longer below 0. It is asked at the ends of blocks;
      between them the end is interpolated.
    - `journal`: a file that keeps every block, from which an interrupted march goes on to the same answer. Functions
      are compared by their code and the values that they hold: a function that counts its calls is another one each
      time.
    - `progress`: called with the fraction of the cycles that is done.

    **Raises:** `ClearanceError` for a rate that is negative or not finite, an `until` that is not finite, and for a
    journal that belongs to another question, cannot be read or written, or is being written.
    """
    stack = np.asarray(depth, float)
    rest = {"profile": stack, "cycles": _lived(cycles), "tolerance": tolerance, "longest": longest}
    with _journal(journal) as kept:
        if kept is not None:
            kept.ask(versions() | numbers(rate, " (rate)") | numbers(until, " (until)") | settings(rest))
        return _history(_march(rate, stack, cycles, tolerance, longest, until, kept, progress))


def _lived(cycles: int) -> int:
    if cycles < 1:
        raise wrong_value("`cycles`", "at least 1", cycles, str(cycles))
    return cycles


def _journal(path: str | Path | None) -> AbstractContextManager[Journal | None]:
    """The journal of a life, if it has a path. Its blocks are ordered."""
    return nullcontext() if path is None else closing(Journal(path, ordered=True))


def _march(rate, stack, cycles, tolerance, longest, until, journal, progress) -> list[WearBlock]:
    """The blocks of a life, continued from those in the journal."""
    first = WearBlock(0, 1, stack.tolist(), 0)
    if until is not None:
        beyond = _beyond(until, stack, 0)
        first = first._replace(beyond=beyond)
        if not beyond < 0:
            return [first._replace(end=0.0)]
    blocks = [first, *(WearBlock(**record) for record in (() if journal is None else journal.records))]
    while blocks[-1].cycles < cycles and blocks[-1].end is None:
        blocks.append(_block(rate, blocks[-1], cycles, tolerance, longest, until))
        if journal is not None:
            journal.add(**blocks[-1]._asdict())
        if progress is not None:
            progress(blocks[-1].cycles / cycles)
    return blocks


def _history(blocks: list[WearBlock]) -> WearHistory:
    every = np.array([block.depth for block in blocks])
    depth, slopes = (every, None) if every.ndim == 2 else (every[:, 0], every[:, 1:])
    cycles, last = np.array([block.cycles for block in blocks]), blocks[-1]
    beyond = None if blocks[0].beyond is None else np.array([block.beyond for block in blocks], float)
    return WearHistory(cycles, depth, last.evaluations, last.end, beyond, slopes=slopes)


def _block(rate: Rate, now: WearBlock, cycles: int, tolerance: float, longest: int | None, until: Any) -> WearBlock:
    """The next block, with jumps that meet the tolerance."""
    h, count, left = np.array(now.depth), now.evaluations + 1, cycles - now.cycles
    jump = max(1, min(now.jump, left // 2))
    first = _check(rate(h, now.cycles), now.cycles)
    if left == 1:  # two jumps of half a cycle, of the same wear
        return _end(now, h, (first, first), 0.5, now.jump, count, until)
    while True:
        then = _check(rate(h + jump * first, now.cycles + jump), now.cycles + jump)
        count += 1
        error = jump * np.max(np.abs(then - first), axis=-1)
        allowed = tolerance * np.max(np.abs(h + jump * (first + then)), axis=-1)
        # Each row of a stack has its own scale.
        worst = np.max(error / np.where(allowed > 0, allowed, np.where(error > 0, 1e-300, 1.0)))
        factor = GROWS if worst == 0 else np.clip(USED / np.sqrt(worst), SHRINKS, GROWS)
        wanted = int(np.clip(np.floor(jump * factor), 1, cycles if longest is None else longest))
        if worst <= 1 or jump == 1:
            return _end(now, h, (first, then), jump, wanted, count, until)
        jump = max(1, min(wanted, jump - 1))


def _profile(stack: np.ndarray) -> np.ndarray:
    """The profile of a stack, or the profile itself."""
    return stack if stack.ndim == 1 else stack[0]


def _end(now: WearBlock, h: Profile, rates: tuple, jump: float | int, wanted: int, count: int, until: Any) -> WearBlock:
    """The block after accepted jumps, with the end of life if it lies within the block."""
    first, then = rates

    def profile(n):
        # Cycle j = 0, 1, ... wears off first + j (then - first) / jump: summed over n, of an incomplete cycle its part.
        complete = np.floor(n)
        return h + n * first + complete * (n - 0.5 * (complete + 1)) / jump * (then - first)

    whole = round(2 * jump)
    last = profile(whole)
    done = WearBlock(now.cycles + whole, wanted, last.tolist(), count)
    if until is None:
        return done
    beyond = _beyond(until, last, done.cycles)
    done = done._replace(beyond=beyond)
    if beyond < 0:
        return done
    root = scipy.optimize.brentq(lambda n: float(until(_profile(profile(n)))), 0.0, float(whole), xtol=1e-12 * whole)
    n = float(root)  # pyright: ignore[reportArgumentType]
    ending = [*np.atleast_2d(profile(n)), *np.atleast_2d(first + np.floor(n) / jump * (then - first))[:1]]
    return done._replace(end=now.cycles + n, ending=np.array(ending).tolist())


def _beyond(until: Callable[[Profile], float], stack: np.ndarray, cycles: int) -> float:
    """The criterion minus its bound: a number, for the root between blocks and for the journal."""
    beyond = float(until(_profile(stack)))
    if not np.isfinite(beyond):
        message = f"What ends the life (`until`) must be a finite number, but after {cycles} cycles it is {beyond}."
        raise ClearanceError(message).about("until", beyond)
    return beyond


def _check(worn: Any, cycles: int) -> Profile:
    worn = np.asarray(worn, float)
    if not np.all(_profile(worn) >= 0):
        raise WornThrough(
            f"What a cycle wears off must be at least 0, but after {cycles} cycles it is {_profile(worn).min()} m."
        )
    if not np.all(np.isfinite(worn)):
        raise ClearanceError(f"The derivative of what a cycle wears off is not finite after {cycles} cycles.")
    return worn


def simulate_wear(
    model: WearModel,
    cycles: int,
    *,
    sectors: int | None = None,
    by: Sequence[str] = (),
    tolerance: float = 1e-3,
    longest: int | None = None,
    until: AbstractCriterion | Callable[[Profile], float] | None = None,
    journal: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
    **options: Unpack[SolveOptions],
) -> WearHistory:
    """Simulate the wear of a joint for so many cycles. Each cycle is the motion from t0 to the model's `cycle`, on the
    profile as worn. Most cycles are jumped over.

    **Arguments:**

    - `model`: a `WearModel`; `cycles`: how many.
    - `sectors`: by default as many as the patch of the first cycle needs for an error of the largest depth below 1 %,
      at least 360. If you give too few, a warning (`SectorsWarning`) says how many are needed.
    - `by`: names of numbers by which depths and life have derivatives: the mechanism's ("pin.radial_clearance",
      "gravity.y"), the law's ("wear.coefficient") or the pressure's ("pressure.stiffness"). The length of each jump
      counts as constant.
    - `tolerance`: largest error of the jumps of a block, as a share of the largest depth; `longest`: the most cycles of
      a jump.
    - `until`: what ends the life: `Deepest`, `Exceeds`, `ImpactSpeed`, or a function of the profile (for derivatives in
      `jax.numpy`) that is below 0 until the life ends.
    - `journal`: a file that keeps every block, from which an interrupted run goes on; `progress`: called with the
      fraction done.
    - `options`: of the motion, as `trace`'s (`start`, `rtol`, ...).

    **Raises:** `ClearanceError` for an unknown name, derivatives of a criterion that has none, a journal of another
    question, and a cycle that wears off too much for one profile (`WearModel.cycle_wears`).
    """
    names, criterion = tuple(by), criterion_of(until)
    values_of(model, names)  # an unknown name raises here
    how_to_solve = with_solver(model, options)
    if names and criterion is not None and not criterion.has_derivatives:
        text = f"A life until `{type(criterion).__name__}` has no derivatives: leave out `by`, or take another `until`."
        raise ClearanceError(text)

    def rate(depth: Profile, after: int) -> np.ndarray:
        worn = model.cycle_wears(np.atleast_2d(depth), names, after, how_to_solve)
        return worn if names else worn[0]

    def beyond(depth: Profile) -> float:
        assert criterion is not None
        return float(criterion.beyond(model.at(depth), model.joint))

    how = {"cycles": _lived(cycles), "sectors": sectors, "tolerance": tolerance, "longest": longest, "by": list(names)}
    with _journal(journal) as kept:
        if kept is not None:
            kept.ask(description(model, criterion, **how, **how_to_solve))
        begin = model.begin(sectors or model.sectors(how_to_solve))
        stack = begin if not names else np.concatenate([begin[None], np.zeros((len(names), begin.size))])
        ends = None if criterion is None else beyond
        blocks = _march(rate, stack, cycles, tolerance, longest, ends, kept, progress)
    history = _history(blocks)._replace(names=names, until=criterion)
    if not names or criterion is None or blocks[-1].ending is None:
        return history
    ending = jnp.asarray(blocks[-1].ending)
    return history._replace(end_slopes=np.asarray(end_slopes(criterion, model, names, ending)))


def lived_so_far(model: WearModel, journal: str | Path, until: Any = None) -> WearHistory | None:
    """The history of an interrupted `simulate_wear` from its journal; `None` if no block is complete. `model`,
    `journal`, `until`: as of `simulate_wear`.
    """
    with closing(Journal(journal, ordered=True)) as kept:
        blocks = [WearBlock(**record) for record in kept.records]
    if not blocks:
        return None
    criterion, size = criterion_of(until), np.atleast_2d(blocks[0].depth).shape[-1]
    begin = model.begin(size)
    beyond = None if criterion is None else float(criterion.beyond(model.at(begin), model.joint))
    stack = np.zeros(np.shape(blocks[0].depth))
    stack[... if stack.ndim == 1 else 0] = begin
    return _history([WearBlock(0, 1, stack.tolist(), 0, beyond), *blocks])._replace(until=criterion)


def description(model: WearModel, until: AbstractCriterion | None, **rest: Any) -> dict[str, Any]:
    """A question by the names of its parts, each a number or a short text; `rest`: further arguments."""
    question = versions() | numbers(model.mechanism)
    for what, part in {"law of wear": model.wear, "pressure": model.pressure, "until": until}.items():
        question |= {} if part is None else numbers(part, f" ({what})")
    return question | settings({"joint": model.joint, "cycle": float(model.cycle), **rest})
