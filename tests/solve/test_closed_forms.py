"""Motions with a closed form, through the library's own solve or its vector field.

What an impact did is also read off the state after it: in free flight the speed tells the restitution, and the place
tells how long the pin was held up. Numbers such as 4.1 are those of the formulas in FACTS.
"""

import dataclasses

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline
from scipy.special import gamma

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.quantities import observe
from clearance_jax.laws.normal.ratios import exact_ratio
from clearance_jax.results.episodes import ContactWarning
from clearance_jax.solve.first_state import initial_state
from clearance_jax.solve.simulate import EnergyWarning

MASS, SPEED, GRAVITY = 0.14, 0.5, 9.81
CLEARANCE, RADIUS, GAP = 1e-3, 0.01, 1e-5
STIFFNESS = 6.61e10
SOFT = 1.4e6
RTOL = 1e-10


# Impacts -----------------------------------------------------------------------------------------------------------


def thrown(*normal) -> cj.Mechanism:
    """A pin for every law, each on a guide through its sleeve's centre, `GAP` before the wall and flying at it.

    The sleeves are loops because a mechanism cannot give the play of a tree joint an initial velocity, and are not
    assembled because that would bring the pins to rest in the middle.
    """
    motion = cj.Motion(position=CLEARANCE - GAP, velocity=SPEED)
    joints = [cj.Prismatic(f"guide{i}", "ground", f"pin{i}", motion=motion) for i in range(len(normal))]
    play = [cj.RevoluteClearance(CLEARANCE, RADIUS, law) for law in normal]
    return cj.Mechanism(
        bodies=tuple(cj.Body(f"pin{i}", MASS) for i in range(len(normal))),
        joints=tuple(joints),
        loops=tuple(cj.Revolute(f"j{i}", "ground", f"pin{i}", clearance=p) for i, p in enumerate(play)),
        gravity=cj.Gravity(x=0.0),
        assemble=False,
    )


@pytest.mark.parametrize(("n", "stiffness"), [(1.1, 1e9), (1.5, STIFFNESS), (2.0, 1e13)])
def test_hertz_impact(n, stiffness):
    """4.1."""
    depth = ((n + 1) * MASS * SPEED**2 / (2 * stiffness)) ** (1 / (n + 1))
    force, p = stiffness * depth**n, 1 / (n + 1)
    duration = depth / SPEED * 2 * np.sqrt(np.pi) * gamma(1 + p) / gamma(0.5 + p)
    m = thrown(laws.Hertz(stiffness, n))
    trace = cj.trace(m, GAP / SPEED + 1.2 * duration, save_at=101, rtol=RTOL, solver="dopri8")
    table = cj.to_dataset(m, trace)
    assert table.sizes["episode"] == 1
    # Steps end just past touch and separation, by up to sqrt(rtol) = 1e-5 of a step. Episodes begin and end at these.
    assert float(table.episode_start[0]) == pytest.approx(GAP / SPEED, abs=1e-16)
    assert float((table.episode_end - table.episode_start)[0]) == pytest.approx(duration, rel=2e-8)
    assert float(table.impact_speed[0]) == pytest.approx(SPEED, rel=1e-12)
    assert float(table.peak_force[0]) == pytest.approx(force, rel=2e-8)
    assert float((table.peak_force[0] / stiffness) ** (1 / n)) == pytest.approx(depth, rel=2e-8)
    assert float(table.separation_speed[0] / table.impact_speed[0]) == pytest.approx(1.0, abs=2e-10)
    # By work, from the step ends alone, where a solve of eighth order has few.
    assert float(table.restitution[0]) == pytest.approx(1.0, abs=1e-4)
    # The state after it has no such delay.
    place, speed = np.asarray(trace.solution.final)[:2]
    assert speed == pytest.approx(-SPEED, rel=2e-10)
    held = trace.time[-1] - (GAP + CLEARANCE - place) / SPEED
    assert held == pytest.approx(duration, rel=2e-10)


