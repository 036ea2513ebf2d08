"""Postures and paths: against closed forms of arms and of a Delta robot, and the tolerance that was asked for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.spatial.transform import Rotation
from spatial import arm, delta, platform

import clearance_jax as cj
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.postures.chain import chain_of
from clearance_jax.dynamics.postures.follow import _run
from clearance_jax.mechanism.state import State
from clearance_jax.spatial import IDENTITY, rotation_between

UPPER, FORE = 0.4, 0.3


def two_links(elbow=cj.Limits(), drives=(None, None)):
    """An arm of two links in the plane; its elbow starts bent to the left."""
    shoulder, other = cj.Motion(drives[0]), cj.Motion(drives[1], position=0.5, limits=elbow)
    joints = (
        cj.Revolute("shoulder", "ground", "upper", motion=shoulder),
        cj.Revolute("elbow", "upper", "fore", cj.Position(UPPER), motion=other),
    )
    bodies = cj.Body("upper", 1.0, 0.1), cj.Body("fore", 1.0, 0.1)
    return cj.Mechanism(bodies, joints, points=(cj.Point("tip", "fore", cj.Position(FORE)),))


def two_angles(x, y):
    """Its angles by the law of cosines, the elbow bent to the left."""
    elbow = np.arccos((x**2 + y**2 - UPPER**2 - FORE**2) / (2 * UPPER * FORE))
    return np.arctan2(y, x) - np.arctan2(FORE * np.sin(elbow), UPPER + FORE * np.cos(elbow)), elbow


def two_tip(shoulder, elbow):
    whole = shoulder + elbow
    x = UPPER * np.cos(shoulder) + FORE * np.cos(whole)
    return np.stack([x, UPPER * np.sin(shoulder) + FORE * np.sin(whole)], -1)


def framed(n, seed=1):
    """An arm of n turns in space with a frame at its end."""
    plain = arm(n, seed=seed)
    tip = cj.Point("tip", f"link{n - 1}", cj.Position(0.1, 0.2, 0.3), cj.Orientation(0.1, 0.2, 0.3))
    return cj.Mechanism(plain.bodies, plain.joints, points=(tip,), gravity=plain.gravity)


def forward(mechanism, q):
    """Place and matrix of the frame at the end of an arm, by the kinematics of its free coordinates."""
    free = chain_of(mechanism, "tip", None).mechanism.prepare()
    point = mechanism.points[0]
    at = frames(free, jnp.zeros(()), State(tuple(jnp.asarray(q)), (0.0,) * len(q), {}))[point.body]
    turned = at.rotate(point.orientation.rotation).rotation
    return jnp.stack(at.point(point.at.vector)), jnp.stack([jnp.stack(row) for row in turned.rows])


def pose_of(place, matrix):
    yaw, pitch, roll = Rotation.from_matrix(np.asarray(matrix)).as_euler("ZYX")
    return cj.Pose(place, cj.Orientation(roll, pitch, yaw))


def along(drive, times):
    """A drive's values, by its own evaluation."""
    ready = drive.prepare()
    return np.asarray(jax.vmap(lambda t: jnp.asarray(ready(t)[0]))(jnp.asarray(times)))


@pytest.mark.parametrize("angle", [1e-9, 0.3, 2.9, np.pi - 1e-9, np.pi])
def test_rotation_vectors_are_exact(angle):
    """From one orientation to another, by tiny turns and by half turns; and differentiable where there is none."""
    first, axis = Rotation.from_euler("xyz", [0.3, -0.8, 2.0]), np.array([2.0, -1.0, 2.0]) / 3

    def rotation(turn):
        rows = turn.as_matrix() if isinstance(turn, Rotation) else turn
        return IDENTITY.compose(tuple(tuple(jnp.asarray(term) for term in row) for row in rows))

    second = Rotation.from_rotvec(angle * axis) * first
    found = np.array(rotation_between(rotation(first), rotation(second)))
    found = found * np.sign(found @ axis)  # of half a turn either sign is right
    np.testing.assert_allclose(found, angle * axis, rtol=0, atol=4e-15)
    still = first.as_matrix()
    slope = jax.jacfwd(lambda rows: jnp.stack(rotation_between(rotation(first), rotation(rows))))(jnp.asarray(still))
    rate = np.einsum("ijk,jk->i", slope, _hat([0.1, 0.2, 0.3]) @ still)
    np.testing.assert_allclose(rate, [0.1, 0.2, 0.3], atol=1e-14)


