"""How many sectors a sleeve needs: so many that the largest depth is that of the wear itself, not of its mean values.

A sector's depth is the mean over its width w. Of a patch that stands still, a to either side and of parabolic pressure,
the largest mean is off by (w / a)^2 / 12 where a sector lies in its middle, and by (w / a)^2 / 3 where two sectors meet
there. Here it is that of the wear of one whole cycle on the round sleeve, where patches are narrowest: they get wider
as the sleeve wears. Forces and volumes are right with any number of sectors.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from clearance_jax.joints import Sections
from clearance_jax.wear.contacts import Contacts
from clearance_jax.wear.laws import AbstractWearLaw, SlidingState
from clearance_jax.wear.pressure import AbstractPressure

# Largest relative error of the largest depth that one cycle wears off. A given number of sectors is doubted a little
# beyond it: with other sectors the motion has other last digits.
OFF, DOUBTED = 0.01, 0.011
# The least number of sectors; the step between numbers, so that similar joints have the same one; the most.
USUAL, STEP, MOST = 360, 60, 3600
# Places around the sleeve at which wear is computed, and offsets of the sectors' grid that are tried.
PLACES, BEGINS = 7200, 16
NARROW = 1.5 * 2 * np.pi / PLACES
# Nodes in time that are computed together.
TOGETHER = 64


class SectorsWarning(UserWarning):
    """A warning that the sectors are too wide for the patch on which a pin presses: depths are too small, and lives too
    long.
    """


def wear_round(
    seen: Contacts, sleeve: Sections, law: AbstractWearLaw, pressure: AbstractPressure, of: str = "sleeve"
) -> Float[np.ndarray, "sections places"]:
    """What these contacts would wear off a round sleeve, or its pin, at `PLACES` around it [m], up to a factor."""
    turn = 0.0 if of == "sleeve" or seen.turn is None else np.asarray(seen.turn)[:, None]
    loads, halves = _patches(seen, sleeve, pressure)
    angles = np.asarray(seen.angle) - turn
    place, worn = 2 * np.pi * (np.arange(PLACES) + 0.5) / PLACES, np.zeros((loads.shape[1], PLACES))
    for section in range(loads.shape[1]):
        # Patches are widened so that none lies between two places; they are still too narrow for any sectors.
        load, half = loads[:, section], np.maximum(halves[:, section], NARROW)
        rubs = np.flatnonzero(load > 0)
        # Padded with the last node at zero weight, so that all have one shape.
        for first in range(0, len(rubs), TOGETHER):
            some = np.pad(rubs[first : first + TOGETHER], (0, max(0, first + TOGETHER - len(rubs))), mode="edge")
            weight = np.asarray(seen.weight)[some] * (np.arange(TOGETHER) < len(rubs) - first)
            beside = place[None] - angles[some, section, None]
            x = (beside - 2 * np.pi * np.round(beside / (2 * np.pi))) / half[some, None]
            shape = np.where(np.abs(x) < 1, np.asarray(pressure.shape(np.clip(x, -1, 1))), 0.0)
            # The pressures bear the force but for a factor, which matters to laws that are not linear.
            high = load[some] / (half[some] * float(sleeve.geometry.sleeve_radius))
            columns = (np.asarray(v)[some, section, None] for v in (seen.speed, seen.traction))
            at = SlidingState(*map(jnp.asarray, (high[:, None] * shape, *columns, np.asarray(seen.time)[some, None])))
            worn[section] += weight @ np.where(shape > 0, np.asarray(law.rate(at)), 0.0)
    return worn


def surely_fine(seen: Contacts, sleeve: Sections, pressure: AbstractPressure, sectors: int) -> bool:
    """Whether the sectors suffice even for the narrowest patch at rest: a quick test before the whole one."""
    loads, halves = _patches(seen, sleeve, pressure)
    narrowest = halves[loads > 0].min(initial=np.inf)
    return bool((2 * np.pi / sectors / narrowest) ** 2 / 3 <= OFF) if narrowest > 0 else False


def _patches(seen: Contacts, sleeve: Sections, pressure: AbstractPressure) -> tuple[np.ndarray, np.ndarray]:
    """Forces per length [N/m], and half angles of their patches [rad], (times, sections)."""
    loads = np.asarray(seen.force) / np.asarray(sleeve.lengths)
    halves = jax.vmap(jax.vmap(lambda load: pressure.half_angle(sleeve.geometry, load)))(jnp.asarray(loads))
    return loads, np.asarray(halves)


def missed_part(worn: Float[np.ndarray, "sections places"], sectors: int) -> float:
    """The relative error of the largest depth with so many sectors, for the worst offset of their grid."""
    worst, width = 0.0, PLACES / sectors
    for profile in worn:
        if profile.max() > 0:
            whole = np.concatenate([[0.0], np.cumsum(np.tile(profile, 2))])
            # Some grids have an edge near the deepest place, which of a single patch is the worst.
            near = (profile.argmax() + 0.5 + np.linspace(-1, 1, BEGINS + 1)) / width % 1
            begins = np.concatenate([near, np.arange(BEGINS) / BEGINS])
            edges = width * (begins[:, None] + np.arange(sectors + 1))
            means = np.diff(np.interp(edges, np.arange(len(whole)), whole), axis=1) / width
            worst = max(worst, 1 - float(means.max(axis=1).min() / profile.max()))
    return worst


def fewest(worn: Float[np.ndarray, "sections places"], least: int = USUAL) -> int:
    """The fewest sectors, from `least` on, with an error of the largest depth of at most `OFF`; or `MOST`."""
    return next((n for n in range(least, MOST, STEP) if missed_part(worn, n) <= OFF), MOST)


def doubt(worn: Float[np.ndarray, "sections places"], sectors: int, joint: str) -> str:
    """A warning of too few sectors; empty if they suffice."""
    off = missed_part(worn, sectors)
    if off <= DOUBTED:
        return ""
    would = fewest(worn)
    rest = "would do" if missed_part(worn, would) <= OFF else "are the most, and too few as well"
    return (
        f"{sectors} sectors of {360 / sectors:.3g} deg are too wide for the patch on which the pin of `{joint}` bears: "
        f"the largest depth of the first cycles is up to {100 * off:.2g} % too small, and a life until that too long; "
        f"in deeper grooves it is less. {would} sectors {rest}."
    )
