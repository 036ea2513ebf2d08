"""A worn sleeve in space: a bore at every station, which is a round one's where nothing is worn; an energy balance that
closes.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from sleeves import AXIAL, RADIAL, checked, random_states, relative, sleeve

import clearance_jax as cj
from clearance_jax import laws, wear
from clearance_jax._basis.numerics import safe_unit
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.sleeve import Meeting
from clearance_jax.laws import Material
from clearance_jax.report.wear_figures import wear_map
from clearance_jax.results import play
from clearance_jax.spatial import Z, add, minus, plus, scale, times

STEEL = Material(2.06e11)
ANGLES = 2 * np.pi * np.arange(120) / 120
HEIGHTS = np.linspace(-1, 1, 8)[:, None]
# Two pockets, on opposite sides at the two ends.
DEPTH = 4e-5 * np.exp(-(((ANGLES - 1.0) / 0.4) ** 2)) * np.maximum(HEIGHTS, 0)
DEPTH = DEPTH + 3e-5 * np.exp(-(((ANGLES - 4.1) / 0.5) ** 2)) * np.maximum(-HEIGHTS, 0)


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_evenly_worn_it_is_a_larger_round_one(pin):
    """To 1e-4 of the clearance, which a smooth largest of sectors is off."""
    for worn in (0.0, 3e-5):
        even = sleeve(pin).worn(jnp.full(360, worn))
        larger = dataclasses.replace(sleeve(pin), radial_clearance=RADIAL + worn)
        for at in (relative((1.3e-4, 0.4e-4, 0.0), (2e-3, -1e-3, 0.0)), relative((0, 0, 2 * AXIAL), (4e-3, 3e-3, 0.0))):
            ours, theirs = even.points(at), larger.points(at)
            np.testing.assert_allclose(ours.penetration, theirs.penetration, rtol=0, atol=3e-4 * RADIAL)
            pressed = np.asarray(theirs.penetration) > -0.9 * RADIAL
            for a, b in zip((*ours.normal, *ours.arm), (*theirs.normal, *theirs.arm), strict=True):
                size = np.abs(b).max()
                np.testing.assert_allclose(
                    np.asarray(a)[pressed], np.asarray(b)[pressed], rtol=0, atol=5e-3 * size + 1e-12
                )


@pytest.mark.optimised
@pytest.mark.parametrize("pin", ["through", "inside"])
def test_power_is_that_of_the_wrench_on_a_worn_profile_too(pin):
    joint = sleeve(pin).worn(DEPTH)
    for at in random_states(10):
        assert float(checked(joint, at).friction_power) >= 0


class Formula(cj.SleeveClearance):
    """A round sleeve, and nothing that could be worn: what its stations cost at least."""

    def _stations(self, at, places):
        heights = 0.5 * self.length * places
        slope = self._slope(at) if self.pin == "through" else Z
        arm = (
            scale(heights - jnp.asarray(at.place[2], float), slope)
            if self.pin == "through"
            else scale(heights, at.axis)
        )
        centre = add(at.place, arm)
        distance, nx, ny = safe_unit(*(jnp.broadcast_to(jnp.asarray(c, float), heights.shape) for c in centre[:2]))
        normal: Any = (nx, ny, minus(0.0, plus(times(nx, slope[0]), times(ny, slope[1]))))
        arm = add(arm, scale(self.sleeve_radius - distance, normal))
        return Meeting(distance - self.radial_clearance, normal, arm)


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_a_round_sleeve_costs_nothing_more(pin):
    """Operation by operation the program of its formula; only a worn one has exponentials, one a sector."""

    def program(joint):
        def does(place, tilt):
            c, s = jnp.cos(tilt), jnp.sin(tilt)
            at = relative((0, 0, 0))._replace(
                place=(place, 0.0 * place, place), rows=((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))
            )
            action = joint.prepare().act(at, ())
            return jnp.stack([jnp.asarray(x, float) for x in (*action.force, *action.torque)])

        return str(jax.make_jaxpr(does)(1e-4, 1e-3))

    numbers = {f.name: getattr(sleeve(pin), f.name) for f in dataclasses.fields(sleeve(pin))}
    assert program(sleeve(pin)) == program(Formula(**numbers))
    assert " exp " not in program(sleeve(pin))
    assert " exp " in program(sleeve(pin).worn(DEPTH))


def rotor(depth):
    """A weight beside the sleeve tilts its pin, which a drive swings: it bears at opposite edges."""
    play = cj.SleeveClearance(
        1e-4, 25e-3, 0.06, laws.HuntCrossley(1e10, 50.0), laws.TanhCoulomb(0.1, 0.01), stations=6,
        pin_material=STEEL, sleeve_material=STEEL, depth=jnp.asarray(depth),
    )  # fmt: skip
    body = cj.Body("disc", 20.0, cj.Inertia(0.1, 0.1, 0.1), cj.Position(0, 0, 0.05))
    motion = cj.Motion(cj.drives.ConstantSpeed(3.0))
    return cj.Mechanism(
        (body,), (cj.Revolute("pin", "ground", "disc", motion=motion, clearance=play),), gravity=cj.Gravity(y=-9.81)
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::clearance_jax.wear.SectorsWarning")
def test_what_wears_at_edges_bears_further_in():
    """On sleeves as they wear: the energy balance closes, the error follows rtol, and the load moves in from the
    edges.
    """
    foundation, law, depth = wear.Foundation(2e13), wear.archard("1e-12 1/Pa"), np.zeros((6, 60))
    inner, at = [], dict(start="settled", save_at=None)
    for _ in range(2):
        trace = cj.trace(rotor(depth), 0.01, rtol=1e-7, **at)
        assert not trace.message
        assert float(trace.solution.energy_residual) < 1e-6
        found = wear.wear(trace, "pin", law, foundation)
        # Beyond k F s by what leans; a worn profile is in the pressures of what wears next.
        assert found.flat_volume is not None
        assert 1 <= float(found.volume / found.flat_volume) < 1.1
        volumes = np.asarray(found.depth).sum(axis=1) * np.asarray(wear.sections_of(rotor(depth), "pin").lengths)
        inner.append(volumes[1:-1].sum() / volumes.sum())
        assert found.depth[0].max() > found.depth[2].max()
        depth = depth + 2e-6 * np.asarray(found.depth) / float(found.deepest)
    assert inner[1] > inner[0]
    best = np.asarray(cj.trace(rotor(depth), 0.01, rtol=1e-10, **at).solution.final[:4])
    errors = []
    for rtol in (1e-6, 1e-8):
        end = np.asarray(cj.trace(rotor(depth), 0.01, rtol=rtol, **at).solution.final[:4])
        errors.append(np.abs((end - best) / [1e-4, 1e-4, 1e-4 / 0.03, 1e-4 / 0.03]).max())
    assert errors[0] < 1e-4
    assert errors[1] < 0.05 * errors[0] + 1e-10


def test_datasets_know_how_deep_a_pin_stands_in_every_bore():
    """As the joint has it, but for the smooth largest of sectors."""
    joint: Any = sleeve(axial=None).worn(DEPTH)
    at = relative((9e-5, 3e-5, 0.0), (2e-3, -1e-3, 0.0))
    found = play.penetration(np.asarray(joint.centres(at)), RADIAL, DEPTH)
    np.testing.assert_allclose(found, joint.points(at).penetration, rtol=0, atol=3e-3 * RADIAL)
    assert play.pin_travel(RADIAL, DEPTH[0]).shape == (2, 361)


def test_a_map_of_what_has_worn_off(tmp_path):
    """Depth over angle and height, in a unit that suits; of a joint in the plane there is none."""
    angle, heights = jnp.asarray(ANGLES), jnp.linspace(-0.02, 0.02, 8)
    figure = wear_map(wear.Wear(angle, heights, jnp.asarray(DEPTH), *(jnp.zeros(()),) * 5), "a sleeve")
    field, beside, _ = figure.axes
    (mesh,) = field.collections
    assert float(np.max(np.asarray(mesh.get_array()))) == pytest.approx(1e6 * DEPTH.max())
    assert beside.lines[0].get_xdata() == pytest.approx(1e6 * DEPTH.max(axis=1))
    figure.savefig(tmp_path / "map.png")
    with pytest.raises(ClearanceError, match="needs a joint with stations"):
        wear_map(wear.Wear(angle, jnp.zeros(1), jnp.asarray(DEPTH[:1]), *(jnp.zeros(()),) * 5))


def test_depths_that_are_none():
    with refused("depth", "(6, 120)"):
        dataclasses.replace(sleeve(), depth=jnp.zeros((6, 120)))
    with refused("depth", "(8, 12)"):
        sleeve().worn(jnp.zeros(12))
    with refused("pin.depth", allowed=None):
        cj.simulate(rotor(np.full((6, 16), 1.0)), 0.01)
