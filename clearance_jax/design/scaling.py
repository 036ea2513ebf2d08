"""A program in logarithms, in which costs and errors are nearly linear, as they are nearly powers of clearances.

A design that cannot be simulated gets large finite numbers there, so that methods go on.
"""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program
from clearance_jax.design.slopes import followed

# The share of its bound below which a limit counts as this share.
FLOOR = 1e-3
# Points that differ by less in logarithms are the same; a search stands still after so many repeats.
ROUND_OFF, PATIENCE = 1e-11, 2


class StandsStill(Exception):
    """Raised if a search asks for the same point again and again."""


class ScaledProgram:
    """A `program` in logarithms of its variables, of value over bound of its limits, and of its objective (if that is
    not positive, it is divided by its size at the `start` instead).

    **Arguments:** `gradient`: whether the start is evaluated with gradients.
    """

    def __init__(self, program: Program, start: np.ndarray, gradient: bool = True):
        self.program = program
        self.bounds = np.log(program.lower), np.log(program.upper)
        self.start = np.clip(np.log(start), *self.bounds)
        first = program.at(np.exp(self.start), gradient)
        self.positive = first.objective > 0
        self.size = max(abs(first.objective), 1e-300)
        self._last, self._still = self.start, 0

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and limits. **Raises** `StandsStill`."""
        self._move(z)
        return self.values_of(self.program.at(np.exp(z)))

    def slopes(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and limits, and their derivatives. **Raises** `StandsStill`, `UselessSlopes`."""
        self._move(z)
        return self.slopes_of(followed(self.program, self.program.at(np.exp(z), True)))

    def values_of(self, point: Evaluation) -> tuple[float, np.ndarray]:
        """Objective and limits of an evaluated point."""
        return self._objective(point), self._limits(point)

    def _move(self, z: np.ndarray) -> None:
        """Count repeats of a point. **Raises** `StandsStill` at the third one that differs by round-off only."""
        if np.array_equal(z, self._last):
            return
        self._still = self._still + 1 if np.allclose(z, self._last, rtol=0.0, atol=ROUND_OFF) else 0
        self._last = np.array(z)
        if self._still >= PATIENCE:
            raise StandsStill

    def fresh_slopes(self, z: np.ndarray, samples: int, seed: int) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """`slopes` by so many fresh samples of manufacture."""
        return self.slopes_of(self.program.fresh(np.exp(z), samples, seed))

    def slopes_of(self, point: Evaluation) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and limits of an evaluated point, and their derivatives."""
        assert point.gradient is not None
        assert point.jacobian is not None
        over = max(point.objective, 1e-12 * self.size) if self.positive else self.size
        ratio = np.maximum(1 + point.limits, FLOOR)
        gradient, jacobian = point.gradient * point.x / over, point.jacobian * point.x / ratio[:, None]
        return self._objective(point), self._limits(point), np.nan_to_num(gradient), np.nan_to_num(jacobian)

    def _objective(self, point: Evaluation) -> float:
        share = point.objective / self.size
        return float(np.nan_to_num(np.log(max(share, 1e-12)) if self.positive else share, nan=1e2))

    def _limits(self, point: Evaluation) -> np.ndarray:
        return np.nan_to_num(np.log(np.maximum(1 + point.limits, FLOOR)), nan=1e1) + self.program.inside
