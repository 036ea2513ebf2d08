"""Every law answers what it answered before the laws had the form that they have now, digit by digit.

`data/laws_reference.npz` was made from the laws as they stood at commit 081aefa: `normal` holds the rows penetration,
its rate, memory (impact speed), `friction` the rows slip, normal force, bristle as a fraction of its scale; `LAW.force`
is the force or traction in these columns, `LAW.force.ARGUMENT` its derivative, `LAW.elastic` the elastic force.
"""

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ROOT

from clearance_jax import laws

pytestmark = pytest.mark.quick

REFERENCE = np.load(ROOT / "tests" / "data" / "laws_reference.npz")
GEOMETRY = laws.Geometry(jnp.asarray(0.01), jnp.asarray(0.0105), jnp.asarray(5e-4))
# A round-off of the terms that a force, or a slope, is the difference of.
DIGITS = 2e-14


def check_close(value, before, size):
    assert np.all(np.abs(np.asarray(value) - before) <= DIGITS * np.maximum(np.abs(before), size))


@pytest.mark.parametrize("name", [name for name in catalogue.NORMAL if f"{name}.force" in REFERENCE])
def test_normal_laws(name):
    law = catalogue.NORMAL[name].prepare(GEOMETRY)
    columns = [jnp.asarray(row) for row in REFERENCE["normal"]]

    def force(d, v, memory):
        return law.force(d, v, (memory,) if law.law.remembers else ())

    value, slopes = jax.jit(jax.vmap(jax.value_and_grad(force, (0, 1))))(*columns)
    elastic = np.abs(REFERENCE[f"{name}.elastic"])
    check_close(value, REFERENCE[f"{name}.force"], elastic)
    for slope, argument in zip(slopes, ("penetration", "penetration_rate"), strict=True):
        before = REFERENCE[f"{name}.force.{argument}"]
        # A clipped force lies on the other side of its kink where it is zero to the last digit.
        kink = np.abs(REFERENCE[f"{name}.unclipped"]) <= DIGITS * elastic
        depth = np.maximum(np.abs(REFERENCE["normal"][0]), 1e-300)
        size = elastic / depth if argument == "penetration" else 0.0
        check_close(np.where(kink, before, slope), before, size)
    check_close(jax.vmap(law.energy)(columns[0]), REFERENCE[f"{name}.energy"], 0.0)


@pytest.mark.parametrize("name", [name for name in catalogue.FRICTION if f"{name}.force" in REFERENCE])
def test_friction_laws(name):
    law = catalogue.FRICTION[name].prepare(GEOMETRY)
    slip, force, fraction = (jnp.asarray(row) for row in REFERENCE["friction"])
    memory = fraction * law.memory_scale(1)[0] if law.law.bristles else fraction

    def traction(s, n, z):
        return law.traction((s,), n, (z,) if law.law.bristles else ())[0]

    value, slopes = jax.jit(jax.vmap(jax.value_and_grad(traction, (0, 1))))(slip, force, memory)
    size = (
        np.abs(np.asarray(force))
        * (1e5 * np.abs(np.asarray(memory)) + 1e-2 * np.abs(np.asarray(slip)))
        * bool(law.law.bristles)
    )
    check_close(value, REFERENCE[f"{name}.force"], size)
    # A saturated slope is a difference of slopes as large as the steepest.
    check_close(slopes[0], REFERENCE[f"{name}.force.slip_velocity"], 30 * np.abs(np.asarray(force)))
    check_close(slopes[1], REFERENCE[f"{name}.force.normal_force"], 1.0)
    if law.law.bristles:

        def rate(s, n, z):
            return law.memory_rate((s,), n, (z,))[0]

        before = REFERENCE[f"{name}.memory_rate"]
        check_close(jax.vmap(rate)(slip, force, memory), before, np.abs(np.asarray(slip)))
