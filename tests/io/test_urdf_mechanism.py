"""Mechanisms made of URDF files: against the file's own kinematics and energies, part by part, and as a user asks."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import energies, slope
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.errors import ClearanceError
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.mechanism import NotReadWarning
from clearance_jax.joints.checks import ImplausibleWarning
from clearance_jax.mechanism.state import layout
from tests import urdf_reference as reference
from tests.urdf_cases import ARM, AXIS, MASS, RIG, hinge, link, robot

GRAVITY = (0.4, -1.0, -9.0)


@pytest.fixture
def written(tmp_path):
    def write(text, name="robot.urdf"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def loaded(path, **options) -> Any:
    """A mechanism whose parts are what a test knows them to be."""
    return cj.load_urdf(path, **options)


def test_what_a_mechanism_is_made_of(written):
    arm = loaded(written(ARM))
    assert arm.name == "arm"
    assert [body.name for body in arm.bodies] == ["upper", "fore"]
    parts: Any = arm.joints
    shoulder, elbow = parts
    assert (shoulder.name, shoulder.parent, shoulder.child) == ("shoulder", "ground", "upper")
    assert [type(joint) for joint in parts] == [cj.Revolute, cj.Revolute]
    assert (shoulder.axis.letter, elbow.axis.letter) == ("z", "y")
    assert (shoulder.at_parent.x, shoulder.at_parent.y) == (None, None)
    assert float(shoulder.at_parent.z) == 0.3
    assert (shoulder.orientation.roll, shoulder.orientation.pitch) == (None, None)
    assert float(shoulder.orientation.yaw) == 0.5
    assert elbow.orientation is None
    assert shoulder.motion.limits == cj.Limits(-2, 2.5, 3, 40)
    damper, friction = shoulder.motion.actuators
    assert (float(damper.stiffness), float(damper.damping)) == (0, 0.5)
    assert isinstance(friction, cj.actuators.JointFriction)
    assert float(friction.effort) == 0.1
    assert elbow.motion.actuators == ()
    assert arm.bodies[1].center_of_mass == cj.Position()
    (tool,) = arm.points
    assert (tool.name, tool.body, tool.orientation) == ("tool", "fore", None)
    assert (float(tool.at.x), tool.at.y, float(tool.at.z)) == (0.3, None, 0.01)
    assert (arm.gravity.x, arm.gravity.y, float(arm.gravity.z)) == (None, None, -9.81)


LOOSE = """<robot name="loose"><link name="base"/>
<link name="disc"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="ball"><inertial><mass value="3"/>
<inertia ixx="0.2" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="floor" type="planar"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/>
<dynamics damping="0.4"/></joint>
<joint name="sky" type="floating"><parent link="base"/><child link="ball"/><dynamics damping="0.3"/></joint>
</robot>"""


def test_damping_of_planar_and_floating_joints_is_along_each_of_their_motions(written):
    """Speeds decay as exp(-d t / m), spins of even bodies as exp(-d t / I)."""
    m = loaded(written(LOOSE), gravity=(0, 0, 0))
    start = np.zeros(3 + 7 + 9)
    start[6] = 1.0
    start[10:] = [0.5, -0.2, 0.7, 0.3, 0.1, -0.4, 0.2, 0.5, -0.6]
    t = 0.4
    found = cj.simulate(m, t, y0=jnp.asarray(start), rtol=1e-9)
    rates = np.exp(-t * np.array([*[0.4 / 2] * 2, 0.4 / 0.1, *[0.3 / 3] * 3, *[0.3 / 0.2] * 3]))
    np.testing.assert_allclose(found.final[10:19], start[10:] * rates, rtol=1e-7)
    assert float(found.energy_residual) < 1e-8
    path = written(LOOSE.replace('damping="0.3"', 'friction="0.3"'))
    with pytest.raises(cj.ClearanceError, match="remove its friction"):
        loaded(path)


def test_friction_of_a_joint_slows_it_evenly(written):
    """A wheel under a constant friction: v = v0 - f t / I, while it turns far faster than the transition."""
    found = LOOSE.replace('type="planar"', 'type="continuous"').replace('damping="0.4"', 'friction="0.4"')
    m = loaded(written(found), gravity=(0, 0, 0))
    y0 = jnp.zeros(1 + 7 + 7).at[4].set(1.0).at[8].set(5.0)
    s = cj.simulate(m, 0.5, y0=y0, rtol=1e-9)
    assert float(s.final[8]) == pytest.approx(5.0 - 0.4 * 0.5 / 0.1, rel=1e-9)


def test_names_and_starts(written):
    rig = loaded(written(RIG), mimic="independent")
    assert [body.name for body in rig.bodies] == ["cart", "slide_1", "jaw_left", "jaw_right", "plate", "drone"]
    assert [joint.name for joint in rig.joints] == ["cart_joint", "lift", "grip", "follow", "table", "flight"]
    assert [type(joint) for joint in rig.joints[3:]] == [cj.Revolute, cj.Planar, cj.Free]
    assert rig.joints[0].axis.letter == "-x"
    assert rig.joints[1].axis.letter is None
    starts = {name: float(leaf.value) for name, leaf in cj.parameters(rig).items() if name.endswith(".position")}
    assert starts["cart_joint.position"] == 0.3
    assert starts["lift.position"] == starts["grip.position"] == 0
    assert [point.name for point in rig.points] == ["jaw_left_frame", "jaw_right_frame", "plate_frame", "drone_frame"]


@pytest.mark.parametrize(("lower", "upper", "start"), [(-1, 2, 0), (1, 2, 1.5), (-3, -1, -2), (0, 0.8, 0)])
def test_a_start_is_within_the_limits(lower, upper, start, written):
    text = ARM.replace('lower="-2" upper="2.5"', f'lower="{lower}" upper="{upper}"')
    assert float(loaded(written(text)).joints[0].motion.position) == start


def test_numbers_are_those_of_the_file(written):
    values = {name: leaf.value for name, leaf in cj.parameters(cj.load_urdf(written(ARM))).items()}
    expected = {
        "upper.mass": 2.5, "fore.mass": 1.5, "fore.inertia.xx": 0.02, "fore.inertia.yy": 0.03, "fore.inertia.zz": 0.04,
        "fore.inertia.xy": 0.001, "fore.inertia.xz": -0.002, "fore.inertia.yz": 0.003, "upper.center_of_mass.x": 0.1,
        "upper.center_of_mass.y": 0.02, "upper.center_of_mass.z": -0.03, "shoulder.at_parent.z": 0.3,
        "shoulder.orientation.yaw": 0.5, "elbow.at_parent.x": 0.4,
    }  # fmt: skip
    assert {name: float(values[name]) for name in expected} == expected


# Against the file --------------------------------------------------------------------------------------------------


def random_motion(mechanism, described, seed, step=1e-5):
    """A state, and the coordinates of the file's joints there, a little later and a little earlier."""
    rng, plan = np.random.default_rng(seed), layout(mechanism)
    at = dict(zip(plan.positions, rng.uniform(-1, 1, len(plan.positions)), strict=True))
    speed = dict(zip(plan.velocities, rng.uniform(-1, 1, plan.free), strict=True))
    for name in [name.removesuffix(".w") for name in at if name.endswith(".w")]:
        size = np.linalg.norm([at[f"{name}.{k}"] for k in "wxyz"])
        at |= {f"{name}.{k}": at[f"{name}.{k}"] / size for k in "wxyz"}
    names = {joint.name: joint for joint in mechanism.joints}

    def coordinates(time):
        out = {}
        for joint in described.joints:
            name = f"{joint.name}_joint" if f"{joint.name}_joint" in names else joint.name
            slides = [at[key] + time * speed[key] for key in at if key.startswith(f"{name}.slide")]
            if joint.kind == "floating":
                quaternion, spin = (
                    np.array([v[f"{name}.{k}"] for k in ks]) for v, ks in ((at, "wxyz"), (speed, "xyz"))
                )
                rate = np.linalg.norm(spin)
                out[joint.name] = slides, matrix(quaternion) @ reference.turned(spin / rate, time * rate)[:3, :3]
            elif joint.kind == "planar":
                across = np.array(names[name].axis.across, float)
                turn = at[f"{name}.turn"] + time * speed[f"{name}.turn"]
                out[joint.name] = np.array(slides) @ across, turn
            elif joint.kind != "fixed":
                out[joint.name] = at[name] + time * speed[name]
        return out

    y = jnp.array([*at.values(), *speed.values()])
    return y, (coordinates(0.0), coordinates(step), coordinates(-step)), step


