"""MJCF files: each element that is read, against MuJoCo's own accelerations; what is left out; what is refused."""

import importlib.util
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.errors import ClearanceError
from clearance_jax.io.urdf.mechanism import NotReadWarning
from clearance_jax.mechanism.state import initial_values, layout

mujoco: Any = pytest.importorskip("mujoco")
mjcf: Any = pytest.importorskip("experiments.mjcf")

INERTIAL = '<inertial pos="0.1 0.02 -0.03" quat="0.8 0.3 -0.2 0.4" mass="2" diaginertia="0.02 0.03 0.04"/>'
SPHERE = '<geom size="0.1"/>'


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log into the working folder

    def write(world, rest="", name="robot.xml", top="<mujoco model='robot'>"):
        path = tmp_path / name
        path.write_text(f"{top}{rest}<worldbody>{world}</worldbody></mujoco>")
        return path

    return write


def loaded(path, **options) -> Any:
    """A mechanism whose parts are what a test knows them to be."""
    return cj.load_mjcf(path, **options)


def body(inner, name="a", place="", inertial=INERTIAL) -> str:
    return f'<body name="{name}" {place}>{inertial}{inner}</body>'


def errors(path) -> float:
    """The largest difference of accelerations from those of MuJoCo, relative, in three random states."""
    return mjcf.compared(path, "").error


HINGE = '<joint name="{}" pos="0.02 -0.1 0.05" axis="1 2 -2" {}/>'
TURNED = 'pos="0.1 0.2 0.3" quat="0.7 0.1 -0.5 0.3"'
CASES = {
    "hinge": body(HINGE.format("q", ""), place=TURNED),
    "slide": body('<joint name="s" type="slide" axis="1 2 -2" pos="0.4 0 0"/>', place=TURNED),
    "ball": body('<joint name="s" type="ball" pos="0.02 -0.1 0.05" damping="0.2"/>', place=TURNED),
    "free": body('<joint name="s" type="free" damping="0.3"/>', place=TURNED),
    "reference": body(
        HINGE.format("q", 'ref="40"') + body('<joint name="s" type="slide" axis="0 1 1" ref="0.3"/>', "b", TURNED),
        place=TURNED,
    ),
    "several joints on one body": body(
        '<joint name="x" type="slide" axis="1 0 0" ref="0.2"/><joint name="z" type="slide" axis="0 1 1"/>'
        + HINGE.format("turn", 'ref="-30"')
        + '<joint name="ball" type="ball" pos="0 0.1 0"/>',
        place=TURNED,
    ),
    "springs, dampers, rotors": body(
        HINGE.format("q", 'stiffness="7" springref="20" damping="0.4" armature="0.05" frictionloss="0.3"')
        + body('<joint name="s" type="slide" stiffness="70" damping="4" armature="0.5"/>', "b", TURNED)
    ),
    "bodies without joints": f"<body {TURNED}>"
    + body(
        HINGE.format("q", "")
        + body(body(HINGE.format("r", ""), "c", TURNED), "b", TURNED)
        + body("", "lump", TURNED)
        + body("", "other", 'pos="0 0.1 0.2"')
    )
    + "</body>",
    "compensation of gravity": body(HINGE.format("q", "") + body("", "b", f'{TURNED} gravcomp="0.7"'), "a", TURNED),
    "inertia of shapes": body(
        HINGE.format("q", "") + '<geom type="capsule" fromto="0 0 0 0.1 0.2 0.3" size="0.05"/><geom size="0.1"/>',
        inertial="",
    ),
}
RESTS = {"gravity": '<option gravity="1 -2 3"/>', "no gravity": '<option><flag gravity="disable"/></option>'}
RESTS |= {"no dampers": '<option><flag damper="disable"/></option>'}
RESTS |= {"no springs": '<option><flag spring="disable"/></option>'}


@pytest.mark.parametrize("case", CASES)
def test_accelerations_are_those_of_mujoco(case, written):
    assert errors(written(CASES[case])) < 1e-10


@pytest.mark.parametrize("rest", RESTS)
def test_options_of_the_file_count(rest, written):
    assert errors(written(CASES["springs, dampers, rotors"], RESTS[rest])) < 1e-10


FINGERS = body(
    '<joint name="hand" axis="0 1 0" damping="0.1"/>'
    + body('<joint name="left" type="slide" axis="0 1 0" ref="0.1" armature="0.2"/>', "b")
    + body('<joint name="right" axis="0 0 1" ref="20" stiffness="3"/>', "c", TURNED)
)