REBOUND = thrown(laws.exact_restitution(STIFFNESS, 0.5, exponent=1.5))


@pytest.mark.parametrize("e", [0.9, 0.7, 0.5, 0.3])
def test_exact_restitution(e):
    """4.2."""
    m = cj.replace(REBOUND, {"j0.normal.restitution": e})
    trace = cj.trace(m, 2e-4, save_at=1001, rtol=0.1 * RTOL, solver="dopri8")
    seen = cj.to_dataset(m, trace.solution).isel(joint=0)
    a = float(exact_ratio(jnp.asarray(e)))
    assert a * (1 + e) == pytest.approx(np.log((1 + a) / (1 - a * e)), rel=1e-13)
    size = 2.5 * MASS * SPEED**2 / STIFFNESS
    depth = (size * (1 / a - np.log1p(a) / a**2)) ** 0.4
    path = CubicHermiteSpline(seen.time, seen.penetration, seen.penetration_rate)
    assert path(path.derivative().roots(extrapolate=False)).max() == pytest.approx(depth, rel=1e-9)
    # The whole way through the contact, at the step ends.
    d, u = trace.y[:, 0] - CLEARANCE, trace.y[:, 1] / SPEED
    d, u = d[d > 0], u[d > 0]
    assert d.size > 20
    expected = size * ((1 - u) / a - np.log((1 + a) / (1 + a * u)) / a**2)
    np.testing.assert_allclose(d**2.5, expected, rtol=0, atol=1e-10 * depth**2.5)
    assert -float(trace.solution.final[1]) == pytest.approx(e * SPEED, rel=1e-11)
    assert float(seen.damping_loss[-1]) == pytest.approx(MASS * SPEED**2 * (1 - e * e) / 2, rel=1e-10)


LINEAR, PULL = 1e7, -2e6


def pulled(normal) -> cj.Mechanism:
    """The thrown pin under a load that begins with nothing and pulls it back from the wall, more and more [N/s]."""
    load = cj.Wrench("pull", "pin0", force=cj.Force(x=PULL), course=cj.drives.ConstantSpeed(1.0))
    return dataclasses.replace(thrown(normal), wrenches=(load,))


def root(function, low: float, high: float, xtol: float) -> float:
    return float(optimize.brentq(function, low, high, xtol=xtol))  # pyright: ignore[reportArgumentType]


def test_a_load_that_grows_in_contact_returns_more_speed_than_came():
    """Of a wall without loss a pin under a growing load leaves faster than it came: m x'' = P t - k max(0, x - gap).

    By energy the contact gave back what it took: not the contact made the pin faster, but the load.
    """
    m = pulled(laws.LinearKelvinVoigt(LINEAR, 0.0))
    omega, jerk, t1 = np.sqrt(LINEAR / MASS), PULL / MASS, 5e-4
    table = cj.to_dataset(m, cj.trace(m, t1, save_at=101, rtol=RTOL, solver="dopri8"))

    def flight(t):
        return SPEED * t + jerk * t**3 / 6 - GAP

    touch = root(flight, 0, 2 * GAP / SPEED, xtol=1e-18)
    came = SPEED + jerk * touch**2 / 2
    # In contact x = P t / k + A sin + B cos of the time since the touch.
    b = -PULL * touch / LINEAR
    a = (came - PULL / LINEAR) / omega

    def depth(s):
        return PULL * (touch + s) / LINEAR + a * np.sin(omega * s) + b * np.cos(omega * s)

    last = root(depth, 0.5 / omega, 4 / omega, xtol=1e-18)
    left = -(PULL / LINEAR + omega * (a * np.cos(omega * last) - b * np.sin(omega * last)))
    assert left / came > 1.2
    assert float(table.impact_speed[0]) == pytest.approx(came, rel=1e-9)
    assert float(table.episode_end[0]) == pytest.approx(touch + last, rel=1e-7)
    assert float(table.separation_speed[0]) == pytest.approx(left, rel=1e-6)
    assert float(table.restitution[0]) == pytest.approx(1.0, abs=1e-4)


