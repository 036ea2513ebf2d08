"""Contracts of the contact laws, over the catalogue; closed forms of impacts."""

from typing import Any, ClassVar

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from clearance_jax import laws
from clearance_jax.joints.gap import Pressing
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw
from clearance_jax.laws.normal.flank import FlankSpring
from clearance_jax.laws.normal.ratios import exact_ratio

pytestmark = pytest.mark.quick

PENETRATIONS = jnp.array([-1e-3, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-5, 3e-5])
RATES = jnp.array([-1.0, -1e-3, 0.0, 1e-9, 1.0])
GRID = [x.ravel() for x in jnp.meshgrid(PENETRATIONS, RATES)]


def concrete(cls):
    for sub in cls.__subclasses__():
        yield from concrete(sub)
        # The library's: tests and examples of the docs make laws too.
        if not sub.__abstractmethods__ and sub.__module__.startswith("clearance_jax."):
            yield sub


@pytest.mark.parametrize(
    ("base", "listed"), [(AbstractNormalLaw, catalogue.NORMAL), (AbstractFrictionLaw, catalogue.FRICTION)]
)
def test_every_law_is_in_the_catalogue(base, listed):
    # Those of gaps have tests of their own (test_gaps).
    in_gaps = {laws.Flank, FlankSpring, Pressing}
    assert set(concrete(base)) - in_gaps == {type(law) for law in listed.values()}


GEOMETRY = laws.Geometry(jnp.asarray(0.01), jnp.asarray(0.0105), jnp.asarray(5e-4), jnp.asarray(0.02))
# Laws that may pull before separation.
PULLING = ("kelvin-voigt-unclipped", "tsuji", "anagnostopoulos")


def prepared(law):
    return law.prepare(GEOMETRY), tuple(jnp.asarray(1e-5 if law.acts_apart else 0.3) for _ in law.remembers)


@pytest.mark.parametrize("name", catalogue.NORMAL)
class TestNormal:
    def test_force_and_gradient(self, name):
        law, memory = prepared(catalogue.NORMAL[name])
        force = jax.vmap(law.force, (0, 0, None))(*GRID, memory)
        slopes = jax.vmap(jax.grad(law.force, (0, 1)), (0, 0, None))(*GRID, memory)
        apart = GRID[0] <= 0
        assert np.all(np.isfinite(force))
        assert all(np.all(np.isfinite(s)) for s in slopes)
        assert np.all(np.asarray(force)[apart] == 0)
        assert all(np.all(np.asarray(s)[apart] == 0) for s in slopes)
        if name not in PULLING:
            assert np.all(force >= 0)

    def test_first_touch_is_as_smooth_as_the_class_says(self, name):
        law, memory = prepared(catalogue.NORMAL[name])
        # The damping of Tsuji's law begins within a picometre; line contacts are stiff at once.
        small = {laws.Tsuji: 1e-16, laws.LineContact: 1e-15}.get(type(law.law), 1e-13)
        jump = law.force(jnp.asarray(small), jnp.asarray(1.0), memory)
        if law.law.smoothness == "C-1":
            assert jump > 100.0
        else:
            assert jump < 1e-5

    def test_energy_is_the_integral_of_the_elastic_force(self, name):
        law, memory = prepared(catalogue.NORMAL[name])
        d = jnp.array([1e-8, 1e-6, 2e-5])
        elastic = jax.vmap(jax.grad(law.energy))(d)
        # A solid that relaxes is at rest where its flow has caught up.
        rest = (d,) if law.law.acts_apart else tuple(jnp.full_like(d, m) for m in memory)
        np.testing.assert_allclose(elastic, jax.vmap(law.force, (0, None, 0))(d, jnp.zeros(()), rest), rtol=1e-12)

    def test_switches_agree_with_the_force(self, name):
        law, memory = prepared(catalogue.NORMAL[name])
        force = np.asarray(jax.vmap(law.force, (0, 0, None))(*GRID, memory))
        functions, presses = jax.vmap(law.event_functions, (0, 0, None))(*GRID, memory)
        apart = np.asarray(GRID[0]) <= 0
        np.testing.assert_array_equal(functions[0], GRID[0])  # the first tells whether the surfaces touch
        if not law.law.acts_apart:
            assert all(np.all(np.asarray(f)[apart] == 1) for f in functions[1:])  # the others say nothing then
        assert not np.any(np.asarray(presses)[apart])
        if name not in PULLING:
            assert np.all(force[~np.asarray(presses)] == 0)
            assert np.all(force[np.asarray(presses)] > 0)

    def test_between_switches_the_force_is_smooth(self, name):
        """Where no sign changes, halving a step makes the second difference four times smaller."""
        law, memory = prepared(catalogue.NORMAL[name])

        def signs(d):
            return jnp.stack(law.event_functions(d, jnp.asarray(0.3), memory)[0]) > 0

        def bend(d, h):
            ends = [law.force(d + k * h, jnp.asarray(0.3), memory) for k in (-1, 0, 1)]
            return ends[0] - 2 * ends[1] + ends[2]

        d = jnp.geomspace(1e-7, 5e-5, 60)
        h = 2e-3 * d
        same = np.asarray(jax.vmap(lambda d, h: jnp.all(signs(d - h) == signs(d + h)))(d, h))
        wide, near = (np.asarray(jax.vmap(bend)(d, k * h)) for k in (1.0, 0.5))
        scale = np.asarray(jax.vmap(law.force, (0, None, None))(d, jnp.asarray(0.3), memory))
        assert same.sum() > 40
        assert np.all(np.abs(wide - 4 * near)[same] <= 1e-3 * np.abs(wide[same]) + 1e-9 * scale[same])

    def test_a_closed_cycle_dissipates(self, name):
        law, memory = prepared(catalogue.NORMAL[name])
        angle = jnp.linspace(0, 2 * jnp.pi, 4001)
        d, rate = 1e-5 + 1e-5 * jnp.sin(angle), 0.05 * jnp.cos(angle)
        loss = jnp.trapezoid(jax.vmap(law.force, (0, 0, None))(d, rate, memory) * 1e-5 * jnp.cos(angle), angle)
        assert loss > -1e-12 * float(law.force(jnp.asarray(2e-5), jnp.zeros(()), memory)) * 1e-5


