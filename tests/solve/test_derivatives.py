"""Derivatives of a solve: against independent references, closed forms and the rules that derivatives obey."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import slope
from clearance_jax.joints.checks import ImplausibleWarning
from clearance_jax.solve.steps.problem import push
from experiments import derivatives
from experiments.derivatives import closed_forms, ladder


@pytest.fixture(scope="module")
def jacobian():
    """Of the slider-crank after a revolution, by c, mu and K; compiled once."""
    return ladder.jacobian(ladder.ours("tsit5"))


@pytest.mark.parametrize("case", ladder.CASES)
def test_ladder(case, jacobian):
    """Against integrations in extended precision that share no code with the library."""
    loose, tight = ladder.ladder(case, "ours, tsit5", jacobian, (1e-6, 1e-9))
    assert loose.worst <= 1e-3
    assert tight.worst <= ladder.AT_NINE
    assert all(b <= 0.03 * a for a, b in zip(loose.errors, tight.errors, strict=True))


def test_derivatives_follow_rtol_with_a_high_order():
    """At several tolerances: at one alone the error is a matter of luck, within a factor of ten."""
    jacobian, near = ladder.jacobian(ladder.ours("dopri8")), (5e-10, 1e-9, 2e-9)
    for case in ladder.CASES:
        found = ladder.ladder(case, "ours, dopri8", jacobian, near)
        assert max(rung.worst / rung.rtol for rung in found) <= 8


# Closed forms --------------------------------------------------------------------------------------------------------


def test_equilibrium_trap():
    """Nothing moves, so nothing limits the steps but the derivatives' own error (arXiv:2406.09699)."""
    found = closed_forms.trap((1e-9,), plain=True)
    assert max(row.error for row in found) <= closed_forms.LIMIT
    # What differentiating the program gives has no error that the tolerance knows of.
    assert max(row.plain_error / row.rtol for row in found) > 1e4


def test_two_balls():
    found = closed_forms.two_balls((closed_forms.TIGHT,), plain=False)
    assert max(row.error for row in found) <= closed_forms.LIMIT
    assert closed_forms.rigid_distance(found) <= closed_forms.RIGID_LIMIT


@pytest.mark.parametrize("case", ["times apart", "times that meet"])
def test_times_of_a_drive(case):
    """A number that acts only through a time of switching; two switches at one time have a derivative each."""
    found = [row for row in closed_forms.timing((1e-9,), plain=False) if row.case == case]
    assert max(row.error for row in found) <= closed_forms.LIMIT


@pytest.mark.slow
def test_time_of_a_drive_against_differences():
    """A contact is driven; the middle of three steps is moved."""
    mechanism = closed_forms.shaken(closed_forms.BEGIN, closed_forms.STOP)
    with pytest.warns(ImplausibleWarning, match="radial_clearance = 100 mm is above the pin's radius 10 mm"):
        play = cj.RevoluteClearance(0.1, 0.01, laws.HuntCrossley(1e3, 0.5))
    mechanism = cj.Mechanism(
        mechanism.bodies, mechanism.joints, (cj.Revolute("play", "carriage", "bob", clearance=play),), assemble=False
    )

    def end(begin):
        m = cj.replace(mechanism, {"drive.rail.begin.1": begin})
        return cj.simulate(m, 1.3, rtol=1e-10, energy_balance=False, throw=False).final

    begin, step = 0.7, 1e-4
    slope = jax.jit(jax.jacfwd(end))(begin)
    up, upper, lower, down = jax.jit(lambda all: jax.lax.map(end, all))(
        begin + step * jnp.array([1.0, 0.5, -0.5, -1.0])
    )
    coarse, fine = (up - down) / (2 * step), (upper - lower) / step
    difference = fine + (fine - coarse) / 3
    np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-6 * np.abs(difference).max())


# The rules of differentiation ----------------------------------------------------------------------------------------


def pin() -> cj.Mechanism:
    """A pin that falls through its sleeve, touches and slips."""
    joint = cj.RevoluteClearance(1e-3, 0.01, laws.HuntCrossley(1e6, 0.5), laws.TanhCoulomb(0.3, 0.01))
    motion = cj.Motion(cj.drives.ConstantSpeed(3.0))
    return cj.Mechanism(
        bodies=(cj.Body("pin", 0.14),),
        joints=(cj.Revolute("joint", "ground", "pin", motion=motion, clearance=joint),),
        gravity=cj.Gravity(y=-9.81),
    )


END = 0.03
NAMES = ("joint.radial_clearance", "joint.friction.coefficient", "pin.mass", "drive.joint.speed")
AT = jnp.array([1e-3, 0.3, 0.14, 3.0])


def fallen(values, t1=END, save_at=None):
    m = cj.replace(pin(), dict(zip(NAMES, values, strict=True)))
    return cj.simulate(m, t1, save_at=save_at, rtol=1e-8, energy_balance=False, throw=False)


