"""Wear files: TOML with units to the arguments of `wear.life`, on top of a scene. Keys are strict, as a scene's."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.io.asking import Asked, asked
from clearance_jax.io.kinds import Words
from clearance_jax.io.metric import Span, metric_of
from clearance_jax.io.metric_keys import METRIC
from clearance_jax.io.table import Chosen, Table, naming
from clearance_jax.io.wear_keys import (
    COEFFICIENT_UNIT,
    GRADED,
    LAW_TABLES,
    MATERIAL,
    PRESSURE_TABLES,
    RUNNING_IN,
    SOLVE,
    UNTIL_TABLES,
    WEAR,
)
from clearance_jax.joints import RevoluteClearance, WornRevoluteClearance
from clearance_jax.laws import Material
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.wear.contacts import sleeve_of
from clearance_jax.wear.criteria import AbstractCriterion, Deepest, Exceeds, ImpactSpeed
from clearance_jax.wear.laws import COEFFICIENT, AbstractWearLaw, Archard, Graded, Reye, RunningIn, Threshold
from clearance_jax.wear.pressure import AbstractPressure, Foundation, HertzLine, Uniform, foundation


class WearFile(NamedTuple):
    """What a wear file says: the positional arguments of `wear.life` and its `options`, those of the solves among
    them; what ends the life, and that in words, if anything; the journal's folder, if it is named; name and
    texts.
    """

    mechanism: Mechanism
    joint: str
    law: AbstractWearLaw
    pressure: AbstractPressure
    cycle: float
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
    mechanism, joint = _jointed(study)
    for key in ("wear", "pressure"):
        top.need(key)
    pressure = _pressure(top.chosen("pressure", PRESSURE_TABLES))
    if not isinstance(pressure, Foundation):
        with naming(top.key("pressure")):
            pressure.half_angle(sleeve_of(mechanism, joint).geometry, jnp.ones(()))  # whether it knows what it needs
    solve = study.usual("t0", "rtol", "solver", "start") | top.table("solve", SOLVE).given()
    until, words = None, ""
    if top.has("until"):
        until, words = _until(top.chosen("until", UNTIL_TABLES), mechanism, span, solve)
    return WearFile(
        mechanism,
        joint,
        _law(top.chosen("wear", LAW_TABLES, _coefficient(top))),
        pressure,
        span.t1,
        top.get("cycles"),
        {name: top.get(name) for name in ("sectors", "tolerance", "longest")},
        solve,
        until,
        words,
        study.path.parent / top.get("journal") if top.has("journal") else None,
        study.name,
        {"scene": study.scene.text, "study": study.text},
    )


def _jointed(study: Asked) -> tuple[Mechanism, str]:
    """The mechanism, whose joint knows the length and the materials that the study gives it."""
    top, mechanism = study.table, study.mechanism
    name, known = top.get("joint"), {joint.name: joint.clearance for joint in mechanism.clearance_joints()}
    if name not in known:
        raise ClearanceError(f"{top.key('joint')}: no joint with clearance has this name. {suggest(name, known)}")
    if not isinstance(known[name], RevoluteClearance | WornRevoluteClearance):
        raise ClearanceError(
            f"{top.key('joint')} must be a pin in a plane sleeve, but `{name}` is another kind of joint."
        )
    given = {"length": top.get("length")} if top.has("length") else {}
    given |= {key: _material(top, key) for key in ("pin_material", "sleeve_material") if top.has(key)}
    clearance = dataclasses.replace(known[name], **given)
    if clearance.length is None:
        raise ClearanceError(f"{top.where} lacks the key `length`, which the depth of wear depends on. Add it.")
    return mechanism.with_clearance(name, clearance), name


def _material(table: Table, key: str) -> Material:
    return Material(**table.table(key, MATERIAL).given())


def _coefficient(top: Table) -> Words:
    """In which unit the coefficient is: beside a hardness in none."""
    given = top.values.get("wear")
    return {COEFFICIENT_UNIT: "" if isinstance(given, dict) and "hardness" in given else COEFFICIENT}


def _law(read: Chosen) -> AbstractWearLaw:
    table, coefficient = read.table, read.table.get("coefficient")
    if read.word == "reye":
        law: AbstractWearLaw = Reye(coefficient)
    else:
        law = Archard(coefficient / table.get("hardness") if table.has("hardness") else coefficient)
    if table.has("graded"):
        law = Graded(law, **table.table("graded", GRADED).given())
    if table.has("least_pressure"):
        law = Threshold(law, table.get("least_pressure"))
    return RunningIn(law, **table.table("running_in", RUNNING_IN).given()) if table.has("running_in") else law


def _pressure(read: Chosen) -> AbstractPressure:
    kind, table = read
    if kind == "hertz":
        return HertzLine()
    if kind == "uniform":
        return Uniform(**table.given("kind"))
    layer = table.has("thickness") or table.has("material")
    if table.has("stiffness") == layer:
        raise ClearanceError(f"{table.where} must have a `stiffness`, or `thickness` and `material` of a layer.")
    if not layer:
        return Foundation(table.get("stiffness"))
    for key in ("thickness", "material"):
        table.need(key)
    return foundation(_material(table, "material"), table.get("thickness"))


def _until(read: Chosen, mechanism: Mechanism, span: Span, solve: dict[str, Any]) -> tuple[AbstractCriterion, str]:
    word, table = read
    if word == "depth":
        return Deepest(table.get("bound")), "largest depth of wear"
    if word == "impact-speed":
        return ImpactSpeed(table.get("bound"), span.t1, solve), "largest speed of impact"
    metric = metric_of(read, mechanism, span)
    of = [table.get(key) for key in ("signal", "point", "body", "joint") if key in table.values]
    return Exceeds(metric, table.get("bound", {METRIC: metric.unit}), span.t1, solve), " ".join([word, *of])