@pytest.mark.parametrize("name", catalogue.FRICTION)
class TestFriction:
    slips = jnp.array([-3.0, -1e-2, -1e-5, -1e-12, 0.0, 1e-12, 1e-5, 1e-2, 3.0])

    def along(self, name, slips, force):
        """Traction and its slope along one tangent, bristles straight."""
        law = catalogue.FRICTION[name].prepare(GEOMETRY)
        memory = tuple(jnp.zeros(()) for _ in law.law.bristles)

        def traction(slip):
            return law.traction((slip,), jnp.asarray(force), memory)[0]

        return jax.vmap(jax.value_and_grad(traction))(slips)

    def test_odd_bounded_and_dissipative(self, name):
        traction, slope = (np.asarray(x) for x in self.along(name, self.slips, 100.0))
        np.testing.assert_allclose(traction, -traction[::-1], atol=1e-12)
        assert np.all(traction * np.asarray(self.slips) <= 0)
        # With damping a traction is bounded along solutions, not for an unbent bristle.
        if not name.endswith(("lugre", "elasto-plastic")):
            assert np.all(np.abs(traction) <= 0.42 * 100)
        assert np.all(np.isfinite(slope))

    def test_no_force_no_friction(self, name):
        traction, _ = self.along(name, self.slips, 0.0)
        assert np.all(np.asarray(traction) == 0)

    def test_two_tangents_are_one_law(self, name):
        """Slip along any direction of a plane meets the traction that it meets along one tangent."""
        law = catalogue.FRICTION[name].prepare(GEOMETRY)
        count, c, s = len(law.law.bristles), np.cos(0.7), np.sin(0.7)

        def plane(v, bend=1e-6):
            slip, force = (c * v, s * v), jnp.asarray(100.0)
            memory = tuple(jnp.asarray(x) for _ in range(count) for x in (c * bend, s * bend))
            return law.traction(slip, force, memory), law.memory_rate(slip, force, memory)

        def line(v, bend=1e-6):
            memory = tuple(jnp.asarray(bend) for _ in range(count))
            force = jnp.asarray(100.0)
            return law.traction((v,), force, memory), law.memory_rate((v,), force, memory)

        # Not below 1e-9 m/s: there the slope of the ratio is what matters, and is checked at zero below.
        for slip in (-3.0, -1e-2, -1e-5, 1e-9, 1e-3, 1e-2, 0.5):
            v = jnp.asarray(slip)
            (wide, wide_rate), (narrow, narrow_rate) = plane(v), line(v)
            np.testing.assert_allclose(wide, np.array([c, s]) * narrow[0], rtol=1e-12, atol=1e-18)
            if count:
                np.testing.assert_allclose(wide_rate, np.array([c, s]) * narrow_rate[0], rtol=1e-12)
        # At zero slip, bristles straight (with bent ones |slip| has a kink there).
        slope = jax.jacfwd(lambda v: plane(v, 0.0)[0][0])(jnp.zeros(()))
        np.testing.assert_allclose(slope, c * jax.jacfwd(lambda v: line(v, 0.0)[0][0])(jnp.zeros(())), rtol=1e-12)

    def test_zones_tell_one_side_from_the_other(self, name):
        law = catalogue.FRICTION[name].prepare(GEOMETRY)
        memory = tuple(jnp.zeros(()) for _ in law.law.bristles)
        before = (jnp.asarray(1.0),)

        def signs(v):
            functions = law.event_functions((jnp.asarray(v),), jnp.asarray(1.0), memory, jnp.asarray(True), before)
            return tuple(bool(f > 0) for f in functions)

        if law.law.event_functions(None, before, jnp.asarray(1.0), (before,)):
            assert len({signs(0.5), signs(1e-6), signs(-0.5)}) == 3
            assert signs(1e-6) == signs(-1e-6)
        else:
            assert signs(0.5) == ()


