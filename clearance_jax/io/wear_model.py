"""Reads the wear model of a study: the joint that wears, the law and the pressure."""

import dataclasses

import jax.numpy as jnp

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.io.kinds import Words
from clearance_jax.io.table import Chosen, TomlTable, naming
from clearance_jax.io.wear_keys import COEFFICIENT_UNIT, GRADED, LAW_TABLES, MATERIAL, PRESSURE_TABLES, RUNNING_IN
from clearance_jax.joints import AbstractPin
from clearance_jax.laws import Material
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.wear.contacts import sections_of
from clearance_jax.wear.laws import COEFFICIENT, AbstractWearLaw, Archard, Graded, Reye, RunningIn, Threshold
from clearance_jax.wear.model import WearModel
from clearance_jax.wear.pressure import AbstractPressure, Foundation, HertzLine, Uniform, foundation


def wear_model(top: TomlTable, mechanism: Mechanism, cycle: float) -> WearModel:
    """The wear model of a section `wear`, with cycles that end at `cycle` [s]. The joint gets the length and the
    materials of the table. **Raises:** `ClearanceError` naming the key and the fix.
    """
    mechanism, joint = _with_joint_values(top, mechanism)
    top.need("law", "pressure")
    law = _law(top.variant("law", LAW_TABLES, _coefficient(top)))
    pressure = _pressure(top.variant("pressure", PRESSURE_TABLES))
    if not isinstance(pressure, Foundation):
        with naming(top.key("pressure")):
            pressure.half_angle(sections_of(mechanism, joint).geometry, jnp.ones(()))  # whether it knows what it needs
    return WearModel(mechanism, joint, law, pressure, cycle)


def _with_joint_values(top: TomlTable, mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The mechanism with the length and materials of the table in the worn joint, and the joint's name."""
    name, known = top.get("joint"), {joint.name: joint.clearance for joint in mechanism.clearance_joints()}
    if name not in known:
        raise ClearanceError(f"{top.key('joint')}: no joint with clearance has this name. {suggest(name, known)}")
    if not isinstance(known[name], AbstractPin) or known[name].section_count > 1:
        raise ClearanceError(
            f"{top.key('joint')} must be a pin in a plane sleeve, but `{name}` is another kind of joint."
        )
    given = {"length": top.get("length")} if top.has("length") else {}
    given |= {key: _material(top, key) for key in ("pin_material", "sleeve_material") if top.has(key)}
    clearance = dataclasses.replace(known[name], **given)
    if clearance.length is None:
        raise ClearanceError(f"{top.where} lacks the key `length`, which the depth of wear depends on. Add it.")
    return mechanism.with_clearance(name, clearance), name


def _material(table: TomlTable, key: str) -> Material:
    return Material(**table.table(key, MATERIAL).arguments())


def _coefficient(top: TomlTable) -> Words:
    """The unit of the coefficient by its placeholder: none beside a hardness."""
    given = top.values.get("law")
    return {COEFFICIENT_UNIT: "" if isinstance(given, dict) and "hardness" in given else COEFFICIENT}


def _law(read: Chosen) -> AbstractWearLaw:
    table, coefficient = read.table, read.table.get("coefficient")
    if read.word == "reye":
        law: AbstractWearLaw = Reye(coefficient)
    else:
        law = Archard(coefficient / table.get("hardness") if table.has("hardness") else coefficient)
    if table.has("graded"):
        law = Graded(law, **table.table("graded", GRADED).arguments())
    if table.has("least_pressure"):
        law = Threshold(law, table.get("least_pressure"))
    return RunningIn(law, **table.table("running_in", RUNNING_IN).arguments()) if table.has("running_in") else law


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
