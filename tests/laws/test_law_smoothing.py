"""Friction laws without corners: two continuous derivatives, nothing changed beyond the width, a bias as told."""

from typing import Any, ClassVar

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

from clearance_jax import laws

GEOMETRY = laws.Geometry(*(jnp.asarray(x) for x in (0.01, 0.0105, 5e-4, 0.02)))
CORNERED = ("cubic", "adams", "threlfall", "ambrosio", "bengisu-akay", "stribeck-1")
BRISTLES = ("lugre", "dahl", "elasto-plastic")


def coefficient(law):
    """The coefficient over the slip, at a normal force of 1 N."""
    ready = law.prepare(GEOMETRY)
    return lambda v: -ready.traction((v,), jnp.ones(()), ())[0]


def corners(law):
    return sorted({float(sign * kink.speed) for kink in law.kinks() for sign in (-1, 1)})


@pytest.mark.parametrize("name", CORNERED)
def test_a_smoothed_law_has_two_continuous_derivatives(name):
    law, width = catalogue.FRICTION[name], 2e-4
    smooth = law.smoothed(width)
    assert (law.smoothness, smooth.smoothness) != ("C2", "C1")
    bend = jax.jit(jax.vmap(jax.grad(jax.grad(coefficient(smooth)))))
    rough = jax.jit(jax.vmap(jax.grad(jax.grad(coefficient(law)))))
    told = corners(law)
    ends = np.array([at + side * width for at in told for side in (-1, 0, 1)])
    before, after = (np.asarray(bend(jnp.asarray(ends + step))) for step in (-1e-11, 1e-11))
    size = np.abs(np.asarray(bend(jnp.linspace(-2e-2, 2e-2, 4001)))).max()
    np.testing.assert_allclose(before, after, atol=1e-6 * size)
    steep = jax.jit(jax.vmap(jax.grad(coefficient(smooth))))
    here, beside = (np.asarray(steep(jnp.asarray(told) + step)) for step in (0.0, 1e-12))
    np.testing.assert_allclose(here, beside, atol=1e-6 * np.abs(here).max())
    # The law itself has the jumps that it tells of: the curvature, or that of a slope within a step.
    slope = jax.jit(jax.vmap(jax.grad(coefficient(law))))
    low, high = (np.array(told) + step for step in (-1e-11, 1e-11))
    by_curvature = np.abs(np.asarray(rough(jnp.asarray(high)) - rough(jnp.asarray(low))))
    by_slope = np.abs(np.asarray(slope(jnp.asarray(high)) - slope(jnp.asarray(low)))) / width
    assert np.all(by_curvature + by_slope > 1e-3 * size)


@pytest.mark.parametrize("name", CORNERED)
def test_beyond_its_width_it_is_the_law(name):
    law, width = catalogue.FRICTION[name], 2e-4
    slips = np.linspace(-2e-2, 2e-2, 20001)
    far = np.all([np.abs(slips - at) > width for at in corners(law)], axis=0)
    whole, smooth = (np.asarray(jax.jit(jax.vmap(coefficient(one)))(slips)) for one in (law, law.smoothed(width)))
    np.testing.assert_allclose(smooth[far], whole[far], rtol=0, atol=2e-16)
    assert np.abs(whole - smooth)[~far].max() > 1e-6
    assert np.all(smooth * slips >= -1e-18)


@pytest.mark.parametrize("name", CORNERED)
def test_the_width_that_a_law_chooses_keeps_its_bias(name):
    """The largest change of a coefficient is below, and near, the tolerance times the largest coefficient."""
    law, rtol = catalogue.FRICTION[name], 1e-3
    smooth = law.smoothed(rtol=rtol)
    width = float(smooth.width)
    near = np.concatenate([at + width * np.linspace(-1, 1, 2001) for at in corners(law)])
    mine, its = (np.asarray(jax.jit(jax.vmap(coefficient(one)))(near)) for one in (law, smooth))
    change = np.abs(mine - its)
    bias = change.max() / float(law.kinks()[0].coefficient)
    assert 0.4 * rtol < bias <= rtol * (1 + 1e-9)


@pytest.mark.parametrize("name", BRISTLES)
def test_smoothed_bristles_hold_what_they_held(name):
    """Faster than the width nothing changes; slower, bristles give way, but never hold more than before."""
    law, width = catalogue.FRICTION[name], 1e-4
    smooth = law.smoothed(width)
    largest = law.memory_scale(None)[0]
    for v in (-2e-2, -2e-4, 2e-4):
        slip, bend = (jnp.asarray(v),), ((0.9 * largest,),)
        for asked in ("traction", "memory_rate"):
            mine, its = (getattr(one, asked)(None, slip, jnp.ones(()), bend) for one in (law, smooth))
            np.testing.assert_allclose(its, mine, rtol=1e-13)

    # A constant load: a pin creeps slower than the width.
    def give(v, share=0.5, of=smooth):
        return of.memory_rate(None, (v,), jnp.ones(()), ((share * largest,),))[0][0]

    if name != "elasto-plastic":
        assert float(give(jnp.zeros(()), of=law)) == 0.0
        assert float(give(jnp.zeros(()))) < 0 < float(give(jnp.asarray(3 / 8 * width)))
        assert float(give(jnp.asarray(3 / 8 * width), share=0.99)) < 0 < float(give(jnp.asarray(width), share=0.99))
    # At the largest deflection it does not bend further, whatever the slip is.
    rates = jax.jit(jax.vmap(lambda v: give(v, 1.0)))(jnp.linspace(-2 * width, 2 * width, 101))
    assert np.all(np.asarray(rates) <= 1e-15)
    bends = jax.jit(jax.vmap(jax.grad(jax.grad(give))))(width * jnp.array([-1.0, 0.0, 1.0]) + 1e-13)
    other = jax.jit(jax.vmap(jax.grad(jax.grad(give))))(width * jnp.array([-1.0, 0.0, 1.0]) - 1e-13)
    np.testing.assert_allclose(bends, other, rtol=1e-6, atol=1e-6 / width)


def test_a_smooth_law_is_its_own_smooth_form():
    for name in ("tanh", "brown-mcphee", "stribeck"):
        law = catalogue.FRICTION[name]
        assert law.smoothness == "C2"
        assert law.smoothed(1e-3) is law


class Untold(laws.AbstractFrictionLaw):
    """A law with a corner that it does not tell of."""

    smoothness: ClassVar[Any] = "C0"

    def traction(self, constants, slip, normal_force, memory):
        return tuple(-normal_force * jnp.clip(1e3 * v, -1.0, 1.0) for v in slip)


def test_a_law_that_does_not_tell_its_corners_is_refused():
    with refused("Untold"):
        Untold().smoothed()


def test_elasto_plastic_friction_is_continuous_in_the_plane():
    """Where the slip turns square to the deflection, bristles begin to give way without a jump."""
    law = catalogue.FRICTION["elasto-plastic"]
    bend = 0.8 * float(law.memory_scale(None)[0])

    def rate(angle):
        slip = (1e-2 * jnp.cos(angle), 1e-2 * jnp.sin(angle))
        return law.memory_rate(None, slip, jnp.ones(()), ((jnp.asarray(bend), jnp.zeros(())),))[0]

    before, after = (np.asarray(rate(jnp.asarray(np.pi / 2 + step))) for step in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-9)