class Ageing(laws.AbstractNormalLaw):
    """A law that goes on while apart: it remembers how long it has been squeezed or free."""

    squeeze: Any = None
    smoothness: ClassVar = "C1"
    remembers: ClassVar = ("age",)
    acts_apart: ClassVar = True

    def formula(self, constants, penetration, penetration_rate, memory):
        return self.squeeze * jnp.where(penetration > 0, penetration, 0.0) ** 2 + memory[0]

    def energy(self, constants, penetration):
        return self.squeeze * jnp.where(penetration > 0, penetration, 0.0) ** 3 / 3

    def memory_rate(self, constants, penetration, penetration_rate, memory):
        return (jnp.ones_like(penetration),)


def test_a_law_may_act_apart_and_its_memory_goes_on():
    law = Ageing(jnp.asarray(1e9)).prepare(GEOMETRY)
    apart, age = jnp.asarray(-1e-4), (jnp.asarray(2.0),)
    assert float(law.force(apart, jnp.zeros(()), age)) == 2.0
    assert float(law.memory_rate(apart, jnp.zeros(()), age)[0]) == 1.0


def test_smoothed_onset_is_the_law_beyond_its_width():
    law = catalogue.NORMAL["kelvin-voigt"]
    smooth = laws.SmoothedOnset(law, 1e-6)
    whole, soft = law.prepare(GEOMETRY), smooth.prepare(GEOMETRY)
    deep, rate = jnp.asarray(1.1e-6), jnp.asarray(0.2)
    assert float(soft.force(deep, rate, ())) == float(whole.force(deep, rate, ()))
    assert float(soft.force(jnp.asarray(1e-12), rate, ())) < 1e-4 * float(whole.force(jnp.asarray(1e-12), rate, ()))


def test_lugre_bristle_stays_bounded_and_reaches_coulomb():
    law = catalogue.FRICTION["lugre"]
    rate = jax.jit(lambda v, z: jnp.stack(law.memory_rate(None, (v,), jnp.asarray(1.0), ((z[0],),))[0]))
    v = 2e-2
    solution = solve_ivp(lambda t, z: np.asarray(rate(v, jnp.asarray(z))), (0, 5e-3), [0.0], rtol=1e-8, atol=1e-14)
    assert np.max(np.abs(solution.y)) <= 0.4 / 1e5
    steady = float(law.traction(None, (jnp.asarray(v),), jnp.asarray(1.0), ((jnp.asarray(solution.y[0, -1]),),))[0])
    assert steady == pytest.approx(-0.3, rel=1e-5)


def impact(law, mass, speed, memory):
    """Delivered restitution, peak force and penetration, and duration of a free impact (DOP853, both ends located)."""
    law = law.prepare(GEOMETRY)
    force = jax.jit(lambda d, v: law.force(d, v, memory))
    formula = jax.jit(lambda d, v: law.law.formula(law.constants, d, v, memory))

    def rhs(t, y):
        return [y[1], -float(force(y[0], y[1])) / mass]

    def apart(t, y):
        return y[0]

    def clipped(t, y):
        return float(formula(y[0], y[1])) if t > 0 else 1.0

    for event in (apart, clipped):
        vars(event).update(terminal=True, direction=-1)
    start = [1e-16, speed]
    out = solve_ivp(
        rhs, (0, 1.0), start, method="DOP853", rtol=1e-11, atol=1e-16, events=[apart, clipped], dense_output=True
    )
    return -out.y[1, -1] / speed, out


