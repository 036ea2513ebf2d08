"""Motions of a joint: from point to point, through via points; the drives of a mechanism, replaced by name."""

import collections
import dataclasses
import random
import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import playful_servo, slider_crank
from places import SCENES, refused
from scipy.interpolate import make_interp_spline

import clearance_jax as cj
from clearance_jax.cli import main
from tests import fuzz
from tests.fuzz_cases import LIFT
from tests.fuzz_trajectories import trajectory

RNG = np.random.default_rng(0)
# Short moves and long ones, forth and back, one by nothing; some begin when the one before has long ended, most do not.
RISES = np.concatenate([RNG.uniform(-3, 3, 20), RNG.uniform(-0.1, 0.1, 20), [0.0]])
BEGINS = np.concatenate([np.cumsum(RNG.uniform(0, 4, 20)), np.zeros(20), [200.0]])
SPEED, ACCELERATION = 1.3, 4.1
LIMITED = cj.drives.Trapezoid(BEGINS, RISES, SPEED, ACCELERATION, offset=0.7)


def along(drive, times):
    """Position, speed and acceleration at times."""
    return np.stack(jax.jit(jax.vmap(drive.prepare()))(jnp.asarray(times)))


def between(times):
    """Two instants inside each piece."""
    gap = np.diff(times)
    return np.sort(np.concatenate([times[:-1] + 0.25 * gap, times[:-1] + 0.75 * gap])[np.tile(gap > 1e-9, 2)])


# From point to point -------------------------------------------------------------------------------------------------


def test_speeds_integrate_to_the_rises():
    times = np.asarray(LIMITED.breaks()).reshape(-1, 4)
    q, v, _ = along(LIMITED, times.ravel())
    v = v.reshape(-1, 4)
    moved = np.sum((v[:, :-1] + v[:, 1:]) / 2 * np.diff(times), axis=1)  # exact: a speed is a broken line
    np.testing.assert_allclose(moved, RISES, rtol=0, atol=1e-13)
    np.testing.assert_allclose(moved[:5], RISES[:5], rtol=0, atol=1e-14)
    np.testing.assert_allclose(q.reshape(-1, 4)[:, 3], 0.7 + np.cumsum(RISES), rtol=0, atol=1e-14)


def test_limits_are_kept_and_reached():
    times = np.asarray(LIMITED.breaks())
    _, v, _ = along(LIMITED, times)
    _, _, a = along(LIMITED, between(times))
    assert np.max(np.abs(v)) == pytest.approx(SPEED, rel=1e-15)
    assert np.max(np.abs(a)) == pytest.approx(ACCELERATION, rel=1e-14)
    # As fast as the limits allow: each move has the speed's limit, or no piece at constant speed.
    v, cruise = v.reshape(-1, 4), np.diff(times.reshape(-1, 4), axis=1)[:, 1]
    still = RISES == 0
    assert np.all((np.abs(v[:, 1]) == SPEED) | (cruise == 0))
    assert np.all(np.abs(v[cruise == 0][:, 1]) <= SPEED)
    size = np.abs(RISES)
    long = size > SPEED**2 / ACCELERATION
    shortest = np.where(long, size / SPEED + SPEED / ACCELERATION, 2 * np.sqrt(size / ACCELERATION))
    np.testing.assert_allclose(np.ptp(times.reshape(-1, 4), axis=1), shortest, rtol=1e-12, atol=1e-13)
    assert {True, False} == set(long.tolist())
    assert np.all(shortest[still] == 0)


def test_a_move_waits_for_the_one_before():
    begin, _, _, end = np.asarray(LIMITED.breaks()).reshape(-1, 4).T
    np.testing.assert_allclose(begin[1:], np.maximum(BEGINS[1:], end[:-1]), rtol=0, atol=1e-12)
    free = BEGINS[1:] > end[:-1]
    assert 5 < np.sum(free) < 35
    np.testing.assert_array_equal(begin[1:][free], BEGINS[1:][free])


