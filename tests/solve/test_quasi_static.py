"""Quasi-static motions: poses by hand, accelerations that vanish, derivatives, the dynamics of slow motions, and how
far a motion says that it can be believed.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from catalogue import playful_servo, slider_crank
from places import refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import relative_accelerations
from clearance_jax.dynamics.pose import frequencies, ideal_states, poses
from clearance_jax.mechanism.motion.motion_laws import DriveSum
from clearance_jax.mechanism.state import layout, parts
from clearance_jax.parameters import values_of
from clearance_jax.solve.validity import FOLLOWS, NOT_VALID, PEAK_ONLY, Validity, bends
from experiments.common import SCENES

POSES = {"fidelity": "quasi-static"}
STIFFNESS, MASS, GRAVITY, RADIUS, CLEARANCE = 1e9, 2.0, 9.81, 0.01, 1e-4
ERROR, PISTON = metrics.PositionError("end"), metrics.PositionError("piston")
TURN = 0.012


def wheel(friction=None, speed: float = 50.0) -> cj.Mechanism:
    """A wheel that turns fast on a pin with play, its centre of mass at the pin: its weight is all that presses."""
    motion = cj.Motion(cj.drives.ConstantSpeed(speed))
    play = cj.RevoluteClearance(CLEARANCE, RADIUS, laws.HuntCrossley(STIFFNESS, 0.5), friction)
    return cj.Mechanism(
        bodies=(cj.Body("wheel", MASS, 0.01),),
        joints=(cj.Revolute("hub", "ground", "wheel", motion=motion, clearance=play),),
        points=(cj.Point("centre", "wheel"),),
        gravity=cj.Gravity(y=-GRAVITY),
    )


def payload(clearance: float, mass: float, took: float, smooth: bool, friction: float = 0.05) -> cj.Mechanism:
    """The paper's joint 5 on a move by a quintic or a trapezoid of accelerations, all of one program."""
    quintic = cj.drives.Quintic([0.0, took], [0.1, 0.1 + 0.9 * smooth])
    trapezoid = cj.drives.Trapezoid([0.0], [0.9 * (not smooth)], duration=[took])
    scene = cj.load(SCENES / "joint5_velocity_1.toml").with_drives({"joint5": DriveSum((quintic, trapezoid))})
    numbers = {"payload.mass": mass, "payload.inertia": 7.0 * mass / 300, "joint5.radial_clearance": clearance}
    return cj.replace(scene, numbers | {"joint5.friction.coefficient": friction})


def validity(solution: cj.Solution) -> Validity:
    """How far a quasi-static solution is to be believed."""
    assert solution.validity is not None
    return solution.validity