def _hat(spin):
    x, y, z = spin
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


# Postures -------------------------------------------------------------------------------------------------------------


def test_two_links_stand_as_the_law_of_cosines_says():
    """Many poses by one program, driven joints alike, and from another posture."""
    mechanism = two_links(drives=(cj.drives.Constant(0.1), cj.drives.Constant(0.7)))
    angle, radius = np.meshgrid(np.linspace(-1.0, 1.5, 7), np.linspace(0.2, 0.68, 5))
    x, y = (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()
    traced = []

    def once(x, y):
        traced.append(1)
        found = cj.inverse_kinematics(mechanism, "tip", cj.Pose((x, y)))
        return found.coordinates["shoulder"], found.coordinates["elbow"], found.distance

    *found, distance = jax.vmap(once)(jnp.asarray(x), jnp.asarray(y))
    np.testing.assert_allclose(found, two_angles(x, y), rtol=0, atol=1e-12)
    assert float(jnp.max(distance)) < 1e-13
    assert len(traced) == 1
    first = cj.inverse_kinematics(mechanism, "tip", cj.Pose((0.5, 0.2)))
    again = cj.inverse_kinematics(mechanism, "tip", cj.Pose((0.5, 0.2)), start=first)
    assert int(again.iterations) < int(first.iterations) <= 8
    # From a start bent to the right it bends to the right.
    right = cj.inverse_kinematics(mechanism, "tip", cj.Pose((0.5, 0.2)), start={"elbow": -0.5})
    assert float(right.coordinates["elbow"]) == pytest.approx(-float(first.coordinates["elbow"]), abs=1e-12)


def test_derivatives_are_those_of_the_closed_form():
    def elbow(upper, x):
        mechanism = cj.replace(two_links(), {"elbow.at_parent.x": upper})
        return cj.inverse_kinematics(mechanism, "tip", cj.Pose((x, jnp.asarray(0.2)))).coordinates["elbow"]

    def closed(upper, x):
        return jnp.arccos((x**2 + 0.2**2 - upper**2 - FORE**2) / (2 * upper * FORE))

    at = jnp.asarray(UPPER), jnp.asarray(0.5)
    wanted = jax.grad(closed, (0, 1))(*at)
    np.testing.assert_allclose(jax.grad(elbow, (0, 1))(*at), wanted, rtol=1e-11)
    np.testing.assert_allclose(jax.jacfwd(elbow, (0, 1))(*at), wanted, rtol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("n", [6, 9])
def test_frames_of_arms_are_brought_to_random_poses(n):
    """A pose that some posture has is found from another one nearby, to round-off; with joints to spare too."""
    mechanism, rng = framed(n), np.random.default_rng(0)
    home = rng.normal(size=n)
    for _ in range(5):
        place, matrix = forward(mechanism, home + 0.4 * rng.normal(size=n))
        start = {f"joint{i}": value for i, value in enumerate(home)}
        found = cj.inverse_kinematics(mechanism, "tip", pose_of(place, matrix), start=start)
        at, turned = forward(mechanism, [found.coordinates[f"joint{i}"] for i in range(n)])
        np.testing.assert_allclose(at, place, rtol=0, atol=1e-12)
        np.testing.assert_allclose(turned, matrix, rtol=0, atol=1e-12)


def test_a_posture_is_found_from_anywhere():
    """Where the mechanism's own start leads nowhere: the far side of a joint's limits, and half a turn away."""
    mechanism = two_links(cj.Limits(-2.5, -0.2))
    found = cj.inverse_kinematics(mechanism, "tip", cj.Pose((-0.5, -0.2)))
    values = [float(found.coordinates[name]) for name in ("shoulder", "elbow")]
    assert -2.5 <= values[1] <= -0.2
    np.testing.assert_allclose(two_tip(*values), [-0.5, -0.2], atol=1e-12)
    one = cj.Mechanism(
        (cj.Body("link", 1.0, 0.1),), (cj.Revolute("pin", "ground", "link"),), points=(cj.Point("tip", "link"),)
    )
    turned = cj.inverse_kinematics(one, "tip", cj.Pose((0.0, 0.0), cj.Orientation(yaw=np.pi)))
    assert abs(float(turned.coordinates["pin"])) == pytest.approx(np.pi, abs=1e-12)


def test_a_delta_stands_as_its_spheres_say():
    """Closed loops: its motors are sought, what is passive follows."""
    mechanism = delta([cj.drives.Constant(value) for value in (0.1, 0.2, 0.3)])
    angles = np.array([0.35, 0.15, 0.25])
    found = cj.inverse_kinematics(mechanism, "centre", cj.Pose(platform(angles)))
    assert list(found.coordinates) == ["motor0", "motor1", "motor2"]
    np.testing.assert_allclose([float(x) for x in found.coordinates.values()], angles, rtol=0, atol=1e-12)


REFUSED = {
    "reach": (lambda: two_links(), (0.9, 0.2), None, r"221\.954\d? mm off\. .* singular, .* along \(0\.976, 0\.217\)"),
    "limit": (lambda: two_links(cj.Limits(-1.0, 1.2)), (0.1, 0.3), None, r"`elbow` is at its upper limit, 1\.2 rad"),
    "pose": (lambda: two_links(), (0.5, 0.2), cj.Orientation(yaw=2.0), "2 coordinates is asked for 3 numbers"),
    "plane": (lambda: two_links(), (0.5, 0.2, 0.1), None, "must have no z"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_poses_out_of_reach_are_refused(case):
    make, place, orientation, words = REFUSED[case]
    if case == "reach":  # by the distance from the circle of the stretched arm
        assert np.hypot(0.9, 0.2) - UPPER - FORE == pytest.approx(0.221954, abs=1e-6)
        words = words.replace(r"221\.954\d?", "222")
    with pytest.raises(cj.ClearanceError, match=words):
        cj.inverse_kinematics(make(), "tip", cj.Pose(place, orientation))


def test_unknown_names_are_refused():
    for changes, name, allowed in (
        ({"point": "top"}, "top", "tip"),
        ({"joints": ["elbo"]}, "elbo", "elbow"),
        ({"start": {"hip": 0.1}}, "hip", "elbow"),
    ):
        given = {"point": "tip"} | changes
        with refused(name, allowed=allowed):
            cj.inverse_kinematics(two_links(), given.pop("point"), cj.Pose((0.5, 0.2)), **given)


def test_what_may_be_prescribed_in_closed_loops_is_said():
    free = delta([cj.drives.Constant(0.1)] * 3).without_drives([f"motor{i}" for i in range(3)])
    words = r"none has a drive\. Name in `joints` .*, of these: .*`motor0`.*`motor1`.*`motor2`"
    with pytest.raises(cj.ClearanceError, match=words):
        cj.inverse_kinematics(free, "centre", cj.Pose((0.0, 0.0, -0.5)))
    with refused("tip"):
        cj.inverse_kinematics(two_links(), "tip", cj.Pose((0.5, 0.2)), joints=[])


# Paths ----------------------------------------------------------------------------------------------------------------


def round_trip(**profile):
    segments = [
        cj.paths.Line(cj.Pose((1.0, 0.0, 0.0), cj.Orientation(roll=0.5))),
        cj.paths.Arc((1.5, 0.5, 0.0), cj.Pose((1.0, 1.0, 0.0))),
        cj.paths.Curve(
            [
                cj.Pose((1.0, 1.0, 1.0), cj.Orientation(pitch=0.3)),
                cj.Pose((0.0, 1.0, 1.0)),
                cj.Pose((0.0, 0.0, 1.0), cj.Orientation(yaw=1.0)),
            ]
        ),
    ]
    return cj.paths.CartesianPath(cj.Pose((0.0, 0.0, 0.0), cj.Orientation(yaw=0.1)), segments, **profile)


def test_a_path_is_what_its_segments_are():
    path = round_trip(durations=[1.0, 2.0, 3.0], begin=0.5)
    at = jax.jit(jax.vmap(path.prepare()))
    line, arc = at(jnp.linspace(0.5, 1.5, 9)), at(jnp.linspace(1.5, 3.5, 9))
    np.testing.assert_allclose(np.asarray(line.position)[:, 1:], 0, atol=1e-15)
    # Of a line the rotation is about one axis, by an angle that grows as the way does.
    off = Rotation.from_matrix(np.asarray(line.rotation)) * Rotation.from_euler("Z", 0.1).inv()
    turn = (Rotation.from_euler("X", 0.5) * Rotation.from_euler("Z", 0.1).inv()).as_rotvec()
    np.testing.assert_allclose(off.as_rotvec(), np.asarray(line.position)[:, :1] * turn, atol=1e-14)
    radius = np.linalg.norm(np.asarray(arc.position) - [1.0, 0.5, 0.0], axis=1)
    np.testing.assert_allclose(radius, 0.5, atol=1e-14)
    assert float(arc.position[4, 0]) == pytest.approx(1.5)
    # A curve meets its poses at its breaks, one that says nothing of how it is turned as the pose before.
    breaks = np.asarray(path.breaks())
    assert breaks[[0, 1, 2, -1]].tolist() == [0.5, 1.5, 3.5, 6.5]
    met = at(jnp.asarray(breaks[3:]))
    np.testing.assert_allclose(met.position, [[1, 1, 1], [0, 1, 1], [0, 0, 1]], atol=1e-12)
    turned = Rotation.from_matrix(np.asarray(met.rotation)).as_euler("XYZ")
    np.testing.assert_allclose(turned, [[0, 0.3, 0], [0, 0.3, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("profile", [{"durations": [1.0, 2.0, 3.0]}, {"speed": 1.0, "acceleration": 4.0}])
def test_rates_of_a_path_are_its_derivatives(profile):
    path = round_trip(**profile)
    at, h = jax.jit(jax.vmap(path.prepare())), 1e-5
    times = np.linspace(0.013, float(path.end) - 0.013, 77)
    times = jnp.asarray(times[np.min(np.abs(times[:, None] - np.asarray(path.breaks())), axis=1) > 2 * h])
    now, before, after = at(times), at(times - h), at(times + h)
    for value, rate in (("position", "velocity"), ("velocity", "acceleration"), ("spin", "spin_rate")):
        slope = (getattr(after, value) - getattr(before, value)) / (2 * h)
        np.testing.assert_allclose(slope, getattr(now, rate), rtol=0, atol=2e-8)
    turning = Rotation.from_matrix(np.asarray(after.rotation)) * Rotation.from_matrix(np.asarray(before.rotation)).inv()
    np.testing.assert_allclose(turning.as_rotvec() / (2 * h), now.spin, rtol=0, atol=2e-8)
    if "speed" in profile:  # lines and arcs keep their limits
        early = np.asarray(times) < float(path.breaks()[8])
        speeds = np.linalg.norm(np.asarray(now.velocity)[early], axis=1)
        assert np.max(speeds) == pytest.approx(1.0, abs=1e-12)


BAD_PATHS = {
    "Segment 1 of the path, Arc: its begin": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Arc((1.0, 0.0), cj.Pose((2.0, 0.0)))], durations=[1.0]
    ),
    "Segment 1 of the path, Curve: it needs two": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Curve([cj.Pose((2.0, 0.0))])], durations=[1.0]
    ),
    "stays at its place": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Line(cj.Pose((0.0, 0.0)))], speed=1.0, acceleration=1.0
    ),
    "needs `durations`": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Line(cj.Pose((1.0, 0.0)))], speed=1.0
    ),
    "one number for each of its 1": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Line(cj.Pose((1.0, 0.0)))], durations=[1.0, 2.0]
    ),
    "its `start` has none": lambda: cj.paths.CartesianPath(
        cj.Pose((0.0, 0.0)), [cj.paths.Line(cj.Pose((1.0, 0.0), cj.Orientation(yaw=1.0)))], durations=[1.0]
    ),
}