def equalities(*several) -> str:
    return f"<equality>{''.join(several)}</equality>"


def test_equal_joints_follow(written):
    rest = equalities(
        '<joint joint1="left" joint2="hand" polycoef="0.02 0.3"/>',
        '<joint name="mesh" joint1="right" joint2="hand" polycoef="-0.1 -2"/>',
    )
    path = written(FINGERS, rest)
    assert errors(path) < 1e-10
    first, second = loaded(path).couplings
    assert (first.name, first.follower, first.leader) == ("left_follows", "left", "hand")
    assert float(first.ratio) == 0.3
    np.testing.assert_allclose(float(first.offset), 0.12, rtol=1e-14)
    assert second.name == "mesh"
    np.testing.assert_allclose(float(second.offset), np.radians(20) - 0.1, rtol=1e-14)
    assert loaded(path, mimic="independent").couplings == ()


def test_a_joint_that_follows_already_leads(written):
    """Two relations of one first joint: it follows by one of them, and leads by the other."""
    rest = equalities(
        '<joint joint1="right" joint2="hand" polycoef="0.1 2"/>',
        '<joint joint1="right" joint2="left" polycoef="0.3 4"/>',
        '<joint name="again" joint1="left" joint2="hand" polycoef="0 1"/>',
    )
    with pytest.warns(NotReadWarning):
        robot = loaded(written(FINGERS, rest))
    assert robot.notes == ("not read: relations of joints that are not linear, or follow from others: `again`",)
    assert [(c.follower, c.leader) for c in robot.couplings] == [("right", "hand"), ("left", "right")]
    second = robot.couplings[1]
    right, left = 0.7, 0.1 + (0.7 - np.radians(20) - 0.3) / 4
    np.testing.assert_allclose(float(second.ratio) * right + float(second.offset), left, rtol=1e-14)


FOUR_BAR = body(
    '<joint name="crank" axis="0 0 1"/>' + body('<joint name="rod" axis="0 0 1"/>', "rod_", 'pos="0.1 0 0"'), "crank_"
) + body('<joint name="rocker" axis="0 0 1"/>', "rocker_", 'pos="0.3 0 0"')


def test_connected_bodies_close_a_loop(written):
    """The ball joint keeps the two anchors together, wherever MuJoCo has them."""
    path = written(FOUR_BAR, equalities('<connect name="pin" body1="rod_" body2="rocker_" anchor="0.2 0.1 0"/>'))
    robot = loaded(path, end_effector=["rod_", "rocker_"])
    (pin,) = robot.loops
    assert (pin.name, pin.parent, pin.child) == ("pin", "rocker_", "rod_")
    model = mujoco.MjModel.from_xml_path(str(path))
    np.testing.assert_allclose([float(x or 0) for x in pin.at_child.vector], model.eq_data[0, :3], atol=1e-15)
    np.testing.assert_allclose([float(x or 0) for x in pin.at_parent.vector], model.eq_data[0, 3:6], atol=1e-15)
    assert cj.mobility(robot).freedom == 1
    sites = '<site name="s" pos="0.2 0.1 0"/>'
    world = FOUR_BAR.replace('name="rod" axis="0 0 1"/>', f'name="rod" axis="0 0 1"/>{sites}')
    tied = loaded(written(f'{world}<site name="t" pos="0.3 0.1 0"/>', equalities('<connect site1="t" site2="s"/>')))
    assert [(loop.parent, loop.child, float(loop.at_parent.x)) for loop in tied.loops] == [("ground", "rod_", 0.3)]


def test_a_loop_accelerates_as_multipliers_say(written):
    """Against MuJoCo's mass matrix and forces, with the condition that the two anchors stay together."""
    path = written(FOUR_BAR, equalities('<connect name="pin" body1="rod_" body2="rocker_" anchor="0.2 0.1 0"/>'))
    robot, model = loaded(path), mujoco.MjModel.from_xml_path(str(path))
    at_q, at_v = mjcf.places(model, robot)
    assert at_q == at_v == [0, 1, 2]
    plan, ready, data = layout(robot), robot.prepare(), mujoco.MjData(model)
    accelerations = jax.jit(lambda y: slope(jnp.zeros(()), y, ready)[plan.v])

    def relative(velocity):
        """Jacobian of the relative motion of the anchors, and its acceleration without those of the coordinates."""
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        jacobians, turning = [], []
        for i, name in enumerate(("rod_", "rocker_")):
            here = data.body(name)
            place = here.xpos + here.xmat.reshape(3, 3) @ model.eq_data[0, 3 * i : 3 * i + 3]
            moves, turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, moves, turns, place, model.body(name).id)
            rates = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jacDot(model, data, *rates, place, model.body(name).id)
            jacobians.append(moves)
            turning.append(rates[0] @ velocity)
        return (jacobians[0] - jacobians[1])[:2], (turning[0] - turning[1])[:2]

    gap, _ = relative(np.zeros(3))
    velocity = np.linalg.svd(gap)[2][-1]
    gap, bias = relative(velocity)
    mass = np.zeros((3, 3))
    for column, unit in zip(mass, np.eye(3), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    whole = np.block([[mass, gap.T], [gap, np.zeros((2, 2))]])
    theirs = np.linalg.solve(whole, np.concatenate([data.qfrc_passive - data.qfrc_bias, -bias]))[:3]
    ours = accelerations(jnp.asarray(np.concatenate([data.qpos, velocity])))
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10 * np.abs(theirs).max())


