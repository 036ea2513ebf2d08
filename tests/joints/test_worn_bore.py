"""A worn sleeve as a joint: a smooth, convex depth that is a round sleeve's where nothing is worn; an energy balance
that closes.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.design.judge.static import static_error
from clearance_jax.joints import Relative
from clearance_jax.joints.bore import Bore, finer
from clearance_jax.metrics.farthest import farthest

C, PIN = 1e-4, 25e-3
ANGLES = 2 * np.pi * np.arange(360) / 360
DOWN = 1.5 * np.pi
POCKETS = 3e-5 * np.exp(-(((ANGLES - DOWN - 0.5) / 0.25) ** 2)) + 2e-5 * np.exp(-(((ANGLES - DOWN + 0.6) / 0.3) ** 2))


def bore(depth):
    return Bore(jnp.asarray(C), jnp.asarray(depth))


def at(angle, far):
    return jnp.asarray(far * np.cos(angle)), jnp.asarray(far * np.sin(angle))


@pytest.mark.parametrize("sectors", [16, 36, 72, 180, 360])
@pytest.mark.parametrize("worn", [0.0, 5e-5])
def test_a_round_sleeve_is_round(sectors, worn):
    """To round-off at any number of sectors, also between them; and a sleeve that has worn evenly is a larger one."""
    even = bore(finer(jnp.full(sectors, worn)))
    find = jax.jit(even.depth_at)
    for far in (1.0, 1.02):
        e = far * (C + worn)
        for angle in np.linspace(0, 2 * np.pi / sectors, 7):
            found = find(*at(angle, e))
            # What a sum over sectors leaves of a bell one of them wide (its first harmonic, by Poisson's formula).
            assert float(found.value) == pytest.approx(e - C - worn, abs=2e-11 * e)
            assert float(found.x) == pytest.approx(np.cos(angle), abs=2e-9)
            assert float(found.y) == pytest.approx(np.sin(angle), abs=2e-9)
    assert float(even.distance(*at(1.0, 1.0), jnp.asarray(0.0))) == pytest.approx(C + worn, rel=2e-11)


@pytest.mark.parametrize("sectors", [16, 36, 360])
def test_a_sleeve_that_is_off_centre_is_a_round_one_there(sectors):
    """Worn by a (1 + cos t) it is the round one of the clearance c + a whose middle is off by a, to less than a
    penetration; and its gradient is a unit vector.
    """
    a = 0.3 * C
    found = bore(finer(jnp.asarray(a * (1 + np.cos(2 * np.pi * np.arange(sectors) / sectors)))))
    find = jax.jit(found.depth_at)
    for angle in np.linspace(0, 2 * np.pi, 11):
        x, y = a + 1.01 * (C + a) * np.cos(angle), 1.01 * (C + a) * np.sin(angle)
        now = find(jnp.asarray(x), jnp.asarray(y))
        assert float(now.value) == pytest.approx(0.01 * (C + a), abs=5e-4 * C)
        assert np.hypot(now.x, now.y) == pytest.approx(1, abs=5e-4)


@pytest.mark.slow
@pytest.mark.parametrize("sectors", [16, 36, 72])
def test_a_pin_at_rest_is_pressed_by_its_load_at_any_number_of_sectors(sectors):
    """Force, penetration, energy and friction are those of a round sleeve."""

    @jax.jit
    def rest(joint):
        ready, still = joint.prepare(), (jnp.zeros(()),) * 3
        place, _ = ready.seat((jnp.asarray(0.0), jnp.asarray(19.62)))
        slides = Relative((*place, 0.0), 0.0, still, (*still[:2], jnp.asarray(3.0)))
        now = ready.act(slides, ())
        points = now.points
        return now.force[1], now.torque[2], points.normal_force, points.penetration, now.elastic_energy, place[1]

    round_one = cj.RevoluteClearance(C, PIN, laws.HuntCrossley(1e10, 50.0), laws.CubicCoulomb(0.1, 1e-2), length=0.05)
    np.testing.assert_allclose(rest(round_one.worn(np.zeros(sectors))), rest(round_one), rtol=1e-7)


@pytest.mark.parametrize("every", [1, 20])
def test_the_depth_is_that_of_the_deepest_sector_and_its_gradient_is_exact(every):
    profile = bore(finer(jnp.asarray(POCKETS[::every])))
    find = jax.jit(profile.depth_at)
    slope = jax.jit(jax.grad(lambda x, y: profile.depth_at(x, y).value, (0, 1)))
    rng = np.random.default_rng(3)
    for x, y in rng.uniform(-1.3 * C, 1.3 * C, (20, 2)):
        found = find(jnp.asarray(x), jnp.asarray(y))
        hard = np.max(x * np.cos(ANGLES) + y * np.sin(ANGLES) - POCKETS - C)
        if every == 1:
            assert float(found.value) == pytest.approx(hard, abs=3e-3 * C)
        gradient = slope(jnp.asarray(x), jnp.asarray(y))
        assert np.allclose((found.x, found.y), gradient, rtol=1e-9, atol=1e-12)


def test_a_pin_is_seated_where_the_wall_s_gradient_opposes_the_force():
    """In the one pocket, in the other, and between them at two places at once; derivatives are those of differences."""
    profile = bore(POCKETS)
    seat = jax.jit(lambda angle, depth: jnp.stack(profile.seat((jnp.cos(angle), jnp.sin(angle), 0.0), depth)))
    deep, places = 1e-6, []
    for angle in DOWN + np.array([-0.9, -0.3, 0.0, 0.3, 0.9]):
        x, y = seat(angle, deep)
        found = profile.depth_at(x, y)
        assert float(found.value) == pytest.approx(deep, rel=1e-9)
        assert float(found.y * np.cos(angle) - found.x * np.sin(angle)) == pytest.approx(0, abs=1e-9)
        places.append((float(x), float(y)))
    assert places[0][0] < 0 < places[-1][0]
    slope = jax.jacfwd(seat)(DOWN + 0.3, deep)
    change = (seat(DOWN + 0.3 + 1e-6, deep) - seat(DOWN + 0.3 - 1e-6, deep)) / 2e-6
    assert np.allclose(slope, change, rtol=1e-5, atol=1e-12)


def rotor(depth):
    """A disc out of balance that a drive swings in its sleeve, with friction."""
    play = cj.RevoluteClearance(C, PIN, laws.HuntCrossley(1e10, 50.0), laws.CubicCoulomb(0.1, 1e-2), length=0.05)
    return cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1, cj.Position(0.05)),),
        joints=(
            cj.Revolute(
                "pin",
                "ground",
                "disc",
                motion=cj.Motion(cj.drives.Harmonic(0.6, 4 * np.pi)),
                clearance=play.worn(depth),
            ),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


@pytest.mark.slow
@pytest.mark.optimised
def test_books_close_and_the_error_follows_rtol_on_a_worn_profile():
    mechanism = rotor(POCKETS)

    def solved(rtol):
        found = cj.simulate(mechanism, 0.5, rtol=rtol, start="settled")
        assert float(found.energy_residual) < 10 * rtol
        return np.array(found.final[:2])

    reference = solved(1e-11)
    rtols = np.array([1e-5, 1e-6, 1e-7, 1e-8, 1e-9])
    errors = np.array([np.abs(solved(rtol) - reference).max() / C for rtol in rtols])
    assert np.all(errors < 50 * rtols)
    assert errors[-1] < 1e-3 * errors[0]


def test_the_farthest_that_play_lets_a_pin_go_is_in_the_worn_bore():
    """Of a sleeve that is off its middle by a, c + a from there; the sum of weights takes the deepest place."""
    a, way = 0.3 * C, np.array([0.6, -0.8])
    off = jnp.asarray(a * (1 + np.cos(ANGLES)))
    joint: Any = rotor(off).joint("pin")
    clearance = joint.clearance
    found = jax.jit(lambda weights: farthest(clearance, weights))
    np.testing.assert_allclose(found(jnp.asarray(3.0 * way)), (C + a) * way + [a, 0], atol=1e-3 * C)
    np.testing.assert_array_equal(found(jnp.zeros(2)), 0)
    assert static_error(rotor(off), {"pin": 2.0}) == pytest.approx(2 * (C + 2 * a), rel=1e-12)
    sleeve = cj.SleeveClearance(C, PIN, 0.05, laws.HuntCrossley(1e10, 50.0)).worn(np.zeros(16))
    with refused("depth"):
        farthest(sleeve, jnp.ones(4))


def test_profiles_that_are_none():
    with refused("depth"):
        rotor(np.zeros(15))
    with refused("pin.depth", allowed=None):
        cj.simulate(rotor(np.full(16, 2 * PIN)), 0.1)
    with refused("pin.depth", allowed="at least 0 m"):
        cj.simulate(rotor(np.full(16, -1e-6)), 0.1)
