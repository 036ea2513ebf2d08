"""Wear against closed forms: of forces and slips that are known, and of motions whose wear is known."""

import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws, wear
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Sections
from clearance_jax.laws import Geometry, Material
from clearance_jax.wear import Contacts, Section, SectionLoad, SlidingState

PIN, CLEARANCE, LENGTH = 25e-3, 1e-4, 50e-3
STEEL = Material(2.06e11)


def geometry(pin, clearance, *materials):
    pin, sleeve, clearance, length = (jnp.asarray(x) for x in (pin, pin + clearance, clearance, LENGTH))
    return Geometry(pin, sleeve, clearance, length, *materials, kind="line")


GEOMETRY = geometry(PIN, CLEARANCE, STEEL, STEEL)
SLEEVE = Sections(GEOMETRY, jnp.zeros(1), jnp.asarray([LENGTH]))
FORCE, K = 3000.0, 6e-14
STIFFNESS = 2e13
PRESSURES = {"hertz": wear.HertzLine(), "uniform": wear.Uniform(), "foundation": wear.Foundation(STIFFNESS)}


def pressing(force, angle=-0.7):
    """A pin that a force holds at a wall, at its clearance."""
    force, angle = (jnp.reshape(jnp.asarray(x, float), (-1, 1)) for x in (force, angle))
    ones = jnp.ones_like(force)
    angle, time = angle * ones, jnp.arange(force.shape[0]) / force.shape[0]
    place = CLEARANCE * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    return Contacts(time, 1.0 / force.shape[0] + 0 * time, force, angle, 2 * ones, 0.3 * ones, place)


def pressed(force, angle=0.0):
    zero = jnp.zeros(())
    return SectionLoad(jnp.asarray(force), jnp.asarray(angle), (zero, zero))


def depths(sectors):
    return jnp.zeros(sectors)


@pytest.mark.parametrize("sectors", [90, 720])
@pytest.mark.parametrize("name", ["hertz", "uniform"])
def test_flat_patches_wear_off_what_archard_says(name, sectors):
    """However narrow a patch is beside a sector, V = k F s."""
    seen = pressing([FORCE, 1.0, 0.0, 1e-7])
    found = wear.wear_of(seen, SLEEVE, wear.Archard(K), PRESSURES[name], depth=depths(sectors))
    assert float(found.volume) == pytest.approx(K * (FORCE + 1.0 + 1e-7) * 2 * 0.25, rel=1e-12)
    assert float(found.sliding) == pytest.approx(1.5)


def test_the_foundation_bears_its_force_as_the_closed_form_says():
    """F' = k R e (a - sin a cos a), cos a = c / e; and the integral of p, 2 k R e (sin a - a cos a), is more."""
    foundation = PRESSURES["foundation"]
    a = 0.3
    radius, e = PIN + CLEARANCE, CLEARANCE / np.cos(a)
    force = STIFFNESS * radius * e * (a - np.sin(a) * np.cos(a))
    spread = foundation.prepare(Section(GEOMETRY, depths(360)))(pressed(force))
    whole = 2 * STIFFNESS * radius * e * (np.sin(a) - a * np.cos(a))
    angles = 2 * np.pi * (np.arange(360)[:, None] + np.linspace(-0.5, 0.5, 401)) / 360
    exact = STIFFNESS * np.maximum(e * np.cos(angles) - CLEARANCE, 0).mean(axis=1)
    assert float(spread.borne) == pytest.approx(force, rel=1e-12)
    assert float(jnp.sum(spread.means)) * radius * 2 * np.pi / 360 == pytest.approx(whole, rel=1e-5)
    assert spread.means == pytest.approx(exact, abs=2e-3 * exact.max())
    assert float(foundation.half_angle(GEOMETRY, force)) == pytest.approx(a, rel=1e-9)
    assert whole > force


def test_more_sectors_change_the_volume_on_a_foundation_ever_less():
    seen = pressing(FORCE)
    volumes = [
        float(wear.wear_of(seen, SLEEVE, wear.Archard(K), PRESSURES["foundation"], depth=depths(n)).volume)
        for n in (90, 180, 360, 720)
    ]
    change = np.abs(np.diff(volumes)) / volumes[-1]
    assert change.max() < 1e-3
    assert change[-1] < 0.2 * change[0]
    # Beyond k F s by what leans, at most 1 / cos a.
    flat = K * FORCE * 2
    lean = np.cos(float(PRESSURES["foundation"].half_angle(GEOMETRY, FORCE / LENGTH)))
    assert flat < volumes[-1] < flat / lean


