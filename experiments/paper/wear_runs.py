"""The runs of joint 5 whose wear is looked at: one on the round sleeve, and a thousand on the sleeve as it wears."""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import wear
from clearance_jax.laws import Material
from experiments.paper.judges import START
from experiments.paper.runs import CLEARANCE, DIAMETRAL, EQ7, JOINT, PLANE, RADIAL, RTOL, SIZES, TABLE1, Reading, scene

MODULI = 2.01e11, 2.06e11
"""Of pin and sleeve, Table 1 [Pa]."""
LENGTH = 50e-3
SPEED, LAST, STEPS = -np.pi, 0.5, 1000
COEFFICIENT = "6e-14 1/Pa"
RUNS, TOLERANCE = 1000, 1e-2
"""How often the paper's one run is taken, and how accurately."""
SECTORS = 360
READINGS = tuple(Reading(PLANE, damping, clearance) for damping in (EQ7, TABLE1) for clearance in (RADIAL, DIAMETRAL))


class Worn(NamedTuple):
    """A run on a sleeve: what rubs, what wears off it, how far the pin is from the middle after the start-up [m], and
    the volume [m^3] that 1000 equal steps find, the paper's Eq. 12.
    """

    seen: wear.Contacts
    wear: wear.Wear
    eccentricity: float
    stepped: float


def rig(reading: Reading) -> cj.Mechanism:
    """Joint 5 as its wear is looked at."""
    size = SIZES[0] * (0.5 if reading.clearance == DIAMETRAL else 1.0)
    m = cj.replace(scene(reading.world, reading.damping), {CLEARANCE: size})
    old: Any = m.joint(JOINT).clearance
    materials = (Material(modulus) for modulus in MODULI)
    numbers = old.radial_clearance, old.pin_radius, old.normal, old.friction
    play = cj.RevoluteClearance(*numbers, None, LENGTH, *materials)
    return m.with_drives({JOINT: cj.drives.ConstantSpeed(SPEED)}).with_clearance(JOINT, play)


def run(mechanism: cj.Mechanism, pressure: wear.AbstractPressure) -> Worn:
    """The motion, and its wear."""
    trace = cj.trace(mechanism, LAST, rtol=RTOL, save_at=STEPS + 1)
    if trace.message:
        raise RuntimeError(trace.message)
    seen, sleeve = wear.contacts(trace, JOINT), wear.sections_of(mechanism, JOINT)
    pin: Any = mechanism.joint(JOINT).clearance
    depth = jnp.zeros(SECTORS) if pin.depth is None else pin.depth
    law = wear.archard(COEFFICIENT)
    found = wear.wear_of(seen, sleeve, law, pressure, depth=depth)
    force, slip = (np.asarray(trace[f"{JOINT}.{name}"]) for name in ("contact_force", "slip_velocity"))
    away = np.linalg.norm(np.asarray(trace[f"{JOINT}.eccentricity"]), axis=1)
    settled = np.linspace(0, 1, STEPS + 1) > START
    stepped = float(law.coefficient) * np.sum(force * np.abs(slip)) * LAST / STEPS
    return Worn(seen, found, float(away[settled].mean()), stepped)


@functools.cache
def first(reading: Reading) -> Worn:
    """The run on the round sleeve, by Hertz's pressures."""
    return run(rig(reading), wear.HertzLine())


def foundation(reading: Reading) -> wear.Foundation:
    """As soft as K d^1.5 of the joint: (2/3) k R c (2 d / c)^1.5 = K d^1.5 / L, d beside c."""
    play: Any = rig(reading).joint(JOINT).clearance
    return wear.Foundation(
        3 * play.normal.stiffness * play.radial_clearance**0.5 / (2**2.5 * play.sleeve_radius * play.length)
    )


@functools.cache
def lived(reading: Reading) -> wear.WearHistory:
    """As many runs one after another as the paper amplifies one by, each on the sleeve as it is by then."""
    law, told = wear.archard(COEFFICIENT), {"sectors": SECTORS, "tolerance": TOLERANCE, "rtol": RTOL}
    return wear.simulate_wear(wear.WearModel(rig(reading), JOINT, law, foundation(reading), LAST), RUNS, **told)


@functools.cache
def aged(reading: Reading) -> list[Worn]:
    """The run on the sleeve as it is at first, half-way and in the end."""
    m, depths = rig(reading), lived(reading).depth
    half = np.argmin(np.abs(lived(reading).cycles - RUNS / 2))
    play: Any = m.joint(JOINT).clearance
    sleeves = [play.worn(depth) for depth in (depths[0], depths[half], depths[-1])]
    return [run(m.with_clearance(JOINT, sleeve), foundation(reading)) for sleeve in sleeves]


def until(reading: Reading, part: float) -> np.ndarray:
    """What of the first run has worn off after a part of it [m]."""
    m, seen = rig(reading), first(reading).seen
    kept = jnp.where(seen.time <= part * LAST, seen.weight, 0.0)
    part_of_it, law = seen._replace(weight=kept), wear.archard(COEFFICIENT)
    found = wear.wear_of(part_of_it, wear.sections_of(m, JOINT), law, wear.HertzLine(), depth=jnp.zeros(SECTORS))
    return np.asarray(found.depth[0])


def clearance(reading: Reading) -> float:
    return float(cj.parameters(rig(reading))[CLEARANCE].value)