def test_restitution_is_what_the_energy_books_say():
    """The work that a contact took up less what it gave back is what the solve's own energy balance says."""
    m = pulled(laws.exact_restitution(STIFFNESS, 0.7))
    table = cj.to_dataset(m, cj.trace(m, 2e-4, save_at=4001, rtol=1e-8))
    power = table.contact_power.values[:, 0]
    taken, given = (np.trapezoid(np.maximum(sign * power, 0.0), table.time) for sign in (1, -1))
    assert taken - given == pytest.approx(float(table.damping_loss[-1]), rel=1e-5)
    assert float(table.restitution[0]) == pytest.approx(np.sqrt(given / taken), rel=1e-5)
    assert float(table.restitution[0]) < float(table.separation_speed[0] / table.impact_speed[0])


class Spring(laws.Hertz):
    """A law that gives back a third more than it takes."""

    def formula(self, constants, penetration, penetration_rate, memory):
        force = super().formula(constants, penetration, penetration_rate, memory)
        return jnp.where(penetration_rate < 0, 4 / 3 * force, force)


def test_a_contact_that_adds_energy_is_told_of():
    m = thrown(Spring(STIFFNESS))
    with pytest.warns(EnergyWarning, match="laws of `j0` have given"):
        trace = cj.trace(m, 2e-4, save_at=3, rtol=1e-7)
    with pytest.warns(ContactWarning, match=r"`j0` gave back more work .* up to 1\.15"):
        table = cj.to_dataset(m, trace)
    assert float(table.restitution[0]) == pytest.approx(np.sqrt(4 / 3), rel=1e-2)


def test_a_drive_that_stands_still_bears_an_impact():
    """A carriage held still by its drive bears nothing until a pin hits it. Then its drive's force is that of the
    contact, at its top Hertz's, and in all it is the momentum that the pin gives up and takes back: 2 m v.
    """
    made = thrown(laws.Hertz(STIFFNESS))
    m = dataclasses.replace(
        made,
        bodies=(*made.bodies, cj.Body("carriage", 5.0)),
        joints=(
            *made.joints,
            cj.Prismatic("slide", "ground", "carriage", motion=cj.Motion(drive=cj.drives.Constant(0.0))),
        ),
        loops=(dataclasses.replace(made.loops[0], parent="carriage"),),
    )
    table = cj.to_dataset(m, cj.trace(m, 2e-4, save_at=4001, rtol=1e-8))
    held, force = table.drive_force.values[:, 0], table.contact_force.values[:, 0]
    np.testing.assert_allclose(held, -force, rtol=0, atol=1e-9 * force.max())
    assert np.trapezoid(force, table.time) == pytest.approx(2 * MASS * SPEED, rel=1e-5)
    depth = (5 * MASS * SPEED**2 / (4 * STIFFNESS)) ** 0.4
    assert np.abs(held).max() == pytest.approx(STIFFNESS * depth**1.5, rel=1e-3)


