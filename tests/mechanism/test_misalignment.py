"""Joints that are off: kinematics of misaligned arms by hand, errors against the ideal one, scatter and its figures."""

import itertools
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.design.asked.specification import scenarios_of
from clearance_jax.io.study.study import load_study

SCENES = Path(__file__).parents[2] / "experiments" / "scenes"
TIMES = np.array([0.0, 0.1, 0.25])
UPPER, FORE = 0.4, 0.3
MOVES = cj.drives.Harmonic(0.7, 9.0, 0.2), cj.drives.Harmonic(-0.5, 7.0, 0.4, 0.3)
NAMES = [
    f"{joint}_misalignment.{of}"
    for joint in ("shoulder", "elbow")
    for of in ("at_parent.x", "at_parent.y", "orientation.yaw")
]


@pytest.fixture(scope="module")
def arm():
    bodies = cj.Body("upper", 2.0, 0.03, cj.Position(0.2)), cj.Body("fore", 1.0, 0.01, cj.Position(0.1))
    joints = (
        cj.Revolute("shoulder", "ground", "upper", motion=cj.Motion(MOVES[0])),
        cj.Revolute("elbow", "upper", "fore", at_parent=cj.Position(UPPER), angle=0.2, motion=cj.Motion(MOVES[1])),
    )
    plain = cj.Mechanism(bodies, joints, points=(cj.Point("tip", "fore", cj.Position(FORE)),))
    return cj.with_misalignment(plain)