@pytest.mark.parametrize("words", BAD_PATHS)
def test_paths_that_there_are_not_are_refused(words):
    with pytest.raises(cj.ClearanceError, match=words):
        BAD_PATHS[words]()


# Following ------------------------------------------------------------------------------------------------------------


def corner(**profile):
    segments = [cj.paths.Line(cj.Pose((0.3, 0.4))), cj.paths.Arc((0.2, 0.5), cj.Pose((0.1, 0.4)))]
    return cj.paths.CartesianPath(cj.Pose((0.5, 0.2)), segments, **profile)


@pytest.mark.parametrize("profile", [{"durations": [1.0, 1.5]}, {"speed": 0.4, "acceleration": 2.0}])
def test_a_tip_stays_as_near_to_its_path_as_asked(profile):
    """By the arm's own formula, everywhere; with accelerations that jump, and that do not."""
    path = corner(**profile)
    times = np.linspace(0, float(path.end), 2001)
    wanted = np.asarray(jax.vmap(path.prepare())(jnp.asarray(times)).position)[:, :2]
    for tolerance in (1e-5, 1e-8):
        drives = cj.follow(two_links(), "tip", path, tolerance=tolerance)
        angles = along(drives["shoulder"], times), along(drives["elbow"], times)
        off = np.max(np.linalg.norm(two_tip(*angles) - wanted, axis=1))
        assert off < tolerance
        assert drives.deviation == pytest.approx(off, rel=0.1)
        assert (drives["elbow"].jumps is None) == ("durations" in profile)
        np.testing.assert_allclose(angles, two_angles(*wanted.T), atol=20 * tolerance)


