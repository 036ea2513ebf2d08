"""What the runs say in words, by class of scene; and what `solver="auto"` costs there."""

from collections.abc import Sequence

import numpy as np

from clearance_jax.solve.settings import HIGH, LIMITS, LOW, kind_of
from experiments.work_precision.ours import TOOLS
from experiments.work_precision.points import BOUNDS, Point, cheapest, of
from experiments.work_precision.scenes import CLASSES, Case

LOCATED = tuple(tool for tool, (_, events) in TOOLS.items() if events)
WITHOUT = tuple(tool for tool in TOOLS if tool not in LOCATED)


def sentences(points: Sequence[Point], cases: Sequence[Case]) -> list[str]:
    """Paragraphs of Markdown, one for each class of scene."""
    found = []
    for kind, words in CLASSES.items():
        names = [case.scene.name for case in cases if case.scene.of == kind]
        if names:
            lines = [_advice(points, names, bound) for bound in BOUNDS]
            found.append(f"**For {words}** ({', '.join(names)}):\n\n" + "\n".join(f"- {x}" for x in lines if x))
            found[-1] += f"\n- {_without(points, names)}"
    return found


def _advice(points: Sequence[Point], names: Sequence[str], bound: float) -> str:
    """Which own solver to use for an error of positions, and how long other tools take."""
    spent = {tool: [cheapest(of(points, name, tool), bound) for name in names] for tool in LOCATED}
    whole = {tool: found for tool, found in spent.items() if None not in found}
    if not whole:
        return f"positions within {bound:.0e}: no solver reaches it at every scene within the tolerances tried."
    best = min(whole, key=lambda tool: np.prod([p.seconds for p in whole[tool] if p is not None]))
    mine = [p for p in whole[best] if p is not None]
    line = f"positions within {bound:.0e}: use `{best}` at rtol {_span([p.rtol for p in mine], '.0e')}"
    for other in whole.keys() - {best}:
        ratios = [b.seconds / a.seconds for a, b in zip(mine, whole[other], strict=True) if b is not None]
        line += f" (`{other}` takes {_span(ratios, '.1f')} x its time)"
    rivals = []
    for name, own in zip(names, mine, strict=True):
        others = {p.tool for p in points if p.scene == name} - set(TOOLS)
        reached = {tool: cheapest(of(points, name, tool), bound) for tool in others}
        times = {tool: p.seconds / own.seconds for tool, p in reached.items() if p is not None}
        rivals.append(min(times.items(), key=lambda item: item[1]) if times else ("", np.nan))
    return f"{line}. {_beside(rivals, names)}"


def _beside(rivals: Sequence[tuple[str, float]], names: Sequence[str]) -> str:
    """How the fastest other tool of every scene compares."""
    told = [(f"{tool} ({ratio:.1f} x)", name) for (tool, ratio), name in zip(rivals, names, strict=True) if tool]
    none = [name for (tool, _), name in zip(rivals, names, strict=True) if not tool]
    said = "The fastest other tool: " + ", ".join(f"{tool} at {name}" for tool, name in told) + "." if told else ""
    return " ".join([said, f"No other tool reaches it at {', '.join(none)}." if none else ""]).strip()


def _without(points: Sequence[Point], names: Sequence[str]) -> str:
    """How small the errors of positions become without event location."""
    least = [
        min((p.position for t in WITHOUT for p in of(points, name, t) if np.isfinite(p.position)), default=np.nan)
        for name in names
    ]
    kept = [
        min((p.position for t in LOCATED for p in of(points, name, t) if np.isfinite(p.position)), default=np.nan)
        for name in names
    ]
    last = "the least error of positions is" if len(names) == 1 else "the least errors of positions are"
    return f"without event location {last} {_list(least)}; with it {_list(kept)}."


def _span(values: Sequence[float], form: str) -> str:
    low, high = (format(f(values), form) for f in (min, max))
    return low if low == high else f"{low} to {high}"


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.0e}" for value in values)


# The choice of a solver -----------------------------------------------------------------------------------------------


def at_equal_error(points: Sequence[Point], name: str, rtol: float) -> float:
    """The time of the solver of order eight over that of order five, for the error of positions that the latter has at
    an rtol: between its own runs the logarithm of time is linear in that of the error. NaN: it has not reached it.
    """
    low = next((p for p in of(points, name, LOW) if p.rtol == rtol), None)
    if low is None or not np.isfinite(low.position):
        return np.nan
    runs = sorted((p for p in of(points, name, HIGH) if np.isfinite(p.position)), key=lambda p: -p.rtol)
    # From the loosest to the tightest the error falls, but for noise: of each error the best run.
    errors = np.minimum.accumulate([p.position for p in runs])
    if not runs or errors[-1] > low.position:
        return np.nan
    x = -np.log(np.maximum(errors, 1e-300)) + 1e-9 * np.arange(len(runs))
    seconds = np.interp(-np.log(low.position), x, np.log([p.seconds for p in runs]))
    return float(np.exp(seconds) / low.seconds)


def choices(points: Sequence[Point], cases: Sequence[Case]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """A table: by scene and rtol the time of dopri8 over that of tsit5 at equal error; `*`: "auto" takes dopri8."""
    rtols = sorted({p.rtol for p in points if p.tool == LOW}, reverse=True)
    rows = []
    for case in cases:
        kind = kind_of(case.mechanism)
        cells = []
        for rtol in rtols:
            ratio = at_equal_error(points, case.scene.name, rtol)
            mark = " *" if rtol <= LIMITS[kind] else ""
            cells.append((f"{ratio:.2f}" if np.isfinite(ratio) else "-") + mark)
        rows.append((case.scene.name, kind, *cells))
    return ("scene", "kind", *(f"{rtol:.0e}" for rtol in rtols)), rows


def cost_of_choice(points: Sequence[Point], cases: Sequence[Case]) -> str:
    """What following the rule costs, over the better solver of each row, in the mean and at most."""
    spent = {"auto": [], LOW: [], HIGH: []}
    for case in cases:
        for rtol in {p.rtol for p in points if p.tool == LOW}:
            ratio = at_equal_error(points, case.scene.name, rtol)
            if np.isfinite(ratio):
                high, low = ratio / min(1, ratio), 1 / min(1, ratio)
                spent[LOW].append(low)
                spent[HIGH].append(high)
                spent["auto"].append(high if rtol <= LIMITS[kind_of(case.mechanism)] else low)
    said = [f"{np.exp(np.mean(np.log(x))):.2f} (at most {max(x):.2f}) by `{tool}`" for tool, x in spent.items() if x]
    return "Time over that of the better solver, over all entries of the table: " + ", ".join(said) + "."
