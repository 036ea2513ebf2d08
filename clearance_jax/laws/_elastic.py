"""The power law that the elastic part of most normal laws shares."""

from clearance_jax._numerics import Real, positive_power, power_three_halves
from clearance_jax._types import Number
from clearance_jax.laws._base import AbstractStiffness, number


def elastic_force(stiffness: Number | AbstractStiffness, exponent: Number | None, penetration: Real) -> Real:
    """F = K max(d, 0)^n [N]; `exponent=None` is n = 3/2 at the price of a square root."""
    if exponent is None:
        return number(stiffness) * power_three_halves(penetration)
    return number(stiffness) * positive_power(penetration, number(exponent))


def elastic_energy(stiffness: Number | AbstractStiffness, exponent: Number | None, penetration: Real) -> Real:
    """The integral of `elastic_force`, K max(d, 0)^(n+1) / (n+1) [J]."""
    if exponent is None:
        return 0.4 * number(stiffness) * penetration * power_three_halves(penetration)
    higher = number(exponent) + 1
    return number(stiffness) * positive_power(penetration, higher) / higher
