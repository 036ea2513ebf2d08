"""Until when a derivative means anything, as the report predicts it from how neighbouring motions part, against the
time from which the derivatives of 64 motions within the scatter have a signal-to-noise ratio below 3 for good.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.analysis.scatter import horizon_of, neighbours
from clearance_jax.analysis.trust import THRESHOLDS
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run
from experiments.common import output, table
from experiments.trust.scenes import NAME, Numbers, scene

RTOL = 1e-8
SCATTERS = (1e-2, 1e-3)
SAMPLED = 64
DRAWS = 16
SEEDS = {"report": 0, "measured": 1}
END = 0.6
TIMES = 401
NOISE = 3.0
FACTOR = 1.5
"""How far the predicted horizon may be from the measured one."""

CHAOTIC = {
    # `TrustThresholds.spread` was chosen with all of these in view, so none of them is a test of that number.
    "A1": Numbers(1e-3, 1e-3, 20, 0.05),
    "A2": Numbers(1e-3, 2e-3, 20, 0.2),
    "A3": Numbers(1e-3, 5e-4, 30, 0.1),
    "A4": Numbers(5e-4, 1e-3, 20, 0.05, speed=0.03),
    "B1": Numbers(2e-3, 1.5e-3, 15, 0.1, speed=0.1),
    "B2": Numbers(1e-3, 1.2e-3, 25, 0.1),
    "B3": Numbers(8e-4, 1e-3, 18, 0.05),
    "B4": Numbers(1.5e-3, 1e-3, 25, 0.02, speed=0.08),
    "B5": Numbers(1e-3, 1.5e-3, 22, 0.1, 9.81),
    "B6": Numbers(1e-3, 7e-4, 28, 0.05, speed=0.1),
    "B7": Numbers(6e-4, 8e-4, 30, 0.1, speed=0.02),
}
REGULAR = {
    "R1, periodic": Numbers(1e-3, 1e-3, 20, 50),
    "R2, periodic": Numbers(1e-3, 2e-3, 20, 20),
    "R3, resting": Numbers(1e-3, 3e-4, 20, 10, 9.81, 0.0),
    "R4, periodic": Numbers(1e-3, 1e-3, 20, 100),
    "R5, periodic": Numbers(5e-4, 1e-3, 30, 100),
    "R6, bouncing to rest": Numbers(1e-3, 1e-4, 20, 0.5, 9.81, 0.0),
}


class Horizon(NamedTuple):
    """Exponent [1/s], impacts, and horizons [s]: predicted by the report, by the nominal motion alone, classical, and
    measured; the last is the end where the derivatives are good until then.
    """

    scene: str
    scatter: float
    chaotic: bool
    exponent: float
    impacts: int
    predicted: float
    nominal: float
    classical: float
    measured: float

    @property
    def factor(self) -> float:
        """How far prediction and measurement are apart, neither counted beyond the end."""
        a, b = min(self.predicted, END), self.measured
        return max(a / b, b / a)


@eqx.filter_jit
def derivatives(mechanism, points, times):
    """Derivative of the pin's position by the clearance at the times, for every clearance in `points`."""

    def at(c):
        changed = cj.replace(mechanism, {NAME: c})
        how = settings_of(changed, times[-1], {"save_at": times, "rtol": RTOL})
        return run(changed, times[-1], how).state("guide")

    return jax.vmap(lambda c: jax.jvp(at, (c,), (jnp.ones_like(c),))[1])(points)


def drawn(clearance: float, scatter: float, count: int, seed: str) -> np.ndarray:
    return clearance * (1 + scatter * np.random.default_rng(SEEDS[seed]).standard_normal(count))


def measured(mechanism: cj.Mechanism, clearance: float, scatter: float) -> float:
    """When the signal-to-noise ratio of the derivative falls below `NOISE` for good."""
    times = np.linspace(0, END, TIMES)
    points = drawn(clearance, scatter, SAMPLED, "measured")
    slopes = np.asarray(derivatives(mechanism, jnp.asarray(points), jnp.asarray(times)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(slopes.mean(0)) / slopes.std(0, ddof=1)
    (good,) = np.nonzero(~(ratio < NOISE))
    return float(times[min(good[-1] + 1, TIMES - 1)])


def horizon(name: str, numbers: Numbers, scatter: float) -> Horizon:
    limit = THRESHOLDS.spread
    mechanism, c = scene(numbers), numbers.clearance
    points = np.concatenate([[c], drawn(c, scatter, DRAWS, "report")])[:, None]
    end, sigma = jnp.asarray(END), jnp.asarray([scatter * c])
    how = settings_of(mechanism, END, {"rtol": RTOL})
    times, spread, touches = neighbours(mechanism, (NAME,), jnp.asarray(points), sigma, end, how)
    times, spread = np.asarray(times), np.asarray(spread)
    exponent, predicted = horizon_of(times, np.sqrt(np.mean(spread**2, axis=0)), limit)
    nominal = horizon_of(times, spread[0], limit)[1]
    # The classical estimate: from the scatter to the size of the play, at the exponent's rate.
    classical = np.log(1 / scatter) / exponent if exponent * END > 1 else np.inf
    found = measured(mechanism, c, scatter)
    impacts = int(touches[0].count[0])
    return Horizon(name, scatter, name in CHAOTIC, exponent, impacts, predicted, nominal, float(classical), found)


def horizons(quick: bool) -> list[Horizon]:
    chosen = {**CHAOTIC, **REGULAR}
    names = ("A1", "B1", "R1, periodic") if quick else chosen
    rows = [horizon(name, chosen[name], scatter) for scatter in SCATTERS for name in names]
    head = (
        "scene",
        "scatter",
        "exponent [1/s]",
        "impacts",
        "horizon [s]",
        "nominal alone",
        "ln(L/s)/exponent",
        "measured",
    )
    head = (*head, "factor")
    table(
        head,
        [
            (
                r.scene,
                r.scatter,
                f"{r.exponent:.1f}",
                r.impacts,
                *(f"{x:.3f}" for x in (r.predicted, r.nominal, r.classical)),
                "end" if r.measured == END else f"{r.measured:.3f}",
                f"{r.factor:.2f}",
            )
            for r in rows
        ],
        output(f"trust_horizon{'_quick' if quick else ''}.md"),
    )
    return rows