def test_durations_are_taken_and_coordinates_are_synchronous():
    durations = np.array([0.5, 2.0, 0.25])
    first, second = (
        cj.drives.Trapezoid([0.0, 1.0, 4.0], np.array([1.0, -0.4, 0.3]) * k, duration=durations) for k in (1.0, -2.5)
    )
    times = np.asarray(first.breaks()).reshape(-1, 4)
    np.testing.assert_allclose(np.diff(times, axis=1), durations[:, None] / 3 * np.ones((1, 3)), rtol=1e-14)
    t = np.linspace(-1, 5, 601)
    np.testing.assert_allclose(along(second, t), -2.5 * along(first, t), rtol=0, atol=1e-13)
    slow = cj.drives.Trapezoid([0.0], [1.0], duration=[2.0], cruise=0.5)
    np.testing.assert_allclose(slow.breaks(), [0.0, 0.5, 1.5, 2.0], rtol=1e-15)
    assert float(slow(jnp.asarray(1.0))[1]) == pytest.approx(2 / 3, rel=1e-14)


def differences(function, point, step=1e-6):
    moves = step * np.eye(point.size)
    return np.stack([(function(point + m) - function(point - m)) / (2 * step) for m in moves], axis=-1)


T = jnp.linspace(-0.2137, 4.0411, 64)  # none at a break
BY_NUMBERS = {
    "limits": (
        lambda x: cj.drives.Trapezoid(x[:3], x[3:6], x[6], x[7], offset=x[8]),
        [0.1, 0.5, 2.2, 1.5, -0.2, 0.6, 2.0, 6.0, 0.4],
    ),
    "durations": (
        lambda x: cj.drives.Trapezoid(x[:2], x[2:4], duration=x[4:6], cruise=x[6]),
        [0.1, 0.5, 1.5, -0.2, 0.9, 0.6, 0.4],
    ),
    "least jerk": (lambda x: cj.drives.Quintic(x[:4], x[4:]), [0.1, 0.5, 1.9, 2.2, 1.5, -0.2, 0.6, 2.0]),
    "speeds": (lambda x: cj.drives.Quintic(x[:3], x[3:6], x[6:9]), [0.1, 0.5, 1.9, 2.2, 1.5, -0.2, 0.6, 2.0, -1.0]),
    "all": (lambda x: cj.drives.Quintic(x[:2], x[2:4], x[4:6], x[6:8]), [0.1, 1.9, 2.2, 1.5, -0.2, 0.6, 2.0, -1.0]),
}


@pytest.mark.parametrize("name", BY_NUMBERS)
def test_derivatives_by_every_number(name):
    make, numbers = BY_NUMBERS[name]
    point = jnp.asarray(numbers)

    @jax.jit
    def places(x):
        """Position and speed, which no number makes jump."""
        return jnp.stack(jax.vmap(make(x).prepare())(T)[:2])

    expected = differences(places, point)
    for jacobian in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(jacobian(places))(point)
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-7 * np.max(np.abs(expected)))
    # All count, but when a move should have begun that has to wait: the second of each trapezoid.
    idle = [1] if isinstance(make(point), cj.drives.Trapezoid) else []
    assert np.flatnonzero(np.max(np.abs(expected), axis=(0, 1)) == 0).tolist() == idle


def test_breaks_are_differentiable():
    ends = jax.jacfwd(lambda v: cj.drives.Trapezoid([0.0], [1.0], v, 4.0).breaks())(jnp.asarray(1.0))
    # v / a, d / v and their sum.
    np.testing.assert_allclose(ends, [0.0, 0.25, -1.0, -0.75], rtol=1e-14)
    still = jax.jacrev(lambda rise: jnp.stack(cj.drives.Trapezoid([1.0], rise, 2.0, 4.0)(jnp.asarray(3.0))))
    np.testing.assert_array_equal(still(jnp.zeros(1)), [[1.0], [0.0], [0.0]])


