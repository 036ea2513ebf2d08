"""A program that computes once what it is made of has the same values, and fewer operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearance_jax._compile.barriers import barrier
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


@pytest.mark.parametrize(("directions", "more"), [(1, 2.0), (3, 1.5)])
def test_work_for_arrays_side_by_side_is_done_once(directions, more):
    """As derivatives of a field: XLA gives each of them a kernel."""

    def values(x):
        a, b = x[0], x[1]
        for k in range(40):
            a, b = a * b + 0.1 * k, a - 0.5 * b * b
        return [a + 0.1 * k * b for k in range(8)]

    def side_by_side(x):
        along = jax.vmap(lambda d: jax.jvp(values, (x,), (d,)), out_axes=(None, 0))
        rows = zip(*along(jnp.ones((directions, 2)) * jnp.arange(1.0, directions + 1.0)[:, None]), strict=True)
        return jnp.stack([jnp.concatenate([value[None], rates]) for value, rates in rows], 1)

    def looped(x):
        return jax.lax.fori_loop(0, 3, lambda _, x: x + side_by_side(x[0, :2]), x)

    def operations(function):
        return busiest_loop(jax.jit(function).lower(jnp.ones((1 + directions, 8))).compile().as_text())

    written = busiest_loop(jax.jit(looped).lower(jnp.ones((1 + directions, 8))).as_text(dialect="hlo", debug_info=True))
    assert operations(compute_once(looped)) <= more * written
    assert operations(looped) > 3 * written  # or the test above shows nothing


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
        within = compute_once(jax.grad(function))
        assert float(jax.jit(within)(0.3)) == 3.0**20
        # Each call has a rule of its own, and whether they are the same is not known.
        with pytest.raises(TypeError):
            jax.jacfwd(read)(0.3)
    halved = jax.jit(lambda x: jnp.sin(x / 2))

    def again(x):
        for _ in range(10):
            x = halved(x)
        return x

    read = compute_once(again)
    assert str(jax.make_jaxpr(read)(0.3)).count("sin ") == 1
    np.testing.assert_allclose(jax.grad(read)(0.3), jax.grad(again)(0.3), rtol=1e-14)


def unlike(what):
    """Ten calls in a row that differ in nothing that a text of their programs shows."""
    made = []
    for k in range(10):
        weights = jnp.asarray([1.0, 0.1 * k])
        if what == "constants":
            made.append(jax.jit(lambda x, w=weights: w * x + w[::-1]))
        elif what == "constants in a loop":
            step = jax.jit(lambda x, w=weights: jax.lax.scan(lambda x, _: (x * w + 0.1, None), x, None, 3)[0])
            made.append(step)
        else:
            python = lambda x, k=k: np.cos(k * x)  # noqa: E731
            made.append(jax.jit(lambda x, f=python: jax.pure_callback(f, x, x, vmap_method="sequential")))

    def through(x):
        for call in made:
            x = call(x)
        return x

    return through


@pytest.mark.parametrize("what", ["constants", "constants in a loop", "callbacks"])
def test_calls_of_unlike_programs_are_no_loop(what):
    function, x = unlike(what), jnp.array([0.3, 0.7])
    np.testing.assert_allclose(jax.jit(compute_once(function))(x), jax.jit(function)(x), rtol=1e-14)


def test_calls_that_begin_with_a_number_known_beforehand():
    grown = jax.jit(lambda x: x + 0.1 * jnp.sin(x))

    def function(x):
        start = jnp.asarray(1.0)
        for _ in range(10):
            start = grown(start)
        return start * x

    np.testing.assert_allclose(jax.jit(compute_once(function))(0.4), jax.jit(function)(0.4), rtol=1e-14)


def test_calls_within_calls_are_read_once():
    """Reading them took twice as long for every level: of thirty it did not end."""
    call = jax.jit(chain)
    for _ in range(30):
        call = jax.jit(lambda x, f=call: 0.4 * f(x) + 0.5 * f(x))
    jax.make_jaxpr(compute_once(call))(jnp.ones(2))


def test_numbers_that_are_not_real_are_left_as_they_are():
    def impedance(x):
        z = jnp.sqrt(x * (1 + 2j)) * jnp.exp(1j * x)
        return jnp.real(z * z + z), jnp.imag(z - 1 / z)

    found = jax.jit(compute_once(impedance))(jnp.asarray([0.3, 2.0]))
    np.testing.assert_allclose(found, impedance(jnp.asarray([0.3, 2.0])), rtol=1e-15)


def test_a_sum_ends_its_kernel():
    """XLA computes anew, after a loop within a kernel, what the kernel has computed before, that loop included."""

    def summed(a, b):
        for _ in range(5):
            rows = a * jnp.arange(1.0, 17.0) + b
            a, b = jnp.sum(rows) * 1e-2 + b, jnp.max(rows * rows) * 1e-3 - a
        return a, b

    program = jax.make_jaxpr(compute_once(summed))(0.3, 0.7).jaxpr
    loops = [e for e in program.eqns if e.primitive.name in ("reduce_sum", "reduce_max")]
    users = [[e.primitive.name for e in program.eqns if loop.outvars[0] in e.invars] for loop in loops]
    assert len(loops) == 10
    assert [set(names) for names in users] == [{barrier.name}] * 10
    plain = jax.make_jaxpr(summed)(0.3, 0.7).jaxpr
    assert barrier.name not in {e.primitive.name for e in plain.eqns}