def test_bouncing_under_gravity():
    """4.5: e with what the weight does while the pin is in contact.

    In units of v0 for speed and L = (m v0^2/K)^(1/(n+1)) for length the contact is u du/dx = g - x^n (1 + a u) with
    g = G L/v0^2. To first order in g the restitution changes by g J (1 - a e)/e, J the integral of
    u x^-n/(1 + a u)^2 over u from -e to 1 along the path of 4.2. That expansion fails where the weight exceeds the
    force, x^n < g; the speed changes there by order x g = g^(1+1/n), which is the order of the remainder.
    """
    e, n, height, clearance = 0.8, 1.5, 0.5, 1.2
    m = cj.replace(
        REBOUND,
        {
            "j0.normal.restitution": e,
            "j0.radial_clearance": clearance,
            "guide0.position": clearance - height,
            "guide0.velocity": 0.0,
            "gravity.x": GRAVITY,
        },
    )
    flight = 2 * np.sqrt(2 * height / GRAVITY)
    trace = cj.trace(m, flight * (0.5 + e + e**2 + e**3 + e**4 / 2), save_at=1001, rtol=RTOL, solver="dopri8")
    table = cj.to_dataset(m, trace)
    v = table.impact_speed.values
    assert v.size == 4
    a = float(exact_ratio(jnp.asarray(e)))

    def work(u):
        path = (1 - u) / a - np.log((1 + a) / (1 + a * u)) / a**2
        return u * ((n + 1) * path) ** (-n / (n + 1)) / (1 + a * u) ** 2

    weight = GRAVITY / v**2 * (MASS * v**2 / STIFFNESS) ** (1 / (n + 1))
    expected = e + weight * (quad(work, -e, 0)[0] + quad(work, 0, 1)[0]) * (1 - a * e) / e
    assert v[0] == pytest.approx(np.sqrt(2 * GRAVITY * height), rel=3e-13)
    np.testing.assert_array_less(np.abs(v[1:] / v[:-1] - expected[:-1]), 0.1 * weight[:-1] ** (1 + 1 / n))
    np.testing.assert_allclose(table.separation_speed.values[:-1], v[1:], rtol=1e-11)
    # The weight does the same work both ways: by energy and by speeds these impacts have one restitution.
    np.testing.assert_allclose(table.restitution.values[:-1], v[1:] / v[:-1], rtol=1e-4)
    aloft = table.episode_start.values[1:] - table.episode_end.values[:-1]
    np.testing.assert_allclose(aloft, 2 * v[1:] / GRAVITY, rtol=1e-11)


def test_a_touch_that_round_off_hides_is_passed():
    """Slow pins at tight tolerances: the round-off of their place is worth more time than that of the clock, and a cut
    just past a touch may not see it. (One in ten of these once stood at the wall for ever.)
    """
    rng = np.random.default_rng(1)
    speed, ratio, rtol = (10 ** rng.uniform(*ends, 128) for ends in ((-3, 1), (-2, -0.3), (-11.5, -5)))
    stiffness = 1e7
    m = thrown(*(laws.LinearKelvinVoigt(stiffness, 1.0, clipped=clipped) for clipped in (True, False)))

    @jax.jit
    @jax.vmap
    def end(v, damping, rtol):
        numbers = {"j0.normal.damping": damping, "j1.normal.damping": 1.3 * damping}
        changed = cj.replace(m, numbers | {"guide0.velocity": v, "guide1.velocity": v})
        t1 = GAP / v + 6 / np.sqrt(stiffness / MASS)
        solution = cj.simulate(
            changed, t1, rtol=rtol, solver="tsit5", max_steps=5000, throw=False, energy_balance=False
        )
        return solution.code, solution.final

    code, y = end(speed, 2 * ratio * np.sqrt(stiffness * MASS), rtol)
    assert not np.any(code)
    # Every pin has come back.
    assert np.all(y[:, 2:] < 0)


