"""Quasi-static poses: depths by closed forms, no acceleration, derivatives, agreement with dynamics, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import relative_accelerations
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.state import layout

CLEARANCE, GRAVITY, MASS, STIFFNESS, FRICTION = 1e-4, 9.81, 2.0, 1e9, 0.2
TURN = 0.012


def turning(speed: float, friction: float = 0.0) -> cj.Mechanism:
    """A disc on a horizontal pin with play, which its drive turns."""
    law = laws.TanhCoulomb(friction, 1e-9) if friction else None
    play = cj.RevoluteClearance(CLEARANCE, 0.01, laws.HuntCrossley(STIFFNESS, 0.5), law)
    motion = cj.Motion(cj.drives.ConstantSpeed(speed))
    return cj.Mechanism(
        bodies=(cj.Body("disc", MASS, 0.01),),
        joints=(cj.Revolute("hip", "ground", "disc", motion=motion, clearance=play),),
        points=(cj.Point("middle", "disc", cj.Position()),),
        gravity=cj.Gravity(y=-GRAVITY),
    )


def eccentricity(mechanism: cj.Mechanism) -> tuple[float, float]:
    solution = cj.simulate(mechanism, 0.1, save_at=2, fidelity="quasi-static")
    return float(solution.state("hip.play_x")[-1]), float(solution.state("hip.play_y")[-1])


def test_a_pin_rests_at_the_depth_of_its_load():
    """K d^1.5 = m g, straight down."""
    x, y = eccentricity(turning(1.0))
    depth = (MASS * GRAVITY / STIFFNESS) ** (2 / 3)
    assert -y == pytest.approx(CLEARANCE + depth, rel=1e-12)
    assert abs(x) < 1e-12 * CLEARANCE


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_friction_turns_the_place_of_rest_by_its_angle(way):
    """Normal force and friction together bear the weight: the normal leans by atan(mu), against the turning."""
    x, y = eccentricity(turning(way, FRICTION))
    assert np.arctan2(abs(x), -y) == pytest.approx(np.arctan(FRICTION), rel=1e-9)
    normal = MASS * GRAVITY / np.hypot(1.0, FRICTION)
    assert np.hypot(x, y) == pytest.approx(CLEARANCE + (normal / STIFFNESS) ** (2 / 3), rel=1e-9)
    # The disc's surface rubs along the sleeve's wall and climbs it.
    assert np.sign(x) == np.sign(eccentricity(turning(1.0, FRICTION))[0]) * way


@pytest.fixture(scope="module")
def crank():
    return slider_crank(1e-4)


def test_nothing_accelerates_in_its_play(crank):
    """Of the field itself, along the play, at all instants; against what the contact alone would do."""
    smooth = cj.replace(crank, {"wrist.friction.coefficient": 0.0})
    solution = cj.simulate(smooth, TURN, save_at=25, fidelity="quasi-static")
    ready = smooth.prepare()

    @jax.jit
    @jax.vmap
    def relative(time, y):
        ((_, rate),) = relative_accelerations(time, y, slope(time, y, ready), ready)
        return jnp.stack(rate.velocity[:2])

    still = np.asarray(relative(solution.time, solution.y))
    scale = np.abs(np.asarray(solution["piston.acceleration"])).max()
    assert np.abs(still).max() < 1e-6 * scale


def peak(mechanism, c, **options):
    metric = {
        "peak": metrics.Peak(metrics.PositionError("piston")),
        "rms": metrics.Rms(metrics.PositionError("piston")),
    }
    found = cj.measure(cj.replace(mechanism, {"wrist.radial_clearance": c}), metric, TURN, **options)
    return jnp.stack([found["peak"], found["rms"]])


def test_derivatives_of_a_peak_and_of_an_average(crank):
    def of(c):
        return peak(crank, c, fidelity="quasi-static")

    value = jax.jit(of)
    found, step = jax.jit(jax.jacfwd(of))(1e-4), 1e-8
    assert np.allclose(found, (value(1e-4 + step) - value(1e-4 - step)) / (2 * step), rtol=1e-5)
    both = jax.vmap(of)(jnp.array([1e-4, 2e-4]))
    assert np.allclose(both[0], value(1e-4), rtol=1e-9)
    # Nearly proportional: the rest is elasticity.
    assert np.allclose(both[1] / both[0], 2.0, rtol=0.1)


def test_slow_dynamics_has_the_same_peak(crank):
    """The pin of a slow crank rides along its wall; the load of gravity alone would be too small to keep it there."""
    dynamic = peak(crank, 1e-5, start="settled", rtol=1e-7)
    assert np.allclose(peak(crank, 1e-5, fidelity="quasi-static")[0], dynamic[0], rtol=0.1)


def test_what_poses_cannot_give(crank):
    quasi = {"fidelity": "quasi-static"}
    with pytest.raises(ClearanceError, match="has no initial state"):
        cj.simulate(crank, TURN, y0=np.zeros(layout(crank).size), **quasi)
    with pytest.raises(ClearanceError, match="no energy balance"):
        cj.measure(crank, {"lost": metrics.EnergyLost()}, TURN, **quasi)
    with pytest.raises(ClearanceError, match="TouchCounter follows a motion step by step"):
        cj.measure(crank, {"impacts": metrics.Impacts("wrist")}, TURN, **quasi)
    with pytest.raises(ClearanceError, match="`fidelity` must be dynamics or quasi-static"):
        cj.simulate(crank, TURN, fidelity="guess")
    with pytest.raises(ClearanceError, match="moves freely"):
        cj.simulate(turning(1.0).without_drives(["hip"]), TURN, **quasi)
    with pytest.raises(ClearanceError, match="moves freely, or by a drive that gives way"):
        cj.simulate(cj.with_compliance(turning(1.0), "hip", cj.Compliance(1e4, 10.0)), TURN, **quasi)
    with pytest.raises(ClearanceError, match="without play is where its drives put it"):
        cj.simulate(crank.ideal(), TURN, **quasi)


def test_what_follows_the_steps_of_a_motion_refuses_poses(crank):
    """A trace answered by the dynamics, without a word."""
    quasi = {"fidelity": "quasi-static"}
    with pytest.raises(ClearanceError, match="follows the steps of a motion"):
        cj.trace(crank, TURN, **quasi)
    exponent = metrics.LyapunovExponent(TURN, count=4)
    with pytest.raises(ClearanceError, match="follows the steps of a motion"):
        cj.measure(crank, {"exponent": exponent}, 6 * TURN, **quasi)
    model = cj.wear.WearModel(crank, "wrist", cj.wear.archard("6e-14 1/Pa"), cj.wear.Uniform(0.2), TURN)
    with pytest.raises(ClearanceError, match="follows the steps of a motion"):
        cj.wear.simulate_wear(model, 10, **quasi)


def test_chunks_side_by_side_come_to_an_end(crank):
    """More samples than a chunk, on two cores: kernels of LAPACK that shared threads waited for each other for ever."""
    found = cj.batch(lambda c: peak(crank, c, fidelity="quasi-static"), np.linspace(1e-5, 1e-4, 192), cores=2)
    assert np.allclose(np.asarray(found)[-1], peak(crank, 1e-4, fidelity="quasi-static"), rtol=1e-9)
