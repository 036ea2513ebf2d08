"""The laws of the literature against tables and closed forms that share no code with them."""

from typing import Any

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from clearance_jax import laws
from clearance_jax.laws.normal import ratios

# A pin of 25 mm in a sleeve of 25.05 mm and 50 mm, of steel; E* [Pa].
E_1, E_2 = 2.01e11, 2.06e11
MODULUS = 1 / ((1 - 0.09) / E_1 + (1 - 0.09) / E_2)
PIN, SLEEVE, CLEARANCE, LENGTH = 0.025, 0.02505, 5e-5, 0.05
GEOMETRY = laws.Geometry(*(jnp.asarray(x) for x in (PIN, SLEEVE, CLEARANCE, LENGTH)))
BALL = GEOMETRY._replace(length=None)
STILL = jnp.zeros(())

# Restitution that the laws deliver for the ones set, to the printed digits: roots of a (1 + e) = ln((1 + a)/(1 - a e)).
SET = (0.05, 0.1, 0.2, 0.3, 0.4, 0.46, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
DELIVERED = {
    "lee_wang": ".6746 .6867 .7120 .7390 .7680 .7864 .7992 .8329 .8693 .9090 .9524 .9756 .9950",
    "lankarani_nikravesh": ".6635 .6653 .6723 .6842 .7016 .7150 .7252 .7561 .7960 .8471 .9132 .9535 .9901",
    "hunt_crossley": ".5014 .5158 .5469 .5813 .6197 .6450 .6630 .7120 .7680 .8329 .9090 .9524 .9901",
    "herbert_mcwhannell": ".4884 .4907 .5008 .5200 .5503 .5746 .5936 .6511 .7227 .8070 .9009 .9501 .9900",
    "gonthier": ".0501 .1010 .2046 .3042 .3978 .4520 .4877 .5773 .6696 .7680 .8764 .9359 .9868",
    "zhiying_qishao": ".1969 .2175 .2664 .3267 .3988 .4478 .4826 .5769 .6796 .7874 .8959 .9489 .9900",
    "flores": ".0329 .0694 .1555 .2562 .3629 .4275 .4704 .5773 .6832 .7885 .8939 .9468 .9893",
    "hu_guo": ".0351 .0741 .1656 .2707 .3796 .4447 .4877 .5936 .6973 .7992 .8999 .9500 .9900",
    "gharib_hurmuzlu": ".0500 .1000 .1970 .2819 .3524 .3887 .4107 .4595 .5008 .5362 .5668 .5807 .5911",
    "exact_restitution": " ".join(map(str, SET)),
}
EXACT = (
    20.0,
    9.9982,
    4.9192,
    3.0871,
    2.0825,
    1.6635,
    1.43275,
    0.97487,
    0.634828,
    0.373146,
    0.166482,
    0.078927,
    0.015151,
)


@pytest.mark.parametrize("name", DELIVERED)
def test_delivered_restitution_of_the_family(name):
    """By the library's Newton, and by a root of the phase-plane relation that scipy finds."""
    make = getattr(laws, name)
    expected = np.array(DELIVERED[name].split(), float)
    for e, told in zip(SET, expected, strict=True):
        law = make(6.61e10, e)
        assert float(law.delivered_restitution()) == pytest.approx(told, abs=1e-4)
        a = float(law.ratio(jnp.asarray(e)))
        delivered = root(lambda x, a=a: a * (1 + x) - np.log1p(a) + np.log1p(-a * x), 1e-9, (1 - 1e-13) / max(a, 1.0))
        assert float(law.delivered_restitution()) == pytest.approx(delivered, rel=1e-8)


def test_the_exact_ratio_and_its_delivery():
    found = [float(ratios.exact_ratio(jnp.asarray(e))) for e in SET]
    np.testing.assert_allclose(found, EXACT, rtol=1e-4)
    # The derivative of the root by its ratio is the inverse of that of the ratio by the root.
    rise = jax.grad(ratios.exact_ratio)(jnp.asarray(0.6))
    back = jax.grad(ratios.delivered_restitution)(ratios.exact_ratio(jnp.asarray(0.6)))
    assert float(rise * back) == pytest.approx(1, rel=1e-9)


# Elastic force [N] at a penetration [mm], to the printed digits.
DEPTHS = (1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
FORCES = {
    "hertz": (16.68, 186.5, 527.5, 1492, 5898, 16680),
    "johnson": (200.2, 1268, 2875, 6669, 21420, 55930),
    "esdu": (159.7, 953.2, 2083, 4598, 13360, 30570),
    "radzimovsky": (193.2, 1211, 2726, 6260, 19660, 49600),
    "liu": (27.74, 308.9, 869.4, 2435, 9360, 25350),
    "bai_zhao": (41.58, 461.8, 1296, 3606, 13610, 35910),
    "pereira": (165.6, 1233, 2928, 6953, 21810, 51770),
}


def root(function, low, high, **options) -> float:
    """By scipy's `brentq`."""
    found: Any = brentq(function, low, high, **options)
    return float(found)


def elastic(law, depths, geometry=GEOMETRY):
    ready = law.prepare(geometry)
    memory = tuple(jnp.asarray(1.0) for _ in law.remembers)
    return np.asarray(jax.jit(jax.vmap(lambda d: ready.force(d, STILL, memory)))(jnp.asarray(depths)))


@pytest.mark.parametrize("name", FORCES)
def test_forces_of_line_contact(name):
    law = laws.Hertz(laws.InternalHertz(E_1, E_2)) if name == "hertz" else getattr(laws, name)(E_1, E_2)
    found = elastic(law, 1e-3 * np.array(DEPTHS))
    told = np.array(FORCES[name])
    # Half of the fourth digit.
    assert np.all(np.abs(found - told) <= 0.5001 * 10.0 ** (np.floor(np.log10(told)) - 3) * 1.1)


def implicit(depth, shape):
    """F' by scipy from d(F')."""
    return root(lambda f: shape(f) - depth, 1e-6, 4 * np.pi * MODULUS * CLEARANCE * 0.134, xtol=1e-9, rtol=1e-14)


def logarithm(inside, constant):
    return lambda f: f / (np.pi * MODULUS) * (np.log(inside(f)) + constant)


def test_implicit_laws_solve_their_equations():
    radius = PIN * SLEEVE / CLEARANCE
    width = lambda f: 4 * np.sqrt(f * radius / (np.pi * MODULUS))  # noqa: E731
    shapes = {
        laws.johnson: logarithm(lambda f: 4 * np.pi * MODULUS * CLEARANCE / f, -1),
        laws.radzimovsky: logarithm(lambda f: 16 * PIN * SLEEVE / width(f) ** 2, 2 / 3),
        laws.esdu: logarithm(lambda f: 4 * np.pi * MODULUS * CLEARANCE / f, 1),
        laws.dubowsky_freudenstein: logarithm(
            lambda f: np.pi * MODULUS * LENGTH**2 * CLEARANCE / (f * PIN * SLEEVE), 1
        ),
    }
    depths = np.array([1e-10, 1e-8, 1e-6, 2e-5])
    for make, shape in shapes.items():
        expected = [LENGTH * implicit(d, shape) for d in depths]
        np.testing.assert_allclose(elastic(make(E_1, E_2), depths), expected, rtol=1e-8)


def test_goldsmith_counts_in_millimetres():
    shape = logarithm(lambda f: np.pi * MODULUS * 1e-6 * CLEARANCE * 1e3 / (f * 1e-3 * PIN * SLEEVE * 1e6), 1)
    expected = LENGTH * root(lambda f: shape(f) - 5e-8, 1e-3, 5e4)
    assert elastic(laws.goldsmith(E_1, E_2), [5e-8])[0] == pytest.approx(expected, rel=1e-8)


def test_a_logarithm_goes_on_along_its_tangent():
    law = laws.johnson(E_1, E_2)
    ready = law.prepare(GEOMETRY)
    limit = law.validity(ready.constants)
    assert float(limit) == pytest.approx(0.4925 * CLEARANCE, rel=1e-3)
    assert float(limit) < 4 * np.exp(-2) * CLEARANCE  # where the relation turns back
    slope = jax.vmap(jax.grad(lambda d: ready.force(d, STILL, ())))
    here, beyond = slope(limit * jnp.array([1 - 1e-9, 3.0]))
    assert float(here) == pytest.approx(float(beyond), rel=1e-6)
    assert float(beyond) == pytest.approx(2 * np.pi * MODULUS * LENGTH, rel=1e-12)


def test_derivatives_of_an_implicit_law_by_its_clearance():
    def force(c):
        ready = laws.johnson(E_1, E_2).prepare(GEOMETRY._replace(radial_clearance=c))
        return ready.force(jnp.asarray(1e-6), STILL, ())

    # dF/dc at a fixed d, from the relation: -F'/c / (ln(4 pi E* c / F') - 2).
    value, slope = jax.value_and_grad(force)(jnp.asarray(CLEARANCE))
    per_length = float(value) / LENGTH
    expected = -per_length / CLEARANCE / (np.log(4 * np.pi * MODULUS * CLEARANCE / per_length) - 2)
    assert float(slope) == pytest.approx(LENGTH * expected, rel=1e-9)


def test_winkler_is_the_sum_of_its_springs():
    stiffness, depths = 2e13, np.array([1e-12, 1e-8, 1e-5, 4e-5, 2e-4])
    expected = []
    nodes, weights = np.polynomial.legendre.leggauss(60)
    for d in depths:
        reach = CLEARANCE + d
        end = 2 * np.arcsin(np.sqrt(d / (2 * reach)))
        angle = 0.5 * end * (nodes + 1)
        # cos t - cos t0 without the difference.
        deep = 2 * reach * np.sin((end + angle) / 2) * np.sin((end - angle) / 2)
        expected.append(stiffness * LENGTH * SLEEVE * end * np.sum(weights * deep * np.cos(angle)))
    np.testing.assert_allclose(elastic(laws.Winkler(stiffness), depths), expected, rtol=1e-12)
    small = 2 / 3 * stiffness * LENGTH * SLEEVE * CLEARANCE * (2e-8 / CLEARANCE) ** 1.5
    assert elastic(laws.Winkler(stiffness), [1e-8])[0] == pytest.approx(small, rel=1e-3)


def test_line_laws_need_a_line():
    for law in (laws.johnson(E_1, E_2), laws.Winkler(2e13)):
        for geometry in (BALL, GEOMETRY._replace(kind="flat")):
            with refused("length"):
                law.prepare(geometry)


def bounce(law, mass, speed):
    """Delivered restitution of a free impact, both ends of it located."""
    ready = law.prepare(GEOMETRY)
    memory = tuple(jnp.asarray(speed) for _ in law.remembers)
    force = jax.jit(lambda d, v: ready.force(d, v, memory))
    unclipped = jax.jit(lambda d, v: law.formula(ready.constants, d, v, memory))

    def apart(t, y):
        return y[0]

    def released(t, y):
        return float(unclipped(y[0], y[1])) if t > 0 and law.clips else 1.0

    for event in (apart, released):
        vars(event).update(terminal=True, direction=-1)
    out = solve_ivp(
        lambda t, y: [y[1], -float(force(*y)) / mass], (0, 1.0), [1e-16, speed], "DOP853", None, False,
        [apart, released], rtol=1e-10, atol=1e-16,
    )  # fmt: skip
    return -out.y[1, -1] / speed


@pytest.mark.parametrize(("e", "clipped"), [(0.9, 0.9020), (0.5, 0.5503)])
def test_tsuji_delivers_what_it_is_set_at_every_speed(e, clipped):
    for speed in (0.05, 0.5):
        assert bounce(laws.Tsuji(6.61e10, e, 0.14), 0.14, speed) == pytest.approx(e, abs=2e-5)
    assert bounce(laws.Tsuji(6.61e10, e, 0.14, clipped=True), 0.14, 0.5) == pytest.approx(clipped, abs=1e-4)


def test_anagnostopoulos_is_a_spring_and_damper_of_its_restitution():
    law = laws.Anagnostopoulos(1e7, 0.7, 0.14)
    ready = law.prepare(GEOMETRY)
    ratio = -np.log(0.7) / np.sqrt(np.pi**2 + np.log(0.7) ** 2)
    damping = float(ready.force(jnp.asarray(1e-15), jnp.asarray(1.0), ()))
    assert damping == pytest.approx(2 * ratio * np.sqrt(1e7 * 0.14), rel=1e-7)
    assert np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2)) == pytest.approx(0.7)