@pytest.mark.parametrize(
    ("arguments", "given", "words"),
    [
        (([0.0, 1.0], [1.0], 1.0, 1.0), {}, "lists of one length"),
        (([], [], 1.0, 1.0), {}, "lists of one length"),
        (([0.0], [1.0]), {"duration": [1.0, 2.0]}, "lists of one length"),
        (([0.0], [1.0]), {}, "`speed` and `acceleration`, or `duration`"),
        (([0.0], [1.0], 1.0), {}, "`speed` and `acceleration`, or `duration`"),
        (([0.0], [1.0], 1.0), {"duration": [1.0]}, "`speed` and `acceleration`, or `duration`"),
        (([0.0], [1.0], 1.0, 1.0), {"duration": [1.0]}, "`speed` and `acceleration`, or `duration`"),
        (([0.0], [1.0], 1.0, 1.0), {"cruise": 0.5}, "`cruise` is a part of a `duration`"),
        (([0.0], [1.0], 0.0, 1.0), {}, "`speed` of a trapezoid drive must be greater than zero"),
        (([0.0], [1.0], 1.0, -1.0), {}, "`acceleration` of a trapezoid drive must be greater than zero"),
        (([0.0], [1.0]), {"duration": [0.0]}, "`duration` of a trapezoid drive must be greater than zero"),
    ],
)
def test_wrong_moves_are_refused(arguments, given, words):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.drives.Trapezoid(*arguments, **given)


def test_a_solve_is_differentiable_by_limits_and_rises():
    """A pendulum on a carriage: its swing feels every ramp, whose ends move with these numbers."""
    moves = cj.drives.Trapezoid([0.1, 0.2], [0.5, -0.3], 1.0, 8.0)
    mechanism = cj.Mechanism(
        bodies=(cj.Body("carriage"), cj.Body("bob", 1.0)),
        joints=(
            cj.Prismatic("slide", "ground", "carriage", motion=cj.Motion(moves)),
            cj.Revolute("hinge", "carriage", "bob", at_child=cj.Position(0.0, 0.4)),
        ),
        gravity=cj.Gravity(y=-9.81),
    )
    names = ["drive.slide.rise.0", "drive.slide.rise.1", "drive.slide.speed", "drive.slide.acceleration"]

    def swing(values):
        varied = cj.replace(mechanism, dict(zip(names, values, strict=True)))
        return cj.simulate(varied, 1.5, rtol=1e-10, energy_balance=False).final

    point = jnp.array([0.5, -0.3, 1.0, 8.0])
    slopes = jax.jit(jax.jacfwd(swing))(point)
    np.testing.assert_allclose(slopes, differences(jax.jit(swing), point, 5e-5), rtol=0, atol=2e-6)
    assert np.min(np.max(np.abs(slopes), axis=0)) > 1e-3


# Through via points --------------------------------------------------------------------------------------------------

TIMES = np.array([0.1, 0.35, 0.5, 0.9, 1.0, 1.45, 1.7])
VALUES = np.array([0.2, -0.4, 0.1, 0.9, 0.3, -1.1, 0.4])
REST = [(1, 0.0), (2, 0.0)]


def quintics(speeds: bool, accelerations: bool) -> cj.drives.Quintic:
    return cj.drives.Quintic(TIMES, VALUES, -VALUES if speeds else None, 3 * VALUES if accelerations else None)


@pytest.mark.parametrize("given", [(False, False), (True, False), (True, True)])
def test_via_points_are_met_smoothly(given):
    drive = quintics(*given)
    size = np.max(np.abs(along(drive, np.linspace(0.1, 1.7, 999))), axis=1)
    at = along(drive, TIMES)
    np.testing.assert_array_equal(at[0], VALUES)
    # C2, by differences over the points: values there and a hair before belong to two quintics.
    before = along(drive, TIMES[1:-1] - 1e-9)
    for order in range(3):
        np.testing.assert_allclose(before[order], at[order, 1:-1], rtol=0, atol=1e-6 * size[order])
    if given[0]:
        np.testing.assert_allclose(at[1], -VALUES, rtol=0, atol=1e-13 * size[1])
    if given[1]:
        np.testing.assert_allclose(at[2, :-1], 3 * VALUES[:-1], rtol=0, atol=1e-12 * size[2])
    # Speeds are the differences of positions, accelerations those of speeds.
    t, h = np.linspace(0.11, 1.69, 300), 1e-6
    now, later, earlier = along(drive, t), along(drive, t + h), along(drive, t - h)
    for order in (1, 2):
        slopes = (later[order - 1] - earlier[order - 1]) / (2 * h)
        np.testing.assert_allclose(now[order], slopes, rtol=0, atol=2e-5 * size[order])


