"""The restitution that laws deliver, and the damping for a wanted one, against impacts that scipy simulates by the
laws' formulas, which are written here anew.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.integrate import solve_ivp

from clearance_jax import laws
from clearance_jax.errors import ClearanceError

K, LINEAR, MASS, SPEED = 6.61e10, 1e7, 0.14, 0.5
GEOMETRY = laws.Geometry(*(jnp.asarray(x) for x in (0.01, 0.0105, 5e-4, 0.02)))


def bounce(force, mass=MASS, speed=SPEED) -> float:
    """The speed after a free impact over that before it."""

    def apart(t, y):
        return y[0]

    vars(apart).update(terminal=True, direction=-1)
    out = solve_ivp(
        lambda t, y: [y[1], -force(max(y[0], 0.0), y[1]) / mass], (0, 1.0), [1e-16, speed], "DOP853",
        events=apart, rtol=1e-10, atol=1e-15,
    )  # fmt: skip
    assert out.status == 1
    return -out.y[1, -1] / speed


def hunt_crossley(law):
    return lambda d, v: max(0.0, K * d**1.5 * (1 + float(law.damping_factor) * v))


def kelvin_voigt(law):
    least = 0.0 if law.clipped else -np.inf
    return lambda d, v: max(least, LINEAR * d + float(law.damping) * v)


def adams(law):
    def force(d, v):
        s = min(d / 1e-5, 1.0)
        return max(0.0, K * d**1.5 + float(law.damping) * s * s * (3 - 2 * s) * v)

    return force


def constant(stiffness, n):
    def of(law):
        logarithm = np.log(float(law.restitution))
        damping = -logarithm / np.hypot(np.pi, logarithm) * np.sqrt(2 * (n + 1) * float(law.effective_mass) * stiffness)
        least = 0.0 if law.clipped else -np.inf
        return lambda d, v: max(least, stiffness * d**n + damping * d ** ((n - 1) / 2) * v)

    return of


CASES: dict[str, tuple[Any, Any]] = {
    "hunt-crossley": (laws.HuntCrossley(K, 0.5), hunt_crossley),
    "kelvin-voigt": (laws.LinearKelvinVoigt(LINEAR, 500.0), kelvin_voigt),
    "kelvin-voigt-overdamped": (laws.LinearKelvinVoigt(LINEAR, 4000.0), kelvin_voigt),
    "kelvin-voigt-unclipped": (laws.LinearKelvinVoigt(LINEAR, 500.0, clipped=False), kelvin_voigt),
    "tsuji": (laws.Tsuji(K, 0.7, MASS), constant(K, 1.5)),
    "tsuji-clipped": (laws.Tsuji(K, 0.7, MASS, clipped=True), constant(K, 1.5)),
    "tsuji-other-mass": (laws.Tsuji(K, 0.5, 0.3), constant(K, 1.5)),
    "anagnostopoulos-clipped": (laws.Anagnostopoulos(LINEAR, 0.4, MASS, clipped=True), constant(LINEAR, 1.0)),
    "adams-impact": (laws.AdamsImpact(K, 2000.0, 1e-5), adams),
}


@pytest.mark.parametrize("name", CASES)
def test_what_a_law_delivers(name):
    law, force = CASES[name]
    for speed, mass in ((0.05, MASS), (0.8, 2 * MASS)):
        told = float(law.delivered_restitution(speed, mass))
        assert told == pytest.approx(bounce(force(law), mass, speed), abs=2e-6), (speed, mass)


@pytest.mark.parametrize("name", CASES)
def test_the_damping_for_a_restitution(name):
    law, force = CASES[name]
    for wanted in (0.25, 0.8)[: 1 if name == "adams-impact" else 2]:
        chosen = law.for_restitution(wanted, SPEED, MASS)
        assert type(chosen) is type(law)
        assert bounce(force(chosen)) == pytest.approx(wanted, abs=2e-6)


def test_laws_that_remember_the_impact_speed():
    """They take the exact ratio; slower than their least speed they lose less."""
    law = laws.lankarani_nikravesh(K, 0.3, minimum_impact_speed=0.1)
    chosen = law.for_restitution(0.6)
    assert float(chosen.delivered_restitution()) == pytest.approx(0.6, rel=1e-12)
    assert float(chosen.minimum_impact_speed) == 0.1
    a = float(law.damping_ratio)
    told = float(law.delivered_restitution(speed=0.02))
    assert told == pytest.approx(bounce(lambda d, v: K * d**1.5 * max(0.0, 1 + a * v / 0.1), MASS, 0.02), abs=2e-6)
    line = laws.bai_zhao(2e11, 2e11, restitution=0.5).for_restitution(0.7)
    assert float(line.delivered_restitution()) == pytest.approx(0.7, rel=1e-12)


def test_simulated_impacts():
    """Laws without a closed form: one of a solid that relaxes, and of laws that are made of others."""
    solid = laws.StandardLinearSolid(LINEAR, 0.4, 5e-4)

    def slope(t, y):
        wall = max(max(y[0], 0.0), 0.4 * y[2])
        return [y[1], -LINEAR * max(0.0, y[0] - 0.4 * y[2]) / MASS, (wall - y[2]) / 5e-4]

    def apart(t, y):
        return y[0]

    vars(apart).update(terminal=True, direction=-1)
    out = solve_ivp(slope, (0, 1), [1e-16, SPEED, 0.0], "DOP853", events=apart, rtol=1e-10, atol=1e-15)
    assert float(solid.delivered_restitution(SPEED, MASS)) == pytest.approx(-out.y[1, -1] / SPEED, abs=2e-6)
    for law in (laws.HuntCrossley(K, 0.5), laws.flores(K, 0.7)):
        whole = float(law.delivered_restitution(SPEED, MASS))
        assert float(law.smoothed(1e-9).delivered_restitution(SPEED, MASS)) == pytest.approx(whole, abs=1e-5)
    assert float(laws.Hertz(K).delivered_restitution()) == 1.0


def test_derivatives_of_a_restitution():
    """Of both directions, by differences; also beyond critical damping, and at it."""

    def delivered(damping, mass):
        return laws.LinearKelvinVoigt(LINEAR, damping).delivered_restitution(mass=mass)

    critical = 2 * np.sqrt(LINEAR * MASS)
    for share in (0.1, 1.0, 1.001, 3.0):
        at = share * critical
        slope = float(jax.grad(delivered)(at, MASS))
        h = 1e-4 * at
        assert slope == pytest.approx(float(delivered(at + h, MASS) - delivered(at - h, MASS)) / (2 * h), rel=1e-6)

    def damping(e):
        return laws.LinearKelvinVoigt(LINEAR, 1.0).for_restitution(e, mass=MASS).damping

    rise = jax.grad(damping)(0.1)
    assert float(rise * jax.grad(delivered)(damping(0.1), MASS)) == pytest.approx(1, rel=1e-9)
    # A small factor: the series, and Newton's root beside it, are one curve.
    small = [float(laws.HuntCrossley(K, a).delivered_restitution(1.0)) for a in (0.0, 9.999e-4, 1.0001e-3)]
    assert small[0] == 1.0
    assert (small[2] - small[1]) / 2e-7 == pytest.approx(-2 / 3 + 8 / 9 * 1e-3, rel=1e-2)


def test_what_a_restitution_needs_is_said():
    with refused("speed"):
        laws.HuntCrossley(K, 0.5).delivered_restitution()
    with refused("mass"):
        laws.LinearKelvinVoigt(LINEAR, 500.0).for_restitution(0.5)
    with pytest.raises(ClearanceError, match=r"give its `geometry`"):
        laws.LinearKelvinVoigt(laws.InternalHertz(2e11, 2e11), 500.0).delivered_restitution(mass=MASS)
    with pytest.raises(ClearanceError, match="give the joint's `geometry`"):
        laws.AdamsImpact(laws.InternalHertz(2e11, 2e11), 2000.0, 1e-5).delivered_restitution(SPEED, MASS)
    whole = laws.AdamsImpact(laws.InternalHertz(2e11, 2e11), 2000.0, 1e-5).delivered_restitution(SPEED, MASS, GEOMETRY)
    assert 0 < float(whole) < 1
    with refused("Hertz"):
        laws.Hertz(K).for_restitution(0.5, SPEED)
    with refused("restitution", 0.1, 0.1353):
        laws.Tsuji(K, 0.5, MASS, clipped=True).for_restitution(0.1)
    with refused("restitution", 1.2):
        laws.AdamsImpact(K, 2000.0, 1e-5).for_restitution(1.2, SPEED, MASS)