@pytest.mark.slow
def test_the_error_falls_with_the_sixth_power():
    """Of an arm with a joint to spare too, whose joints the path does not determine."""
    mechanism = framed(7)
    home = 0.3 * (-1.0) ** np.arange(7)
    start, end = (pose_of(*forward(mechanism, q)) for q in (home, home + 0.3 * np.cos(np.arange(7))))
    path = cj.paths.CartesianPath(start, [cj.paths.Line(end)], durations=[1.0]).prepare()
    chain = chain_of(mechanism, "tip", None)
    # In the middle of the path: where it begins and ends, and the path's own derivatives change most, later.
    runs = [_run(chain, path, np.linspace(0, 1, n + 1), jnp.asarray(home)) for n in (8, 16, 32)]
    errors = [np.max(run.deviation[len(run.deviation) // 2]) for run in runs]
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 6.0, atol=0.15)


@pytest.mark.slow
def test_a_robot_moves_as_its_path_says(tmp_path):
    """Simulated under its drives: places and orientations; and its drives by way of a file."""
    robot = cj.load_urdf("experiments/scenes/six_axes.urdf", end_effector="tcp")
    turned = cj.Orientation(0.1, 1.5, 0.3)
    there = cj.Pose((0.5, 0.1, 0.6), cj.Orientation(0.1, 1.4, 0.4))
    path = cj.paths.CartesianPath(cj.Pose((0.5, 0.2, 0.5), turned), [cj.paths.Line(there)], durations=[1.0])
    drives = cj.follow(robot, "tcp", path)
    assert list(drives) == [f"axis_{i}" for i in range(1, 7)]
    assert max(drives.deviation, drives.angle) < 1e-6
    fingers = {"finger_left": cj.drives.Constant(0.02), "finger_right": cj.drives.Constant(0.02)}
    driven = robot.with_drives(drives | fingers)
    assert "drive.axis_1.values" in cj.parameters(driven)
    solution = cj.simulate(driven, 1.0, save_at=21)
    wanted = jax.vmap(path.prepare())(solution.time)
    off = np.linalg.norm(np.asarray(solution["tcp.position"]) - np.asarray(wanted.position), axis=1)
    assert np.max(off) < 1e-6
    file = tmp_path / "line.csv"
    cj.write_trajectory(file, drives, 1.0, samples=401)
    for name, drive in cj.read_trajectory(file, robot, ends="clamped").items():
        np.testing.assert_allclose(along(drive, solution.time), along(drives[name], solution.time), atol=1e-8)


@pytest.mark.slow
def test_a_delta_follows_a_path():
    mechanism = delta([cj.drives.Constant(value) for value in (0.1, 0.2, 0.3)])
    begin = platform(np.array([0.35, 0.15, 0.25]))
    path = cj.paths.CartesianPath(
        cj.Pose(begin), [cj.paths.Line(cj.Pose(np.add(begin, [0.05, 0.0, -0.05])))], durations=[0.3]
    )
    drives = cj.follow(mechanism, "centre", path)
    times = np.linspace(0, 0.3, 41)
    angles = np.stack([along(drives[f"motor{i}"], times) for i in range(3)], 1)
    wanted = np.asarray(jax.vmap(path.prepare())(jnp.asarray(times)).position)
    off = np.max(np.linalg.norm([platform(a) for a in angles] - wanted, axis=1))
    assert off < 1e-6
    assert drives.deviation == pytest.approx(off, rel=0.2)


def test_what_is_driven_otherwise_is_reckoned_with():
    """A cart that carries the arm away: the arm makes up for it, and its masses do not matter."""
    plain, speed = two_links(), 0.1
    cart = cj.Prismatic("rail", "ground", "cart", motion=cj.Motion(cj.drives.ConstantSpeed(speed)))
    shoulder = cj.Revolute("shoulder", "cart", "upper")
    mechanism = cj.Mechanism((cj.Body("cart"), *plain.bodies), (cart, shoulder, plain.joints[1]), points=plain.points)
    path = corner(durations=[1.0, 1.0])
    drives = cj.follow(mechanism, "tip", path, joints=["shoulder", "elbow"])
    times = np.linspace(0, 2, 501)
    wanted = np.asarray(jax.vmap(path.prepare())(jnp.asarray(times)).position)[:, :2]
    found = two_tip(along(drives["shoulder"], times), along(drives["elbow"], times))
    found[:, 0] += speed * times
    assert np.max(np.linalg.norm(found - wanted, axis=1)) < 1e-6


def test_jumps_of_a_quintic_are_where_it_says():
    times, jumps = np.array([0.0, 1.0, 2.5]), np.array([0.5, -2.0, 1.5])
    drive = cj.drives.Quintic(times, [0.0, 1.0, 0.5], [0.0, 0.3, 0.0], [0.5, 0.7, 0.0], jumps).prepare()
    after, before = (
        [[float(x) for x in drive.within(jnp.asarray(t), jnp.asarray(t + beside))] for t in times]
        for beside in (1e-3, -1e-3)
    )
    np.testing.assert_allclose(np.subtract(after, before)[:, :2], 0, atol=1e-13)
    np.testing.assert_allclose(np.subtract(after, before)[1, 2], jumps[1], atol=1e-12)
    with refused("accelerations"):
        cj.drives.Quintic(times, times, times, jumps=jumps)


def straight(begin, end, duration=1.0):
    return cj.paths.CartesianPath(cj.Pose(begin), [cj.paths.Line(cj.Pose(end))], durations=[duration])


ASTRAY = {
    "begin": (cj.Limits(), straight((0.9, 0.2), (0.5, 0.2)), r"\(0\.9, 0\.2\) m, where the path begins: .* 222 mm off"),
    # The arm of 0.7 m is stretched where x is the root of 0.49 - 0.04; at the end it is 222 mm too short.
    "reach": (
        cj.Limits(),
        straight((0.5, 0.2), (0.9, 0.2)),
        r"\(0\.670\d*, 0\.2\) m at 0\.46\d* s .* stretched .* 222 mm",
    ),
    "limit": (cj.Limits(-1.0, 1.8), straight((0.5, 0.2), (0.2, 0.2)), r"`elbow` is at its upper limit, 1\.8 rad"),
    "speed": (cj.Limits(velocity=2.0), straight((0.5, 0.2), (0.2, 0.2), 0.3), r"`elbow` would have to move at 5\.87"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ASTRAY)
def test_paths_that_no_posture_follows_are_refused(case):
    elbow, path, words = ASTRAY[case]
    with pytest.raises(cj.ClearanceError, match=words):
        cj.follow(two_links(elbow), "tip", path)


def test_paths_past_a_singular_posture_are_refused():
    """So near past the shoulder of an arm that can fold that the shoulder would turn half round at once."""
    equal = cj.replace(two_links(), {"tip.at.x": UPPER})
    with pytest.raises(cj.ClearanceError, match=r"singular posture at 0\.5\d* s .* `shoulder` would have to move at"):
        cj.follow(equal, "tip", straight((0.5, 1e-8), (-0.5, 1e-8)), tolerance=1e-9)
