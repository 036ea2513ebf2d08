"""A program that computes once what it is made of has the same values, and fewer operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearance_jax._compile.once import compute_once
from experiments.hlo import busiest_loop

# Only a compiler that optimises computes anything twice.
pytestmark = pytest.mark.optimised


def links(a, b):
    """Each of two numbers is made of both before it: computed anew, the work doubles with every link."""
    for i in range(12):
        a, b = a * b + 0.1 * i, a - 0.5 * b * b
    return a * 1e-3, b * 1e-3


def chain(x):
    return jnp.stack(links(x[0], x[1]))


def looped(x):
    return jax.lax.fori_loop(0, 3, lambda _, x: chain(x), x)


def branched(x):
    return jax.lax.cond(x[0] > 0, chain, lambda x: -chain(-x), x)


@jax.custom_jvp
def ruled(x):
    return chain(x)


@ruled.defjvp
def _(primals, tangents):
    return ruled(*primals), 7.0 * tangents[0]


def called(x):
    """Two calls of one program, one of whose arguments it uses often, and a flag that is used twice."""
    once = jax.jit(chain)
    flag = jnp.sum(x * x) > 1
    return jnp.where(flag, once(x * x + 1), once(x)) + jnp.where(flag, 1.0, ruled(x))


def scanned(x):
    return jax.lax.scan(lambda x, k: (chain(x * k), x), x, jnp.arange(1.0, 4.0))


@pytest.mark.parametrize("function", [chain, looped, branched, ruled, called, scanned])
def test_values_and_derivatives_are_the_same(function):
    x = jnp.array([0.3, 0.7])
    for transform in (jax.jit, lambda f: jax.jit(jax.vmap(f)), jax.jacfwd, jax.jacrev):
        given = jnp.stack([x, -x]) if transform is not jax.jit and transform not in (jax.jacfwd, jax.jacrev) else x
        ours, plain = transform(compute_once(function))(given), transform(function)(given)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-15), ours, plain)


def test_what_is_no_array_goes_through():
    out = compute_once(lambda x, word: {"x": x * 2, "word": word, "none": None})(jnp.ones(2), "as it is")
    assert out["word"] == "as it is"
    assert out["none"] is None
    assert out["x"].tolist() == [2.0, 2.0]


def test_work_does_not_double_with_every_link():
    """Of links that cost more than the few operations that may be repeated."""

    def heavy(a, b):
        for _ in range(12):
            x = a * b
            for k in range(10):
                x = 0.1 * k + 0.5 * x * a
            a, b = x + 0.1 * b, x - 0.5 * b
        return a, b

    def apart(x):
        return jax.lax.fori_loop(0, 3, lambda _, state: heavy(*state), (x[0], x[1]))

    def operations(function):
        return busiest_loop(jax.jit(function).lower(jnp.ones(2)).compile().as_text())

    written = busiest_loop(jax.jit(apart).lower(jnp.ones(2)).as_text(dialect="hlo", debug_info=True))
    assert operations(compute_once(apart)) <= 1.25 * written
    assert operations(apart) > 1.5 * written  # or the test above shows nothing


@jax.custom_jvp
def below(x):
    return jnp.nextafter(x, -jnp.inf)


below.defjvp(lambda primals, tangents: (below(*primals), 3.0 * tangents[0]))


def test_calls_in_a_row_become_a_loop():
    """Each on the result of the one before. A result that is used elsewhere too ends a row."""

    def down(x):
        for _ in range(10):
            x = below(x)
        return x

    def twice(x):
        return down(down(x))

    def apart(x):
        half = down(x)
        return down(half) + 0.0 * half

    x = 0.3
    for _ in range(20):
        x = np.nextafter(x, -np.inf)
    for function, calls in ((twice, 1), (apart, 2)):
        read = compute_once(function)
        assert str(jax.make_jaxpr(read)(0.3)).count("nextafter") == calls
        assert float(jax.jit(read)(0.3)) == x
        assert float(jax.jit(jax.jacfwd(read))(0.3)) == float(jax.jit(jax.grad(read))(0.3)) == 3.0**20


def test_numbers_that_are_not_real_are_left_as_they_are():
    def impedance(x):
        z = jnp.sqrt(x * (1 + 2j)) * jnp.exp(1j * x)
        return jnp.real(z * z + z), jnp.imag(z - 1 / z)

    found = jax.jit(compute_once(impedance))(jnp.asarray([0.3, 2.0]))
    np.testing.assert_allclose(found, impedance(jnp.asarray([0.3, 2.0])), rtol=1e-15)