def matrix(quaternion):
    w, v = quaternion[0], quaternion[1:]
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * skew


@pytest.mark.parametrize("text", [ARM, RIG, *(reference.tree(seed, 9, bare=0.0) for seed in (1, 2, 3))])
def test_energies_and_frames_are_those_of_the_file(text, written):
    path = written(text)
    _, described = read_urdf(path)
    every = [link.name for link in described.links]
    mechanism = cj.load_urdf(path, gravity=GRAVITY, mimic="independent", end_effector=every)
    assert len(mechanism.points) == len(every)
    ready = mechanism.prepare()

    @jax.jit
    def of(y):
        motion = frames(ready, jnp.zeros(()), layout(ready).split(y))
        poses = []
        for point in mechanism.points:
            frame = motion[point.body].move_origin(point.at.vector)
            turn = frame.rotation if point.orientation is None else frame.rotate(point.orientation.rotation).rotation
            poses.append(jnp.array([[*row, p] for row, p in zip(turn.rows, frame.position, strict=True)], float))
        return energies(jnp.zeros(()), y, ready), jnp.stack(poses)

    for seed in range(5):
        y, motion, step = random_motion(mechanism, described, seed)
        held, poses = of(y)
        kinetic, potential = reference.energies(described, *motion, step, GRAVITY)
        # The ground's own energy is none of the mechanism's.
        still = [link for link in described.links if mechanism.points[every.index(link.name)].body == "ground"]
        links = reference.poses(described.root, described.joints, motion[0])
        works = {
            one.name: one.mass * np.dot(GRAVITY, (links[one.name] @ [*one.center, 1.0])[:3]) for one in described.links
        }
        potential += sum(works[one.name] for one in still)
        np.testing.assert_allclose(held.kinetic, kinetic, rtol=1e-8)
        # Links above and below the origin cancel: the round-off is that of the terms, not of their sum.
        terms = sum(abs(work) for work in works.values())
        np.testing.assert_allclose(held.potential, potential, rtol=0.0, atol=5e-15 * terms)
        np.testing.assert_allclose(poses, [links[name][:3] for name in every], atol=1e-14)