def test_kelvin_voigt_impact():
    """4.3. Clipped, the force ends at F = 0, before separation; the flight after it tells when and how fast."""
    zeta, stiffness = np.array([0.05, 0.1, 0.2, 0.4]), 1e7
    damping, omega = 2 * zeta * np.sqrt(stiffness * MASS), np.sqrt(stiffness / MASS)
    m = thrown(*(laws.LinearKelvinVoigt(stiffness, 1.0, clipped=clipped) for clipped in (True, False)))
    t1 = GAP / SPEED + 6 / omega

    @jax.jit
    @jax.vmap
    def end(b):
        changed = cj.replace(m, {"j0.normal.damping": b, "j1.normal.damping": b})
        return cj.simulate(changed, t1, rtol=0.1 * RTOL, solver="tsit5").final

    y = np.asarray(end(damping))
    root = np.sqrt(1 - zeta**2)
    time = np.arctan2(2 * zeta * root, 2 * zeta**2 - 1) / (omega * root)
    for i, (t, e) in enumerate(
        [(time, np.exp(-zeta * omega * time)), (np.pi / (omega * root), np.exp(-np.pi * zeta / root))]
    ):
        np.testing.assert_allclose(-y[:, 2 + i] / SPEED, e, rtol=5e-10)
        # Clipped, the pin leaves the force at F = k d - b e v0 = 0.
        left = damping * e * SPEED / stiffness if i == 0 else 0.0
        flight = (left - (y[:, i] - CLEARANCE)) / (e * SPEED)
        np.testing.assert_allclose(t1 - GAP / SPEED - flight, t, rtol=5e-10)


# Linearised --------------------------------------------------------------------------------------------------------


def hung() -> cj.Mechanism:
    """A body hung on a frictionless pin with clearance."""
    joint = cj.RevoluteClearance(5e-4, RADIUS, laws.Hertz(STIFFNESS, 1.5))
    return cj.Mechanism(
        bodies=(cj.Body("bob", 1.0, 0.01, cj.Position(y=-0.3)),),
        joints=(cj.Revolute("j", "ground", "bob", clearance=joint),),
        gravity=cj.Gravity(y=-GRAVITY),
    )


@jax.jit
@jax.vmap
def equilibrium(values):
    """The static equilibrium by Newton's method on `rate`, and the Jacobian of `rate` there."""
    m, now = cj.replace(hung(), values).prepare(), jnp.asarray(0.0)

    def acceleration(q):
        return slope(now, jnp.concatenate([q, jnp.zeros(3)]), m)[3:]

    def newton(_, q):
        return q - jnp.linalg.solve(jax.jacfwd(acceleration)(q), acceleration(q))

    # From above the root: there the force is convex, and Newton's method cannot leave the contact.
    start = jnp.stack([jnp.asarray(0.0), -values["j.radial_clearance"] - 1e-5, jnp.asarray(0.0)])
    q = jax.lax.fori_loop(0, 60, newton, start)
    return q, jax.jacfwd(lambda y: slope(now, y, m))(jnp.concatenate([q, jnp.zeros(3)]))


def test_static_load_and_small_oscillations():
    """4.4 and 4.11."""
    n = np.array([1.5, 1.5, 1.1, 2.0])
    stiffness, mass = np.array([STIFFNESS, STIFFNESS, 1e9, 1e13]), np.array([1.0, 0.14, 0.14, 0.14])
    inertia, length, clearance = np.array([0.01, 0.001, 0.002, 0.003]), 0.3, np.full(4, 5e-4)
    q, jacobian = equilibrium(
        {
            "j.normal.exponent": n,
            "j.normal.stiffness": stiffness,
            "j.radial_clearance": clearance,
            "bob.mass": mass,
            "bob.inertia": inertia,
        }
    )
    depth = (mass * GRAVITY / stiffness) ** (1 / n)
    np.testing.assert_allclose(-np.asarray(q)[:, 1] - clearance, depth, rtol=1e-11)
    np.testing.assert_allclose(np.asarray(q)[:, [0, 2]], 0.0, rtol=0, atol=1e-18)
    for i in range(4):
        # The first link of the double pendulum is as long as the pin hangs low: c + d.
        link, about_pin = clearance[i] + depth[i], inertia[i] + mass[i] * length**2
        squares = np.roots(
            [
                link * inertia[i],
                -GRAVITY * (about_pin + mass[i] * length * link),
                mass[i] * GRAVITY**2 * length,
            ]
        )
        expected = np.sort([*np.sqrt(squares), np.sqrt(n[i] * GRAVITY / depth[i])])
        values = np.linalg.eigvals(np.asarray(jacobian)[i])
        np.testing.assert_allclose(np.sort(values.imag)[3:], expected, rtol=1e-11)
        if i == 0:
            # FACTS leaves d out, which is 0.06 % of c here.
            np.testing.assert_allclose(expected[:2], [5.421284, 443.2436], rtol=5e-4)
        if i == 1:
            assert depth[i] == pytest.approx(75.58e-9, rel=1e-4)
            assert expected[2] == pytest.approx(13953.45, rel=1e-7)