def size(values):
    """One number made of several samples."""
    s = fallen(values, save_at=jnp.linspace(0.0, END, 7))
    return jnp.sum(s.y**2 @ jnp.array([1e6, 1e6, 1.0, 1.0])) + 1e3 * s.final[0]


def test_reverse_is_forward():
    reverse, forward = jax.jit(jax.grad(size))(AT), jax.jit(jax.jacfwd(size))(AT)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    _, along = jax.jit(lambda v, d: jax.jvp(size, (v,), (d,)))(AT, 2 * AT)
    np.testing.assert_allclose(along, 2 * forward @ AT, rtol=1e-6)


@pytest.mark.slow
def test_batch_is_loop():
    at = jnp.outer(jnp.linspace(0.8, 1.3, 5), AT)
    slopes = jax.jacfwd(lambda v: fallen(v).final)
    batch, alone = jax.jit(jax.vmap(slopes))(at), jax.jit(slopes)
    loop = np.stack([alone(v) for v in at])
    largest = np.abs(loop).max((0, 1))
    assert np.max(np.abs(batch - loop) / largest) <= 1e-7


def test_a_pushed_function_is_traced_once():
    """Its numbers with derivatives, and whatever else it gives, are those of the function."""
    calls = []

    def function(tree):
        calls.append(tree)
        x, y = tree["x"], tree["y"]
        return {
            "of x": x * x,
            "both": x[0] * y,
            "none": tree["fixed"] * 2,
            "place": jnp.argmax(x),
            "word": "as it is",
            "n": 3,
        }

    tree = {"x": jnp.array([2.0, 5.0]), "y": jnp.asarray(3.0), "fixed": jnp.asarray(7.0)}
    directions = {"x": jnp.array([[1.0, 0.0], [0.0, 1.0]]), "y": jnp.array([0.0, 4.0]), "fixed": None}
    value, rates, movers = push(function, tree, directions)
    assert len(calls) == 1
    jax.tree.map(np.testing.assert_array_equal, value, function(tree))
    np.testing.assert_array_equal(rates["of x"], [[4.0, 0.0], [0.0, 10.0]])
    np.testing.assert_array_equal(rates["both"], [3.0, 8.0])
    assert {name for name, rate in rates.items() if rate is not None} == {"of x", "both"}
    assert (movers["of x"], movers["both"], movers["none"]) == (frozenset([0]), frozenset([0, 1]), None)


def test_a_mechanism_may_be_made_of_the_number_that_is_differentiated():
    """A Python float too, whose tracer has no shape of its own; coasting, the place is speed times time."""

    def end(speed):
        hip = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(velocity=speed))
        return cj.simulate(cj.Mechanism((cj.Body("arm", 2.0, 0.03),), (hip,)), 0.1, energy_balance=False)["hip"]

    for derivative in (jax.grad, jax.jacfwd):
        np.testing.assert_allclose(derivative(end)(1.0), 0.1, rtol=1e-12)


def test_derivative_by_time_is_the_rate():
    """By the end, and by every sample time: the rate of the motion there, and only there."""
    times = jnp.array([0.004, 0.017, 0.02, 0.029])

    @jax.jit
    def slopes(t1, times):
        def both(t1, times):
            s = fallen(AT, t1, times)
            return (s.final, s.y, s.time), (s.final, s.y)

        return jax.jacfwd(both, (0, 1), has_aux=True)(t1, times)

    ((final_t1, final_times), (y_t1, y_times), (_, time_times)), (final, y) = slopes(jnp.asarray(END), times)
    m = pin().prepare()
    np.testing.assert_allclose(final_t1, slope(jnp.asarray(END), final, m), rtol=1e-12)
    np.testing.assert_array_equal(final_times, 0.0)
    np.testing.assert_array_equal(y_t1, 0.0)
    np.testing.assert_array_equal(time_times, np.eye(4))
    for i, (t, state) in enumerate(zip(times, y, strict=True)):
        np.testing.assert_allclose(y_times[i, :, i], slope(t, state, m), rtol=1e-12)
        np.testing.assert_array_equal(np.delete(y_times[i], i, axis=1), 0.0)


TSUJI, EXACT = laws.Tsuji(6.61e10, 0.7, 0.14), laws.exact_restitution(6.61e10, 0.7)


def share_returned(law, clearance, speed, rtol, begin=0.0):
    """Speed after each of some free impacts, and its derivative by the speed before it."""
    play = cj.RevoluteClearance(1e-3, 1e4, law)
    body, stands = cj.Body("pin", 0.14), cj.Motion(cj.drives.ConstantSpeed(0.0))
    m = cj.Mechanism((body,), (cj.Revolute("j", "ground", "pin", motion=stands, clearance=play),))

    @jax.jit
    def last(clearance, v):
        start = jnp.zeros(4 + len(play.remembers)).at[2].set(v)
        one = cj.replace(m, {"j.radial_clearance": clearance})
        end = begin + 1.5 * clearance / v
        return cj.simulate(one, end, t0=begin, y0=start, rtol=rtol).final[2]

    return [
        [float(x) for x in jax.jvp(partial(last, gap), (jnp.asarray(v),), (jnp.ones(()),))]
        for gap, v in np.broadcast(np.atleast_1d(clearance), speed)
    ]