def test_a_free_base_falls_as_the_arm_on_it_does(written):
    text = ARM.replace('<link name="base"/>', link("base"))
    robot = cj.load_urdf(written(text), base="free", gravity=GRAVITY)
    plan = layout(robot)
    assert plan.positions[:7] == (
        *(f"floating_base.slide_{k}" for k in "xyz"),
        *(f"floating_base.{k}" for k in "wxyz"),
    )
    assert (len(plan.positions), plan.free) == (9, 8)
    y = jnp.zeros(plan.size).at[plan.positions.index("floating_base.w")].set(1.0).at[7:9].set(0.6)
    rate = np.asarray(jax.jit(lambda y: slope(jnp.zeros(()), y, robot.prepare()))(y))[plan.v]
    np.testing.assert_allclose(rate, [*GRAVITY, 0, 0, 0, 0, 0], atol=1e-13)


def test_a_robot_moves_and_keeps_its_energy(written):
    start = {"shoulder.velocity": 2.0, "elbow.velocity": 5.0}
    solution = cj.simulate(cj.replace(cj.load(written(ARM)), start), 0.3, rtol=1e-9)
    assert float(solution.energy_residual) < 1e-8
    assert float(solution["damping_loss"]) > 0.05
    assert float(solution["drive_work"]) == pytest.approx(0, abs=1e-12)
    assert float(solution["elbow.position"]) > 1.0
    assert solution["tool.position"].shape == (3,)


# As a user asks ----------------------------------------------------------------------------------------------------


def test_a_suffix_says_what_a_file_is(written):
    for name in ("robot.urdf", "ROBOT.URDF"):
        assert cj.load(written(ARM, name)).name == "arm"
    scene = load_scene(written(ARM))
    assert (scene.solve, scene.text) == ({}, ARM)
    path = written(ARM, "robot.toml")
    with refused(path, None):
        cj.load(path)
    with pytest.warns(ImplausibleWarning, match="fore.mass"):
        cj.load(written(ARM.replace(MASS, '<mass value="1.5e10"/>')))


