"""The section `wear` of a study: how a joint wears (the law, the pressure), and the life that is asked for."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp

from clearance_jax.analysis.rubbing import sections_of
from clearance_jax.errors import ClearanceError, naming, unknown_name
from clearance_jax.io.keys import wear as keys
from clearance_jax.io.keys.metric import METRIC
from clearance_jax.io.study.file import Span, StudyFile
from clearance_jax.io.table import Chosen, TomlTable
from clearance_jax.joints import AbstractPin
from clearance_jax.laws import Material
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed
from clearance_jax.wear.laws import COEFFICIENT, AbstractWearLaw, Archard, Graded, Reye, RunningIn, Threshold
from clearance_jax.wear.model import WearModel
from clearance_jax.wear.pressure import AbstractPressure, Foundation, HertzLine, Uniform, foundation

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
    table = study.table.table("wear", keys.WEAR)
    span = study.span_to(table.get("cycle"), table.key("cycle")) if table.has("cycle") else study.span
    model = wear_model(table, study.mechanism, span.t1)
    if not table.has("cycles"):
        table.refuse(*OF_A_LIFE, why="has no effect without `cycles`, how many it lives. Add it.")
    until, words = None, ""
    if table.has("until"):
        until, words = _until(table.variant("until", keys.UNTIL_TABLES), study, span)
    options = {name: table.get(name) for name in ("sectors", "tolerance", "longest")}
    journal = study.path.parent / table.get("journal") if table.has("journal") else None
    return WearAsked(model, table.get("cycles"), options, study.options, until, words, journal)


def _until(read: Chosen, study: StudyFile, span: Span) -> tuple[AbstractCriterion, str]:
    kind, table = read
    if kind == "depth":
        return Deepest(table.get("bound")), "largest depth of wear"
    if kind == "impact-speed":
        return ImpactSpeed(table.get("bound"), span.t1, study.options), "largest speed of impact"
    name = table.get("metric")
    metric = study.metric(name, span, table.key("metric"))
    times = getattr(metric, "times", None)
    if times is not None and not callable(times):
        raise ClearanceError(f"{table.key('metric')}: `{name}` is several numbers, of which none ends a life.")
    return Exceeds(metric, table.get("bound", {METRIC: metric.unit}), span.t1, study.options), name


def wear_model(top: TomlTable, mechanism: Mechanism, cycle: float) -> WearModel:
    """The wear model of a section `wear`, with cycles that end at `cycle` [s], length and materials of the table."""
    mechanism, joint = _with_joint_values(top, mechanism)
    top.need("law", "pressure")
    given = top.values["law"]  # beside a hardness the coefficient has no unit
    unit = "" if isinstance(given, dict) and "hardness" in given else COEFFICIENT
    law = _law(top.variant("law", keys.LAW_TABLES, {keys.COEFFICIENT_UNIT: unit}))
    pressure = _pressure(top.variant("pressure", keys.PRESSURE_TABLES))
    if not isinstance(pressure, Foundation):
        with naming(top.key("pressure")):
            # Raises if it needs a number of the joint that is missing.
            pressure.half_angle(sections_of(mechanism, joint).geometry, jnp.ones(()))
    return WearModel(mechanism, joint, law, pressure, cycle)


def _with_joint_values(top: TomlTable, mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The mechanism with the length and materials of the table in the worn joint, and the joint's name."""
    name, known = top.get("joint"), {joint.name: joint.clearance for joint in mechanism.clearance_joints()}
    if name not in known:
        raise unknown_name(f"{top.key('joint')}: no joint with clearance has this name.", name, known, top.key("joint"))
    if not isinstance(known[name], AbstractPin) or known[name].section_count > 1:
        top.refuse("joint", why=f"must be a pin in a plane sleeve, but `{name}` is another kind of joint.")
    changes = {"length": top.get("length")} if top.has("length") else {}
    changes |= {key: _material(top, key) for key in ("pin_material", "sleeve_material") if top.has(key)}
    clearance = dataclasses.replace(known[name], **changes)
    if clearance.length is None:
        raise ClearanceError(f"{top.where} lacks the key `length`, which the depth of wear depends on. Add it.")
    return mechanism.with_clearance(name, clearance), name


def _material(table: TomlTable, key: str) -> Material:
    return Material(**table.table(key, keys.MATERIAL).arguments())


def _law(read: Chosen) -> AbstractWearLaw:
    word, table = read
    coefficient = table.get("coefficient")
    if "hardness" in table.values:
        coefficient = coefficient / table.get("hardness")
    law: AbstractWearLaw = Reye(coefficient) if word == "reye" else Archard(coefficient)
    if table.has("graded"):
        law = Graded(law, **table.table("graded", keys.GRADED).arguments())
    if table.has("least_pressure"):
        law = Threshold(law, table.get("least_pressure"))
    return RunningIn(law, **table.table("running_in", keys.RUNNING_IN).arguments()) if table.has("running_in") else law


def _pressure(read: Chosen) -> AbstractPressure:
    kind, table = read
    if kind == "hertz":
        return HertzLine()
    if kind == "uniform":
        return Uniform(**table.arguments("kind"))
    layer = table.has("thickness") or table.has("material")
    if table.has("stiffness") == layer:
        raise ClearanceError(f"{table.where} must have a `stiffness`, or `thickness` and `material` of a layer.")
    if not layer:
        return Foundation(table.get("stiffness"))
    table.need("thickness", "material")
    return foundation(_material(table, "material"), table.get("thickness"))
