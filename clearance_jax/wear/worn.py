"""What wears off a sleeve, or its pin, along a motion: depths by section and sector, and how many sectors that takes.

The depth of a sector is the mean over its width w, so the largest depth is too small. Below a resting patch of the half
width a with parabolic pressure it is too small by (w / a)^2 / 12 where a sector lies in the middle of the patch, and by
(w / a)^2 / 3 where two sectors meet there. The number of sectors is chosen so that this error is small for the wear of
one whole cycle on the round sleeve, where patches are narrowest: they get wider as the sleeve wears. Forces and volumes
are right with any number of sectors.
"""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.analysis.rubbing import Contacts, contacts, largest_swing, pin_of, sections_of
from clearance_jax.errors import ClearanceError, WearFailure, wrong_value
from clearance_jax.joints import Sections
from clearance_jax.solve.drivers.trace import Trace
from clearance_jax.units import format_quantity
from clearance_jax.wear.laws import AbstractWearLaw, SlidingState
from clearance_jax.wear.pressure import AbstractPressure, HertzLine, Section, SectionLoad

# The part of the force that the pressures of the sectors may miss: round-off and the tolerance of a search. Forces that
# are fainter than this part of the largest, as just after a touch, count as if they were as large.
MISSED = FAINT = 1e-6
# Half steps are cut, into PARTS at most, until a patch moves between nodes by at most JUMPED times the sum of a sector
# and its own half width.
PARTS, JUMPED = 64, 0.25
SURFACES = ("sleeve", "pin")
# Largest half angle of a patch that counts as flat [rad].
WIDEST = 0.5 * np.pi
# Largest relative error of the largest depth of one cycle. Given sectors raise a warning a little later: those chosen
# by OFF must not, though with other sectors the motion has other last digits.
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
        # Patches are widened so that each covers a place. They still need more sectors than `MOST`.
        load, half = loads[:, section], np.maximum(halves[:, section], NARROW)
        rubs = np.flatnonzero(load > 0)
        # Padded with the last node at zero weight, so that all have one shape.
        for first in range(0, len(rubs), TOGETHER):
            some = np.pad(rubs[first : first + TOGETHER], (0, max(0, first + TOGETHER - len(rubs))), mode="edge")
            weight = np.asarray(seen.weight)[some] * (np.arange(TOGETHER) < len(rubs) - first)
            beside = place[None] - angles[some, section, None]
            x = (beside - 2 * np.pi * np.round(beside / (2 * np.pi))) / half[some, None]
            shape = np.where(np.abs(x) < 1, np.asarray(pressure.shape(np.clip(x, -1, 1))), 0.0)
            # `shape` is scaled to 1 at its largest, so the sum of these pressures is the force times a factor. A linear
            # law only scales the wear by it, others change its shape a little.
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
    return loads, np.asarray(_halves(jnp.asarray(loads), sleeve, pressure))


def _halves(loads: Array, sleeve: Sections, pressure: AbstractPressure) -> Array:
    return jax.vmap(jax.vmap(lambda load: pressure.half_angle(sleeve.geometry, load)))(loads)


def missed_part(worn: Float[np.ndarray, "sections places"], sectors: int) -> float:
    """The relative error of the largest depth with so many sectors, for the worst offset of their grid."""
    worst, width = 0.0, PLACES / sectors
    for profile in worn:
        if profile.max() > 0:
            whole = np.concatenate([[0.0], np.cumsum(np.tile(profile, 2))])
            # Offsets of the grid in sectors. Some put an edge near the deepest place, the worst case of a single patch.
            near = (profile.argmax() + 0.5 + np.linspace(-1, 1, BEGINS + 1)) / width % 1
            offsets = np.concatenate([near, np.arange(BEGINS) / BEGINS])
            edges = width * (offsets[:, None] + np.arange(sectors + 1))
            means = np.diff(np.interp(edges, np.arange(len(whole)), whole), axis=1) / width
            worst = max(worst, 1 - float(means.max(axis=1).min() / profile.max()))
    return worst


def fewest(worn: Float[np.ndarray, "sections places"]) -> int:
    """The fewest sectors, from `USUAL` on, with an error of the largest depth of at most `OFF`; or `MOST`."""
    return next((n for n in range(USUAL, MOST, STEP) if missed_part(worn, n) <= OFF), MOST)


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


