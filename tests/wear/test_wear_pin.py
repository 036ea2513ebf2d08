"""Wear of a pin, in its own axes: where the load stands still it wears all round, where it turns along at one place."""

import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws, wear
from clearance_jax.joints import Sections
from clearance_jax.laws import Geometry, Material
from clearance_jax.wear import Contacts
from clearance_jax.wear import worn as accumulated

PIN, CLEARANCE, LENGTH, K = 25e-3, 1e-4, 50e-3, 6e-14
STEEL = Material(2.06e11)
LAW = wear.Archard(K)
SPEED = 4 * np.pi


def rotor(off, gravity):
    """A disc that a drive turns once in half a second."""
    play = cj.RevoluteClearance(
        CLEARANCE,
        PIN,
        laws.HuntCrossley(1e10, 50.0),
        length=LENGTH,
        pin_material=STEEL,
        sleeve_material=STEEL,
    )
    motion = cj.Motion(cj.drives.ConstantSpeed(SPEED))
    return cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1, cj.Position(off)),),
        joints=(cj.Revolute("pin", "ground", "disc", motion=motion, clearance=play),),
        gravity=cj.Gravity(y=-gravity),
    )


@pytest.mark.slow
@pytest.mark.parametrize(("off", "gravity"), [(0.0, 9.81), (0.05, 0.0)])
def test_where_loads_stand_still_or_turn_along(off, gravity):
    """A weight wears its sleeve below and its pin all round; what is out of balance the other way round."""
    turn = cj.trace(rotor(off, gravity), 0.5, rtol=1e-8, start="settled", save_at=None)
    sleeve = wear.wear(turn, "pin", LAW)
    pin = wear.wear(turn, "pin", wear.Archard(3 * K), of="pin")
    for found, factor in ((sleeve, 1), (pin, 3)):
        force = 20.0 * (gravity + off * SPEED**2)
        reach = PIN if off else PIN - (force / 1e10) ** (2 / 3)
        # Out of balance the centre of mass runs on a circle that is larger by the play.
        expected = factor * K * force * reach * 2 * np.pi
        assert float(found.volume) == pytest.approx(expected, rel=5e-3 if off else 1e-6)
        assert float(found.volume) == pytest.approx(float(found.flat_volume), rel=1e-12)
    evenly, one = (pin, sleeve) if gravity else (sleeve, pin)
    even, deep = np.asarray(evenly.depth[0]), np.asarray(one.depth[0])
    assert np.abs(even / even.mean() - 1).max() < 0.02
    assert np.flatnonzero(deep > 0.5 * deep.max()).size <= 3 * deep.size / 360
    assert np.degrees(float(one.angle[deep.argmax()])) == pytest.approx(270 if gravity else 0, abs=1)
    # Each has its own radius, so that with its own coefficient the volumes are as the coefficients are.
    assert float(pin.volume) == pytest.approx(3 * float(sleeve.volume), rel=1e-9)


def test_a_pin_that_turns_by_part_of_a_sector_loses_nothing():
    """Of one press each: what the sleeve has at an angle, the pin has where it was turned there."""
    pin, bore, clearance, length = (jnp.asarray(x) for x in (PIN, PIN + CLEARANCE, CLEARANCE, LENGTH))
    play = Geometry(pin, bore, clearance, length, STEEL, STEEL, "line")
    sleeve = Sections(play, jnp.zeros(1), jnp.asarray([LENGTH]))
    one = jnp.ones((1, 1))
    for turn in (0.0, 1.234, -7.7):
        place = CLEARANCE * jnp.asarray([[[np.cos(2.0), np.sin(2.0)]]])
        seen = Contacts(one[0], one[0], 3e3 * one, 2.0 * one, one, 0 * one, place, jnp.asarray([turn]))
        for pressure in (wear.HertzLine(), wear.Foundation(2e13)):
            on = {
                of: wear.wear_of(seen, sleeve, LAW, pressure, of=of, depth=jnp.zeros(360)) for of in ("sleeve", "pin")
            }
            assert float(on["pin"].volume) == pytest.approx(float(on["sleeve"].volume), rel=1e-12)
            centre = np.angle(np.asarray(on["pin"].depth[0]) @ np.exp(1j * np.asarray(on["pin"].angle)))
            assert np.cos(centre - (2.0 - turn)) == pytest.approx(1, abs=1e-6)
    with refused("of", "bush"):
        wear.wear_of(seen, sleeve, LAW, wear.HertzLine(), of="bush", depth=jnp.zeros(360))


def test_sectors_of_a_pin_that_lie_across_those_of_its_sleeve_lack_a_quarter_of_a_square():
    """Of a parabolic patch that reaches a to either side the largest depth lacks (w / a)^2 / 4, beside what it lacks in
    sectors that lie as the pin's do: as docs/wear.md says.
    """
    spread, count = 0.2, 360
    width = 2 * np.pi / count

    def patch(begin):
        x = (width * (np.arange(count) + begin) - np.pi) / spread
        return np.maximum(1 - x * x, 0.0)

    across = accumulated._turn(jnp.asarray(patch(0.0)), jnp.asarray(width / 2))
    assert patch(-0.5).max() - float(across.max()) == pytest.approx((width / spread) ** 2 / 4, rel=1e-9)
    assert float(across.sum()) == pytest.approx(patch(0.0).sum(), rel=1e-12)
