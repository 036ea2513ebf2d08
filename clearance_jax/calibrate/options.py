"""The options of a fit."""

from typing import Any

from clearance_jax._basis.module import Module
from clearance_jax.calibrate.losses import LOSSES, LossName
from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.parameters import describe

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
        raise ClearanceError(f"There is no loss {quote(loss)}. {suggest(str(loss), LOSSES)}")
    limits = {"seed": (seed, 0, 10**9), "most": (most, 2, MOST_MOTIONS)}
    limits |= {} if starts is None else {"starts": (starts, 1, MOST_STARTS)}
    for name, (value, low, high) in limits.items():
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ClearanceError(f"`{name}` must be a whole number from {low} to {high}, but it is {quote(value)}.")
    return FitOptions(loss, starts, seed, most)