@pytest.mark.parametrize(("degrees", "more"), [(30, 1.028), (60, 1.115), (80, 1.212)])
def test_the_volume_of_a_wide_patch_is_that_of_its_pressures(degrees, more):
    """Beyond k F s by 2 (sin a - a cos a) / (a - sin a cos a): the figures of docs/wear.md."""
    a = np.radians(degrees)
    ratio = 2 * (np.sin(a) - a * np.cos(a)) / (a - np.sin(a) * np.cos(a))
    assert ratio == pytest.approx(more, abs=5e-4)
    force = LENGTH * STIFFNESS * (PIN + CLEARANCE) * CLEARANCE / np.cos(a) * (a - np.sin(a) * np.cos(a))
    found = wear.wear_of(pressing(force), SLEEVE, wear.Archard(K), PRESSURES["foundation"], depth=depths(720))
    assert float(found.volume) / float(np.asarray(found.flat_volume)) == pytest.approx(ratio, rel=1e-4)


def test_a_worn_sleeve_bears_more_evenly():
    """On the profile that a patch has worn off, the same force has less pressure: what wear is slowed down by."""
    foundation = PRESSURES["foundation"]
    first = foundation.prepare(Section(GEOMETRY, depths(360)))(pressed(FORCE / LENGTH, 0.5)).means
    deep = 0.5 * first / STIFFNESS
    second = foundation.prepare(Section(GEOMETRY, deep))(pressed(FORCE / LENGTH, 0.5))
    assert float(second.borne) == pytest.approx(FORCE / LENGTH, rel=1e-12)
    assert float(second.means.max()) < 0.9 * float(first.max())


@pytest.mark.parametrize("relief", [1.9, 2.1])
def test_cycles_that_wear_off_more_than_twice_how_deep_the_pin_stands_run_away(relief):
    """Below that each cycle comes to wear off what the one before did; beyond, other sectors in turn."""
    law, depth, cycles, last = wear.Archard(relief / (STIFFNESS * 2)), depths(90), [], 0.0
    for _ in range(40):
        found = wear.wear_of(pressing(FORCE), SLEEVE, law, PRESSURES["foundation"], depth=depth)
        depth, last = depth + found.depth[0], float(found.relief)
        cycles.append(found.depth[0] / jnp.linalg.norm(found.depth[0]))
    assert last == pytest.approx(relief)
    alike = float(cycles[-1] @ cycles[-2])
    assert alike > 0.99 if relief < 2 else alike < 0.9


def test_the_paper_s_numbers():
    """F = 3 kN, B = 50 mm, c = 0.05 mm: p0 = 13.06 MPa (its Eq. 16 with the root that is missing), and a slip of
    39.3 mm at k = 6e-14 1/Pa wears off 3.1e-8 m.
    """
    paper = geometry(25e-3, 5e-5, Material(2.01e11), Material(2.06e11))
    spread = wear.HertzLine().prepare(Section(paper, depths(7200)))(pressed(FORCE / LENGTH))
    assert float(spread.means.max()) == pytest.approx(13.06e6, rel=1e-3)
    law = wear.archard("6e-5 mm^3/(N*m)")
    depth = law.rate(SlidingState(spread.means.max(), jnp.asarray(39.3e-3), jnp.zeros(()), jnp.zeros(())))
    assert float(depth) == pytest.approx(3.1e-8, rel=1e-2)


def test_coefficients_have_units():
    assert float(wear.archard("6e-14 1/Pa").coefficient) == pytest.approx(6e-14)
    assert float(wear.archard("6e-5 mm^3/(N*m)").coefficient) == pytest.approx(6e-14)
    assert float(wear.archard(7.8e-5, "1.3 GPa").coefficient) == pytest.approx(6e-14)
    assert float(wear.reye("6e-5 mm^3/J").coefficient) == pytest.approx(6e-14)
    with refused("coefficient", 6e-14):
        wear.archard(6e-14)
    with refused("coefficient", "6e-14 m"):
        wear.archard("6e-14 m")


