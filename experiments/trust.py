"""How often `gradient_report` is right: `python -m experiments.trust` writes out/trust_horizon.md,
out/trust_verdicts.md.

All scenes are one mechanism with other numbers: a pin on a guide, in a sleeve that is shaken along it, with impacts on
both sides. With little damping in the impacts it is chaotic, with much of it periodic.

- Horizon: the time until which a derivative is meaningful. The report predicts it from the rate at which neighbouring
  motions move apart. The prediction is compared with the time from which the signal-to-noise ratio of the derivatives
  of 64 motions within the scatter stays below 3.
- Verdicts: each case gets a label from a dense sweep of the metric's values over the step, without any derivative. A
  gradient is misleading if it does not predict the change of the metric over the step, and good if it does. A verdict
  that trusts a misleading gradient is a miss, one that refuses a good gradient a false alarm.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.analysis.divergence import horizon_of, neighbours
from clearance_jax.analysis.trust import THRESHOLDS
from clearance_jax.errors import ClearanceError
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run
from experiments.common import output, table
from experiments.publish import command, say

NAME = "play.radial_clearance"
PIN_MASS, PIN_RADIUS, STIFFNESS = 0.1, 0.01, 1e9
RTOL = 1e-8


class Numbers(NamedTuple):
    """A scene: clearance [m], amplitude [m] and frequency [Hz] of the shaker, damping factor of the impacts [s/m],
    gravity along the guide [m/s^2], and the pin's speed at the start [m/s].
    """

    clearance: float
    amplitude: float
    frequency: float
    damping: float
    gravity: float = 0.0
    speed: float = 0.05


def scene(n: Numbers, law: Callable = laws.HuntCrossley) -> cj.Mechanism:
    play = cj.RevoluteClearance(n.clearance, PIN_RADIUS, law(STIFFNESS, n.damping))
    shaker = cj.Motion(cj.drives.Harmonic(n.amplitude, 2 * np.pi * n.frequency))
    return cj.Mechanism(
        bodies=(cj.Body("sleeve", 1.0), cj.Body("pin", PIN_MASS)),
        joints=(
            cj.Prismatic("shaker", "ground", "sleeve", motion=shaker),
            cj.Prismatic("guide", "ground", "pin", motion=cj.Motion(None, 0.0, n.speed)),
        ),
        loops=(cj.Revolute("play", "sleeve", "pin", clearance=play),),
        gravity=cj.Gravity(x=-n.gravity),
        assemble=False,
    )


# Horizon -------------------------------------------------------------------------------------------------------------

SCATTERS = (1e-2, 1e-3)
SAMPLED = 64
DRAWS = 16
SEEDS = {"report": 0, "measured": 1}
END = 0.6
TIMES = 401
NOISE = 3.0
FACTOR = 1.5
"""How far the predicted horizon may be from the measured one."""

CHAOTIC = {
    # `TrustThresholds.spread` was chosen with all of these in view, so none of them is a test of that number.
    "A1": Numbers(1e-3, 1e-3, 20, 0.05),
    "A2": Numbers(1e-3, 2e-3, 20, 0.2),
    "A3": Numbers(1e-3, 5e-4, 30, 0.1),
    "A4": Numbers(5e-4, 1e-3, 20, 0.05, speed=0.03),
    "B1": Numbers(2e-3, 1.5e-3, 15, 0.1, speed=0.1),
    "B2": Numbers(1e-3, 1.2e-3, 25, 0.1),
    "B3": Numbers(8e-4, 1e-3, 18, 0.05),
    "B4": Numbers(1.5e-3, 1e-3, 25, 0.02, speed=0.08),
    "B5": Numbers(1e-3, 1.5e-3, 22, 0.1, 9.81),
    "B6": Numbers(1e-3, 7e-4, 28, 0.05, speed=0.1),
    "B7": Numbers(6e-4, 8e-4, 30, 0.1, speed=0.02),
}
REGULAR = {
    "R1, periodic": Numbers(1e-3, 1e-3, 20, 50),
    "R2, periodic": Numbers(1e-3, 2e-3, 20, 20),
    "R3, resting": Numbers(1e-3, 3e-4, 20, 10, 9.81, 0.0),
    "R4, periodic": Numbers(1e-3, 1e-3, 20, 100),
    "R5, periodic": Numbers(5e-4, 1e-3, 30, 100),
    "R6, bouncing to rest": Numbers(1e-3, 1e-4, 20, 0.5, 9.81, 0.0),
}


class Horizon(NamedTuple):
    """Exponent [1/s], impacts, and horizons [s]: predicted by the report, by the nominal motion alone, classical, and
    measured; the last is the end where the derivatives are good until then.
    """

    scene: str
    scatter: float
    chaotic: bool
    exponent: float
    impacts: int
    predicted: float
    nominal: float
    classical: float
    measured: float

    @property
    def factor(self) -> float:
        """How far prediction and measurement are apart, neither counted beyond the end."""
        a, b = min(self.predicted, END), self.measured
        return max(a / b, b / a)


@eqx.filter_jit
def derivatives(mechanism, points, times):
    """Derivative of the pin's position by the clearance at the times, for every clearance in `points`."""

    def at(c):
        changed = cj.replace(mechanism, {NAME: c})
        how = settings_of(changed, times[-1], {"save_at": times, "rtol": RTOL})
        return run(changed, times[-1], how).state("guide")

    return jax.vmap(lambda c: jax.jvp(at, (c,), (jnp.ones_like(c),))[1])(points)