def test_the_command_reads_robots(written):
    ran = CliRunner().invoke(app, ["info", str(written(ARM))])
    assert ran.exit_code == 0
    assert "states: 4 (positions and speeds of shoulder, elbow)" in ran.output
    assert "upper.inertia.xx" in ran.output
    shown = {row.split("│")[1].strip(): [cell.strip() for cell in row.split("│")[2:-1]] for row in _rows(ran.output)}
    assert shown["shoulder"] == ["-2 rad", "2.5 rad", "3 rad/s", "40 N m"]


def _rows(output):
    """The lines of the tables that were printed."""
    return [line for line in output.splitlines() if line.count("│") > 2]


def test_end_effectors_are_chosen_by_name(written):
    path = written(ARM)
    (base, fore) = cj.load_urdf(path, end_effector=("base", "fore")).points
    assert (base.name, base.body) == ("base", "ground")
    assert (fore.name, fore.body) == ("fore_frame", "fore")
    assert cj.load_urdf(path, end_effector=[]).points == ()
    assert [point.name for point in cj.load_urdf(path, end_effector="tool").points] == ["tool"]


def test_joints_that_follow_others(written):
    text = ARM.replace(AXIS, AXIS + '<mimic joint="shoulder" multiplier="2" offset="0.5"/>')
    (coupling,) = cj.load_urdf(written(text)).couplings
    assert (coupling.name, coupling.follower, coupling.leader) == ("elbow_mimic", "elbow", "shoulder")
    assert (float(coupling.ratio), float(coupling.offset)) == (2.0, 0.5)
    assert layout(cj.load_urdf(written(text))).positions == ("shoulder",)
    with pytest.warns(NotReadWarning):
        rigid: Any = cj.load_urdf(written(text.replace('multiplier="2"', 'multiplier="0"')))
    assert rigid.couplings == ()
    assert float(rigid.joint("elbow").motion.drive(0.0)[0]) == 0.5
    assert layout(cj.load_urdf(written(text), mimic="independent")).positions == ("shoulder", "elbow")
    fixed = ARM.replace("</joint>\n  <transmission", '<mimic joint="elbow"/></joint>\n  <transmission')
    assert fixed != ARM
    with pytest.warns(NotReadWarning):
        assert len(cj.load_urdf(written(fixed)).joints) == 2


WRONG = {
    "a base": ({"base": "floating"}, "`base` must be one of the allowed words, but it is 'floating'. Allowed:"),
    "mimic": ({"mimic": "ignore"}, "`mimic` must be one of the allowed words"),
    "gravity": ({"gravity": 9.81}, "`gravity` must be three finite numbers in m/s^2, but it is 9.81"),
    "a plane gravity": ({"gravity": (0, -9.81)}, "`gravity` must be three finite numbers"),
    "gravity that is none": ({"gravity": (0, 0, float("nan"))}, "`gravity` must be three finite numbers"),
    "an end effector": ({"end_effector": "tol"}, "there is no link 'tol'. Did you mean `tool`"),
    "one of several": ({"end_effector": ["tool", "x"]}, "there is no link 'x'"),
    "a base of nothing": ({"base": "free"}, "line 4: the root link `base` has no mass, so it cannot be a free base"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused(case, written):
    given, words = WRONG[case]
    with pytest.raises(ClearanceError) as caught:
        cj.load_urdf(written(ARM), **given)
    assert words in str(caught.value)


def test_a_robot_that_cannot_move(written):
    path = written(robot(link("base"), link("top"), hinge("bolt", "base", "top", "0 0 1", kind="fixed")))
    with pytest.raises(ClearanceError, match="nothing of the robot moves"):
        cj.load_urdf(path)
    drone = cj.load_urdf(path, base="free")
    assert [point.name for point in drone.points] == ["top"]
    assert float(drone.bodies[0].mass) == 3


def test_robots_are_loaded_inside_jitted_functions(written):
    path = written(ARM)

    @jax.jit
    def weight(scale):
        return scale * sum(body.mass for body in loaded(path).bodies)

    assert float(weight(2.0)) == 8.0