def test_other_laws():
    at = SlidingState(jnp.asarray([0.0, 1e6, 3e6]), jnp.asarray(0.5), jnp.asarray(0.3), jnp.asarray(2.0))
    archard = wear.Archard(K)
    plain = archard.rate(at)
    assert plain == pytest.approx(K * 0.5 * np.array([0, 1e6, 3e6]))
    assert wear.Reye(K).rate(at) == pytest.approx(0.3 * plain)
    assert wear.Threshold(archard, 1e6).rate(at) == pytest.approx(K * 0.5 * np.array([0, 0, 2e6]))
    assert wear.RunningIn(archard, 5.0, 2.0).rate(at) == pytest.approx((1 + 4 / np.e) * plain)
    graded = wear.Graded(archard, 1e6, 1.0, 0.5, -0.25).rate(at)
    assert graded == pytest.approx(plain * np.array([0, 1, 3]) ** 0.5 * 0.5**-0.25)


def test_what_does_not_wear_and_what_cannot():
    none = wear.wear_of(pressing(FORCE), SLEEVE, wear.Archard(0.0), wear.HertzLine(), depth=depths(90))
    assert float(none.volume) == 0
    apart = wear.wear_of(pressing(0.0), SLEEVE, wear.Archard(K), PRESSURES["foundation"], depth=depths(90))
    assert float(apart.volume) == float(apart.sliding) == 0
    with pytest.raises(ClearanceError, match="further than a flat patch"):
        wear.wear_of(pressing(1e9), SLEEVE, wear.Archard(K), wear.HertzLine(), depth=depths(90))
    soft = Sections(GEOMETRY._replace(pin_material=None), SLEEVE.heights, SLEEVE.lengths)
    with refused("pin_material"):
        wear.wear_of(pressing(FORCE), soft, wear.Archard(K), wear.HertzLine(), depth=depths(90))


# Motions -------------------------------------------------------------------------------------------------------------


def rotor(drive, **changes):
    """A disc whose pin turns in a sleeve that stands still, under its weight of 196.2 N and no friction."""
    play = dict(normal=laws.HuntCrossley(1e10, 50.0), length=LENGTH, pin_material=STEEL, sleeve_material=STEEL)
    clearance = cj.RevoluteClearance(CLEARANCE, PIN, **play | changes)
    return cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1),),
        joints=(cj.Revolute("pin", "ground", "disc", motion=cj.Motion(drive), clearance=clearance),),
        gravity=cj.Gravity(y=-9.81),
    )


@pytest.mark.slow
def test_a_pin_that_turns_and_one_that_swings():
    """V = k F R w t of a pin that turns, 4 k F R a a cycle of one that swings: R the radius at which it rubs."""
    penetration = (196.2 / 1e10) ** (2 / 3)
    reach, law = PIN - penetration, wear.Archard(K)
    turning = wear.wear(cj.trace(rotor(cj.drives.ConstantSpeed(3.0)), 0.5, rtol=1e-8, start="settled"), "pin", law)
    assert float(turning.volume) == pytest.approx(K * 196.2 * reach * 3.0 * 0.5, rel=1e-6)
    assert turning.angle[int(jnp.argmax(turning.depth[0]))] == pytest.approx(1.5 * np.pi)
    swinging = cj.trace(rotor(cj.drives.Harmonic(0.2, 4 * np.pi)), 1.0, rtol=1e-8, start="settled")
    found = wear.wear(swinging, "pin", law)
    assert float(found.volume) == pytest.approx(2 * 4 * K * 196.2 * reach * 0.2, rel=1e-6)


@pytest.mark.slow
def test_a_tilted_pin_wears_its_sleeve_most_at_the_edges():
    """A weight beside the sleeve tilts the pin: it bears at opposite edges, on opposite sides, and nowhere between."""
    play = cj.SleeveClearance(
        CLEARANCE, PIN, 0.06, laws.HuntCrossley(1e10, 50.0), stations=6, pin_material=STEEL, sleeve_material=STEEL
    )
    mechanism = cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, cj.Inertia(0.1, 0.1, 0.1), cj.Position(0, 0, 0.05)),),
        joints=(cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.ConstantSpeed(3.0)), clearance=play),),
        gravity=cj.Gravity(y=-9.81),
    )
    trace = cj.trace(mechanism, 0.02, rtol=1e-6, start="settled", save_at=None)
    found = wear.wear(trace, "pin", wear.Archard(K))
    deepest = np.asarray(found.depth.max(axis=1))
    assert np.all(deepest[2:4] == 0)
    assert deepest[0] > deepest[1] > 0
    assert deepest[-1] > deepest[-2] > 0
    sides = np.degrees(np.asarray(found.angle[jnp.argmax(found.depth[jnp.asarray([0, -1])], axis=1)]))
    assert sides == pytest.approx([90, 270], abs=5)
    assert float(found.volume) == pytest.approx(float(found.flat_volume), rel=1e-9)
