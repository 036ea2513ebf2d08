"""Functions that a CPU runs as one: what they compute, how they are marked, and what is left as it is."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax._compile.one_function import one_function
from experiments.common import SCENES

pytestmark = pytest.mark.quick

MARKS = 'inlineable = "false", xla_cpu_small_call = "true"'


def walk(start, steps, name, away):
    """Steps along a wave, from a number, with a whole number, a name and a flag; one array is not used."""

    def once(_, x):
        return jnp.where(away, x + jnp.sin(x) / steps, x - 1)

    assert name == "wave"
    return {"end": jax.lax.fori_loop(0, 1000, once, start), "steps": steps, "name": name, "away": ~away}


def arguments(start=0.1):
    return jnp.asarray([start, 0.4]), jnp.asarray(-(2**62) - 1), "wave", jnp.asarray(True)


def marked(function, *numbers, platform="cpu"):
    return MARKS in jax.jit(function).trace(*numbers).lower(lowering_platforms=(platform,)).as_text()


def test_it_gives_what_the_function_gives():
    alone, one = walk(*arguments()), one_function(walk)(*arguments())
    for name, value in alone.items():
        np.testing.assert_array_equal(one[name], value)
    assert one["steps"].dtype == alone["steps"].dtype == jnp.int64
    assert one["away"].dtype == bool


def test_whole_numbers_and_flags_come_as_they_are():
    """Small ones too, whose bits as a float would be a denormal number, which arithmetic may flush to zero."""
    values = jnp.asarray([0, 1, 2, -1, -2, 2**31, 2**53 + 1, -(2**63), 2**63 - 1])
    flags, little = values % 2 == 0, jnp.asarray([-1, 3], jnp.int32)
    floats = jnp.asarray([5e-324, -0.0, jnp.inf, 1.0])
    passed = jax.jit(one_function(lambda *numbers: numbers))(values, flags, little, floats)
    for new, old in zip(passed[:3], (values, flags, little), strict=True):
        assert new.dtype == old.dtype
        np.testing.assert_array_equal(new, old)
    np.testing.assert_array_equal(passed[3][1:], floats[1:])


def test_it_is_marked_under_every_transformation():
    def end(start):
        return one_function(walk)(*arguments(start))["end"].sum()

    many = jnp.linspace(0.1, 0.3, 3)
    turned = {"alone": end, "jvp": lambda x: jax.jvp(end, (x,), (x,))[1], "jacfwd": jax.jacfwd(end)}
    for name, function in turned.items():
        assert marked(function, 0.1), name
        assert marked(jax.vmap(function), many), name
        np.testing.assert_allclose(jax.vmap(function)(many), [function(x) for x in many], rtol=1e-14)
    assert not marked(end, 0.1, platform="cuda")


def test_the_call_stays_one_in_what_is_compiled():
    text = jax.jit(lambda x: one_function(walk)(*arguments(x))["end"]).lower(0.1).compile().as_text() or ""
    assert re.search(r'call\(.*to_apply=%program.*xla_cpu_small_call="true"', text)


def looped(kernel):
    """A kernel twice, as one function."""
    return one_function(lambda x: jax.lax.fori_loop(0, 2, lambda _, x: kernel(x), x))


# XLA leaves them to a library, whose kernels no function can hold: products with matrices.
LIBRARY = {
    "square": (lambda x: x @ x, (8, 8)),
    "rows": (lambda x: x @ jnp.full((4, 4), 0.2), (16, 4)),
    "network": (jax.vmap(lambda x: jnp.tanh(jnp.full((6, 6), 0.2) @ x)), (12, 6)),
    "tall": (lambda x: x @ (x.T @ x), (30, 2)),
    "many squares": (jax.vmap(lambda x: x @ x), (16, 12, 12)),
    "many norms": (jax.vmap(lambda x: x / (x @ x)), (64, 70)),
}


@pytest.mark.parametrize("name", LIBRARY)
def test_what_xla_leaves_to_a_library_is_left_as_it_is(name):
    kernel, shape = LIBRARY[name]
    numbers = jnp.linspace(0.1, 0.2, math.prod(shape)).reshape(shape)
    assert not marked(looped(kernel), numbers)
    np.testing.assert_allclose(jax.jit(looped(kernel))(numbers), kernel(kernel(numbers)), rtol=1e-13)


@pytest.mark.parametrize(
    ("kernel", "shape"),
    [
        (lambda x: x / jnp.sum(jnp.exp(x)), (5000,)),
        (lambda x: x / jnp.max(jnp.exp(x), axis=-1, keepdims=True), (30, 180)),
        (jax.vmap(lambda x: x - jnp.min(x, axis=0, keepdims=True)), (64, 70, 2)),
        (lambda x: x / jnp.prod(1 + 1e-4 * x), (5000,)),
    ],
)
def test_long_reductions_stay_within_one(kernel, shape):
    numbers = jnp.linspace(0.1, 0.2, math.prod(shape)).reshape(shape)
    assert marked(looped(kernel), numbers)
    np.testing.assert_allclose(jax.jit(looped(kernel))(numbers), kernel(kernel(numbers)), rtol=1e-13)


@pytest.mark.parametrize("size", [6, 7, 40])
def test_products_with_vectors_stay_within_one(size):
    square = jnp.full((size, size), 1 / size)
    for kernel in (lambda x: square @ x, lambda x: x / (1 + x @ x), lambda x: jnp.outer(x, x) @ x / size):
        numbers = jnp.linspace(0.1, 0.2, size)
        assert marked(looped(kernel), numbers)
        np.testing.assert_allclose(jax.jit(looped(kernel))(numbers), kernel(kernel(numbers)), rtol=1e-13)


@pytest.mark.parametrize(
    "kernel", [lambda x: jnp.linalg.inv(x), lambda x: jnp.sort(x), lambda x: x.at[jnp.array([1, 0])].add(1.0)]
)
def test_what_needs_kernels_of_its_own_is_left_as_it_is(kernel):
    matrix = jnp.asarray([[2.0, 1.0], [0.0, 4.0]])
    twice = looped(kernel)
    assert not marked(twice, matrix)
    np.testing.assert_allclose(twice(matrix), kernel(kernel(matrix)), rtol=1e-15)
    # Within it, another function can be one.
    inner = one_function(lambda x: twice(x) + one_function(walk)(x, *arguments()[1:])["end"])
    assert marked(inner, matrix)
    assert np.all(np.isfinite(jax.jit(inner)(matrix)))


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["bennett", "pick_up"])
def test_a_motion_with_loops_or_payloads_is_one(scene):
    """With one scatter in its field a motion takes 25 times its time."""
    mechanism = cj.load(SCENES / f"{scene}.toml")
    assert marked(lambda end: cj.simulate(mechanism, end).final, 0.01)


def test_a_batch_on_a_trajectory_of_many_points_is_one():
    """The next break of 64 lanes is searched among 80."""
    mechanism, times = cj.load(SCENES / "slider_crank.toml"), np.linspace(0.0, 0.02, 80)
    mechanism = mechanism.with_drives({"main": cj.drives.Spline(times, 500 * times)})

    def end(clearance):
        loose = cj.replace(mechanism, {"wrist.radial_clearance": clearance})
        return cj.simulate(loose, 0.01, energy_balance=False).final

    assert marked(jax.vmap(end), jnp.linspace(1e-4, 5e-4, 64))


def test_a_table_whose_reactions_are_measured_is_one():
    """A product of matrices in its loop would end the function."""
    bodies = tuple(cj.Body(f"b{i}", 1.0, cj.Inertia(0.01, 0.01, 0.01), cj.Position(0.05)) for i in range(20))
    joints = tuple(
        cj.Revolute(f"j{i}", f"b{i - 1}" if i else "ground", f"b{i}", cj.Position(0.1 if i else 0.0), axis="zyx"[i % 3])
        for i in range(20)
    )
    chain = cj.Mechanism(bodies, joints, gravity=cj.Gravity(z=-9.81))
    peak = cj.metrics.Peak(cj.metrics.JointReaction("j3"))
    assert chain.prepare().is_tabled
    assert marked(lambda end: peak(chain, end), 0.01)