def test_least_jerk_is_the_quintic_spline_at_rest():
    """The curve of least jerk is the spline of degree five, four times differentiable."""
    t = np.linspace(0.1, 1.7, 400)[:-1]
    spline = make_interp_spline(TIMES, VALUES, k=5, bc_type=(REST, REST))
    found = along(cj.drives.Quintic(TIMES, VALUES), t)
    for order in range(3):
        expected = spline(t, nu=order)
        np.testing.assert_allclose(found[order], expected, rtol=0, atol=1e-11 * np.max(np.abs(expected)))


def test_least_jerk_by_given_speeds():
    """Nothing else of the kind has less: the jerk's integral over curves with these speeds is stationary."""

    def jerk(accelerations):
        pieces = cj.drives.Quintic(TIMES, VALUES, -VALUES, accelerations).prepare().coefficients[1:-1]
        third = pieces[:, 3:] * jnp.array([[6.0, 24.0, 60.0]])
        h = jnp.diff(TIMES)[:, None, None]
        i = jnp.arange(3)
        power = (i[:, None] + i[None] + 1)[None]
        return jnp.sum(third[:, :, None] * third[:, None, :] * h**power / power)

    chosen = along(quintics(True, False), TIMES)[2]
    chosen[-1] = 0.0  # at the last point the straight line begins
    slope = jax.grad(jerk)(jnp.asarray(chosen))
    assert np.max(np.abs(slope[1:-1])) < 1e-11 * np.max(np.abs(slope))
    np.testing.assert_array_equal(chosen[[0, -1]], 0.0)
    assert all(jerk(chosen + 0.01 * move) > jerk(chosen) for move in np.eye(7)[1:-1])


def test_two_points_are_a_step5():
    t = np.linspace(-0.5, 2.5, 301)
    expected = along(cj.drives.Step5Sum([0.2], [1.7], [2.5], 0.4), t)
    np.testing.assert_allclose(along(cj.drives.Quintic([0.2, 1.7], [0.4, 2.9]), t), expected, rtol=0, atol=1e-13 * 10)


def test_outside_its_points_it_goes_straight_on():
    t = np.array([-1.0, 0.0, 1.7, 3.0])
    q, v, a = along(quintics(True, True), t)
    np.testing.assert_allclose(v, -VALUES[[0, 0, -1, -1]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(q, VALUES[[0, 0, -1, -1]] + v * (t - TIMES[[0, 0, -1, -1]]), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(a, 0.0)


def test_a_long_table_of_via_points():
    rng = np.random.default_rng(1)
    times, values = np.cumsum(rng.uniform(0.5, 1.5, 3000)), rng.standard_normal(3000)
    spline = make_interp_spline(times, values, k=5, bc_type=(REST, REST))
    t = rng.uniform(times[0], times[-1], 500)
    np.testing.assert_allclose(along(cj.drives.Quintic(times, values), t)[0], spline(t), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.0], [1.0]), "at least 2"),
        (([0.0, 1.0], [1.0]), "of one length"),
        (([0.0, 1.0], [1.0, 2.0], [0.0]), "of one length"),
        (([0.0, 1.0], [1.0, 2.0], None, [0.0, 0.0]), "needs `speeds` too"),
        (([0.0, 0.0], [1.0, 2.0]), "must increase"),
    ],
)
def test_wrong_via_points_are_refused(arguments, words):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.drives.Quintic(*arguments)