def turn(angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def tip_by_hand(time, off):
    """Frames one after the other: place, error, turn of the joint."""
    first, second = (float(move(jnp.asarray(time))[0]) for move in MOVES)
    x, y, yaw, u, v, tilt = off
    shoulder = turn(yaw + first)
    elbow = np.array([UPPER, 0]) + turn(0.2) @ [u, v]
    return np.array([x, y]) + shoulder @ (elbow + turn(0.2 + tilt + second) @ [FORE, 0])


def test_a_misaligned_arm_is_where_its_frames_are_by_hand(arm):
    off = [1e-3, -2e-3, 3e-3, 2e-3, 1e-3, -4e-3]
    moved = cj.replace(arm, dict(zip(NAMES, off, strict=True)))
    wanted = {
        "place": metrics.Function(lambda s: s["tip.position"], TIMES),
        "error": metrics.At(metrics.PositionError("tip"), TIMES),
        "angle": metrics.At(metrics.OrientationError("fore"), TIMES),
    }
    found = cj.measure(moved, wanted, 0.3)
    by_hand = np.array([tip_by_hand(t, off) for t in TIMES])
    np.testing.assert_allclose(found["place"][:, :2], by_hand, rtol=1e-12, atol=1e-14)
    meant = np.array([tip_by_hand(t, [0.0] * 6) for t in TIMES])
    np.testing.assert_allclose(found["error"], np.linalg.norm(by_hand - meant, axis=1), rtol=1e-9)
    np.testing.assert_allclose(found["angle"], 1e-3, rtol=1e-9)  # 3 - 4 mrad


def test_figures_of_iso_9283_of_a_scripted_arm(arm):
    """Arms as they are made: repeatability and accuracy of their poses by the definition, from places by hand."""
    rng = np.random.default_rng(9)
    offs = rng.normal(0, 1, (40, 6)) * [1e-4, 1e-4, 2e-4, 2e-4, 2e-4, 3e-4]
    place = metrics.Function(lambda s: s["tip.position"], TIMES)
    one = jax.jit(jax.vmap(lambda off: place(cj.replace(arm, dict(zip(NAMES, off, strict=True))), 0.3)))
    attained = np.asarray(one(jnp.asarray(offs)))
    last = np.array([tip_by_hand(TIMES[-1], off) for off in offs])
    commanded = tip_by_hand(TIMES[-1], [0.0] * 6)
    centre = sum(last) / 40
    distances = [math.dist(row, centre) for row in last]
    mean = sum(distances) / 40
    expected = mean + 3 * math.sqrt(sum((d - mean) ** 2 for d in distances) / 39)
    assert float(metrics.pose_repeatability(attained[:, -1])) == pytest.approx(expected, rel=1e-9)
    accuracy = metrics.pose_accuracy(attained[:, -1, :2], commanded)
    assert float(accuracy.total) == pytest.approx(math.dist(centre, commanded), rel=1e-9)


def test_turns_in_space_are_about_the_joints_own_axes():
    """The frame that is meant, then the error's place and its roll, pitch and yaw, then the joint's turn."""

    def rotation(axis, angle):
        c, s = math.cos(angle), math.sin(angle)
        return np.array(
            [
                [[1, 0, 0], [0, c, -s], [0, s, c]],
                [[c, 0, s], [0, 1, 0], [-s, 0, c]],
                [[c, -s, 0], [s, c, 0], [0, 0, 1]],
            ][axis]
        )

    angle, meant = 0.3, (0.4, -0.2, 0.7)
    body = cj.Body("link", 1.0, cj.Inertia(0.01, 0.02, 0.02), cj.Position(0.1))
    joint = cj.Revolute(
        "joint",
        "ground",
        "link",
        at_parent=cj.Position(0.1, 0.2, 0.3),
        orientation=cj.Orientation(*meant),
        axis="z",
        motion=cj.Motion(cj.drives.Constant(angle)),
    )
    plain = cj.Mechanism((body,), (joint,), points=(cj.Point("tip", "link", cj.Position(0.5, 0.1, 0.2)),))
    place, turns = np.array([1e-3, 2e-3, -1e-3]), (0.02, -0.01, 0.03)
    off = {f"joint_misalignment.at_parent.{x}": p for x, p in zip("xyz", place, strict=True)}
    off |= {f"joint_misalignment.orientation.{n}": t for n, t in zip(("roll", "pitch", "yaw"), turns, strict=True)}
    moved = cj.replace(cj.with_misalignment(plain), off)

    def rpy(roll, pitch, yaw):
        return rotation(2, yaw) @ rotation(1, pitch) @ rotation(0, roll)

    expected = np.array([0.1, 0.2, 0.3]) + rpy(*meant) @ (
        place + rpy(*turns) @ rotation(2, angle) @ np.array([0.5, 0.1, 0.2])
    )
    np.testing.assert_allclose(cj.simulate(moved, 0.01)["tip.position"].reshape(-1, 3)[-1], expected, rtol=1e-12)


def test_a_urdf_arms_links_and_zeros_have_names_with_units():
    arm = cj.with_misalignment(cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp"), ["axis_1", "axis_2"])
    known = cj.parameters(arm)
    for joint, at in itertools.product(("axis_1", "axis_2"), "xyz"):
        assert known[f"{joint}_misalignment.at_parent.{at}"].unit == "m"
    assert known["axis_2_misalignment.orientation.roll"].unit == "rad"
    with refused("axis_9"):
        cj.with_misalignment(arm, ["axis_9"])
    with refused("axis_1"):
        cj.with_misalignment(arm, ["axis_1"])


def test_a_yield_scatters_zeros_by_distributions(arm):
    limit = design.Limit(metrics.Peak(metrics.PositionError("tip")), 1e-3)
    scatter = {NAMES[2]: cj.scatter(0.0, 1e-3), "fore.mass": 0.05}
    made = design.Yield(scatter, target=0.9, samples=64)
    problem = design.ToleranceProblem(arm, 0.3, {"upper.mass": (1.0, 3.0)}, [limit], manufacture=made)
    drawn = np.array([float(one.values[NAMES[2]]) for one in scenarios_of(problem.specification)])
    masses = np.array([float(one.values["fore.mass"]) for one in scenarios_of(problem.specification)])
    assert abs(drawn.mean()) < 1e-4
    assert drawn.std() == pytest.approx(1e-3, rel=0.1)
    assert masses.std() == pytest.approx(0.05, rel=0.1)
    with refused("upper.mass"):
        design.Yield({"upper.mass": cj.scatter(2.0, 0.1)}).draws(("upper.mass",))
    with refused(NAMES[0], "wide"):
        design.Yield({NAMES[0]: "wide"}).check()


def test_a_study_misaligns_and_scatters_the_joints_of_its_scene(tmp_path):
    text = (SCENES / "arm.toml").read_text()
    (tmp_path / "arm.toml").write_text('misalignment = ["hip"]\n' + text)
    study = """
scene = "arm.toml"
[metric.tip]
kind = "peak"
signal = "position-error"
point = "tip"
[scatter."hip_misalignment.orientation.yaw"]
deviation = "0.02 deg"
[scatter."arm.mass"]
deviation = "2 percent"
[design.variable."hip.radial_clearance"]
lower = "10 um"
upper = "0.3 mm"
[design.limit.tip]
bound = "0.5 mm"
[design.manufacture]
kind = "yield"
"""
    path = tmp_path / "study.toml"
    path.write_text(study)
    asked = load_study(path).design
    assert asked is not None
    made = asked.problem.specification.manufacture
    assert isinstance(made, design.Yield)
    assert made.scatter["arm.mass"] == pytest.approx(0.02)
    assert made.scatter["hip_misalignment.orientation.yaw"].std() == pytest.approx(np.deg2rad(0.02))
    path.write_text(
        study.replace('"arm.mass"]\ndeviation = "2 percent"', '"hip.radial_clearance"]\ndeviation = "1 um"')
    )
    with refused("scatter.hip.radial_clearance"):
        load_study(path)
