"""The section `wear` of a study: how a joint wears, and the life that is asked for."""

from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.errors import ClearanceError
from clearance_jax.io.asking import StudyFile
from clearance_jax.io.asking_keys import METRIC
from clearance_jax.io.metric import Span
from clearance_jax.io.table import Chosen, TomlTable
from clearance_jax.io.wear_keys import UNTIL_TABLES, WEAR
from clearance_jax.io.wear_model import wear_model
from clearance_jax.wear import WearModel
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed

# Keys that only a life asks for.
OF_A_LIFE = ("until", "longest", "journal")


class WearAsked(NamedTuple):
    """The section as read: the `model`; `cycles` of the life (`None`: no life is asked for); `options` of its
    simulation, and `solve` options of the motions; `until`: the criterion that ends it, in `words` too; the `journal`
    file.
    """

    model: WearModel
    cycles: int | None
    options: dict[str, Any]
    solve: dict[str, Any]
    until: AbstractCriterion | None
    words: str
    journal: Path | None


def wear_of(study: StudyFile) -> WearAsked:
    """Read the section. **Raises:** `ClearanceError` naming the key and the fix."""
    table = study.table.table("wear", WEAR)
    span = study.span_to(table.get("cycle"), table.key("cycle")) if table.has("cycle") else study.span
    model = wear_model(table, study.mechanism, span.t1)
    if not table.has("cycles"):
        table.refuse(*OF_A_LIFE, why="has no effect without `cycles`, how many it lives. Add it.")
    until, words = None, ""
    if table.has("until"):
        until, words = _until(table.variant("until", UNTIL_TABLES), study, span)
    return WearAsked(
        model,
        table.get("cycles"),
        {name: table.get(name) for name in ("sectors", "tolerance", "longest")},
        study.options,
        until,
        words,
        study.path.parent / table.get("journal") if table.has("journal") else None,
    )


def _until(read: Chosen, study: StudyFile, span: Span) -> tuple[AbstractCriterion, str]:
    kind, table = read
    if kind == "depth":
        return Deepest(table.get("bound")), "largest depth of wear"
    if kind == "impact-speed":
        return ImpactSpeed(table.get("bound"), span.t1, study.options), "largest speed of impact"
    name = table.get("metric")
    metric = study.metric(name, span, table.key("metric"))
    if not _is_one_number(table, metric):
        raise ClearanceError(f"{table.key('metric')}: `{name}` is several numbers, of which none ends a life.")
    return Exceeds(metric, table.get("bound", {METRIC: metric.unit}), span.t1, study.options), name


def _is_one_number(table: TomlTable, metric: Any) -> bool:
    return getattr(metric, "times", None) is None or callable(metric.times)