def test_an_onset_with_a_pole_has_a_derivative():
    """dv/dv0 = -e of a free impact. The slope of Tsuji's force has a pole at first touch, where steps collapsed."""
    ((value, rate),) = share_returned(laws.Tsuji(6.61e10, 0.7, 0.14), 1e-3, 0.5, 1e-8)
    assert value == pytest.approx(-0.35, rel=1e-8)
    assert rate == pytest.approx(-0.7, abs=1e-5)


def test_a_memory_that_begins_at_a_touch_has_a_derivative():
    """It is linear, so that e is one number: dv/dv0 = v/v0. The memory's derivative grows from nothing, beside a
    motion's that is large after a flight of a metre, faster than a step of round-off resolves, where steps collapsed.
    """
    ((value, rate),) = share_returned(laws.StandardLinearSolid(1e7, 0.5, 1e-6), 1.0, 30.0, 1e-10)
    assert rate == pytest.approx(value / 30.0, rel=1e-7)


# The linear solid's own share of the speed was integrated apart, by SciPy.
RETURNED = [(EXACT, -0.7), (laws.StandardLinearSolid(1e8, 0.9, 1e-5), -0.39746128711)]


@pytest.mark.parametrize(("law", "share"), RETURNED)
def test_late_times_leave_a_derivative_its_digits(law, share):
    """A time of 3 s is known to 4e-16 s. A time of 10 s is known to 2e-15 s, in which the slope of the force of some
    touches changes by more than a step may err: their derivative is right or NaN.
    """
    speeds = np.array([0.3, 0.37, 0.5, 0.61, 0.7])
    for begin, least in ((3.0, 5), (10.0, 5 if law is EXACT else 4)):
        found = np.array(share_returned(law, 1e-3, speeds, 1e-10, begin))
        known = np.isfinite(found[:, 1])
        assert np.sum(known) >= least
        np.testing.assert_allclose(found[known], np.stack([share * speeds, share + 0 * speeds], 1)[known], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "share"), RETURNED)
def test_a_derivative_that_round_off_hides_is_none(law, share):
    """Over a gap the derivative grows by the gap over the penetration, and falls again: after a kilometre none of its
    digits is known. It is right or NaN, and never a number that is wrong.
    """
    found = np.array(share_returned(law, [0.1, 1.0, 10.0, 100.0, 1e3], 30.0, 1e-10))
    assert np.all(np.isfinite(found[:3]))
    known = np.isfinite(found[:, 1])
    np.testing.assert_allclose(found[known], np.broadcast_to([30.0 * share, share], found[known].shape), rtol=1e-4)


def test_laws_that_jump_are_refused():
    play = cj.RevoluteClearance(1e-3, 0.01, laws.LinearKelvinVoigt(1e6, 100.0))
    m = pin().with_clearance("joint", play)
    assert bool(cj.simulate(m, 1e-3, energy_balance=False).succeeded)
    with refused("joint", "LinearKelvinVoigt"):
        jax.jacfwd(
            lambda c: cj.simulate(cj.replace(m, {"joint.radial_clearance": c}), 1e-3, energy_balance=False).final
        )(1e-3)


def test_a_spring_without_damping_has_derivatives():
    """It does not jump. A drop and a bounce in closed form: the contact lasts 2 (pi - atan(v w/g)) / w."""
    play = cj.RevoluteClearance(1e-3, 0.01, laws.LinearKelvinVoigt(1e6, 0.0))
    m = pin().with_clearance("joint", play)

    def height(c, k):
        changed = cj.replace(m, {"joint.radial_clearance": c, "joint.normal.stiffness": k})
        return cj.simulate(changed, END, energy_balance=False, rtol=1e-9, save_at=2)["joint.play_y"][-1]

    def exact(c, k):
        w, g = jnp.sqrt(k / 0.14), 9.81
        speed = jnp.sqrt(2 * g * c)
        since = END - speed / g - 2 * (jnp.pi - jnp.arctan(speed * w / g)) / w
        return -c + speed * since - g * since**2 / 2

    (value, found), (told, slopes) = (jax.value_and_grad(f, (0, 1))(1e-3, 1e6) for f in (height, exact))
    assert float(value) == pytest.approx(float(told), rel=1e-7)
    np.testing.assert_allclose(found, slopes, rtol=1e-6)


# The experiment ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_quick_experiment(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    found = derivatives.main(quick=True)
    assert max(rung.worst for rung in found.rungs if rung.tool.startswith("ours") and rung.rtol == 1e-9) <= 1e-6
    assert {"trap", "two balls", "times apart"} <= {row.case for row in found.closed}
    assert all(cost.steps_both > cost.steps > 100 for cost in found.costs)
    assert all(count.bad == count.stopped == 0 for count in found.counts)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        f"derivatives_{part}_quick.md" for part in ("ladder", "limits", "closed_forms", "cost", "finite")
    }