def test_sites_and_bodies_are_where_mujoco_has_them(written):
    site = '<site name="tip" pos="0.1 0.2 -0.3" quat="0.5 0.1 0.3 -0.7"/>'
    several = CASES["several joints on one body"].replace("</body>", f"{site}{body('', 'tool', TURNED)}</body>")
    path = written(several)
    robot, model = loaded(path, end_effector=["tip", "tool"]), mujoco.MjModel.from_xml_path(str(path))
    at_q, _ = mjcf.places(model, robot)
    ready, plan, data = robot.prepare(), layout(robot), mujoco.MjData(model)
    start = np.asarray(initial_values(robot))
    np.testing.assert_allclose(start[: len(at_q)], model.qpos0[at_q], atol=1e-15)
    mujoco.mj_integratePos(model, data.qpos, np.random.default_rng(3).uniform(-0.7, 0.7, model.nv), 1.0)
    mujoco.mj_forward(model, data)
    motion = frames(ready, jnp.zeros(()), plan.split(jnp.concatenate([data.qpos[at_q], jnp.zeros(plan.free)])))
    tip, tool = ((point, motion[point.body].move_origin(point.at.vector)) for point in robot.points)
    for (point, frame), place, turn in (
        (tip, data.site("tip").xpos, data.site("tip").xmat),
        (tool, data.body("tool").xpos, data.body("tool").xmat),
    ):
        np.testing.assert_allclose([float(x) for x in frame.position], place, atol=1e-14)
        rows = np.array(frame.rotate(point.orientation.rotation).rotation.rows, float)
        np.testing.assert_allclose(rows, turn.reshape(3, 3), atol=1e-14)


def test_parts_and_their_names(written):
    world = f'<body name="base" pos="0 0 1">{SPHERE}' + body(
        '<joint name="a" range="-30 40" actuatorfrcrange="-5 7" frictionloss="0.3"/><joint axis="1 0 0"/>'
        f'<site name="tip" pos="0.1 0 0" euler="0 0 90"/>{body(SPHERE, "tool", TURNED)}',
        "a",
        'pos="0.1 0 0"',
    )
    robot = loaded(written(f"{world}</body>"), end_effector=["tip", "tool", "base"])
    assert robot.name == "robot"
    assert [joint.name for joint in robot.joints] == ["a_joint", "joint_1"]
    assert [each.name for each in robot.bodies] == ["a_a", "a"]
    hinge = robot.joints[0]
    assert hinge.motion.limits == cj.Limits(np.radians(-30.0), np.radians(40.0), None, 7.0)
    assert isinstance(hinge.motion.actuators[0], cj.actuators.JointFriction)
    assert [(point.name, point.body) for point in robot.points] == [("tip", "a"), ("tool", "a"), ("base", "ground")]
    np.testing.assert_allclose(float(robot.points[0].orientation.yaw), np.pi / 2)
    assert (hinge.parent, float(hinge.at_parent.z)) == ("ground", 1.0)
    assert [point.name for point in loaded(written(f"{world}</body>")).points] == ["tool"]


def test_what_is_left_out_is_said_once(written):
    world = (
        body('<joint name="a"/><site name="s"/>', "a")
        + body('<joint name="free" type="free" armature="0.1"/>', "b")
        + body("", "c", 'mocap="true"')
        + '<site name="t"/>'
    )
    rest = (
        '<option density="1.2"/><actuator><motor name="m" joint="a"/></actuator>'
        '<tendon><spatial name="rope"><site site="s"/><site site="t"/></spatial></tendon>'
        + equalities('<weld name="held" body1="b" body2="c"/>', '<joint name="stop" joint1="a" polycoef="0.1 0"/>')
    )
    with pytest.warns(NotReadWarning) as caught:
        robot = loaded(written(world, rest))
    assert len(caught) == 1
    (note,) = robot.notes
    assert note == (
        "not read: relations of joints that are not linear, or follow from others: `stop`, equality constraints <weld> "
        "`held`, actuators `m`, tendons `rope`, motions of the mocap bodies `c`, springs, armatures and friction "
        "losses of `free`, forces of the fluid around it"
    )


