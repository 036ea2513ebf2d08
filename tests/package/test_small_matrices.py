"""Small matrices in batches of batches: values as of each alone, and no kernel with much work."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearance_jax._basis.small_matrices import LITTLE, small_eigh, small_inverse

SHAPES = [(3, 3), (7, 3, 3), (5, 200, 4, 4), (2, 3, 26, 12, 12)]


def matrices(shape: tuple[int, ...]) -> jnp.ndarray:
    """Symmetric ones far from singular."""
    a = np.random.default_rng(0).normal(size=shape)
    return jnp.asarray(a + np.swapaxes(a, -1, -2) + 20 * np.eye(shape[-1]))


def batched(function, shape):
    """The function over all but the last two axes."""
    for _ in shape[2:]:
        function = jax.vmap(function)
    return function


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_values_in_batches_are_those_of_each_alone(shape):
    given = matrices(shape)
    values, vectors = batched(small_eigh, shape)(given)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(given), rtol=1e-12)
    rebuilt = np.einsum("...ij,...j,...kj->...ik", vectors, values, vectors)
    np.testing.assert_allclose(rebuilt, given, rtol=0, atol=1e-12)
    inverse = batched(small_inverse, shape)(given)
    np.testing.assert_allclose(inverse @ given, np.broadcast_to(np.eye(shape[-1]), shape), rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_no_kernel_gets_much_work(shape):
    def sizes(jaxpr):
        for equation in jaxpr.eqns:
            if equation.primitive.name == "eigh":
                yield np.prod(equation.invars[0].aval.shape[:-2]) * shape[-1] ** 3
            for inner in jax.tree.leaves(list(equation.params.values()), is_leaf=lambda x: hasattr(x, "eqns")):
                inner = getattr(inner, "jaxpr", inner)
                if hasattr(inner, "eqns"):
                    yield from sizes(inner)

    found = list(sizes(jax.make_jaxpr(batched(small_eigh, shape))(matrices(shape)).jaxpr))
    assert found
    assert max(found) <= LITTLE