class Wear(Module):
    """What is worn off a sleeve, or its pin.

    - `angle` (sectors,) [rad], in the sleeve's axes, for a pin in its own; `heights` (sections,): along the sleeve [m].
    - `depth` (sections, sectors) [m]: by how much the sleeve's radius grows, or the pin's shrinks.
    - `volume` [m^3]; `flat_volume` [m^3]: what the law gives if pressures add up to the normal force, as in a narrow
      patch (k F s); `None` for a law that is not linear in pressure, because its volume depends on the patch.
    - `sliding` [m]: how far the pin has slid while it was pressed; `half_angle` [rad]: that of the widest patch.
    - `relief`: the largest share of its pressure that a sector would lose if it alone wore so. The profile is kept
      constant during the motion, so this should be well below 1. It is 0 for pressures that do not depend on the worn
      profile.
    """

    angle: Float[Array, " sectors"]
    heights: Float[Array, " sections"]
    depth: Float[Array, "sections sectors"]
    volume: Float[Array, ""]
    flat_volume: Float[Array, ""] | None
    sliding: Float[Array, ""]
    half_angle: Float[Array, ""]
    relief: Float[Array, ""]

    @property
    def deepest(self) -> Array:
        """The largest depth [m]."""
        return jnp.max(self.depth)

    def __repr__(self) -> str:
        deepest, sliding = (format_quantity(float(length), "m") for length in (self.deepest, self.sliding))
        return f"worn off: {1e9 * float(self.volume):.6g} mm^3, {deepest} at most, by {sliding} of sliding"


def wear(
    trace: Trace,
    joint: str,
    law: AbstractWearLaw,
    pressure: AbstractPressure | None = None,
    *,
    of: str = "sleeve",
    depth: Array | None = None,
    sectors: int | None = None,
    before: Any = 0.0,
) -> Wear:
    """What a motion wears off a joint's sleeve, or its pin. The motion itself is not changed by this wear.

    **Arguments:**

    - `trace`: of the motion; `joint`: its name.
    - `law`: of wear, for instance `archard("6e-14 1/Pa")`.
    - `pressure`: how a force spreads; by default Hertz's line contact, which is for a round sleeve. A worn one needs a
      `Foundation`.
    - `of`: the surface that wears, "sleeve" or "pin". Each has a law of its own. A pin wears in its own axes, in the
      sections of the sleeve. A worn pin changes neither pressures nor motion.
    - `depth` (sectors,) or (sections, sectors) [m]: the earlier wear of the sleeve, on which a `Foundation` depends; by
      default that of the joint, or none, in so many `sectors` (by default as many as the patches need for an error of
      the largest depth below 1 %, at least 360; a warning says if you give too few).
    - `before`: how long the joint has run before the motion [s], for laws that depend on it.

    **Raises:** `ClearanceError` for a joint that does not wear or lacks a length or a material, for a patch that is too
    wide for a flat one, and if pressures do not add up to the force.
    """
    mechanism = trace.solution.mechanism
    sleeve, depth = sections_of(mechanism, joint), pin_of(mechanism, joint).profile if depth is None else depth
    if pressure is None and depth is not None:
        raise ClearanceError(f"`{joint}` is worn: say how a force spreads, by a `Foundation` on the worn profile.")
    pressure, fixed = pressure or HertzLine(), sectors if depth is None else jnp.asarray(depth).shape[-1]
    seen = _follow(trace, joint, sleeve, pressure, of, fixed or USUAL)
    whole = wear_round(seen, sleeve, law, pressure, of)
    count = fixed or fewest(whole)
    if fixed and (message := doubt(whole, count, joint)):
        warnings.warn(message, SectorsWarning, stacklevel=2)
    if count > (fixed or USUAL):
        seen = _follow(trace, joint, sleeve, pressure, of, count)
    given = jnp.zeros(count) if depth is None else jnp.asarray(depth, float)
    return wear_of(seen, sleeve, law, pressure, of=of, depth=given, before=before)


def _follow(trace: Trace, joint: str, sleeve: Sections, pressure: AbstractPressure, of: str, sectors: int) -> Contacts:
    """Contacts at nodes so close to one another that a patch does not jump over sectors."""
    parts = 1
    while True:
        seen = contacts(trace, joint, parts)
        angle = seen.angle if of == "sleeve" or seen.turn is None else seen.angle - seen.turn[:, None]
        allowed = 2 * np.pi / sectors + _halves(seen.force / sleeve.lengths[None, :], sleeve, pressure)
        swing = float(largest_swing(seen, angle, allowed, parts))
        if swing <= JUMPED or parts >= PARTS:
            return seen
        parts = min(PARTS, parts * 2 ** int(np.ceil(np.log2(swing / JUMPED))))


def wear_of(
    seen: Contacts,
    sleeve: Sections,
    law: AbstractWearLaw,
    pressure: AbstractPressure,
    *,
    of: str = "sleeve",
    depth: Array,
    before: Any = 0.0,
) -> Wear:
    """What known contacts (`contacts`) wear off.

    **Arguments:** `seen`: the contacts; `sleeve`: its sections (`sections_of`); `law`, `pressure`, `of` and `before` as
    of `wear`; `depth`: the earlier wear, (sectors,) or (sections, sectors) [m].
    """
    if of not in SURFACES:
        raise wrong_value("`of`", " or ".join(SURFACES), of)
    depth = jnp.broadcast_to(jnp.atleast_2d(depth), (sleeve.lengths.shape[0], depth.shape[-1]))
    worn, missed = accumulate(seen, sleeve, law, pressure, of, depth, jnp.asarray(before, float))
    _check(worn, float(missed), pressure)
    return worn


