"""The film of a short bearing against its closed form, and against a quadrature of Reynolds' equation."""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from formulas import Formula, plain
from places import ROOT, refused

from clearance_jax import laws
from clearance_jax.joints.elements import Offset, ShortBearing

VISCOSITY, CLEARANCE, RADIUS, LENGTH = 0.05, 1e-4, 0.02, 0.015
GEOMETRY = laws.Geometry(*(jnp.asarray(x) for x in (RADIUS, RADIUS + CLEARANCE, CLEARANCE, LENGTH)))
FILM = ShortBearing(VISCOSITY, 1e-7)


@jax.jit
def wrench(place, velocity, roll):
    zero = (0.0, 0.0, 0.0)
    offset = Offset((*place, 0.0), (*velocity, 0.0), zero, 1.0, zero, roll)
    (x, y, _), (_, _, torque) = FILM.wrench(offset, GEOMETRY)
    return jnp.stack([x, y, torque])


def film(place, velocity, roll):
    return np.asarray(wrench(*(tuple(jnp.asarray(float(c)) for c in p) for p in (place, velocity)), jnp.asarray(roll)))


@pytest.mark.parametrize("e", [0.05, 0.3, 0.7, 0.95])
def test_a_turning_pin_is_carried_as_ocvirk_says(e):
    x, y, _ = film((e * CLEARANCE, 0.0), (0.0, 0.0), 50.0)
    # W = m U L^3/(4 c^2) e/(1 - e^2)^2 sqrt(16 e^2 + pi^2 (1 - e^2)), tan phi = pi sqrt(1 - e^2)/(4 e).
    speed = 50.0 * RADIUS
    load = VISCOSITY * speed * LENGTH**3 / (4 * CLEARANCE**2) * e / (1 - e * e) ** 2
    assert np.hypot(x, y) == pytest.approx(load * np.sqrt(16 * e * e + np.pi**2 * (1 - e * e)), rel=1e-12)
    assert x < 0 < y  # away from the wall, and on in the sense of the turning
    assert abs(y / x) == pytest.approx(np.pi * np.sqrt(1 - e * e) / (4 * e), rel=1e-12)


@pytest.mark.parametrize("roll", [0.0, 80.0, -300.0])
def test_squeeze_and_turning_by_quadrature(roll):
    rng = np.random.default_rng(3)
    for _ in range(6):
        place, velocity = CLEARANCE * 0.6 * rng.uniform(-1, 1, 2), 0.01 * rng.uniform(-1, 1, 2)
        angle = np.linspace(0, 2 * np.pi, 200_001)[:-1]
        normal = np.array([np.cos(angle), np.sin(angle)])
        height = CLEARANCE - place @ normal
        rate, slope = -velocity @ normal, place[0] * np.sin(angle) - place[1] * np.cos(angle)
        # d/dz (h^3 dp/dz) = 12 m (dh/dt + w/2 dh/dt_angle), and its integral over z: L^3/12 of the right-hand side.
        pressure = np.maximum(-VISCOSITY * LENGTH**3 / height**3 * (rate + 0.5 * roll * slope), 0.0)
        force = -RADIUS * np.mean(pressure * normal, axis=1) * 2 * np.pi
        found = film(place, velocity, roll)
        np.testing.assert_allclose(found[:2], force, rtol=1e-6, atol=1e-6 * np.abs(force).max())
        # It never adds power.
        assert found[:2] @ velocity + found[2] * roll <= 0


def test_a_film_gives_over_to_contact():
    """Beyond the wall its force is finite, and its slope has no jump where it is held."""
    deep = film((1.2 * CLEARANCE, 0.0), (1e-3, 0.0), 0.0)
    held = film((1.0 * CLEARANCE, 0.0), (1e-3, 0.0), 0.0)
    np.testing.assert_allclose(deep, held, rtol=1e-12)
    assert np.all(np.isfinite(film((0.0, 0.0), (0.0, 0.0), 0.0)))
    slope = jax.jit(
        jax.grad(lambda x: wrench((x, jnp.zeros(())), (jnp.asarray(1e-3), jnp.zeros(())), jnp.zeros(()))[0])
    )
    begin = CLEARANCE - 2e-7
    before, after = (float(slope(jnp.asarray(begin + d))) for d in (-1e-12, 1e-12))
    assert before == pytest.approx(after, rel=1e-3)