# Mechanisms driven otherwise -----------------------------------------------------------------------------------------


def drive_of(mechanism: cj.Mechanism, name: str) -> Any:
    joint: Any = mechanism.joint(name)
    return joint.motion.drive


def test_a_driven_mechanism_is_the_one_built_by_hand():
    """Both moved, and solved to the last digit alike."""
    drive = cj.drives.Trapezoid([0.0], [0.2], 40.0, 4e4)
    servo = playful_servo()
    (hip,) = servo.joints
    by_hand = cj.Mechanism(
        servo.bodies,
        (dataclasses.replace(hip, motion=cj.Motion(drive)),),
        points=servo.points,
        gravity=servo.gravity,
    )
    driven = servo.with_drives({"hip": drive})
    assert list(cj.parameters(driven)) == list(cj.parameters(by_hand))
    one, two = (cj.simulate(m, 0.01, rtol=1e-6) for m in (driven, by_hand))
    np.testing.assert_array_equal(one.final, two.final)
    assert float(one["hip"]) == pytest.approx(0.2, rel=1e-14)
    assert float(one.energy_residual) < 1e-4


def test_what_is_not_named_stays():
    crank = slider_crank()
    assert crank.with_drives({}) is not crank
    assert jax.tree.structure(crank.with_drives({})) == jax.tree.structure(crank)
    held = crank.with_drives({"main": cj.drives.Constant(0.3)})
    assert held.loops[0] is crank.loops[0]
    assert held.joints[1:] == crank.joints[1:]
    assert isinstance(drive_of(held, "main"), cj.drives.Constant)
    assert isinstance(drive_of(crank, "main"), cj.drives.ConstantSpeed)


@pytest.mark.slow
def test_a_held_crank_is_one_at_no_speed():
    crank = slider_crank()
    held, slow = (
        cj.simulate(crank.with_drives({"main": drive}), 1e-3, rtol=1e-6)
        for drive in (cj.drives.Constant(0.3), cj.drives.ConstantSpeed(0.0, 0.3))
    )
    np.testing.assert_allclose(held.final, slow.final, rtol=1e-12, atol=1e-12)
    assert float(held["main"]) == 0.3
    assert held["main.drive_force"].shape == ()


@pytest.mark.parametrize(
    ("drives", "about"),
    [
        ({"hpi": cj.drives.Constant(0.0)}, ("hpi", "hpi", "hip")),
        ({"hip.play_x": cj.drives.Constant(0.0)}, ("hip.play_x", "hip.play_x", "hip")),
        ({"hip": 1.0}, ("hip", 1.0)),
    ],
)
def test_what_cannot_be_driven_is_refused(drives, about):
    with refused(*about):
        playful_servo().with_drives(drives)


def test_a_joint_that_closes_a_loop_is_not_driven():
    with refused("wrist"):
        slider_crank().with_drives({"wrist": cj.drives.Constant(0.0)})


def drill() -> cj.Mechanism:
    """A drill on a ball: a slide and a turn about one axis, in space."""
    drilling = cj.Cylindrical(
        "drill",
        "head",
        "bit",
        slide=cj.Motion(actuators=(cj.actuators.ConstantEffort(-3.0),), limits=cj.Limits(0.0, 0.2)),
        orientation=cj.Orientation(0.3, -0.2, 0.1),
    )
    bodies = cj.Body("head", 2.0, (0.02, 0.03, 0.04)), cj.Body("bit", 0.5, (2e-3, 2e-3, 1e-3))
    return cj.Mechanism(bodies, (cj.Spherical("ball", "ground", "head"), drilling), gravity=cj.Gravity(z=-9.81))


