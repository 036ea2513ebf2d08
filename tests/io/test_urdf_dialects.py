"""What dialects of URDF say beside its own elements is read where it is physics, and what is not read is said."""

from typing import Any

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.dynamics.field import slope
from clearance_jax.errors import ClearanceError
from clearance_jax.io.urdf.mechanism import NotReadWarning
from clearance_jax.mechanism.actuators import JointFriction, JointSpring

MASS = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.012" izz="0.014" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def mini(in_joint="", beside="", in_link="", limit="", head="", kind="revolute"):
    """A pendulum of one link, and what is said beside it."""
    return f"""<robot name="mini" {head}><link name="base"/><link name="a">{in_link}{MASS}</link>
<joint name="j" type="{kind}"><origin xyz="0.2 0 0"/><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="5" {limit}/>{in_joint}</joint>
{beside}
</robot>"""


DRAKE = 'xmlns:drake="http://drake.mit.edu"'
ROTOR = (
    '<transmission><type>SimpleTransmission</type><joint name="j"/><actuator name="m">'
    '<drake:gear_ratio value="160"/><drake:rotor_inertia value="0.00013"/></actuator></transmission>'
)
LOOP = '<loop_joint name="close" type="continuous"><link1 link="a"/><link2 link="base"/></loop_joint>'
SDF = '<gazebo><joint name="close" type="revolute"><parent>a</parent><child>base</child></joint></gazebo>'
BUSHING = '<drake:linear_bushing_rpy><drake:bushing_frameA name="x"/></drake:linear_bushing_rpy>'
FORCE = (
    '<force_element name="s"><torsional_spring stiffness="50" rest_angle="0.2"><joint name="j"/>{}</torsional_spring>'
    "</force_element>"
)


@pytest.fixture
def load(tmp_path):
    def of(text):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return cj.load(path)

    return of


def acting(mechanism):
    """Stiffness, rest, damping, friction and rotor of the only joint."""
    motion: Any = mechanism.joints[0].motion
    springs = [a for a in motion.actuators if isinstance(a, JointSpring)]
    friction = [float(a.effort) for a in motion.actuators if isinstance(a, JointFriction)]
    of_springs = [sum(float(getattr(a, name)) for a in springs) for name in ("stiffness", "rest", "damping")]
    return (*of_springs, sum(friction), 0.0 if motion.rotor_inertia is None else float(motion.rotor_inertia))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (mini(), (0, 0, 0, 0, 0)),
        (mini(limit='damping="5" friction="1"'), (0, 0, 5, 1, 0)),
        (mini('<joint_properties damping="5" friction="1"/>'), (0, 0, 5, 1, 0)),
        (mini('<dynamics damping="5"/>', limit='damping="5"'), (0, 0, 5, 0, 0)),
        (mini('<dynamics damping="0.1" spring_stiffness="50" spring_reference="0.2"/>'), (50, 0.2, 0.1, 0, 0)),
        (
            mini(beside='<gazebo reference="j"><springStiffness> 50 </springStiffness></gazebo>'),
            (50, 0, 0, 0, 0),
        ),
        (mini(beside=FORCE.format("")), (50, 0.2, 0, 0, 0)),
        (mini('<dynamics damping="0.1" armature="0.03"/>'), (0, 0, 0.1, 0, 0.03)),
        (mini(beside=ROTOR, head=DRAKE), (0, 0, 0, 0, 160**2 * 0.00013)),
        (mini(beside=ROTOR.replace("drake:", "")), (0, 0, 0, 0, 160**2 * 0.00013)),
    ],
)
def test_springs_losses_and_rotors_are_read_whoever_says_them(load, text, expected):
    mechanism = load(text)
    assert acting(mechanism) == pytest.approx(expected, rel=1e-15)
    assert mechanism.notes == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (mini(beside=LOOP), "loop_joint `close` closes a loop"),
        (mini(beside=SDF), "joint `close` closes a loop"),
        (mini(beside='<drake:joint name="k" type="universal"/>', head=DRAKE), "joint `k` is no joint of URDF but of"),
        (mini('<dynamics damping="5"/>', limit='damping="4"'), "its damping is 5 in <dynamics> and 4 in <limit>"),
        (mini('<joint_properties friction="-1"/>'), "its friction must be at least 0, but it is -1"),
        (mini('<dynamics armature="-1"/>'), "the inertia of its rotor must be at least 0"),
        (mini('<dynamics spring_stiffness="5"/>', kind="floating"), "but this joint is floating"),
        (mini('<dynamics spring_stiffness="5"/>', FORCE.format("")), "is 50 here and 5 elsewhere"),
        (mini(beside=ROTOR.replace('"j"', '"jj"'), head=DRAKE), "there is no joint `jj`. Did you mean `j`"),
        (mini(beside=FORCE.format('<joint name="k"/>')), "must name one <joint>, but it names 2"),
        (
            mini(beside='<gazebo reference="j"><springStiffness>stiff</springStiffness></gazebo>'),
            "<springStiffness> must be written as plain decimal numbers, but it holds 'stiff'",
        ),
        (mini().replace('xyz="0.2 0 0"', 'xyz="0.2, 0, 0"'), "has a comma: '0.2,'. Separate numbers by spaces only"),
        (mini().replace('effort="10"', 'effort="10,5"'), "Write a decimal point: 10.5"),
    ],
)
def test_what_cannot_be_right_is_refused(load, text, words):
    with pytest.raises(ClearanceError) as caught:
        load(text)
    assert words in str(caught.value)