# A worn sleeve ------------------------------------------------------------------------------------------------------

SOME = (0.4, -0.5), (3e-3, 2e-3), 40.0


@jax.jit
def worn(depth, place, velocity, roll):
    zero = (0.0, 0.0, 0.0)
    offset = Offset((*place, 0.0), (*velocity, 0.0), zero, 1.0, zero, roll)
    (x, y, _), (_, _, torque) = FILM.wrench(offset, GEOMETRY._replace(depth=depth))
    return jnp.stack([x, y, torque])


@pytest.mark.parametrize("sectors", [16, 360])
@pytest.mark.parametrize("off", [0.0, 5e-5])
def test_an_evenly_worn_sleeve_is_a_larger_one(sectors, off):
    """Also where roughness holds the film, and where the pin stands in the wall."""
    larger = CLEARANCE + off
    for size, rtol in ((0.0, 1e-4), (0.6, 1e-4), (0.95, 1e-4), (0.9985, 1e-3), (1.01, 1e-3)):
        place = tuple(jnp.asarray(size * larger * c) for c in (0.6, -0.8))
        velocity = tuple(jnp.asarray(c) for c in SOME[1])
        found = np.asarray(worn(jnp.full(sectors, off), place, velocity, jnp.asarray(40.0)))
        zero = (0.0, 0.0, 0.0)
        geometry = GEOMETRY._replace(radial_clearance=jnp.asarray(larger))
        force, torque = FILM.wrench(Offset((*place, 0.0), (*velocity, 0.0), zero, 1.0, zero, 40.0), geometry)
        expected = np.array([*force[:2], torque[2]])
        np.testing.assert_allclose(found[:2], expected[:2], rtol=rtol, atol=rtol * np.abs(expected[:2]).max())
        assert found[2] == pytest.approx(expected[2], rel=rtol)


def test_a_pin_is_carried_where_the_worn_sleeve_carries_it():
    """At rest under a load it is as far out as Ocvirk's load says of the larger clearance."""
    load, c = 100.0, CLEARANCE + 5e-5
    speed = 50.0 * RADIUS

    def ocvirk(e):
        whole = VISCOSITY * speed * LENGTH**3 / (4 * c**2) * e / (1 - e * e) ** 2
        return whole * np.sqrt(16 * e * e + np.pi**2 * (1 - e * e)) - load

    e: Any = scipy.optimize.brentq(ocvirk, 0.01, 0.99)
    place, still = (jnp.asarray(e * c), jnp.zeros(())), (jnp.zeros(()), jnp.zeros(()))
    x, y, _ = np.asarray(worn(jnp.full(360, 5e-5), place, still, jnp.asarray(50.0)))
    assert np.hypot(x, y) == pytest.approx(load, rel=1e-4)


def test_a_profile_by_quadrature_and_its_derivatives():
    """The pressure of the local height, integrated over the angle; the derivatives by place, and by depth."""
    sectors, (place, velocity, roll) = 360, SOME
    place = CLEARANCE * np.array(place)

    def profile(angle):
        return 3e-5 * (1 + np.sin(2 * angle) * np.cos(angle - 1.0))

    angle = np.linspace(0, 2 * np.pi, 200_001)[:-1]
    normal = np.array([np.cos(angle), np.sin(angle)])
    height = CLEARANCE + profile(angle) - place @ normal
    rate, slope = -np.array(velocity) @ normal, np.gradient(height, angle)
    pressure = np.maximum(-VISCOSITY * LENGTH**3 / height**3 * (rate + 0.5 * roll * slope), 0.0)
    force = -RADIUS * np.mean(pressure * normal, axis=1) * 2 * np.pi
    shear = VISCOSITY * RADIUS**3 * LENGTH * roll * np.mean(1 / height) * 2 * np.pi
    torque = np.pi * RADIUS * np.mean(pressure * slope) - shear
    given = tuple(map(jnp.asarray, place)), tuple(map(jnp.asarray, velocity)), jnp.asarray(roll)
    depth = jnp.asarray(profile(2 * np.pi * np.arange(sectors) / sectors))
    found = np.asarray(worn(depth, *given))
    np.testing.assert_allclose(found, [*force, torque], rtol=1e-3)
    assert found[:2] @ np.array(velocity) + found[2] * roll <= 0

    @jax.jit
    def along(step):
        return worn(depth * (1 + step), (given[0][0] * (1 + step), given[0][1]), *given[1:])

    differences = (along(1e-5) - along(-1e-5)) / 2e-5
    np.testing.assert_allclose(jax.jvp(along, (0.0,), (1.0,))[1], differences, rtol=1e-6)