def test_a_line_contact_delivers_its_restitution():
    """The relation of damping ratio and restitution holds for every elastic force."""
    assert bounce(laws.johnson(E_1, E_2, restitution=0.7), 0.14, 0.5) == pytest.approx(0.7, abs=1e-5)
    assert bounce(laws.pereira(E_1, E_2, restitution=0.7), 0.14, 0.5) == pytest.approx(0.7960, abs=1e-4)


def test_a_solid_that_relaxes():
    """Relaxation under a held penetration, the loss of a harmonic one, and an impact by the exponential of a matrix."""
    stiffness, share, time = 1e7, 0.4, 5e-3
    law = laws.StandardLinearSolid(stiffness, share, time)
    ready = law.prepare(GEOMETRY)

    def rate(d, z):
        return ready.memory_rate(d, STILL, (z,))[0]

    rate, force = jax.jit(rate), jax.jit(lambda d, z: ready.force(d, STILL, (z,)))
    held = 1e-5
    flow = solve_ivp(lambda t, z: [float(rate(held, z[0]))], (0, 0.01), [0.0], rtol=1e-9, atol=1e-18).y[0, -1]
    expected = stiffness * held * (1 - share * (1 - np.exp(-0.01 / time)))
    assert float(force(held, flow)) == pytest.approx(expected, rel=1e-7)
    # d = d0 + A sin(w t): the loss of a period is pi g K A^2 w T / (1 + w^2 T^2).
    w, size = 300.0, 4e-6
    steps = np.linspace(0, 2 * np.pi / w, 4001)[:-1]
    lag = size / np.sqrt(1 + (w * time) ** 2) * np.sin(w * steps - np.arctan(w * time))
    forces = np.asarray(jax.vmap(force)(jnp.asarray(held + size * np.sin(w * steps)), jnp.asarray(held + lag)))
    loss = np.mean(forces * size * w * np.cos(w * steps)) * 2 * np.pi / w
    expected = np.pi * share * stiffness * size**2 * w * time / (1 + (w * time) ** 2)
    assert loss == pytest.approx(expected, rel=1e-9)
    # A free impact is linear until the force is zero.
    mass, speed = 0.14, 0.5
    system = np.array([[0, 1, 0], [-stiffness / mass, 0, share * stiffness / mass], [1 / time, 0, -1 / time]])
    start = np.array([0.0, speed, 0.0])
    end = root(lambda t: np.array([1, 0, -share]) @ expm(system * t) @ start, 2e-4, 5e-4)
    found = solve_ivp(
        lambda t, y: [y[1], -float(force(y[0], y[2])) / mass, float(rate(y[0], y[2]))],
        (0, 2 * end), start, "DOP853", rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    assert found.y[1, -1] == pytest.approx((expm(system * end) @ start)[1], rel=1e-6)
    # Apart, the wall recovers free of force.
    assert float(rate(-1e-5, 2e-6)) == pytest.approx(-(1 - share) * 2e-6 / time)
    assert float(force(-1e-5, 2e-6)) == 0.0


# Friction -------------------------------------------------------------------------------------------------------------


def step(x, x0, h0, x1, h1):
    s = np.clip((x - x0) / (x1 - x0), 0, 1)
    return h0 + (h1 - h0) * s * s * (3 - 2 * s)


def adams(v):
    slow, fast = 1e-3, 1e-2
    if abs(v) < slow:
        return step(v, -slow, -0.4, slow, 0.4)
    return np.sign(v) * step(abs(v), slow, 0.4, fast, 0.3)


def bengisu_akay(v):
    speed = abs(v)
    slow, fast = 0.4 - 0.4 / 1e-4 * (speed - 1e-2) ** 2, 0.3 + 0.1 * np.exp(-200 * (speed - 1e-2))
    return np.sign(v) * (slow if speed <= 1e-2 else fast)


CURVES = [
    (laws.AdamsFriction(0.4, 0.3, 1e-3, 1e-2), adams),
    (laws.Threlfall(0.3, 1e-2), lambda v: 0.3 * np.sign(v) * (1 - np.exp(-3 * min(abs(v) / 1e-2, 1)))),
    (laws.Ambrosio(0.3, 1e-3, 1e-2), lambda v: 0.3 * np.sign(v) * np.clip((abs(v) - 1e-3) / 9e-3, 0, 1)),
    (laws.BengisuAkay(0.4, 0.3, 1e-2, 5e-3), bengisu_akay),
    (
        laws.Stribeck(0.4, 0.3, 1e-3, 1e-4, 1.0, 2.0),
        lambda v: (0.3 + 0.1 * np.exp(-abs(v) / 1e-3)) * np.tanh(v / 1e-4) + 2 * v,
    ),
]


@pytest.mark.parametrize(("law", "curve"), CURVES, ids=lambda x: type(x).__name__)
def test_friction_over_slip(law, curve):
    slips = np.array([-0.05, -1.1e-2, -1e-2, -7e-3, -1e-3, -6e-4, -1e-7, 1e-7, 3e-4, 2e-3, 9e-3, 0.02, 1.0])
    ready = law.prepare(GEOMETRY)
    traction = jax.jit(jax.vmap(lambda v: ready.traction((v,), jnp.asarray(10.0), ())[0]))(jnp.asarray(slips))
    np.testing.assert_allclose(traction, [-10 * curve(v) for v in slips], rtol=1e-12, atol=1e-15)


def test_two_speeds_of_a_law_must_follow_each_other():
    for law in (laws.AdamsFriction(0.4, 0.3, 1e-2, 1e-3), laws.Ambrosio(0.3, 1e-2, 1e-3)):
        assert not any(bool(demand.holds) for demand in law.demands())


def test_bristles_of_dahl_follow_their_closed_form():
    """From a straight bristle at a constant slip: s0 z = mu (1 - exp(-s0 x / mu)) over the distance x."""
    law = laws.Dahl(0.3, 1e5)
    rate = jax.jit(lambda v, z: law.memory_rate(None, (v,), jnp.asarray(1.0), ((z,),))[0][0])
    found = solve_ivp(lambda t, z: [float(rate(0.01, z[0]))], (0, 5e-4), [0.0], rtol=1e-9, atol=1e-16).y[0, -1]
    assert 1e5 * found == pytest.approx(0.3 * (1 - np.exp(-1e5 * 5e-6 / 0.3)), rel=1e-7)


@pytest.mark.parametrize("name", ["dahl", "lugre", "elasto-plastic"])
def test_a_touch_a_step_ago_bends_a_bristle_as_its_rate_does(name):
    """A step may begin as long after a touch as a bristle takes to bend fully. Its derivative by the time of the touch,
    which is what an impact in a wide play has of it, is as exact: -0.603 and not +2.14 at the end of such an impact.
    """
    law, slip = catalogue.FRICTION[name], jnp.array([12.0, -16.0])
    zero = jnp.zeros(())

    def bend(elapsed):
        touch = laws.Touch(jnp.asarray(True), jnp.asarray(False), zero, tuple(slip), elapsed)
        return jnp.stack(law.latch(None, ((zero, zero),), touch)[0])

    rates = jax.jit(lambda z: jnp.stack(law.memory_rate(None, tuple(slip), jnp.ones(()), (tuple(z),))[0]))
    # A fifth of the way: there elasto-plastic bristles do not give way yet.
    for elapsed in (1e-12, 3e-8):
        bent, rate = jax.jvp(bend, (jnp.asarray(elapsed),), (jnp.ones(()),))
        right = solve_ivp(lambda t, z: rates(z), (0, elapsed), [0.0, 0.0], rtol=1e-11, atol=1e-20).y[:, -1]
        np.testing.assert_allclose(bent, right, rtol=1e-9)
        np.testing.assert_allclose(rate, rates(right), rtol=1e-9)


def test_an_elasto_plastic_pin_does_not_drift_under_a_small_load():
    """Bristles that swing below break-away come back exactly; LuGre's creep on. At high slip both are the same."""
    rest = laws.ElastoPlastic(0.4, 0.3, 1e-3, 1e5, 0.0, breakaway_share=0.7)
    creeping = laws.LuGre(0.4, 0.3, 1e-3, 1e5)

    def rate(law):
        return jax.jit(lambda v, z: law.memory_rate(None, (v,), jnp.asarray(1.0), ((z,),))[0][0])

    def after(law, slip, start, end):
        asked = rate(law)
        return solve_ivp(lambda t, z: [float(asked(slip(t), z[0]))], (0, end), [start], rtol=1e-9, atol=1e-16).y[0, -1]

    def swing(t):
        return 2e-6 * 100 * np.sin(100 * t)  # up to 4 um and back, in 63 ms: 0.7 of 4 um is not reached by 2 um

    assert after(rest, lambda t: 0.5 * swing(t), 0.0, 2 * np.pi / 100) == pytest.approx(0.0, abs=1e-13)
    assert abs(after(creeping, lambda t: 0.5 * swing(t), 0.0, 2 * np.pi / 100)) > 1e-8
    for law in (rest, creeping):
        assert 1e5 * after(law, lambda t: 0.02, 0.0, 5e-3) == pytest.approx(0.3, rel=1e-6)