SAID = [
    (mini(beside=MASS), "not read: <inertial> in <robot> (line 4)"),
    (mini(in_link="<mass>3</mass>"), "not read: <mass> in <link> (line 1)"),
    (mini(beside=BUSHING, head=DRAKE), "not read: <linear_bushing_rpy> in <robot> (line 4)"),
    (
        mini('<dynamics viscous_k="3"/>', '<gazebo reference="a"><turnGravityOff>true</turnGravityOff></gazebo>' * 2),
        "not read: `viscous_k` of <dynamics> (line 3), <turnGravityOff> in <gazebo> (line 4, 2 times)",
    ),
    (
        mini(beside="".join(f"<thing{k}/>" for k in range(10))),
        "not read: " + ", ".join(f"<thing{k}> in <robot> (line 4)" for k in range(8)) + ", 2 kinds more",
    ),
]


@pytest.mark.parametrize(("text", "note"), SAID)
def test_what_is_not_read_is_said(load, text, note):
    with pytest.warns(NotReadWarning) as caught:
        mechanism = load(text)
    assert mechanism.notes == (note,)
    assert [str(warning.message).split("robot.urdf: ")[1] for warning in caught] == [note]


def shown(*words):
    """What a command prints, in one line."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


def test_notes_stand_in_datasets_and_on_the_screen(tmp_path):
    text, note = SAID[0]
    path, result = tmp_path / "robot.urdf", tmp_path / "robot.nc"
    path.write_text(text)
    shown("simulate", path, "--t1", "1 ms", "--samples", 2, "-o", result)
    assert cj.load_dataset(result).attrs["notes"] == note
    assert note in shown("info", path)
    scene = tmp_path / "scene.toml"
    scene.write_text('[robot]\nfile = "robot.urdf"\n')
    with pytest.warns(NotReadWarning, match=r"scene\.toml: not read: <inertial>"):
        assert cj.load(scene).notes == (note,)


@pytest.mark.slow
def test_a_robot_whose_base_moves_is_not_said_to_be_held(tmp_path):
    path = tmp_path / "robot.urdf"
    hung = f"<link name='b'>{MASS}</link><joint name='k' type='planar'><parent link='base'/><child link='b'/></joint>"
    path.write_text(mini(beside=hung))
    said = shown("simulate", path, "--t1", "1 ms", "--samples", 2)
    assert "what is not driven is held where it stands. k cannot be held: what hangs on it moves freely" in said
    path.write_text(mini())
    assert "each is held where it stands. Drive joints" in shown("simulate", path, "--t1", "1 ms", "--samples", 2)


def test_a_scene_keeps_the_rotor_of_its_robot(tmp_path, load):
    load(mini(beside=ROTOR, head=DRAKE))
    scene = tmp_path / "scene.toml"
    scene.write_text('[robot]\nfile = "robot.urdf"\n[robot.joint.j]\nposition = "0.1 rad"\n')
    assert acting(cj.load(scene))[-1] == pytest.approx(3.328)


# An arm like the iiwa 14, with its motors --------------------------------------------------------------------------

AXES = ("0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1")
OFFSETS = (0.1575, 0.2025, 0.2045, 0.2155, 0.1845, 0.2155, 0.081)
MASSES = (5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2)
RATIOS = (160, 160, 160, 160, 100, 160, 160)
CENTER, MOMENTS, ROTOR_INERTIA = np.array([0.01, -0.03, 0.07]), np.array([0.033, 0.031, 0.0123]), 1.321e-4
ANGLES = np.array([0.3, -0.6, 0.2, 1.1, -0.4, 0.7, 0.5])


def arm():
    parts = ['<link name="l0"/>']
    for k, (axis, up, mass, ratio) in enumerate(zip(AXES, OFFSETS, MASSES, RATIOS, strict=True), 1):
        inertia = " ".join(f'{key}="{value}"' for key, value in zip(("ixx", "iyy", "izz"), MOMENTS, strict=True))
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="{" ".join(map(str, CENTER))}"/><mass value="{mass}"/>'
            f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="continuous"><origin xyz="0 0 {up}"/><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><axis xyz="{axis}"/></joint><transmission><joint name="j{k}"/><actuator>'
            f'<drake:rotor_inertia value="{ROTOR_INERTIA}"/><drake:gear_ratio value="{ratio}"/></actuator>'
            "</transmission>"
        )
    return f'<robot name="arm" {DRAKE}>{"".join(parts)}</robot>'


def accelerations(rotors):
    """From rest: (M + diag(n^2 J)) a = -dV/dq, of Jacobians written by hand."""
    turn, place, axes, pivots, mass, load = np.eye(3), np.zeros(3), [], [], np.diag(rotors), np.zeros(7)
    for k in range(7):
        place = place + turn @ [0, 0, OFFSETS[k]]
        axis = np.array(AXES[k].split(), float)
        axes.append(turn @ axis)
        pivots.append(place)
        x, y, z = axis
        across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = turn @ (np.eye(3) + np.sin(ANGLES[k]) * across + (1 - np.cos(ANGLES[k])) * across @ across)
        center = place + turn @ CENTER
        slides, spins = np.zeros((3, 7)), np.zeros((3, 7))
        for i in range(k + 1):
            slides[:, i], spins[:, i] = np.cross(axes[i], center - pivots[i]), axes[i]
        mass = mass + MASSES[k] * slides.T @ slides + spins.T @ turn @ np.diag(MOMENTS) @ turn.T @ spins
        load -= MASSES[k] * 9.81 * slides[2]
    return np.linalg.solve(mass, load)


def test_an_arm_accelerates_with_the_rotors_of_its_motors(load):
    mechanism = load(arm())
    reflected = np.square(RATIOS) * ROTOR_INERTIA
    assert [float(joint.motion.rotor_inertia) for joint in mechanism.joints] == pytest.approx(reflected)
    ready = mechanism.prepare()
    y = jnp.concatenate([jnp.asarray(ANGLES), jnp.zeros(7)])
    found = np.asarray(jax.jit(lambda y: slope(jnp.zeros(()), y, ready))(y))[7:]
    np.testing.assert_allclose(found, accelerations(reflected), rtol=1e-11)
    # Without them the last joint would be 50 times as quick or more.
    bare = accelerations(np.zeros(7))
    assert np.abs(bare[-1] / found[-1]) > 50


def test_a_decimal_comma_is_named():
    pendulum = catalogue.slider_crank()
    from clearance_jax.io.settings import parse_settings

    with refused("--set wrist.radial_clearance=0,1 mm", "0,1 mm"):
        parse_settings(["wrist.radial_clearance=0,1 mm"], pendulum)
