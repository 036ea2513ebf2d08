"""Eigenvalues and inverses of small matrices in large batches of lanes.

A LAPACK kernel for a large batch shares its work among threads. If two programs run side by side (`cj.batch` on two
cores), each may wait for ever for threads that the other one holds. So a large batch is cut into small ones.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Largest arithmetic of one kernel call, as a sum of cubes of the matrices' size.
LITTLE = 4096


def _in_small_batches(function: Callable) -> Callable:
    """The same function of a matrix. A batch that is too large for one kernel call is computed in several, in turn."""
    few = jax.custom_batching.custom_vmap(function)

    @few.def_vmap
    def _more(size, batched, matrices):
        at_once = math.prod(matrices.shape[:-2]) * matrices.shape[-1] ** 3 <= LITTLE
        out = few(matrices) if at_once else jax.lax.map(few, matrices)
        return out, jax.tree.map(lambda _: True, out)

    return few


@_in_small_batches
def small_eigh(matrix: Float[Array, "*batch n n"]) -> tuple[Float[Array, "*batch n"], Float[Array, "*batch n n"]]:
    """Eigenvalues and eigenvectors of a small symmetric matrix."""
    eigen = jnp.linalg.eigh(matrix)
    return eigen.eigenvalues, eigen.eigenvectors


@_in_small_batches
def small_inverse(matrix: Float[Array, "*batch n n"]) -> Float[Array, "*batch n n"]:
    """The inverse of a small matrix."""
    return jnp.linalg.inv(matrix)