def _check(worn: Wear, missed: float, pressure: AbstractPressure) -> None:
    """Raise where pressures are not the force's, or the volume not the law's."""
    if pressure.is_narrow and float(worn.half_angle) > WIDEST:
        raise WearFailure(
            f"The patch of the largest force spreads {np.degrees(float(worn.half_angle)):.0f} deg to either side, "
            "further than a flat patch can. Use a `Foundation`, or look at the force: an impact that no sleeve "
            "survives?"
        )
    if not missed <= MISSED:
        raise WearFailure(
            f"The pressures miss {missed:.1e} of the normal force. A foundation that is too soft lets the pin through "
            "its sleeve: check its `stiffness` [Pa/m]."
        )
    if worn.flat_volume is None:
        return
    # Pressures beside the middle of a patch lean, so that all together exceed the force; those of a flat patch do not.
    volume, flat = float(worn.volume), float(worn.flat_volume)
    lacks, beyond = flat - volume, MISSED * flat
    if lacks > beyond or (pressure.is_narrow and -lacks > beyond):
        text = f"The volume {volume:.9g} m^3 worn off is not that of the law, {flat:.9g} m^3."
        raise ClearanceError(text)


@eqx.filter_jit
def accumulate(
    seen: Contacts,
    sleeve: Sections,
    law: AbstractWearLaw,
    pressure: AbstractPressure,
    of: str,
    depth: Array,
    before: Scalar,
) -> tuple[Wear, Array]:
    """What wears off along a motion, and the largest part of a force that its pressures do not bear."""
    inner, turn = of == "pin", jnp.zeros_like(seen.time) if seen.turn is None else seen.turn
    radius = sleeve.geometry.pin_radius if inner else sleeve.geometry.sleeve_radius
    strongest = jnp.max(seen.force, initial=0.0)
    faintest = jnp.where(strongest > 0, FAINT * strongest, 1.0)

    def section(worn, length, force, angle, speed, traction, place):
        spread = pressure.prepare(Section(sleeve.geometry, worn))

        def add(carry, now):
            depth, relief, missed = carry
            weight, time, turn, force, angle, speed, traction, place = now
            field = spread(SectionLoad(force / length, angle, (place[0], place[1])))
            # The pin bears the same force on a little less of surface.
            means = _turn(field.means, -turn) * (sleeve.geometry.sleeve_radius / radius) if inner else field.means

            def off(mean):
                return law.rate(SlidingState(mean, speed, traction, before + time))

            rate, by_pressure = jax.jvp(off, (means,), (jnp.where(means > 0, 1.0, 0.0),))
            lacks = jnp.abs(field.borne * length - force)
            lacks = jnp.where(force > 0, lacks / jnp.maximum(force, faintest), 0.0)
            # A law may have no slope at no pressure (p^0.5).
            relief = relief + weight * jnp.where(means > 0, by_pressure, 0.0) * pressure.rises
            return (depth + weight * rate, relief, jnp.maximum(missed, lacks)), None

        nodes = seen.weight, seen.time, turn, force, angle, speed, traction, place
        return jax.lax.scan(add, (jnp.zeros_like(worn), jnp.zeros_like(worn), jnp.zeros(())), nodes)[0]

    columns = [jnp.moveaxis(x, 1, 0) for x in (seen.force, seen.angle, seen.speed, seen.traction, seen.place)]
    new, relief, missed = jax.lax.map(lambda row: section(*row), (depth, sleeve.lengths, *columns))
    volume = jnp.sum(new * sleeve.lengths[:, None]) * (2 * np.pi / depth.shape[1] * radius)
    shares = sleeve.lengths / jnp.sum(sleeve.lengths)
    sliding = seen.weight @ jnp.where(seen.force > 0, seen.speed, 0.0) @ shares
    time = jnp.broadcast_to((seen.time + before)[:, None], seen.force.shape)
    # The volume by a linear law is its rate with the force in the place of a pressure.
    flat = jnp.sum(seen.weight[:, None] * law.rate(SlidingState(seen.force, seen.speed, seen.traction, time)))
    largest = jnp.max(seen.force / sleeve.lengths[None, :], initial=0.0)
    half = pressure.half_angle(sleeve.geometry, largest)
    places = jnp.asarray(2 * np.pi * np.arange(depth.shape[1]) / depth.shape[1]), jnp.asarray(sleeve.heights, float)
    worn = Wear(*places, new, volume, flat if law.is_linear else None, sliding, half, jnp.max(relief))
    return worn, jnp.max(missed)


def _turn(means: Float[Array, " sectors"], angle: Scalar) -> Float[Array, " sectors"]:
    """Mean values of sectors, turned by an angle [rad]. A value that comes to lie on two sectors is shared by them."""
    sectors = angle * (means.shape[0] / (2 * np.pi))
    whole = jnp.floor(sectors)
    part = sectors - whole
    near = jnp.roll(means, whole.astype(int))
    return (1 - part) * near + part * jnp.roll(near, 1)