def test_a_sleeve_that_is_worn_by_stations_has_no_film():
    with refused("depth"):
        worn(jnp.zeros((4, 360)), (jnp.zeros(()),) * 2, (jnp.zeros(()),) * 2, jnp.zeros(()))


FOUND_IN_DOCS = r"A film has the height .*?(?=\n\nA preloaded bearing has)"


def docs_formulas() -> dict[str, str]:
    """The formulas of the film in docs/joints.md: height, pressure, moment, and the held eccentricity with its s."""
    (text,) = re.findall(FOUND_IN_DOCS, (ROOT / "docs" / "joints.md").read_text(encoding="utf-8"), re.DOTALL)
    text = text.replace(r"\frac{\partial h}{\partial \varphi}", "h_t")
    (height,) = re.findall(r"height \$h = ([^$]*)\$ at", text)
    (pressure,) = re.findall(r"\$\$([^$]*)\$\$", text)
    (moment,) = re.findall(r"moment on the pin is \$([^$]*)\$", text)
    (held,) = re.findall(r"smaller eccentricity \$([^$]*)\$", text)
    (s,) = re.findall(r"with \$s = ([^$]*)\$, at most 1", text)
    return {name: plain(told) for name, told in locals().items() if name != "text"}


def of_docs(name: str, **symbols):
    """The value of a formula of the docs, which must be read to its end."""
    told = docs_formulas()[name]
    formula = Formula(told, {"pi", *symbols})
    assert not told[formula.end :].strip()
    return formula.value({"pi": np.pi, **symbols}.__getitem__)


@pytest.mark.parametrize("reach", [0.5, 0.9, 0.999, 1.2])
def test_the_film_of_the_docs(reach):
    """From free motion to a pin that is nearer to the wall than the roughness."""
    least, angle = 1e-5, np.linspace(0, 2 * np.pi, 50_001)[:-1]
    rough = jax.jit(
        lambda p, u, w: ShortBearing(VISCOSITY, least).wrench(
            Offset((*p, 0.0), (*u, 0.0), (0.0,) * 3, 1.0, (0.0,) * 3, w), GEOMETRY
        )
    )
    places, weights = np.polynomial.legendre.leggauss(4)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        way, (u, v), turning = rng.uniform(0, 2 * np.pi), 0.01 * rng.uniform(-1, 1, 2), rng.uniform(-100, 100)
        p, part = reach * CLEARANCE, least / CLEARANCE
        if reach > 1 - 2 * part:
            s = min(of_docs("s", p=p, c=CLEARANCE, l=part), 1.0)
            p = of_docs("held", c=CLEARANCE, l=part, s=s)
        x, y = p * np.cos(way), p * np.sin(way)
        height = of_docs("height", c=CLEARANCE, p_x=x, p_y=y, varphi=angle)
        assert height.min() > 0.999 * least
        rate = -u * np.cos(angle) - v * np.sin(angle)
        slope = x * np.sin(angle) - y * np.cos(angle)
        given = {"mu": VISCOSITY, "L": LENGTH, "omega": turning, "h": height, "h'": rate, "h_t": slope}
        lines = [np.maximum(of_docs("pressure", z=LENGTH / 2 * z, **given), 0.0) for z in places]
        line = LENGTH / 2 * np.tensordot(weights, lines, 1)
        fx, fy = (-RADIUS * 2 * np.pi * np.mean(line * f(angle)) for f in (np.cos, np.sin))
        moment = of_docs(
            "moment", p_x=x, p_y=y, f_x=fx, f_y=fy, mu=VISCOSITY, r=RADIUS, L=LENGTH, omega=turning, c=CLEARANCE
        )
        true_place = (reach * CLEARANCE * np.cos(way), reach * CLEARANCE * np.sin(way))
        (a, b, _), (_, _, torque) = rough(true_place, (u, v), turning)
        np.testing.assert_allclose([a, b], [fx, fy], rtol=1e-6, atol=1e-6 * np.hypot(fx, fy))
        assert float(torque) == pytest.approx(moment, rel=1e-6)
