"""The clearance of a scene's joint: its radii, however they are given, and its laws."""

from typing import Any, cast

import numpy as np

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.io.scene_keys import FRICTION_TABLES, NORMAL_TABLES, STIFFNESS
from clearance_jax.io.table import Table, naming
from clearance_jax.joints import RevoluteClearance, SleeveClearance
from clearance_jax.laws import FRICTION_LAWS, NORMAL_LAWS, AbstractFrictionLaw, AbstractNormalLaw, InternalHertz

OF_A_SLEEVE = ("axial_clearance", "stations", "pin", "collar_radius", "ring")
RADIAL, DIAMETRAL, PIN, SLEEVE = "radial_clearance", "diametral_clearance", "pin_radius", "sleeve_radius"


def clearance_of(table: Table) -> RevoluteClearance | SleeveClearance | None:
    """The clearance of a revolute joint; `None` where the joint is ideal."""
    if not (table.has(RADIAL) or table.has(DIAMETRAL) or (table.has(PIN) and table.has(SLEEVE))):
        for key in ("normal", "friction", PIN, SLEEVE, "length", *OF_A_SLEEVE):
            if table.has(key):
                raise ClearanceError(f"{table.key(key)} belongs to a joint with clearance: add `{RADIAL}` too.")
        return None
    clearance, pin = _radii(table)
    laws = _normal(table), _friction(table)
    if not table.has("length"):
        for key in OF_A_SLEEVE:
            if table.has(key):
                raise ClearanceError(f"{table.key(key)} belongs to a sleeve of some length: add `length` too.")
        return RevoluteClearance(clearance, pin, *laws)
    numbers = {key: table.get(key) for key in OF_A_SLEEVE if table.has(key)}
    with naming(table.where):
        return SleeveClearance(clearance, pin, table.get("length"), *laws, **numbers)


def _radii(table: Table) -> tuple[float, float]:
    """Radial clearance and pin radius [m], from two of clearance, pin radius and sleeve radius."""
    pin, sleeve = table.get(PIN), table.get(SLEEVE)
    clearance = _given_clearance(table)
    if clearance is None:
        clearance = sleeve - pin  # both are there
        if clearance <= 0:
            raise ClearanceError(f"{table.where}: the pin must fit in the sleeve, but {PIN} >= {SLEEVE}.")
    if pin is None:
        if sleeve is None:
            raise ClearanceError(f"{table.where} lacks the key `{PIN}`. Add it (or `{SLEEVE}`).")
        pin = sleeve - clearance
        if pin <= 0:
            raise ClearanceError(
                f"{table.key(SLEEVE)} must be greater than the radial clearance {clearance:g} m, or there is no pin, "
                f"but it is {sleeve:g} m."
            )
    if sleeve is not None and not np.isclose(sleeve - pin, clearance, rtol=1e-6):
        raise ClearanceError(
            f"{table.where}: {SLEEVE} - {PIN} is {sleeve - pin:g} m, but the radial clearance is {clearance:g} m. "
            "The pin must fit in the sleeve: give two of the three, or make them agree."
        )
    return clearance, pin


def _given_clearance(table: Table) -> float | None:
    if table.has(RADIAL) and table.has(DIAMETRAL):
        raise ClearanceError(f"{table.where} gives both a radial and a diametral clearance. Give one.")
    return table.get(DIAMETRAL) / 2 if table.has(DIAMETRAL) else table.get(RADIAL)


def _normal(joint: Table) -> AbstractNormalLaw:
    if not joint.has("normal"):
        raise ClearanceError(
            f"{joint.where} lacks the table `normal` (its contact law). Add one with a key `law`. "
            + suggest("", NORMAL_LAWS)
        )
    word, table = joint.chosen("normal", NORMAL_TABLES)
    make: Any = NORMAL_LAWS[word]
    table.need("stiffness")
    values = table.given("law", "stiffness")
    if isinstance(table.values["stiffness"], dict):
        inner = table.table("stiffness", STIFFNESS)
        return make(stiffness=InternalHertz(**inner.given()), **values)
    # In which unit, the law knows once it has its other numbers.
    provisional = cast(AbstractNormalLaw, make(stiffness=1.0, **values))
    return make(stiffness=table.get("stiffness", provisional.units()), **values)


def _friction(joint: Table) -> AbstractFrictionLaw | None:
    if not joint.has("friction") or joint.get("friction") in ("none", {}):
        return None
    word, table = joint.chosen("friction", FRICTION_TABLES)
    return FRICTION_LAWS[word](**table.given("law"))