# Pin in sleeve -----------------------------------------------------------------------------------------------------


def spun() -> cj.Mechanism:
    """A spinning pin in a soft sleeve under gravity; a damper brings it to rest where friction would not."""
    joint = cj.RevoluteClearance(CLEARANCE, RADIUS, laws.HuntCrossley(SOFT, 1.0, 1.5), laws.TanhCoulomb(0.3, 1e-3))
    return cj.Mechanism(
        bodies=(cj.Body("pin", MASS, None, cj.Position(0.0)),),
        joints=(cj.Revolute("j", "ground", "pin", motion=cj.Motion(cj.drives.ConstantSpeed(1.0)), clearance=joint),),
        springs=(cj.Spring("damper", "ground", "pin", 0.0, 1.0, 0.0, cj.Position(0.1)),),
        gravity=cj.Gravity(y=-GRAVITY),
    )


def lanes(**columns):
    """Values of the parameters that `end_spun` is compiled for, four of each; those not given are zero."""
    names = {
        "speed": "drive.j.speed",
        "exponent": "j.normal.exponent",
        "friction": "j.friction.coefficient",
        "damping": "j.normal.damping_factor",
        "damper": "damper.damping",
        "gravity": "gravity.y",
        "offset": "pin.center_of_mass.x",
    }
    return {name: np.broadcast_to(columns.get(short, 0.0), 4) for short, name in names.items()}


@jax.jit
@jax.vmap
def end_spun(values, y0, t1):
    """What is observed of the pin at the end."""
    m = cj.replace(spun(), values)
    # A resting pin, whose steps are as long as they are stable, stays within a few tolerances of where it belongs.
    seen = observe(t1, cj.simulate(m, t1, y0=y0, rtol=0.03 * RTOL).final, m.prepare())
    forces = ("contact_force", "friction_force", "drive_force")
    return {name: seen[name][0] for name in ("eccentricity", "penetration", "slip_velocity", *forces)}


def test_friction_angle():
    """4.9: the pin climbs against its spin by atan(mu). Its surface turns on the contact point with the arm r - d."""
    mu, spin = np.array([0.0, 0.1, 0.3, 0.6]), np.array([10.0, 10.0, 10.0, -10.0])
    values = lanes(speed=spin, exponent=1.5, friction=mu, damping=39.0, damper=13.0, gravity=-GRAVITY)
    seen = end_spun(values, np.tile([0.0, -CLEARANCE, 0.0, 0.0], (4, 1)), np.full(4, 1.5))
    load, phi = MASS * GRAVITY, np.arctan(mu) * np.sign(spin)
    depth = (load * np.cos(phi) / SOFT) ** (1 / 1.5)
    # Saturated: tanh of a hundred is 1.
    np.testing.assert_allclose(seen["slip_velocity"], spin * (RADIUS - depth), rtol=4e-12)
    direction = np.stack([-np.sin(phi), -np.cos(phi)], 1)
    np.testing.assert_allclose(seen["eccentricity"], (CLEARANCE + depth)[:, None] * direction, rtol=0, atol=2e-15)
    np.testing.assert_allclose(seen["penetration"], depth, rtol=2e-11)
    np.testing.assert_allclose(seen["contact_force"], load * np.cos(phi), rtol=2e-11)
    np.testing.assert_allclose(seen["friction_force"], -load * np.sin(phi), rtol=2e-11, atol=1e-14)
    np.testing.assert_allclose(seen["drive_force"], load * np.sin(phi) * (RADIUS - depth), rtol=2e-11, atol=1e-16)