def test_each_coordinate_of_a_joint_is_driven_by_its_own_name():
    feed, turn = cj.drives.Trapezoid([0.0], [0.1], 1.0, 10.0), cj.drives.ConstantSpeed(100.0)
    driven = drill().with_drives({"drill.slide": feed, "drill.turn": turn})
    joint: Any = driven.joint("drill")
    assert joint.slide.limits == cj.Limits(0.0, 0.2)
    assert joint.slide.actuators == ()
    assert [c.name for c in driven.free_coordinates()] == ["ball"]
    solution = cj.simulate(driven, 0.15, rtol=1e-9)
    assert float(solution.energy_residual) < 1e-8
    np.testing.assert_allclose([solution["drill.slide"], solution["drill.turn"]], [0.0875, 15.0], rtol=1e-13)


def test_an_orientation_in_space_is_not_driven():
    with refused("ball", allowed="drill.turn"):
        drill().with_drives({"ball": cj.drives.Constant(0.0)})


def test_columns_are_coordinates(tmp_path):
    text = GOOD.replace("slide", "drill.slide").replace("hinge", "drill.turn")
    drives = cj.read_trajectory(written(tmp_path, text), drill())
    assert {c.name for c in drill().with_drives(drives).coordinates() if not c.motion.is_free} == set(drives)
    with refused("drill.slide", "deg"):
        cj.read_trajectory(written(tmp_path, text.replace("[mm]", "[deg]")), drill())


# Files ---------------------------------------------------------------------------------------------------------------

GOOD = """# logged by the controller
time [ms], slide [mm], hinge [deg]
0, 0, 10
100, 20, 20

200, 15, 5
400, -5, 0
"""


def written(tmp_path, text):
    path = tmp_path / "moves.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def carriage() -> cj.Mechanism:
    """A pendulum on a carriage."""
    joints = (cj.Prismatic("slide", "ground", "carriage"), cj.Revolute("hinge", "carriage", "bob"))
    return cj.Mechanism((cj.Body("carriage", 1.0), cj.Body("bob", 1.0, 0.1)), joints)


SPOKEN = {
    "as it is": GOOD,
    "byte order mark": b"\xef\xbb\xbf" + GOOD.encode(),
    "lines of Windows": GOOD.replace("\n", "\r\n"),
    "quoted": GOOD.replace("slide [mm]", '"slide [mm]"').replace(", 5\n", ', "5"\n'),
    "Time": GOOD.replace("time", " TIME"),
    "SI": "hinge,slide,time\n" + "\n".join(f"{h * np.pi / 180},{s / 1000},{t}" for t, s, h in
        [(0.0, 0, 10), (0.1, 20, 20), (0.2, 15, 5), (0.4, -5, 0)]),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOKEN)
def test_a_trajectory_is_read(name, tmp_path):
    path = written(tmp_path, SPOKEN[name])
    for mechanism in (carriage(), None):
        drives = cj.read_trajectory(path, mechanism, "natural")
        assert set(drives) == {"slide", "hinge"}
        assert all(drive.ends == "natural" for drive in drives.values())
        for drive in drives.values():
            np.testing.assert_allclose(drive.times, [0.0, 0.1, 0.2, 0.4], rtol=1e-15)
        np.testing.assert_allclose(drives["slide"].values, [0.0, 0.02, 0.015, -0.005], rtol=1e-15)
        np.testing.assert_allclose(drives["hinge"].values, np.deg2rad([10, 20, 5, 0]), rtol=1e-15)


def test_what_is_read_drives(tmp_path):
    driven = carriage().with_drives(cj.read_trajectory(written(tmp_path, GOOD), carriage()))
    solution = cj.simulate(driven, 0.4, save_at=jnp.array([0.0, 0.1, 0.2, 0.4]))
    np.testing.assert_allclose(solution["slide"], [0.0, 0.02, 0.015, -0.005], rtol=0, atol=1e-15)
    np.testing.assert_allclose(solution["hinge"], np.deg2rad([10, 20, 5, 0]), rtol=0, atol=1e-15)


