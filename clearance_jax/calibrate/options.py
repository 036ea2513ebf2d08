"""The options of a fit, and the loss functions, which reduce the weight of residuals far larger than the noise.

With a residual r in units of its deviation and z = (r / C)^2 the fit minimises the sum of C^2 rho(z) / 2. Each loss has
the C at which it loses 5 % of the information where the noise is normal (Holland and Welsch 1977,
doi 10.1080/03610927708827533, for Huber's and Cauchy's).
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from clearance_jax._basis.module import Module
from clearance_jax.errors import quote, unknown_name, wrong_value
from clearance_jax.parameters import describe

LossName = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]


class Loss(NamedTuple):
    """A loss: its `scale` C, and `rho` of z with its first and second derivative, shape (3, *z's)."""

    scale: float
    rho: Callable[[np.ndarray], np.ndarray]

    def influence(self, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """psi, the derivative of the loss by each residual, and the derivative of psi."""
        z = (residuals / self.scale) ** 2
        _, first, second = self.rho(z)
        return residuals * first, first + 2 * z * second

    def normal_squares(self) -> tuple[float, float]:
        """The mean of psi^2 for normal residuals, and the freedom of a chi-square with the same relative scatter."""
        noise = np.linspace(-8.0, 8.0, 4001)
        weights = np.exp(-(noise**2) / 2)
        squares = self.influence(noise)[0] ** 2
        mean = np.average(squares, weights=weights)
        return float(mean), float(2 * mean**2 / np.average((squares - mean) ** 2, weights=weights))

    def cost(self, residuals: np.ndarray) -> float:
        """The sum of the losses, which the fit minimises."""
        return float(0.5 * self.scale**2 * np.sum(self.rho((residuals / self.scale) ** 2)[0]))


def _soft_l1(z: np.ndarray) -> np.ndarray:
    root = np.sqrt(1 + z)
    return np.stack([2 * (root - 1), 1 / root, -0.5 / root**3])


def _huber(z: np.ndarray) -> np.ndarray:
    root = np.sqrt(np.maximum(z, 1.0))
    outside = z > 1
    return np.stack([np.where(outside, 2 * root - 1, z), 1 / root, np.where(outside, -0.5 / root**3, 0.0)])


LOSSES: dict[str, Loss] = {
    "linear": Loss(1.0, lambda z: np.stack([z, np.ones_like(z), np.zeros_like(z)])),
    "soft_l1": Loss(1.2871, _soft_l1),
    "huber": Loss(1.3450, _huber),
    "cauchy": Loss(2.3849, lambda z: np.stack([np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2])),
    "arctan": Loss(2.5714, lambda z: np.stack([np.arctan(z), 1 / (1 + z**2), -2 * z / (1 + z**2) ** 2])),
}


MOST_STARTS, MOST_MOTIONS = 1000, 1_000_000


class FitOptions(Module):
    """The options of a fit: the loss of a residual, and the starts of the search."""

    loss: LossName = describe(
        "what a large residual costs: `linear` is least squares; with the others outliers count less",
        '"huber"',
        default="linear",
        static=True,
    )
    starts: int | None = describe(
        "number of starts: the first at the scene's values, the others scattered over the bounds",
        "5",
        "one, and up to seven more while the residuals do not look like noise",
        default=None,
        least=1,
        most=MOST_STARTS,
        static=True,
    )
    seed: int = describe("of the scattered starts", "1", default=0, static=True)
    most: int = describe(
        "trial points after which a search gives up", "200", default=100, least=2, most=MOST_MOTIONS, static=True
    )


def fit_options(loss: Any, starts: Any, seed: Any, most: Any) -> FitOptions:
    """The options, checked. **Raises** `ClearanceError` naming what is wrong."""
    if loss not in LOSSES:
        raise unknown_name(f"There is no loss {quote(loss)}.", str(loss), LOSSES, "loss")
    limits = {"seed": (seed, 0, 10**9), "most": (most, 2, MOST_MOTIONS)}
    limits |= {} if starts is None else {"starts": (starts, 1, MOST_STARTS)}
    for name, (value, low, high) in limits.items():
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise wrong_value(f"`{name}`", f"a whole number from {low} to {high}", value)
    return FitOptions(loss, starts, seed, most)