def test_forced_whirl():
    """4.10, after one turn and after part of one (a pin off its orbit may be back on it after one by accident)."""
    n, zero = np.array([1.5, 1.5, 2.0, 1.2]), np.zeros(4)
    depth, offset = np.array([1e-5, 3e-5, 1e-5, 1e-6]), np.array([0.0, 1e-3, 2e-3, 5e-4])
    radius = CLEARANCE + depth
    omega = np.sqrt(SOFT * depth**n / (MASS * (radius + offset)))
    values = lanes(speed=omega, exponent=n, offset=offset)
    start = np.stack([radius, zero, zero, omega * radius], 1)
    for turns in (1.0, 0.37):
        angle = 2 * np.pi * turns
        seen = end_spun(values, start, angle / omega)
        direction = np.array([np.cos(angle), np.sin(angle)])
        np.testing.assert_allclose(seen["eccentricity"], radius[:, None] * direction, rtol=0, atol=3e-15)
        np.testing.assert_allclose(seen["penetration"], depth, rtol=2e-10)
        force = MASS * omega**2 * radius + MASS * offset * omega**2
        np.testing.assert_allclose(seen["contact_force"], force, rtol=2e-10)


def test_sliding_block_stops_and_creeps():
    """4.6, with a wheel for the block: an eccentric axle presses it on the sleeve with a constant force.

    Under the cubic law x = v/vc follows q = x^2/(3 - x^2), q' = -3 a q/vc, below vc, over the path
    vc^2/a times the integral of 2/(3 - x^2); a is the deceleration by Coulomb's friction.
    """
    mu, inertia, depth = 0.3, 1e-3, 1e-5
    arm = RADIUS - depth
    a = mu * STIFFNESS * depth**1.5 * arm**2 / inertia
    joint = cj.RevoluteClearance(CLEARANCE, RADIUS, laws.Hertz(STIFFNESS), laws.CubicCoulomb(mu, 0.1))
    axle = cj.Position(0.0, -CLEARANCE - depth)
    m = cj.Mechanism(
        bodies=(cj.Body("wheel", None, inertia),),
        joints=(cj.Revolute("axle", "ground", "wheel", axle, motion=cj.Motion(velocity=1 / arm)),),
        loops=(cj.Revolute("j", "ground", "wheel", clearance=joint),),
        assemble=False,
    )

    @jax.jit
    @jax.vmap
    def end(vc, t1):
        return cj.simulate(cj.replace(m, {"j.friction.transition_speed": vc}), t1, rtol=RTOL, solver="tsit5").final[:2]

    vc, lasts = np.repeat([0.02, 0.1, 0.5], 2), np.tile([3.0, 40.0], 3)
    creeping = lasts * vc / (1.5 * a)
    way, speed = np.asarray(end(vc, (1 - vc) / a + creeping)).T * arm
    q = 0.5 * np.exp(-3 * a * creeping / vc)
    x = np.sqrt(3 * q / (1 + q))

    def path(x):
        return np.log((np.sqrt(3) + x) / (np.sqrt(3) - x)) / np.sqrt(3)

    assert path(1.0) - 0.5 == pytest.approx(0.260346, abs=5e-7)
    np.testing.assert_allclose(way, 1 / (2 * a) + vc**2 / a * (path(1.0) - 0.5 - path(x)), rtol=1e-11)
    np.testing.assert_allclose(way[1::2], (1 / 2 + 0.260346 * vc[1::2] ** 2) / a, rtol=1e-8)
    np.testing.assert_allclose(speed, x * vc, rtol=0, atol=3e-11)