LINE = GOOD.splitlines()
REFUSED = {
    "empty": ("", "moves.csv` is empty"),
    "comments only": ("# nothing\n\n", "moves.csv` is empty"),
    "binary": (b"time,slide\0\1\2\n", "binary data"),
    "UTF-16": (GOOD.encode("utf-16"), "not a text in UTF-8"),
    "no header": ("0,1\n1,2\n", "line 1 must be a header"),
    "no time": (GOOD.replace("time [ms]", "t"), "line 2: no column is called `time`"),
    "no joint": ("time\n0\n1\n2\n3\n", "line 1: the header has no joint beside `time`"),
    "semicolons": (GOOD.replace(",", ";"), "line 2: columns are separated by ';'"),
    "tabs": (GOOD.replace(",", "\t"), "line 2: columns are separated by"),
    "decimal commas": (GOOD.replace("20, 20", "20,5, 20,5"), "line 4 has 5 cells, .* 3 columns. Are there decimal"),
    "ragged": (GOOD.replace("15, 5", "15"), "line 6 has 2 cells, but the header has 3 columns"),
    "twice": (GOOD.replace("slide [mm]", "hinge"), "line 2, column 3: `hinge` has a column already"),
    "nameless": (GOOD.replace("hinge [deg]", "").replace("slide", "hinge"), "line 2, column 3 has no name"),
    "unknown": (GOOD.replace("hinge", "hnge"), "no coordinate `hnge` to drive. Did you mean `hinge`"),
    "wrong unit": (GOOD.replace("[deg]", "[mm]"), "column 3: `hinge` must be in a unit of angle, not in 'mm'"),
    "unit of time": (GOOD.replace("[ms]", "[mm]"), "column 1: `time` must be in a unit of time, not in 'mm'"),
    "no such unit": (GOOD.replace("[mm]", "[foo]"), "column 2: `slide` must be in a unit of length, not in 'foo'"),
    "brackets": (GOOD.replace("[mm]", "[mm"), "column 2 must be a name with a unit in brackets"),
    "not a number": (GOOD.replace("15", "abc"), "line 6, column `slide` must be a number, but it is 'abc'"),
    "nothing": (GOOD.replace("15", ""), "line 6, column `slide` must be a number, but nothing is there"),
    "underscore": (GOOD.replace("15", "1_5"), "line 6, column `slide` must be a number"),
    "nan": (GOOD.replace("15", "nan"), "line 6, column `slide` must be finite, but it is 'nan'"),
    "infinite": (GOOD.replace("200", "1e999"), "line 6, column `time` must be finite"),
    "stays": (GOOD.replace("200", "100"), "line 6, column `time`: times must increase, but 0.1 s follows 0.1 s"),
    "few": ("\n".join(LINE[:6]), "moves.csv` has 3 rows of numbers, but a spline needs 4"),
    "huge numbers": (GOOD.replace("15", "1e308"), "column `slide`: its numbers are too large"),
    "open quote": (GOOD.replace("15", '"15'), "line 6: its cells cannot be told apart"),
    "endless line": ("time," + "x" * 200_000, "line 1 is longer than 100000 characters"),
    "many rows": ("time,slide\n" + "0,0\n" * 100_001, "has 100001 rows, but at most 100000 are read"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_file_is_refused(name, tmp_path):
    text, words = REFUSED[name]
    with pytest.raises(cj.ClearanceError, match=words) as refused:
        cj.read_trajectory(written(tmp_path, text), carriage())
    assert "moves.csv" in str(refused.value)


def test_what_is_no_file_is_refused(tmp_path, monkeypatch):
    for path in (tmp_path, tmp_path / "missing.csv", "/dev/zero", "a\0b"):
        with pytest.raises(cj.ClearanceError, match="Cannot read the trajectory"):
            cj.read_trajectory(path)
    monkeypatch.setattr("clearance_jax.io.files.LARGEST_TABLE", 20)
    with pytest.raises(cj.ClearanceError, match="larger than"):
        cj.read_trajectory(written(tmp_path, GOOD))


def test_spoiled_files_load_or_are_refused_by_a_sentence(tmp_path):
    ends = collections.Counter()
    for seed in range(200):
        end, _ = fuzz.tried(fuzz.Case("trajectory", trajectory(random.Random(seed))), tmp_path)
        ends[end] += 1
    assert min(ends["loaded"], ends["refused"]) > 20


# Scenes --------------------------------------------------------------------------------------------------------------


def arm(tmp_path, drive):
    """The shipped arm, driven otherwise."""
    text = (SCENES / "arm.toml").read_text(encoding="utf-8")
    path = tmp_path / "arm.toml"
    path.write_text(re.sub(r"(?m)^drive = .*$", f"drive = {drive}", text), encoding="utf-8")
    return path


@pytest.fixture
def command(monkeypatch, capsys):
    """What `clearance` ends with, and says, called with words."""

    def run(*words):
        monkeypatch.setattr("sys.argv", ["clearance", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return ended.value.code or 0, " ".join((said.out + said.err).split())

    return run


ARM = SCENES / "arm.toml"


def test_the_command_follows_a_trajectory(command, tmp_path):
    """To the end of the scene, or where it has none to that of the trajectory."""
    path, scene = tmp_path / "lift.csv", tmp_path / "endless.toml"
    path.write_text("time [ms], hip [deg]\n0, 0\n2, 1\n4, 4\n6, 9\n")
    scene.write_text(re.sub(r"(?m)^solve.t1.*$", "", ARM.read_text()))
    out = tmp_path / "o.nc"
    short = "--ideal", "--samples", 7, "--rtol", "1e-6"
    code, said = command("simulate", scene, "--trajectory", path, "-o", out, *short)
    assert code == 0, said
    dataset = cj.load_dataset(out)
    np.testing.assert_allclose(dataset["time"], np.arange(7) * 1e-3, rtol=1e-12, atol=1e-18)
    # These are squares, which a cubic spline is through exactly.
    np.testing.assert_allclose(dataset["q"].sel(coordinate="hip"), np.deg2rad(np.arange(7) ** 2 / 4), rtol=1e-9)
    assert dataset.attrs["trajectory"] == str(path)
    assert "at t = 0.003 s" in command("simulate", scene, "--trajectory", path, "--t1", "3ms", *short)[1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--trajectory", LIFT, "--t1", "0.2s"], "t1 is 0.2 s, but the trajectory `.*arm_lift.csv` ends at 0.1 s"),
        (["--trajectory", "late.csv"], "t0 is 0 s, but the trajectory `late.csv` begins at 0.01 s"),
        (["--trajectory", "short.csv"], "t1 is 0.1 s, but the trajectory `short.csv` ends at 0.04 s"),
        (["--trajectory", "other.csv"], "column 2: there is no coordinate `knee` to drive"),
        (["--trajectory", LIFT, "--set", "drive.hip.amplitude=1deg"], "no parameter `drive.hip.amplitude`"),
        (["--trajectory", "o.nc", "-o", "o.nc"], "The trajectory and the output are the same file `o.nc`"),
    ],
)
def test_what_a_trajectory_does_not_cover_is_refused(words, said, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, joint, first in (("late", "hip", 10), ("short", "hip", 0), ("other", "knee", 0), ("o", "hip", 0)):
        rows = "".join(f"{first + 10 * i}, {i}\n" for i in range(20 if name == "late" else 5))
        Path("o.nc" if name == "o" else f"{name}.csv").write_text(f"time [ms], {joint} [deg]\n{rows}")
    code, found = command("simulate", ARM, *words)
    assert code == 2
    assert re.search(said, found), found


def test_a_scene_is_driven_from_point_to_point(tmp_path):
    drive = '{ type = "trapezoid", begin = ["0 s", "1 s"], rise = ["90 deg", "-30 deg"], speed = "30 rpm", %s }'
    path = arm(tmp_path, drive % 'acceleration = "720 deg/s^2"')
    found = drive_of(cj.load(path), "hip")
    np.testing.assert_allclose(found.breaks()[:4], [0.0, 0.25, 0.5, 0.75], rtol=1e-14)
    path = arm(tmp_path, drive % 'acceleration = "720 1/s^2"')
    with refused("joint.hip.drive.acceleration", "720 1/s^2"):
        cj.load(path)