@pytest.mark.parametrize(("mu", "way"), [(0.0, 1), (0.3, 1), (0.3, -1)])
def test_a_pin_rests_as_deep_as_its_law_bears_and_is_carried_up_the_wall_by_friction(mu, way):
    mechanism = wheel(laws.TanhCoulomb(mu, 1e-2) if mu else None, 50.0 * way)
    solution = cj.simulate(mechanism, 0.1, save_at=5, **POSES)
    angle = np.arctan(mu)
    depth = (MASS * GRAVITY * np.cos(angle) / STIFFNESS) ** (2 / 3)
    # The lowest point of the pin slides to the right, so that friction carries it to the left; or the other way round.
    at = (CLEARANCE + depth) * np.array([-way * np.sin(angle), -np.cos(angle)])
    found = np.stack([solution["hub.play_x.position"], solution["hub.play_y.position"]], -1)
    np.testing.assert_allclose(found, np.tile(at, (5, 1)), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(solution["hub.contact_force"], MASS * GRAVITY * np.cos(angle), rtol=1e-9)
    assert validity(solution).word == "follows"


def accelerations(mechanism: cj.Mechanism, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the play at the poses, and where pins touch nothing."""
    ready, plan = mechanism.prepare(), layout(mechanism)
    own = {joint.name + one.suffix for joint in ready.clearance_joints() for one in joint.joint.play()}
    rows = np.array([part.v.start for part in parts(mechanism) if part.coordinate.name in own])
    places = np.array([part.q.start for part in parts(mechanism) if part.coordinate.name in own])

    @jax.jit
    def both(times):
        found = poses(times, ready, ideal_states(ready, times))
        loose = found.y.at[:, places].set(0.0)
        return tuple(jax.vmap(lambda t, y: slope(t, y, ready)[plan.v][rows])(times, y) for y in (found.y, loose))

    held, free = both(jnp.asarray(times))
    return np.asarray(held), np.asarray(free)


def test_play_does_not_accelerate_at_a_pose():
    held, free = accelerations(payload(5e-5, 100.0, 0.5, True), np.linspace(0, 0.5, 20))
    assert np.abs(held).max() <= 1e-8 * np.abs(free).max()


@pytest.mark.slow
def test_play_does_not_accelerate_at_a_pose_in_space_wherever_its_search_begins():
    mechanism = cj.load(SCENES / "tool_changer.toml")
    times = np.linspace(0.02, 0.48, 9)
    held, free = accelerations(mechanism, times)
    assert np.abs(held).max() <= 1e-8 * np.abs(free).max()
    ready = mechanism.prepare()

    @jax.jit
    def found(t):
        at = poses(t, ready, ideal_states(ready, t))
        return at.play, frequencies(t, ready, at)

    # The first of a row begins in the middle of its sleeve, the others between poses.
    together, alone = (jax.tree.map(np.asarray, found(jnp.asarray(t))) for t in (times, [*times[1:], 0.49]))
    size = np.abs(together[0][0]).max(0)
    np.testing.assert_allclose(together[0][0][1:] / size, alone[0][0][:8] / size, rtol=0, atol=1e-9)
    np.testing.assert_allclose(together[1][1:], alone[1][:8], rtol=1e-6)


@pytest.fixture(scope="module")
def crank():
    return slider_crank(1e-4)


def sliding_block() -> cj.Mechanism:
    """The slider-crank with play in its guide too, along which its block rubs."""
    guide = cj.GuideClearance(1e-4, 0.06, 0.03, laws.HuntCrossley(1e9, 0.5), laws.TanhCoulomb(0.2, 0.01))
    crank = slider_crank(1e-4)
    block = dataclasses.replace(crank.bodies[2], inertia=jnp.asarray(1e-4))
    return dataclasses.replace(crank, bodies=(*crank.bodies[:2], block)).with_clearance("guide", guide)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mechanism",
    [
        cj.replace(slider_crank(1e-4), {"wrist.friction.coefficient": 0.3}),
        cj.load(SCENES / "slider_crank_two_clearances.toml"),
        sliding_block(),
    ],
    ids=["loop", "tree and loop", "guide"],
)
def test_nothing_accelerates_in_its_play_whatever_rubs(mechanism):
    """Of the field itself: friction in one joint of a loop changes what the other joints bear."""
    ready, plan, times = mechanism.prepare(), layout(mechanism), jnp.linspace(1e-4, 0.0115, 12)
    joints = ready.clearance_joints()
    own = {joint.name + one.suffix for joint in joints if joint.in_tree for one in joint.joint.play()}
    rows = np.array([part.v.start for part in parts(mechanism) if part.coordinate.name in own], int)

    @jax.jit
    def both(times):
        y = poses(times, ready, ideal_states(ready, times)).y

        def one(time, y):
            rate = slope(time, y, ready)
            rates = [rate for _, rate in relative_accelerations(time, y, rate, ready)]
            across = [
                jnp.stack(one.velocity[:2]) for joint, one in zip(joints, rates, strict=True) if not joint.in_tree
            ]
            return jnp.concatenate([rate[plan.v][rows], *across]), jnp.max(jnp.abs(rate[plan.v]))

        return jax.vmap(one)(times, y)

    play, largest = both(times)
    assert np.abs(play).max() <= 1e-8 * np.max(largest)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mechanism", "t1", "point", "names"),
    [
        (payload(5e-5, 100.0, 0.5, True), 0.5, "end", ("joint5.radial_clearance", "payload.mass")),
        (cj.load(SCENES / "slider_crank_loaded.toml"), 0.05, "piston", ("wrist.radial_clearance", "guide.0.effort")),
    ],
    ids=["tree", "loop"],
)
def test_derivatives_are_those_of_differences(mechanism, t1, point, names):
    error = metrics.PositionError(point)
    asked = {"peak": metrics.Peak(error), "rms": metrics.Rms(error), "at": metrics.At(error, [0.37 * t1])}
    centre = values_of(mechanism, names)

    @jax.jit
    def of(parts):
        changed = cj.replace(mechanism, {name: value * (1 + parts[name]) for name, value in centre.items()})
        found = cj.measure(changed, asked, t1, **POSES)
        return jnp.stack([found["peak"], found["rms"], found["at"][0]])

    nothing = {name: jnp.zeros(()) for name in names}
    slopes = jax.jacfwd(of)(nothing)
    for name in names:
        step = 1e-3
        ends = [[of(nothing | {name: jnp.asarray(side * h)}) for side in (1, -1)] for h in (step, step / 2)]
        once, twice = ((up - down) / (2 * h) for (up, down), h in zip(ends, (step, step / 2), strict=True))
        expected = (4 * twice - once) / 3
        np.testing.assert_allclose(slopes[name], expected, rtol=1e-6, atol=1e-6 * float(jnp.abs(of(nothing)).max()))


@pytest.mark.slow
def test_a_slow_motion_is_that_of_the_dynamics():
    mechanism, t1 = payload(3e-5, 60.0, 0.8, True), 0.8
    times = np.linspace(0.1, t1, 36)
    asked = {
        "peak": metrics.Peak(ERROR, since=0.08),
        "rms": metrics.Rms(ERROR),
        "mean": metrics.Mean(ERROR),
        "at": metrics.At(ERROR, times),
    }
    found = cj.measure(mechanism, asked, t1, **POSES)
    known = cj.measure(mechanism, asked, t1, rtol=1e-7, start="settled")
    for name, value in found.items():
        np.testing.assert_allclose(value, known[name], rtol=0.02, err_msg=name)
    # Averages are those of samples of the same poses.
    solution = cj.simulate(mechanism, t1, save_at=2001, **POSES)
    ideal = cj.simulate(mechanism.ideal(), t1, save_at=2001)
    off = np.linalg.norm(np.asarray(solution["end.position"] - ideal["end.position"]), axis=-1)
    mean = np.trapezoid(off, dx=1 / 2000)
    assert float(found["mean"]) == pytest.approx(mean, rel=1e-5)
    assert float(found["rms"]) == pytest.approx(np.sqrt(np.trapezoid(off**2, dx=1 / 2000)), rel=1e-5)
    assert validity(solution).level == FOLLOWS


def peak(mechanism, c, **options):
    metric = {
        "peak": metrics.Peak(PISTON),
        "rms": metrics.Rms(PISTON),
    }
    found = cj.measure(cj.replace(mechanism, {"wrist.radial_clearance": c}), metric, TURN, **options)
    return jnp.stack([found["peak"], found["rms"]])


@pytest.mark.slow
def test_an_error_is_nearly_proportional_to_the_clearance_in_a_batch_too(crank):
    both = jax.vmap(lambda c: peak(crank, c, **POSES))(jnp.array([1e-4, 2e-4]))
    assert np.allclose(both[0], peak(crank, 1e-4, **POSES), rtol=1e-9)
    # The rest is elasticity.
    assert np.allclose(both[1] / both[0], 2.0, rtol=0.1)


@pytest.mark.slow
def test_slow_dynamics_has_the_same_peak(crank):
    """The pin of a slow crank rides along its wall; the load of gravity alone would be too small to keep it there."""
    dynamic = peak(crank, 1e-5, start="settled", rtol=1e-7)
    assert np.allclose(peak(crank, 1e-5, **POSES)[0], dynamic[0], rtol=0.1)


@pytest.mark.slow
def test_samples_that_fall_on_the_grid_are_its_poses(crank):
    """At equal distances the poses of the grid are read again; elsewhere they are found beside it."""
    even = cj.simulate(crank, TURN, save_at=301, **POSES)
    times = np.asarray(even.time)
    apart = cj.simulate(crank, TURN, save_at=np.append(times[:-1], 0.9999 * TURN), **POSES)
    np.testing.assert_allclose(even.y[:-1], apart.y[:-1], rtol=1e-9, atol=1e-15)
    coarse = cj.simulate(crank, TURN, save_at=4, **POSES)
    np.testing.assert_allclose(coarse.y, even.y[::100], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(coarse.time, times[::100], rtol=1e-14)


@pytest.mark.slow
def test_chunks_side_by_side_come_to_an_end(crank):
    """More samples than a chunk, on two cores: kernels of LAPACK that shared threads waited for each other for ever."""
    found = cj.batch(lambda c: peak(crank, c, **POSES), np.linspace(1e-5, 1e-4, 192), cores=2)
    assert np.allclose(np.asarray(found)[-1], peak(crank, 1e-4, **POSES), rtol=1e-9)


@pytest.mark.slow
def test_the_words_of_three_motions_and_what_they_are_worth():
    """A slow quintic, a trapezoid whose jumps ring a little, and a fast one: gaps over peaks of 0.1, 20 and 80 %."""
    slow, jumping, fast = (
        payload(3.3e-5, 83.0, 0.47, True, 0.0),
        payload(1.66e-4, 46.0, 0.67, False),
        payload(1.22e-4, 30.0, 0.16, False),
    )
    together = jax.tree.map(lambda *one: jnp.stack(one), slow, jumping, fast)
    ends = jnp.array([0.47, 0.67, 0.16])
    batch = jax.vmap(lambda m, t1: cj.simulate(m, t1, save_at=101, **POSES))(together, ends)
    assert list(np.asarray(validity(batch).level)) == [FOLLOWS, PEAK_ONLY, NOT_VALID]
    assert "1 follows, 1 peak only, 1 not valid" in repr(batch)
    one = cj.simulate(jumping, 0.67, save_at=101, **POSES)
    np.testing.assert_allclose(batch.y[1], one.y, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(validity(batch).ringing[1], validity(one).ringing, rtol=1e-9)
    assert validity(one).word == "peak only"
    assert validity(one).periods == pytest.approx(float(validity(one).frequency) * 0.67)
    assert "Ringing to be expected of `end`" in repr(validity(one))
    assert repr(validity(one)) in repr(one)
    motion = cj.simulate(jumping, 0.67, save_at=101, rtol=1e-6, start="settled")
    apart = np.linalg.norm(np.asarray(motion["end.position"] - one["end.position"]), axis=-1)
    # It does ring as was expected, and its peak is that of the poses.
    expected = float(validity(one).ringing[0])
    assert 0.3 * expected < apart[10:].max() < 2 * expected
    peak = metrics.Peak(ERROR, since=0.067)
    by_poses, by_dynamics = peak(jumping, 0.67, **POSES), peak(jumping, 0.67, rtol=1e-6, start="settled")
    assert float(by_poses) == pytest.approx(float(by_dynamics), rel=0.25)


def test_an_oscillator_that_is_led_rings_as_its_path_bends():
    """Jumps, kinks and curves; shorter than the distance of samples nothing is seen."""
    times, frequency = jnp.linspace(0, 1.0, 201), jnp.full(201, 10 / (2 * jnp.pi))
    jump = jnp.where(times > 0.5, 2.0, 0.0)
    kink, curve = 3.0 * jnp.maximum(times - 0.5, 0.0), 4.0 * times**2
    paths = jnp.stack([jump, kink, curve], -1)[:, :, None]
    found = np.asarray(bends(times, paths, frequency))
    np.testing.assert_allclose(found[:, 0].max(), 2.0, rtol=1e-12)
    np.testing.assert_allclose(found[:, 1].max(), 0.3, rtol=1e-12)
    # A chord between samples lies off a curve by an eighth of the curvature times their distance squared.
    np.testing.assert_allclose(found[30:-30, 2], 8.0 / 100, rtol=1e-2)
    fast = np.asarray(bends(times, paths, 100 * frequency))
    np.testing.assert_allclose(fast[:, 0].max(), 2.0, rtol=1e-12)
    still = np.asarray(bends(times, paths, 0 * frequency))
    assert np.all(np.isfinite(still))


def test_what_poses_cannot_give_is_refused_in_words():
    mechanism = wheel()
    with refused("hip", None):
        cj.simulate(playful_servo(), 0.1, **POSES)
    with refused("hub", None):
        cj.simulate(mechanism.without_drives(["hub"]), 0.1, **POSES)
    with refused("clearance"):
        cj.simulate(mechanism.ideal(), 0.1, **POSES)
    with refused("y0"):
        cj.simulate(mechanism, 0.1, y0=jnp.zeros(layout(mechanism).size), **POSES)
    with refused("energy_balance", True):
        cj.simulate(mechanism, 0.1, energy_balance=True, **POSES)
    with refused("energy_balance", True):
        cj.measure(mechanism, {"lost": metrics.EnergyLost()}, 0.1, **POSES)
    with refused("TouchCounter"):
        metrics.Impacts("hub")(mechanism, 0.1, **POSES)
    with refused("fidelity", "guess"):
        cj.simulate(mechanism, 0.1, fidelity="guess")
    with refused("fidelity", "static"):
        cj.simulate(mechanism, 0.1, fidelity="static")


@pytest.mark.slow
def test_what_follows_the_steps_of_a_motion_refuses_poses(crank):
    """A trace answered by the dynamics, without a word."""
    with refused("fidelity", "quasi-static", "dynamics"):
        cj.trace(crank, TURN, **POSES)
    exponent = metrics.LyapunovExponent(TURN, count=4)
    with refused("fidelity", "quasi-static", "dynamics"):
        cj.measure(crank, {"exponent": exponent}, 6 * TURN, **POSES)
    model = cj.wear.WearModel(crank, "wrist", cj.wear.archard("6e-14 1/Pa"), cj.wear.Uniform(0.2), TURN)
    with refused("fidelity", "quasi-static", "dynamics"):
        cj.wear.simulate_wear(model, 10, **POSES)


def test_a_static_bound_has_no_validity(crank):
    """Its pins are in the middle of their play, which has no frequency."""
    question = cj.sweep(crank, {"wrist.radial_clearance": [1e-4]}, {"p": metrics.Peak(PISTON)}, TURN, fidelity="static")
    assert "validity" not in question
    assert float(question.p[0]) > 0


@pytest.mark.slow
def test_a_sweep_stores_how_far_poses_are_to_be_believed(tmp_path):
    mechanism = payload(1.22e-4, 30.0, 0.16, False)
    axes = {"joint5.radial_clearance": [1e-6, 1.22e-4]}
    found = cj.sweep(mechanism, axes, {"peak": metrics.Peak(ERROR)}, 0.16, **POSES)
    assert int(found.validity[1]) == NOT_VALID
    assert found.validity.dims == found.peak.dims
    assert "2 not valid" in found.validity.attrs["long_name"]


@pytest.mark.slow
def test_the_command_line_says_it_and_writes_it(tmp_path):
    out, scene = tmp_path / "poses.nc", str(SCENES / "joint5_velocity_1.toml")
    words = ["simulate", scene, "--t1", "0.2s", "--samples", "11", "--fidelity"]
    result = CliRunner().invoke(app, [*words, "quasi-static", "-o", str(out)])
    assert result.exit_code == 0, result.output
    with xr.open_dataset(out) as dataset:
        assert dataset.attrs["validity"].split(":")[0] in result.output
        assert "Ringing to be expected" in dataset.attrs["validity"]
        assert dataset.sizes["time"] == 11
    wrong = CliRunner().invoke(app, [*words, "static"])
    assert "`--fidelity` must be dynamics or quasi-static" in str(wrong.exception)


FILM = cj.joints.ShortBearing(0.1, 1e-6)


@pytest.mark.parametrize(
    ("normal", "friction", "element"),
    [
        (laws.HuntCrossley(STIFFNESS, 0.5), laws.LuGre(0.4, 0.3, 1e-3, 1e5, 100.0, 0.0), None),
        (laws.HuntCrossley(STIFFNESS, 0.5), laws.Dahl(0.3, 1e5), None),
        (laws.StandardLinearSolid(1e8, 0.5, 5e-3), None, None),
        (laws.HuntCrossley(STIFFNESS, 0.5).smoothed(1e-7), laws.Dahl(0.3, 1e5), None),
        (laws.HuntCrossley(STIFFNESS, 0.5), None, FILM),
    ],
    ids=["lugre", "dahl", "solid", "smoothed and dahl", "film"],
)
def test_forces_that_depend_on_the_past_or_on_motion_have_no_poses(normal, friction, element):
    play = cj.RevoluteClearance(CLEARANCE, RADIUS, normal, friction, element, length=0.02)
    hub = cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(cj.drives.ConstantSpeed(50.0)), clearance=play)
    mechanism = cj.Mechanism((cj.Body("wheel", MASS, 0.01),), (hub,), gravity=cj.Gravity(y=-GRAVITY))
    with refused("hub") as caught:
        cj.simulate(mechanism, 0.01, **POSES)
    assert "needs forces that follow from places and slips" in str(caught.value)
    if isinstance(normal, laws.StandardLinearSolid):
        with refused("hub", "StandardLinearSolid"):
            cj.simulate(mechanism, 0.001, start="settled")


@pytest.mark.slow
def test_pins_that_nothing_holds_and_poses_that_are_none_are_not_valid():
    floating = dataclasses.replace(wheel(), gravity=cj.Gravity())
    assert int(validity(cj.simulate(floating, 0.01, **POSES)).level) == NOT_VALID

    def solve(clearance):
        return cj.simulate(cj.replace(wheel(), {"hub.radial_clearance": clearance}), 0.01, throw=False, **POSES)

    found = jax.vmap(solve)(jnp.asarray([CLEARANCE, -CLEARANCE]))
    assert found.succeeded.tolist() == [True, False]
    assert validity(found).level.tolist() == [FOLLOWS, NOT_VALID]
