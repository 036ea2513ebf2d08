"""Whether solved motions, also those of a batch, stay within the validity of their contact laws."""

from jaxtyping import Array

from clearance_jax.solve.law_validity import ValidityWarning, asked_of_laws
from clearance_jax.solve.solution import Solution

__all__ = ["ValidityWarning", "within_validity"]


def within_validity(solution: Solution) -> dict[str, Array]:
    """By joint, whether its normal law held at every sample of a motion (a flag; of a batch one for each motion).
    Joints whose law says nothing of its validity are left out. What happens between samples is not seen.

    **Arguments:** `solution`: of `cj.simulate`.
    """
    return {name: deepest <= limit for name, deepest, limit, _ in asked_of_laws(solution)}