@pytest.mark.parametrize(
    ("e", "exact", "ln", "flores"), [(0.3, 0.3, 0.6842, 0.2562), (0.5, 0.5, 0.7252, 0.4704), (0.9, 0.9, 0.9132, 0.8939)]
)
def test_delivered_restitution(e, exact, ln, flores):
    # Table of the delivered restitution derived from the phase-plane integral a(1+e) = ln((1+a)/(1-ae)).
    for make, expected in ((laws.exact_restitution, exact), (laws.lankarani_nikravesh, ln), (laws.flores, flores)):
        delivered, _ = impact(make(catalogue.K, e), 0.14, 0.5, (jnp.asarray(0.5),))
        assert delivered == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize("e", [0.05, 0.1, 0.3, 0.5, 0.9, 0.99, 0.999])
def test_exact_ratio_solves_its_equation(e):
    a = float(exact_ratio(jnp.asarray(e)))
    assert a * (1 + e) == pytest.approx(np.log1p(a) - np.log1p(-a * e), rel=1e-8)
    h = 1e-4 * e * (1 - e)
    difference = (exact_ratio(jnp.asarray(e + h)) - exact_ratio(jnp.asarray(e - h))) / (2 * h)
    assert float(jax.grad(exact_ratio)(jnp.asarray(e))) == pytest.approx(float(difference), rel=1e-5)


def test_hertz_impact_closed_form():
    # d_max = (5 m v^2 / 4 K)^0.4, F = K d^1.5, T = 2.943275 d/v
    _, out = impact(laws.Hertz(6.61e10), 0.14, 0.5, ())
    deepest = (5 * 0.14 * 0.25 / (4 * 6.61e10)) ** 0.4
    assert np.max(out.sol(np.linspace(0, out.t[-1], 20001))[0]) == pytest.approx(deepest, rel=1e-8)
    assert out.t[-1] == pytest.approx(2.943275 * deepest / 0.5, rel=1e-6)
    assert -out.y[1, -1] == pytest.approx(0.5, rel=1e-8)


@pytest.mark.parametrize(("zeta", "clipped", "unclipped"), [(0.05, 0.85876, 0.85447), (0.4, 0.36353, 0.25383)])
def test_kelvin_voigt_restitution(zeta, clipped, unclipped):
    k, m = 1e7, 0.14
    b = 2 * zeta * np.sqrt(k * m)
    e, _ = impact(laws.LinearKelvinVoigt(k, b), m, 0.5, ())
    assert e == pytest.approx(clipped, abs=1e-5)
    free = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    assert free == pytest.approx(unclipped, abs=1e-5)


@pytest.mark.parametrize(
    ("mass", "speed", "e"), [(50.0, 1e-3, 0.698), (50.0, 5e-3, 0.224), (300.0, 1e-3, 0.630), (300.0, 5e-3, 0.181)]
)
def test_adams_impact_with_the_papers_numbers(mass, speed, e):
    law = laws.AdamsImpact(2.487e6 * 1000**1.5, 2.487e6, 1e-5)
    delivered, _ = impact(law, mass, speed, ())
    assert delivered == pytest.approx(e, abs=6e-4)


def test_internal_hertz_stiffness_of_the_papers_joint():
    def pin(c):
        return laws.Geometry(jnp.asarray(0.025), jnp.asarray(0.025) + c, jnp.asarray(c))

    material = laws.InternalHertz(2.01e11, 2.06e11, 0.3, 0.3)
    assert float(material.value(pin(5e-5))) == pytest.approx(5.27540e11, rel=1e-5)
    slope = jax.grad(lambda c: material.value(pin(c)))(jnp.asarray(5e-5))
    assert float(slope) == pytest.approx(-5.27540e11 / (2 * 5e-5), rel=2e-3)
    fixed = laws.InternalHertz(2.01e11, 2.06e11, 0.3, 0.3, 5e-5)
    assert float(jax.grad(lambda c: fixed.value(pin(c)))(jnp.asarray(2e-4))) == 0.0