def test_inactive_equalities_do_nothing(written):
    rest = equalities('<joint joint1="left" joint2="hand" active="false"/>')
    assert loaded(written(FINGERS, rest)).couplings == ()
    assert loaded(written(FINGERS, rest)).notes == ()


def test_backlash_is_seen_by_name_or_range(written):
    hinge = '<joint name="{}" axis="0 1 0" range="{}" armature="0.01"/>'
    world = body(hinge.format("pan", "-90 90") + hinge.format("pan_backlash", "-0.5 0.5"), "a")
    with pytest.warns(NotReadWarning):
        robot = loaded(written(world))
    assert robot.notes[0].startswith("joint `pan_backlash` stands for backlash of 1 deg (-0.5 to 0.5 deg)")
    assert robot.joints[1].motion.limits.upper == np.radians(0.5)
    with pytest.warns(NotReadWarning):
        loaded(written(body(hinge.format("pan", "-90 90") + hinge.format("gap", "-2 2"), "a")))
    assert loaded(written(body(hinge.format("pan", "-90 90") + hinge.format("gap", "-9 9"), "a"))).notes == ()


def test_scenes_and_commands_take_mjcf(written, tmp_path):
    rest = equalities('<joint joint1="left" joint2="hand" polycoef="0 0.3"/>')
    path = written(FINGERS.replace("</body>", "", 1) + body("", "weight", 'gravcomp="1"') + "</body>", rest)
    assert cj.load(path).couplings[0].follower == "left"
    scene = tmp_path / "scene.toml"
    scene.write_text('[robot]\nfile = "robot.xml"\nend_effector = ["weight"]\njoint.hand = { drive = "0.1 * time" }\n')
    robot = cj.load(scene)
    assert [coupling.follower for coupling in robot.couplings] == ["left"]
    assert [wrench.name for wrench in robot.wrenches] == ["weight_gravcomp"]
    assert [point.name for point in robot.points] == ["weight"]
    ran = CliRunner().invoke(app, ["check", str(path)])
    assert ran.exit_code == 0, ran.output
    assert "a valid robot" in ran.output
    # What follows is not held: its leader is.
    (idle,) = (line for line in ran.output.splitlines() if "nothing drives" in line)
    assert "hand" in idle
    assert "left" not in idle
    scene.write_text('[robot]\nfile = "robot.xml"\nbase = "free"\n')
    with refused("base", "free"):
        cj.load(scene)


def test_urdf_in_an_xml_file_stays_urdf(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(cj.examples.path("six_axes").read_text())
    assert cj.load(path).joint("axis_2").name == "axis_2"
    with pytest.raises(ClearanceError) as caught:
        cj.load_mjcf(path)
    assert "its outermost element must be <mujoco>, but it is <robot>" in str(caught.value)


REFUSED = {
    "misspelt": (body('<joint axsi="1 0 0"/>'), {}, "unrecognized attribute: 'axsi' Element 'joint', line 1"),
    "no mass": ('<body name="light"><joint/></body>', {}, "Element name 'light'"),
    "nothing moves": (body(""), {}, "nothing of the robot moves"),
    "two hinges about one axis": (
        body('<joint/><joint name="second"/>'),
        {},
        "can move without moving any mass",
    ),
    "no such point": (body("<joint/>"), {"end_effector": "b"}, "must name sites or bodies, but there is none called"),
    "mimic": (body("<joint/>"), {"mimic": "never"}, "`mimic`"),
    "no mesh": (body('<joint/><geom type="mesh" mesh="m"/>'), {}, "mesh"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_said_in_a_sentence(case, written):
    world, options, words = REFUSED[case]
    path = written(world)
    with pytest.raises(ClearanceError) as caught:
        loaded(path, **options)
    assert words in str(caught.value)
    assert case == "mimic" or str(path) in str(caught.value)


def test_without_mujoco_the_command_is_said(written, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ClearanceError) as caught:
        loaded(written(body("<joint/>")))
    assert "pip install" in str(caught.value)
    assert "[mjcf]" in str(caught.value)
