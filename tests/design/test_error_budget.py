"""Static bounds against the weights of levers, and what an error is made of: parts that add up, and a picture."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax import design, laws, metrics
from clearance_jax.design.judge.budget import RIGID, advice, error_budget
from clearance_jax.design.judge.static import static_error
from clearance_jax.dynamics.pose import displaced, ideal_states
from clearance_jax.metrics.signals import PositionError
from clearance_jax.report.design_figures import budget_figure

ERROR = metrics.Peak(metrics.PositionError("piston"))
TURN = 0.012


@pytest.fixture(scope="module")
def two_pins():
    return cj.load(SCENES / "slider_crank_two_clearances.toml")


def bound(mechanism, fidelity="static"):
    return cj.measure(mechanism, {"error": ERROR}, TURN, fidelity=fidelity)["error"]


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["slider_crank", "slider_crank_two_clearances"])
def test_a_static_bound_is_the_sum_of_levers(scene):
    """Of small play: what is left out of the weights is the square of play over length."""
    mechanism = cj.load(SCENES / f"{scene}.toml")
    small = cj.replace(mechanism, {f"{joint.name}.radial_clearance": 1e-6 for joint in mechanism.clearance_joints()})
    levers = static_error(small, design.static_weights(small, "piston", TURN, 201))
    assert bound(small) == pytest.approx(levers, rel=1e-4)


def test_the_bound_of_a_tilting_pin_and_of_a_block_in_its_guide():
    """Beside a sleeve both ends of its axis may be anywhere: 2 c l / L at the end of an arm along it, and the axial
    play square to that; in a guide the block may be in a corner.
    """
    law, radial, axial, length, end = laws.HuntCrossley(1e9, 0.5), 1e-6, 5e-7, 0.04, 0.2
    sleeve = cj.SleeveClearance(radial, 0.01, length, law, axial_clearance=axial)
    body = cj.Body("body", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, None, 0.02))
    turning = cj.Motion(cj.drives.Harmonic(0.35, 30.0))
    hip = cj.Revolute("hip", "ground", "body", motion=turning, clearance=sleeve)
    box = cj.GuideClearance(radial, length, 0.03, law, width=0.02)
    guide = cj.Prismatic("guide", "ground", "body", axis="z", motion=turning, clearance=box)
    point = cj.Point("tip", "body", cj.Position(z=end))
    metric = {"tip": metrics.At(metrics.PositionError("tip"), [0.02, 0.05])}
    for joint, expected in (
        (hip, np.hypot(2 * end / length * radial, axial)),
        (guide, np.sqrt(2) * 2 * end / length * radial),
    ):
        mechanism = cj.Mechanism((body,), (joint,), points=(point,), gravity=cj.Gravity(z=-9.81))
        found = cj.measure(mechanism, metric, 0.1, fidelity="static")["tip"]
        assert np.asarray(found) == pytest.approx(expected, rel=1e-3)


def test_no_place_within_the_play_has_a_larger_error(two_pins):
    """Random places of both pins, on their walls and within, at random times."""
    rng, ready, signal = np.random.default_rng(3), two_pins.prepare(), PositionError("piston")
    times = jnp.sort(jnp.asarray(rng.uniform(0, TURN, 50)))
    ideal = ideal_states(ready, times)
    sizes = [float(joint.clearance.radial_clearance) for joint in two_pins.clearance_joints()]
    turned, inward = rng.uniform(0, 2 * np.pi, (50, 2)), np.sqrt(rng.uniform(0.2, 1.0, (50, 2)))
    places = np.stack([np.cos(turned), np.sin(turned)], -1) * (inward * sizes)[..., None]

    @jax.jit
    def error(time, y, places):
        at = displaced(time, ready, (places[0], places[1]), y)
        return signal.value(time, at, ready, y)

    seen = jax.vmap(error)(times, ideal, jnp.asarray(places))
    most = cj.measure(two_pins, {"at": metrics.At(signal, times)}, TURN, fidelity="static")["at"]
    assert np.all(np.asarray(seen) <= np.asarray(most) * (1 + 1e-6))
    assert np.max(seen / most) > 0.7


@pytest.mark.slow
def test_the_derivative_of_a_static_bound(two_pins):
    names = [f"{joint.name}.radial_clearance" for joint in two_pins.clearance_joints()]
    at = np.array([float(joint.clearance.radial_clearance) for joint in two_pins.clearance_joints()])

    @jax.jit
    def of(c):
        return bound(cj.replace(two_pins, dict(zip(names, c, strict=True))))

    slopes = jax.jit(jax.jacfwd(of))(at)
    for k, slope in enumerate(slopes):
        step = 1e-3 * at[k] * np.eye(len(at))[k]
        assert slope == pytest.approx(float(of(at + step) - of(at - step)) / (2e-3 * at[k]), rel=1e-4)


def test_the_bound_knows_no_forces_and_is_no_motion():
    mechanism = slider_crank()
    with refused("fidelity", "static"):
        cj.measure(mechanism, {"force": metrics.Peak(metrics.ContactForce("wrist"))}, TURN, fidelity="static")
    with refused("fidelity", "static"):
        cj.simulate(mechanism, TURN, fidelity="static")


@pytest.fixture(scope="module")
def budget(two_pins):
    return error_budget(two_pins, "piston", TURN)


@pytest.mark.slow
def test_parts_of_an_error(budget, two_pins):
    shares, peaks = budget.shares, budget.peaks
    assert set(shares) == {joint.name for joint in two_pins.clearance_joints()}
    # One pin at a time adds up to all together, but for the square of play over length.
    assert sum(shares.values()) == pytest.approx(peaks["quasi_static"], rel=0.02)
    vectors = budget.dataset.joint_error.sum("joint").values
    assert np.allclose(np.linalg.norm(vectors, axis=1), budget.dataset.quasi_static, atol=0.02 * peaks["quasi_static"])
    # Rigid pins stay within the static bound, and elastic ones reach further.
    assert peaks["play"] <= float(bound(two_pins)) * (1 + 1e-3)
    assert peaks["play"] < peaks["quasi_static"]
    assert 0 < peaks["elasticity"] < 0.1 * peaks["quasi_static"]
    assert peaks["quasi_static"] == pytest.approx(float(bound(two_pins, "quasi-static")), rel=1e-3)


@pytest.mark.slow
def test_dynamics_is_the_error_of_a_solve(budget, two_pins):
    # Samples miss the top of a peak by the square of their distance.
    solved = cj.measure(two_pins, {"error": ERROR}, TURN, start="settled", rtol=1e-6)["error"]
    assert budget.peaks["dynamics"] == pytest.approx(float(solved), rel=0.02)


def test_the_table_and_its_advice(budget):
    said = str(budget)
    assert all(name in said for name in budget.shares)
    assert f"contacts {RIGID:g} times stiffer" in said
    worst = max(budget.shares, key=lambda name: abs(budget.shares[name]))
    assert f"Most is play of `{worst}`" in advice(budget)


def test_the_picture(budget):
    figure = budget_figure(budget)
    robot, bars, curves = figure.axes
    assert [text.get_text() for text in bars.get_yticklabels()] == sorted(
        budget.shares, key=lambda name: abs(budget.shares[name])
    )
    ends = [bar.get_x() + bar.get_width() for bar in bars.containers[1]]
    assert np.allclose(ends, sorted(1e6 * np.array([*budget.shares.values()]), key=abs), rtol=1e-6)
    assert len(curves.lines) == 4
    assert robot.get_title().startswith("shares at")


def test_what_has_no_budget(two_pins):
    with refused("pistn", allowed="piston"):
        error_budget(two_pins, "pistn", TURN)
    with refused("clearance"):
        error_budget(two_pins.ideal(), "piston", TURN)
    free = cj.load(SCENES / "slider_crank_guide.toml")
    with refused("main"):
        error_budget(free, "slider", TURN)
