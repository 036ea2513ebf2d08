"""How often the verdict is right: cases labelled by dense sweeps of the metric's values over the step, without any
derivative, against what the report says of them; and how narrow an island of other motion it sees.
"""

from collections.abc import Callable
from itertools import groupby
from typing import NamedTuple

import jax
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.analysis.trust import GradientReport
from clearance_jax.errors import ClearanceError
from experiments.common import output, table
from experiments.trust.cases import DRAWS, QUICK, STEP, SWEEP_RTOL, Case, cases, evaluated
from experiments.trust.scenes import FAMILIES, NAME, Numbers, place, random_scenes, scene

SEED = 3
"""The report's thresholds and the number of its probes were chosen on the cases of other seeds."""
SWEEP = 101
WRONG, RIGHT = 0.5, 0.2
"""A gradient is misleading where the sweep contradicts it by more than the one, good where by less than the other."""
CLASSES = {"plane": "plane", "worn": "worn", "sleeve": "spatial", "arm": "spatial"}


class Sweep(NamedTuple):
    """How far a sweep of values contradicts a gradient, relatively: `off`, its slope and its changes to either end;
    `departure`, its farthest point from what the gradient predicts, over what it predicts for the step.
    """

    off: float
    departure: float

    @property
    def good(self) -> bool | None:
        """Whether the gradient is good; false: misleading; none: in between."""
        if self.off > WRONG:
            return False
        return True if self.off < RIGHT and self.departure < WRONG else None


class Verdict(NamedTuple):
    """What the sweep says of a case, and what the report does."""

    case: Case
    sweep: Sweep
    trusted: bool
    reasons: tuple[str, ...]

    @property
    def good(self) -> bool | None:
        """What the sweep says."""
        return self.sweep.good


def contradiction(gradient: float, moves: np.ndarray, values: np.ndarray) -> Sweep:
    """How far values at changes of the parameter contradict a gradient."""
    changes = values - values[len(values) // 2]
    slope = np.polyfit(moves, values, 1)[0]
    ends = [changes[i] / moves[i] for i in (0, -1)]
    worst = max(abs(x - gradient) for x in (slope, *ends))
    resolved = SWEEP_RTOL * np.max(np.abs(values)) / moves[-1]
    size = max(abs(gradient), resolved)
    departure = float(np.max(np.abs(changes - gradient * moves)) / (size * moves[-1]))
    return Sweep(0.0 if worst <= resolved else worst / size, departure)


def swept(chosen: list[Case], shifts: np.ndarray) -> list[np.ndarray]:
    """The metric of every case at changes of its parameter."""

    def program(i):
        return chosen[i].family, chosen[i].metric

    found: dict[int, np.ndarray] = {}
    for (family, metric), group in groupby(sorted(range(len(chosen)), key=program), key=program):
        rows = list(group)
        numbers, ends = (np.array([getattr(chosen[i], name) for i in rows]) for name in ("numbers", "end"))
        columns = np.array([chosen[i].column for i in rows])
        points = numbers[np.arange(len(rows)), columns][:, None] * (1 + shifts)
        found.update(zip(rows, evaluated(metric, numbers, ends, points, family, columns), strict=True))
    return [found[i] for i in range(len(chosen))]


def report_on(case: Case) -> GradientReport:
    """What the library says of a case."""
    known = FAMILIES[case.family]
    return cj.gradient_report(
        known.scene(case.numbers), known.metrics[case.metric], [case.parameter], case.end, step=STEP,
        on_untrusted="ignore",
    )  # fmt: skip


def verdicts(quick: bool, seed: int = SEED) -> list[Verdict]:
    chosen = cases(QUICK if quick else DRAWS, seed)
    shifts = np.linspace(-STEP, STEP, SWEEP)
    out = []
    for case, values in zip(chosen, swept(chosen, shifts), strict=True):
        report = report_on(case)
        sweep = contradiction(float(report.gradient[0]), case.numbers[case.column] * shifts, values)
        out.append(Verdict(case, sweep, report.trusted, report.reasons))
    return out


def tally(found: list[Verdict], quick: bool) -> None:
    """A table of the verdicts, by class and by kind."""

    def row(name: str, of: list[Verdict]) -> tuple:
        bad, good, rest = ([v for v in of if v.good is label] for label in (False, True, None))
        alarms = sum(not v.trusted for v in good)
        share = f"{alarms} ({alarms / len(good):.1%})" if good else "0"
        believed = [sum(v.trusted for v in group) for group in (bad, rest)]
        return name, len(of), len(bad), believed[0], len(good), share, len(rest), believed[1]

    def rows(name: Callable[[Verdict], str]) -> list[tuple]:
        return [row(key, [v for v in found if name(v) == key]) for key in dict.fromkeys(map(name, found))]

    by_class = rows(lambda v: CLASSES[v.case.family])
    by_kind = rows(lambda v: f"{v.case.family}: {v.case.kind}")
    head = ("cases of", "all", "misleading", "of these trusted", "good", "of these refused", "in between")
    head = (*head, "of these trusted")
    table(head, [*by_class, row("all", found), *by_kind], output(f"trust_verdicts{'_quick' if quick else ''}.md"))


def refused(count: int) -> int:
    """How many reports on a law of class C-1 are refused."""
    scenes = random_scenes(np.random.default_rng(1), count, (1.0, 10.0))
    seen = 0
    for numbers in scenes:
        try:
            cj.gradient_report(scene(numbers, laws.LinearKelvinVoigt), place, [NAME], 0.05)
        except ClearanceError:
            seen += 1
    return seen


# Islands --------------------------------------------------------------------------------------------------------------

ISLAND = Numbers(1e-3, 1e-3, 20, 50)
WIDTHS = (1 / 64, 1 / 32, 1 / 24, 1 / 16, 1 / 12, 1 / 8, 1 / 4)
PLACES = 48


def with_island(middle, width, mechanism, _):
    """A metric that follows the clearance, but for an island that lies a step higher; all in steps."""
    changed = (mechanism.joint("play").clearance.radial_clearance / ISLAND.clearance - 1) / STEP
    return changed + 1.0 * (abs(changed - middle) < width / 2)


def islands(quick: bool) -> dict[float, float]:
    """The share of islands that are seen, by their width over the step; they lie anywhere within the step."""
    widths, count = (WIDTHS[3:5], 4) if quick else (WIDTHS, PLACES)
    rng, shares = np.random.default_rng(SEED), {}
    for width in widths:
        # Not about the design itself, and not beyond the step.
        middles = rng.choice([-1, 1], count) * rng.uniform(0.51 * width, 1 - width / 2, count)
        metrics = [jax.tree_util.Partial(with_island, middle, width) for middle in middles]
        reports = [cj.gradient_report(scene(ISLAND), m, [NAME], 0.01, on_untrusted="ignore") for m in metrics]
        shares[width] = float(np.mean([not report.trusted for report in reports]))
    rows = [(f"{w:.4f}", f"{w * STEP:.3%}", f"{share:.0%}") for w, share in shares.items()]
    head = ("width over the step", "width over the clearance", "seen")
    table(head, rows, output(f"trust_islands{'_quick' if quick else ''}.md"))
    return shares