@pytest.mark.parametrize(("spin", "end"), [(10.0, 0.1), (0.03, 0.6)])
def test_lugre_in_a_solve(spin, end):
    """Fast (100 Stribeck speeds) the traction is kinetic; slow (0.3) the pin sticks, climbs and breaks away again."""
    clearance, depth = 3e-4, (MASS * GRAVITY / SOFT) ** (1 / 1.5)
    friction = laws.LuGre(0.4, 0.3, 1e-3, 1e5, 100.0, 0.0)
    joint = cj.RevoluteClearance(clearance, RADIUS, laws.HuntCrossley(SOFT, 39.0), friction)
    drive = cj.Motion(cj.drives.ConstantSpeed(spin))
    start = cj.Position(0.0, -clearance - depth)
    m = cj.Mechanism(
        bodies=(cj.Body("pin", MASS),),
        joints=(cj.Revolute("j", "ground", "pin", motion=drive, clearance=joint, eccentricity=start),),
        gravity=cj.Gravity(y=-GRAVITY),
    )
    trace = cj.trace(m, end, save_at=301, rtol=RTOL, solver="tsit5")
    seen = cj.to_dataset(m, trace.solution).isel(joint=0)
    bent, limit = np.abs(trace.y[:, 4]).max(), 0.4 / 1e5
    assert bent <= limit
    assert float(trace.solution.energy_residual) <= 10 * RTOL
    assert np.all(seen.contact_force > 0)
    if spin > 1:
        late = seen.time > end / 2
        assert float(seen.slip_velocity[late].min()) > 1e-2
        np.testing.assert_allclose(seen.friction_force[late], -0.3 * seen.contact_force[late], rtol=3e-9)
    else:
        assert bent > 0.95 * limit
        assert float(seen.slip_velocity.min()) < 0 < 1e-3 < float(seen.slip_velocity.max())


# Loops -------------------------------------------------------------------------------------------------------------


def test_slider_follows_the_play():
    """4.13, by the assembly at the start of a solve: the slider is held off the rod's end by c (cos, sin) psi.

    The eccentricity is given in the axes of the sleeve, which is the rod's: psi, fixed in the world, is psi + beta
    there. The derivative is a difference of fourth order, good to 1e-16/h.
    """
    crank, rod, h = 0.05, 0.12, 1e-4
    rng = np.random.default_rng(0)
    psi, theta = rng.uniform(-np.pi, np.pi, (2, 200))
    c = rng.uniform(0, 2e-3, 200) + h * np.array([[-2], [-1], [0], [1], [2]])
    beta = np.arcsin((crank * np.sin(theta) + c * np.sin(psi)) / rod)
    play = next(joint.clearance for joint in catalogue.slider_crank().clearance_joints())
    start = cj.Position(0.0, 0.0)
    loop = cj.Revolute("wrist", "conrod", "slider", cj.Position(rod), clearance=play, eccentricity=start)
    m = cj.Mechanism(catalogue.slider_crank().bodies, catalogue.slider_crank().joints, (loop,))

    @jax.jit
    @jax.vmap
    def assembled(x, y, theta):
        values = {"wrist.eccentricity.x": x, "wrist.eccentricity.y": y}
        # The rod is level at first, so that it is found on the slider's side of the crank.
        values |= {"drive.main.start": theta, "crankpin.position": -theta}
        return initial_state(cj.replace(m, values).prepare(), jnp.asarray(0.0))[:2]

    x, y = c * np.cos(psi + beta), c * np.sin(psi + beta)
    y0 = np.asarray(assembled(x.ravel(), y.ravel(), np.tile(theta, 5))).reshape(5, 200, 2)
    np.testing.assert_allclose(y0[..., 0] + theta, -beta, rtol=0, atol=2e-15)
    slider = y0[..., 1]
    expected = crank * np.cos(theta) + rod * np.cos(beta) + c * np.cos(psi)
    np.testing.assert_allclose(slider, expected, rtol=0, atol=5e-16)
    slope = (8 * (slider[3] - slider[1]) - (slider[4] - slider[0])) / (12 * h)
    np.testing.assert_allclose(slope, (np.cos(psi + beta) / np.cos(beta))[2], rtol=0, atol=5e-12)
