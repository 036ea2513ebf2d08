"""What a derivative of the equations of motion may not hold, whatever the laws."""

from collections.abc import Iterator
from typing import Any

import catalogue
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jax.extend.core import Literal
from places import SCENES

import clearance_jax as cj
from clearance_jax._basis import numerics
from clearance_jax.dynamics.field import slope
from clearance_jax.mechanism.state import layout


def equations(program: Any) -> Iterator[Any]:
    """The equations of a program, and of those that it calls."""
    for equation in program.eqns:
        yield equation
        for value in jax.tree.leaves(equation.params, is_leaf=lambda x: hasattr(x, "eqns") or hasattr(x, "jaxpr")):
            inner = getattr(value, "jaxpr", value)
            if hasattr(inner, "eqns"):
                yield from equations(inner)


def compared(function, *given) -> list[str]:
    """Where the derivative of a function asks whether two floats that it computes are equal."""
    program = jax.make_jaxpr(lambda *x: jax.jvp(function, x, x))(*given).jaxpr
    return [
        str(equation)
        for equation in equations(program)
        if equation.primitive.name in ("eq", "ne")
        and all(jnp.issubdtype(x.aval.dtype, jnp.floating) and not isinstance(x, Literal) for x in equation.invars)
    ]


def in_field(mechanism: cj.Mechanism) -> list[str]:
    numbers, rest = eqx.partition(mechanism, eqx.is_inexact_array)

    def rate(numbers, y, time):
        return slope(time, y, eqx.combine(numbers, rest).prepare())

    return compared(rate, numbers, jnp.zeros(layout(mechanism).size), 0.1)


@pytest.mark.quick
def test_two_kernels_cannot_disagree_about_a_minimum():
    """JAX's derivative of a minimum asks which of its arguments it equals. Where another kernel computes the argument
    with other last digits it equals neither, and the derivative is zero: so was that of a flank's damper, in a batch
    that was compiled without optimisation.
    """
    x, y = jnp.asarray(1.0), jnp.asarray(2.0)
    assert compared(jnp.minimum, x, y) != []
    for function in (numerics.lesser, numerics.greater, lambda x, y: numerics.within(x, -y, y)):
        assert compared(function, x, y) == []
    crank = catalogue.slider_crank()
    wrist = eqx.tree_at(lambda j: j.clearance.length, crank.joint("wrist"), 0.02, is_leaf=lambda x: x is None)
    for kind, every in (("normal", catalogue.NORMAL), ("friction", catalogue.FRICTION)):
        for name, law in every.items():
            joint = eqx.tree_at(lambda j, kind=kind: getattr(j.clearance, kind), wrist, law)
            assert in_field(crank.with_joint(joint)) == [], name


@pytest.mark.parametrize("scene", ["arm_with_backlash", "bearing", "disc_worn", "gears", "pick_up", "press", "servo"])
def test_nor_in_scenes(scene):
    assert in_field(cj.load(SCENES / f"{scene}.toml")) == []