def drawn(clearance: float, scatter: float, count: int, seed: str) -> np.ndarray:
    return clearance * (1 + scatter * np.random.default_rng(SEEDS[seed]).standard_normal(count))


def measured(mechanism: cj.Mechanism, clearance: float, scatter: float) -> float:
    """When the signal-to-noise ratio of the derivative falls below `NOISE` for good."""
    times = np.linspace(0, END, TIMES)
    points = drawn(clearance, scatter, SAMPLED, "measured")
    slopes = np.asarray(derivatives(mechanism, jnp.asarray(points), jnp.asarray(times)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(slopes.mean(0)) / slopes.std(0, ddof=1)
    (good,) = np.nonzero(~(ratio < NOISE))
    return float(times[min(good[-1] + 1, TIMES - 1)])


def horizon(name: str, numbers: Numbers, scatter: float) -> Horizon:
    limit = THRESHOLDS.spread
    mechanism, c = scene(numbers), numbers.clearance
    points = np.concatenate([[c], drawn(c, scatter, DRAWS, "report")])[:, None]
    end, sigma = jnp.asarray(END), jnp.asarray([scatter * c])
    how = settings_of(mechanism, END, {"rtol": RTOL})
    times, spread, touches = neighbours(mechanism, (NAME,), jnp.asarray(points), sigma, end, how)
    times, spread = np.asarray(times), np.asarray(spread)
    exponent, predicted = horizon_of(times, np.sqrt(np.mean(spread**2, axis=0)), limit)
    nominal = horizon_of(times, spread[0], limit)[1]
    # The classical estimate: from the scatter to the size of the play, at the exponent's rate.
    classical = np.log(1 / scatter) / exponent if exponent * END > 1 else np.inf
    found = measured(mechanism, c, scatter)
    impacts = int(touches[0].count[0])
    return Horizon(name, scatter, name in CHAOTIC, exponent, impacts, predicted, nominal, float(classical), found)


def horizons(quick: bool) -> list[Horizon]:
    chosen = {**CHAOTIC, **REGULAR}
    names = ("A1", "B1", "R1, periodic") if quick else chosen
    rows = [horizon(name, chosen[name], scatter) for scatter in SCATTERS for name in names]
    head = (
        "scene",
        "scatter",
        "exponent [1/s]",
        "impacts",
        "horizon [s]",
        "nominal alone",
        "ln(L/s)/exponent",
        "measured",
    )
    head = (*head, "factor")
    table(
        head,
        [
            (
                r.scene,
                r.scatter,
                f"{r.exponent:.1f}",
                r.impacts,
                *(f"{x:.3f}" for x in (r.predicted, r.nominal, r.classical)),
                "end" if r.measured == END else f"{r.measured:.3f}",
                f"{r.factor:.2f}",
            )
            for r in rows
        ],
        output(f"trust_horizon{'_quick' if quick else ''}.md"),
    )
    return rows


# Verdicts ------------------------------------------------------------------------------------------------------------

STEP = 0.02
SEED = 1
"""The report's thresholds were set on the cases of seed 0."""
SWEEP = 101
SWEEP_RTOL = 1e-10
WRONG, RIGHT = 0.5, 0.2
"""A gradient is misleading where the sweep contradicts it by more than the one, good where by less than the other."""
GRID = 33
WINDOW = 0.1
BATCH = 512


def place(solution):
    """The pin's position at the end [m]."""
    return solution.state("guide")


METRICS: dict[str, Any] = {"place": place, "peak force": metrics.Peak(metrics.ContactForce("play"))}


class Case(NamedTuple):
    """A design and what is asked of it."""

    kind: str
    metric: str
    numbers: Numbers
    end: float


class Verdict(NamedTuple):
    """What the sweep says of a case (None: in between), what the report says, and how far the gradient is off."""

    case: Case
    good: bool | None
    trusted: bool
    off: float
    reasons: tuple[str, ...]


def _primal(kind: str):
    """A function (numbers (6,), end) -> number of the motion."""

    def of(numbers, end):
        mechanism = scene(Numbers(*numbers))
        options = {"rtol": SWEEP_RTOL, "solver": "dopri8"}
        if kind == "place":
            return place(run(mechanism, end, settings_of(mechanism, end, options)))
        if kind == "peak force":
            return METRICS[kind](mechanism, end, **options)
        if kind == "peak time":
            return METRICS["peak force"].times(mechanism, end, rtol=RTOL)[0]
        return metrics.Impacts("play")(mechanism, end, rtol=RTOL)

    return of


PROGRAMS = {k: jax.jit(jax.vmap(_primal(k))) for k in ("place", "peak force", "peak time", "impacts")}


def evaluated(kind: str, numbers: np.ndarray, ends: np.ndarray, clearances: np.ndarray) -> np.ndarray:
    """A number of motions for every case (cases, 6) and each of its clearances (cases, points)."""
    points = np.repeat(numbers[:, None], clearances.shape[1], 1)
    points[..., 0] = clearances
    flat, ends = points.reshape(-1, numbers.shape[1]), np.repeat(ends, clearances.shape[1])
    # One batch size, so one program; the last batch is filled up with copies.
    count = -(-len(flat) // BATCH) * BATCH
    fill = np.minimum(np.arange(count), len(flat) - 1)
    parts = [np.asarray(PROGRAMS[kind](jnp.asarray(flat[i]), jnp.asarray(ends[i]))) for i in fill.reshape(-1, BATCH)]
    return np.concatenate(parts)[: len(flat)].reshape(clearances.shape)


def random_scenes(rng: np.random.Generator, count: int, damping: tuple[float, float]) -> list[Numbers]:
    """Scenes of all sizes; damping factors between the given ones, evenly in the logarithm."""
    out = []
    for _ in range(count):
        clearance = rng.uniform(0.5e-3, 2e-3)
        amplitude, frequency = clearance * rng.uniform(0.5, 2.0), rng.uniform(15, 30)
        factor = np.exp(rng.uniform(*np.log(damping)))
        out.append(Numbers(clearance, amplitude, frequency, factor, rng.choice([0.0, 9.81]), rng.uniform(-0.1, 0.1)))
    return out


def at_events(kind: str, seen: str, scenes: list[Numbers], ends: np.ndarray, rng: np.random.Generator) -> list:
    """Of the scenes those near which `seen` jumps over the clearance, moved to within a step of the jump."""
    numbers = np.array(scenes)
    grid = numbers[:, :1] * np.linspace(1 - WINDOW, 1 + WINDOW, GRID)
    values = evaluated(seen, numbers, ends, grid)
    # A time moves smoothly by less than this share of a period from one grid point to the next.
    jump = 0.5 if seen == "impacts" else 0.25 / numbers[:, 2]
    jumps = np.abs(np.diff(values, axis=1)) > np.broadcast_to(np.asarray(jump), len(numbers))[:, None]
    has, first = np.any(jumps, axis=1), np.argmax(jumps, axis=1)
    # The grid is finer than the step: where between two of its points the jump is, does not matter.
    moved = grid[np.arange(len(numbers)), first] * (1 + STEP * rng.uniform(-0.8, 0.8, len(numbers)))
    metric = ["peak force"] * len(moved) if kind == "ties" else ["place", "peak force"] * len(moved)
    return [
        Case(kind, metric[i], scenes[i]._replace(clearance=float(moved[i])), float(ends[i]))
        for i in np.flatnonzero(has)
    ]


def cases(quick: bool, seed: int = SEED) -> list[Case]:
    """Designs of every kind, drawn with one seed; few and of two kinds, for one metric, in the quick mode."""
    rng = np.random.default_rng(seed)

    def ends_of(scenes, low, high):
        return np.array([rng.uniform(low, high) / n.frequency for n in scenes])

    def plain(kind, count, damping, periods):
        scenes = random_scenes(rng, 4 if quick else count, damping)
        names = ["place"] if quick else list(METRICS)
        ends = ends_of(scenes, *periods)
        return [Case(kind, names[i % len(names)], n, float(ends[i])) for i, n in enumerate(scenes)]

    found = plain("regular, short", 70, (0.05, 50), (0.8, 2))
    found += plain("chaos", 40, (0.02, 0.2), (4, 7))
    if quick:
        return found
    found += plain("regular, damped", 50, (20, 200), (2, 6))
    for kind, seen, count in (("grazing", "impacts", 50), ("ties", "peak time", 50)):
        scenes = random_scenes(rng, count, (0.1, 20))
        found += at_events(kind, seen, scenes, ends_of(scenes, 1, 3), rng)
    # What jumps with the parameter: the motion a while after an impact that happens or not.
    scenes = random_scenes(rng, 40, (0.1, 5))
    later = at_events("jumps", "impacts", scenes, ends_of(scenes, 1, 3), rng)
    return found + [case._replace(end=case.end + rng.uniform(0.2, 0.6) / case.numbers.frequency) for case in later]


def off_by(gradient: float, moves: np.ndarray, values: np.ndarray) -> float:
    """How far a sweep of values contradicts a gradient: its slope and its change at either end, relatively."""
    middle = values[len(values) // 2]
    slope = np.polyfit(moves, values, 1)[0]
    ends = [(values[i] - middle) / moves[i] for i in (0, -1)]
    worst = max(abs(x - gradient) for x in (slope, *ends))
    resolved = SWEEP_RTOL * np.max(np.abs(values)) / moves[-1]
    return 0.0 if worst <= resolved else worst / max(abs(gradient), resolved)


def verdicts(quick: bool) -> list[Verdict]:
    chosen = cases(quick)
    shifts = np.linspace(-STEP, STEP, SWEEP)
    sweeps: dict[int, np.ndarray] = {}
    for metric in METRICS:
        rows = [i for i, case in enumerate(chosen) if case.metric == metric]
        if not rows:
            continue
        numbers = np.array([chosen[i].numbers for i in rows])
        ends = np.array([chosen[i].end for i in rows])
        swept = evaluated(metric, numbers, ends, numbers[:, :1] * (1 + shifts))
        sweeps.update(zip(rows, swept, strict=True))
    out = []
    for i, case in enumerate(chosen):
        report = cj.gradient_report(
            scene(case.numbers), METRICS[case.metric], [NAME], case.end, step=STEP, on_untrusted="ignore"
        )
        off = off_by(float(report.gradient[0]), case.numbers.clearance * shifts, sweeps[i])
        good = False if off > WRONG else True if off < RIGHT else None
        out.append(Verdict(case, good, report.trusted, off, report.reasons))
    return out


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


def tally(found: list[Verdict], quick: bool) -> None:
    rows = []
    for kind in [*dict.fromkeys(v.case.kind for v in found), "all"]:
        of = [v for v in found if kind in (v.case.kind, "all")]
        bad, good = [v for v in of if v.good is False], [v for v in of if v.good]
        alarms = sum(not v.trusted for v in good)
        share = f"{alarms} ({alarms / len(good):.1%})" if good else "0"
        rows.append(
            (kind, len(of), len(bad), sum(v.trusted for v in bad), len(good), share, len(of) - len(bad) - len(good))
        )
    head = ("kind", "cases", "misleading", "of these trusted", "good", "false alarms", "in between")
    table(head, rows, output(f"trust_verdicts{'_quick' if quick else ''}.md"))


def main(quick: bool = False) -> tuple[list[Horizon], list[Verdict]]:
    far = horizons(quick)
    found = verdicts(quick)
    tally(found, quick)
    count = 2 if quick else 6
    say(f"Laws of class C-1: {refused(count)} of {count} refused.")
    return far, found


if __name__ == "__main__":
    command(main, __doc__)
