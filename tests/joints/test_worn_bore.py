"""A worn sleeve as a joint: a smooth, convex depth that is a round sleeve's where nothing is worn; an energy balance
that closes.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.bore import Bore

C, PIN = 1e-4, 25e-3
ANGLES = 2 * np.pi * np.arange(360) / 360
DOWN = 1.5 * np.pi
POCKETS = 3e-5 * np.exp(-(((ANGLES - DOWN - 0.5) / 0.25) ** 2)) + 2e-5 * np.exp(-(((ANGLES - DOWN + 0.6) / 0.3) ** 2))


def bore(depth):
    return Bore(jnp.asarray(C), jnp.asarray(depth))


def at(angle, far):
    return jnp.asarray(far * np.cos(angle)), jnp.asarray(far * np.sin(angle))


@pytest.mark.parametrize("worn", [0.0, 5e-5])
def test_a_round_sleeve_is_round(worn):
    """Also between its sectors, to far less than a penetration; and a sleeve that has worn evenly is a larger one."""
    even = bore(np.full(360, worn))
    for far in (1.0, 1.02):
        e = far * (C + worn)
        depths = np.array([float(even.depth_at(*at(angle, e)).value) for angle in np.linspace(0, 2 * np.pi / 360, 7)])
        assert np.abs(depths - (e - C - worn)).max() < 1e-4 * C
        # What a sum over sectors leaves of a bell of variance T / e (its first harmonic, by Poisson's formula).
        blend = C * (2 * np.pi / 360) ** 2
        assert np.ptp(depths) < 4.1 * blend * np.exp(-2 * np.pi**2 * C / e) + 1e-15
    assert float(even.distance(*at(1.0, 1.0), jnp.asarray(0.0))) == pytest.approx(C + worn, rel=1e-4)


def test_the_depth_is_that_of_the_deepest_sector_and_its_gradient_is_exact():
    profile = bore(POCKETS)
    rng = np.random.default_rng(3)
    for x, y in rng.uniform(-1.3 * C, 1.3 * C, (20, 2)):
        found = profile.depth_at(jnp.asarray(x), jnp.asarray(y))
        hard = np.max(x * np.cos(ANGLES) + y * np.sin(ANGLES) - POCKETS - C)
        assert float(found.value) == pytest.approx(hard, abs=3e-3 * C)
        gradient = jax.grad(lambda x, y: profile.depth_at(x, y).value, (0, 1))(jnp.asarray(x), jnp.asarray(y))
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


def test_profiles_that_are_none():
    with pytest.raises(ClearanceError, match="at least 16"):
        rotor(np.zeros(15))
    with pytest.raises(ClearanceError, match="must be below the pin's radius"):
        cj.simulate(rotor(np.full(16, 2 * PIN)), 0.1)
    with pytest.raises(ClearanceError, match="at least 0"):
        cj.simulate(rotor(np.full(16, -1e-6)), 0.1)
