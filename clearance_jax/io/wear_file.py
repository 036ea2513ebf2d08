"""Wear files: TOML with units to a model of wear and how it is simulated, on top of a scene. Keys are strict."""

from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.io.asking import Asked, asked
from clearance_jax.io.metric import Span, metric_of
from clearance_jax.io.metric_keys import METRIC
from clearance_jax.io.table import Chosen, naming
from clearance_jax.io.wear_keys import SOLVE, UNTIL_TABLES, WEAR
from clearance_jax.io.wear_model import wear_model
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed
from clearance_jax.wear.model import WearModel


class WearFile(NamedTuple):
    """What a wear file says: the arguments of `wear.simulate_wear`, `options` and those of the solves among them; what
    ends the life, and that in words, if anything; the journal's folder, if it is named; name and texts.
    """

    model: WearModel
    cycles: int
    options: dict[str, Any]
    solve: dict[str, Any]
    until: AbstractCriterion | None
    words: str
    journal: Path | None
    name: str
    texts: dict[str, str]


def load_wear(path: str | Path) -> WearFile:
    """Read a wear file. **Raises:** `ClearanceError` naming the file, the key and the fix."""
    path = Path(path)
    with naming(str(path)):
        return _wear(asked(path, "wear", WEAR))


def _wear(study: Asked) -> WearFile:
    top, span = study.table, study.span("cycle")
    model = wear_model(top, study.mechanism, span.t1)
    solve = study.usual("t0", "rtol", "solver", "start") | top.table("solve", SOLVE).given()
    until, words = None, ""
    if top.has("until"):
        until, words = _until(top.chosen("until", UNTIL_TABLES), model.mechanism, span, solve)
    return WearFile(
        model,
        top.get("cycles"),
        {name: top.get(name) for name in ("sectors", "tolerance", "longest")},
        solve,
        until,
        words,
        study.path.parent / top.get("journal") if top.has("journal") else None,
        study.name,
        {"scene": study.scene.text, "study": study.text},
    )


def _until(read: Chosen, mechanism: Mechanism, span: Span, solve: dict[str, Any]) -> tuple[AbstractCriterion, str]:
    word, table = read
    if word == "depth":
        return Deepest(table.get("bound")), "largest depth of wear"
    if word == "impact-speed":
        return ImpactSpeed(table.get("bound"), span.t1, solve), "largest speed of impact"
    metric = metric_of(read, mechanism, span)
    of = [table.get(key) for key in ("signal", "point", "body", "joint") if key in table.values]
    return Exceeds(metric, table.get("bound", {METRIC: metric.unit}), span.t1, solve), " ".join([word, *of])
