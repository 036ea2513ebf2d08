"""What other readers of URDF load is loaded with a note of what was assumed; what cannot be is refused, or mended on
request.
"""

import sys
import types
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
from clearance_jax.errors import LONGEST, ClearanceError
from clearance_jax.io.urdf.bodies import merge
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.mechanism import NotReadWarning
from clearance_jax.mechanism.body import Limits

pytestmark = pytest.mark.quick

MOMENTS = 'ixx="0.01" iyy="0.012" izz="0.014" ixy="0" ixz="0" iyz="0"'
LINE = "line 4"


def inertial(mass="1", moments=MOMENTS, origin="0.1 0 0"):
    inertia = "" if moments is None else f"<inertia {moments}/>"
    return f'<inertial><origin xyz="{origin}"/><mass value="{mass}"/>{inertia}</inertial>'


LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="5"/>'


def mini(
    in_link: str = inertial(),
    axis: str = '<axis xyz="0 1 0"/>',
    limit: str = LIMIT,
    in_joint: str = "",
    beside: str = "",
    head: str = "",
    kind: str = "revolute",
    names: tuple[str, str, str] = ("base", "a", "j"),
):
    """A pendulum of one link, whose link is line 4 and whose joint is line 5."""
    (base, link, joint), rest = names, axis + limit + in_joint
    return f"""<?xml version="1.0"?>
<robot name="mini"{head}>
<link name="{base}"/>
<link name="{link}">{in_link}</link>
<joint name="{joint}" type="{kind}"><origin xyz="0.2 0 0"/><parent link="{base}"/><child link="{link}"/>{rest}</joint>
{beside}
</robot>
"""


def second(name="k", parent="a", inner=""):
    return (
        f'<link name="b">{inertial()}</link><joint name="{name}" type="revolute"><origin xyz="0.2 0 0"/>'
        f'<parent link="{parent}"/><child link="b"/><axis xyz="0 1 0"/>{LIMIT}{inner}</joint>'
    )


def diagonal(x, y, z):
    return f'ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"'


GOOD = mini()
DRAKE = ' xmlns:drake="http://drake.mit.edu"'
WORLD = GOOD.replace('<link name="base"/>\n', "").replace('<parent link="base"/>', '<parent link="world"/>')
POINT = "mass without inertia about some axis is that of a point or a rod"
ROTOR = (
    '<transmission><type>SimpleTransmission</type><joint name="j"/><actuator name="m">'
    '<drake:gear_ratio value="160"/><drake:rotor_inertia value="0.00013"/></actuator></transmission>'
)
TWICE = 'ixx="0.01" iyy="0.012" izz="0.014" ixy="0" iyx="0" ixz="0" izx="0.0" iyz="0" izy="0"'


def limited(numbers):
    return mini(limit=f"<limit {numbers}/>")


# The text, and the notes that it is loaded with.
LOADED: dict[str, tuple[Any, tuple[str, ...]]] = {
    "plain": (GOOD, ()),
    "a turned axis": (
        mini(axis='<axis xyz="0 1 0" rpy="0 0 0"/>'),
        ("assumed: `rpy` of <axis>, which URDF does not have, is left out (line 5)",),
    ),
    "both halves of an inertia": (
        mini(inertial(moments=TWICE)),
        (
            f"assumed: `iyx` of <inertia> beside `ixy` is left out ({LINE}), "
            f"`izx` of <inertia> beside `ixz` is left out ({LINE}), "
            f"`izy` of <inertia> beside `iyz` is left out ({LINE})",
        ),
    ),
    "halves that differ": (
        mini(inertial(moments=MOMENTS + ' izx="0.1"')),
        (f"assumed: `izx` of <inertia> beside `ixz` is left out, though it differs ({LINE})",),
    ),
    "a triangle by three digits": (mini(inertial(moments=diagonal(0.01, 0.02, 0.03002))), ()),
    "a triangle by less than 1 %": (
        mini(inertial(moments=diagonal(0.01, 0.02, 0.0302))),
        (f"assumed: moments of inertia of which two add up to less than the third, by less than 1 % ({LINE})",),
    ),
    "a point mass": (mini(inertial(moments=diagonal(0, 0, 0), origin="0.5 0 0")), (f"assumed: {POINT} ({LINE})",)),
    "a rod": (mini(inertial(moments=diagonal(0, 0.1, 0.1))), (f"assumed: {POINT} ({LINE})",)),
    "no inertia": (
        mini(inertial(moments=None, origin="0.5 0 0")),
        (f"assumed: mass without <inertia> is a point mass ({LINE}), {POINT} ({LINE})",),
    ),
    "an unknown speed": (
        limited('lower="-1" upper="1" effort="10" velocity="-1"'),
        ("assumed: `velocity` -1 of <limit> is taken as unknown (line 5)",),
    ),
    "no speed and no effort": (
        limited('lower="-1" upper="1" effort="0" velocity="0"'),
        (
            "assumed: `effort` 0 of <limit> is taken as unknown (line 5), "
            "`velocity` 0 of <limit> is taken as unknown (line 5)",
        ),
    ),
    "no range": (
        limited('lower="0" upper="0" effort="10"'),
        ("assumed: `lower` and `upper` that are both 0 are taken as unknown (line 5)",),
    ),
    "swapped limits": (
        limited('lower="1" upper="-1"'),
        ("assumed: `lower` above `upper` is taken the other way round (line 5)",),
    ),
    "limits of which one is zero": (
        limited('lower="1" upper="0"'),
        ("assumed: `lower` above `upper` is taken the other way round (line 5)",),
    ),
    "no limits of a fixed joint": (
        mini(beside=second().replace("revolute", "fixed").replace('effort="10"', 'effort="-1"')),
        (),
    ),
    "a blank before the declaration": (
        "\n" + GOOD,
        ("assumed: `<?xml ...?>`, which is not at the beginning of the file, is left out (line 2)",),
    ),
    "a comment before the declaration": (
        "<!-- made by hand -->\n" + GOOD,
        ("assumed: `<?xml ...?>`, which is not at the beginning of the file, is left out (line 2)",),
    ),
    "an undeclared world": (WORLD, ("assumed: a link `world`, which is not declared, carries the robot (line 4)",)),
    "an unbound prefix": (
        mini(beside="<!-- <other:thing/> --><drake:ignore_self_collision/>"),
        (
            "not read: <ignore_self_collision> in <robot> (line 6)",
            "assumed: the prefix `drake`, which is not declared, is taken as declared (line 6)",
        ),
    ),
    "an unbound prefix of a known element": (
        mini(beside=ROTOR),
        ("assumed: the prefix `drake`, which is not declared, is taken as declared (line 6)",),
    ),
    "what xacro left": (
        mini(head=' xmlns:xacro="http://www.ros.org/wiki/xacro"', beside='<xacro:sensor name="x"/>'),
        ("assumed: <xacro:sensor> is left over from xacro, and not expanded (line 6)",),
    ),
    "a macro that nothing calls": (
        mini(beside='<xacro:property name="x" value="1"/><xacro:macro name="m"><link name="z"/></xacro:macro>'),
        (
            "assumed: the prefix `xacro`, which is not declared, is taken as declared (line 6), "
            "<xacro:property> is left over from xacro, and not expanded (line 6), "
            "<xacro:macro> is left over from xacro, and not expanded (line 6)",
        ),
    ),
    "a default namespace": (
        mini(head=' xmlns="http://drake.mit.edu"'),
        ("assumed: the namespace `http://drake.mit.edu` of <robot> means nothing (line 2)",),
    ),
    "a plane damping of three": (
        mini(kind="planar", limit="", in_joint='<dynamics damping="0.1 0.1 0.1"/>'),
        ("assumed: three equal numbers of `damping` are one for each motion of the joint (line 5)",),
    ),
    "a mimic of nothing": (
        mini(beside=second(inner='<mimic joint="gone"/>')),
        ("assumed: <mimic> of `gone`, which is no joint, is left out (line 6)",),
    ),
    "a mimic of a fixed joint": (
        mini(
            beside=second(inner='<mimic joint="bolt"/>')
            + '<link name="c"/><joint name="bolt" type="fixed"><parent link="b"/><child link="c"/></joint>'
        ),
        ("assumed: <mimic> of `bolt`, which is fixed, is left out (line 6)",),
    ),
    "a mimic on a fixed joint": (
        mini(beside=second(inner='<mimic joint="j"/>').replace("revolute", "fixed")),
        ("assumed: <mimic> on a fixed joint is left out (line 6)",),
    ),
    "a mimic that stays": (
        mini(beside=second(inner='<mimic joint="j" multiplier="0" offset="0.2"/>')),
        ("assumed: a joint whose <mimic> has the multiplier 0 stays at the offset (line 6)",),
    ),
    "a mimic": (mini(beside=second(parent="base", inner='<mimic joint="j" multiplier="-1"/>')), ()),
    "a rotor": (mini(head=DRAKE, beside=ROTOR), ()),
    "losses in a limit": (limited('lower="-1" upper="1" damping="5" friction="1"'), ()),
    "a spring": (mini(in_joint='<dynamics damping="0.1" spring_stiffness="50"/>'), ()),
    "losses of a dialect": (mini(in_joint='<joint_properties damping="5" friction="1"/>'), ()),
    "an inertial in the robot": (mini(beside=inertial()), ("not read: <inertial> in <robot> (line 6)",)),
    "a mass as text": (mini("<mass>3</mass>" + inertial()), (f"not read: <mass> in <link> ({LINE})",)),
    "slashes": (mini(names=("r/base", "r/a", "r/j")), ()),
    "spaces": (mini(names=("my base", "my a", "my j")), ()),
    "words of the library": (mini(names=("base", "time", "drive")), ()),
    "other letters": (mini(names=("Grundplatte", "Ärm", "gelenk_π")), ()),
    "brackets": (mini(names=("base", "a[0]", "j:0,1")), ()),
    "the ground": (mini(names=("ground", "a", "j")), ()),
    "stars": (mini(names=("base", "a*", "j*")), ()),
    "one name for two": (mini(names=("base", "arm", "arm")), ()),
    "words of a dataset": (mini(names=("base", "t", "coordinate")), ()),
    "a mark and returns": (("\ufeff" + GOOD).replace("\n", "\r\n"), ()),
    "two bytes a letter": (GOOD.encode("utf-16"), ()),
    "declared Latin-1": (
        GOOD.replace("?>", ' encoding="iso-8859-1"?><!-- Gerät -->').encode("latin-1"),
        (),
    ),
    "undeclared Latin-1": (
        GOOD.replace("<link", "<!-- Gerät --><link", 1).encode("latin-1"),
        ("assumed: a text that is not in UTF-8 is read as Latin-1 (line 1)",),
    ),
    "an encoding that it cannot have": (GOOD.replace("?>", ' encoding="utf-16"?>').encode(), ()),
    "an encoding that is none": (
        GOOD.replace("?>", ' encoding="unicode_escape"?>').encode(),
        (),
    ),
    "zeros at the end": (GOOD + "\0\n\0", ("assumed: zero bytes at the end of the file are left out (line 8)",)),
}  # fmt: skip


@pytest.fixture
def written(tmp_path):
    def write(text, name="robot.urdf"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def quietly(path, **options):
    """A robot, whose notes are looked at elsewhere."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotReadWarning)
        return cj.load_urdf(path, **options)


def refusal(path, **options):
    """What is said of a robot that is refused."""
    with pytest.raises(ClearanceError) as caught:
        cj.load_urdf(path, **options)
    return str(caught.value)


@pytest.mark.parametrize("case", LOADED)
def test_what_others_load_is_loaded_and_said(case, written):
    text, notes = LOADED[case]
    path, mimic = written(text), "independent"
    if not notes:
        assert cj.load_urdf(path, mimic=mimic).notes == ()
        return
    with pytest.warns(NotReadWarning) as caught:
        mechanism = cj.load_urdf(path, mimic=mimic)
    assert mechanism.notes == notes
    assert [str(warning.message) for warning in caught] == [f"{path}: {'; '.join(notes)}"]


@pytest.mark.parametrize(
    ("numbers", "limits"),
    [
        ('lower="1" upper="-1" effort="2" velocity="3"', Limits(-1, 1, 3, 2)),
        ('lower="1" upper="0"', Limits(0, 1)),
        ('lower="1"', Limits(0, 1)),
        ('lower="0.5" upper="0.5" effort="2" velocity="-3"', Limits(None, None, None, 2)),
        ('lower="-1" upper="1" effort="0" velocity="0"', Limits(-1, 1)),
    ],
)
def test_limits_that_say_nothing_are_not_obeyed(numbers, limits, written):
    assert read_urdf(written(limited(numbers)))[1].joints[0].limits == limits
    (joint,) = quietly(written(limited(numbers))).joints
    (coordinate,) = joint.own_coordinates()
    assert float(coordinate.motion.position) == 0


def test_mends_do_not_change_the_motion(written):
    """Every text of the pendulum means the same pendulum, with the mass matrix of the plain one."""
    plain = merge(read_urdf(written(GOOD))[1])
    same = ("a turned axis", "both halves of an inertia", "halves that differ", "swapped limits", "a default namespace")
    same += ("a blank before the declaration", "zeros at the end", "two bytes a letter", "what xacro left")
    for case in same:
        whole = merge(read_urdf(written(LOADED[case][0]))[1])
        assert whole.joints[0]._replace(limits=None, line=0) == plain.joints[0]._replace(limits=None, line=0), case
        np.testing.assert_array_equal(whole.bodies["a"].inertia, plain.bodies["a"].inertia)


def accelerations(mechanism, angle=0.0):
    ready = mechanism.prepare()
    count = len(ready.joints)
    y = jnp.array([angle] * count + [0.0] * count)
    return np.asarray(jax.jit(lambda y: slope(jnp.zeros(()), y, ready))(y))[count:]


def test_a_point_mass_swings_as_a_pendulum(written):
    for case in ("a point mass", "no inertia"):
        found = accelerations(quietly(written(LOADED[case][0])))
        assert found == pytest.approx([9.81 / 0.5], rel=1e-14)


REFUSED = {
    "a triangle by 3 %": (
        mini(inertial("0.01", diagonal(9e-7, 2e-6, 3e-6))),
        f"{LINE}: link `a`: no body has its principal moments of inertia 9e-07, 2e-06 and 3e-06 kg*m^2",
    ),
    "a triangle": (mini(inertial(moments=diagonal(0.001, 0.002, 0.01))), "0.001, 0.002 and 0.01 kg*m^2"),
    "a negative moment": (mini(inertial(moments=diagonal(-0.01, 0.01, 0.02))), "-0.01, 0.01 and 0.02 kg*m^2"),
    "no mass": (
        mini(f"<inertial><inertia {MOMENTS}/></inertial>"),
        f'{LINE}: link `a` lacks <mass>. Add one, as <mass value="1.2"/>.',
    ),
    "no inertials": (mini(""), "line 5: joint `j` can move without moving any mass. Give the link `a`"),
    "a point on the axis": (
        mini(inertial(moments=None, origin="0 0.3 1e-17")),
        "line 5: joint `j` can move without moving any mass",
    ),
    "two different axes": (mini(axis='<axis xyz="0 1 0"/><axis xyz="0 0 1"/>'), "joint `j` has 2 <axis>"),
    "one half only": (
        mini(inertial(moments=MOMENTS.replace("ixy", "iyx"))),
        "an attribute `iyx`, which is not known",
    ),
    "damping of three kinds": (
        mini(kind="planar", limit="", in_joint='<dynamics damping="0.1 0.1 0.2"/>'),
        "`damping` of <dynamics> must be one number, but it is '0.1 0.1 0.2'",
    ),
    "a ball": (mini(kind="spherical", limit=""), "joint `j` has the type 'spherical', which is no known one"),
    "commas": (GOOD.replace('"0.2 0 0"', '"0.2, 0, 0"'), "has a comma: '0.2,'"),
    "nothing moves": ("<robot name='r'><link name='a'/></robot>", "nothing of the robot moves: every joint is fixed"),
    "a loop": (mini(beside='<loop_joint name="close" type="continuous"/>'), "loop_joint `close` closes a loop"),
    "a dialect": (mini(head=DRAKE, beside='<drake:joint name="k"/>'), "but of the dialect 'http://drake.mit.edu'"),
    "a macro": (
        mini(
            head=' xmlns:xacro="http://www.ros.org/wiki/xacro"',
            beside='<xacro:macro name="m"><link name="z"/></xacro:macro>\n<xacro:m/>',
        ),
        "line 7: <xacro:m> is a macro, not yet a robot. Install xacro",
    ),
    "a condition": (mini(beside='<xacro:if value="1"/>'), "line 6: <xacro:if> is a macro"),
    "an expression": (GOOD.replace('"0.2 0 0"', '"${length} 0 0"'), "is to be expanded by xacro. Install xacro"),
    "a zero in the middle": (GOOD.replace("mini", "mi\0ni"), "is not valid XML"),
    "a mimic without a number": (
        mini(beside=second(inner='<mimic joint="j" multiplier="x"/>')),
        "`multiplier` of <mimic> must be written as plain decimal numbers, but it holds 'x'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_by_line_and_element(case, written, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    text, words = REFUSED[case]
    said = refusal(written(text), mimic="independent")
    assert words in said
    assert "robot.urdf" in said
    assert len(said) <= LONGEST


LEFTOVERS = '<xacro:x name="y"/>' * 20_000
UNCALLED = "".join(f'<xacro:macro name="m{i}"/>' for i in range(10_000))
HOSTILE = {
    "comments without end": "\n" + "<!--" * 250_000 + GOOD,
    "declarations without end": "\n" + "<?xml " * 200_000 + GOOD,
    "an unbound prefix, then comments": "<robot><a:b/>" + "<!--" * 250_000,
    "many leftovers": mini(kind="spherical", beside=LEFTOVERS),
    "many macros": mini(kind="spherical", beside=UNCALLED),
    "many mimics": mini(in_joint='<mimic joint="gone"/>' * 20_000),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_text_is_refused_in_time_that_grows_with_its_size(case, written):
    """Quadratic time would be minutes here."""
    assert "robot.urdf" in refusal(written(HOSTILE[case]))


# Inertias on request --------------------------------------------------------------------------------------------------


def body(path, name="a", **options):
    mechanism = quietly(path, **options)
    (found,) = (each for each in mechanism.bodies if each.name == name)
    inertia: Any = found.inertia
    center = [
        0.0 if x is None else float(x) for x in (found.center_of_mass.x, found.center_of_mass.y, found.center_of_mass.z)
    ]
    six = [
        0.0 if x is None else float(x) for x in (inertia.xx, inertia.yy, inertia.zz, inertia.xy, inertia.xz, inertia.yz)
    ]
    return float(found.mass), center, six, mechanism.notes


def test_balance_takes_the_mean_of_impossible_moments(written):
    bad = 'ixx="0.001" iyy="0.002" izz="0.01" ixy="0.0005" ixz="0" iyz="0"'
    mass, center, six, notes = body(written(mini(inertial(moments=bad))), inertia="balance")
    assert (mass, center) == (1, [0.1, 0, 0])
    assert six == pytest.approx([0.013 / 3] * 3 + [0, 0, 0], rel=1e-15)
    assert notes == (f"assumed: moments that no body has are replaced by their mean ({LINE})",)
    assert body(written(GOOD), inertia="balance") == (1, [0.1, 0, 0], [0.01, 0.012, 0.014, 0, 0, 0], ())
    said = refusal(written(mini(inertial(moments=diagonal(-1, 0, 0)))), inertia="balance")
    assert "no body has its principal moments of inertia -1, 0 and 0" in said


def shape(inner, tag="collision", origin=""):
    return f"<{tag}>{origin}<geometry>{inner}</geometry></{tag}>"


BOX = '<box size="0.4 0.1 0.2"/>'
OF_BOX = np.array([0.1**2 + 0.2**2, 0.4**2 + 0.2**2, 0.4**2 + 0.1**2]) / 12


@pytest.mark.parametrize(
    ("inner", "mass", "moments"),
    [
        (BOX, 8.0, 8.0 * OF_BOX),
        ('<cylinder radius="0.1" length="0.5"/>', 5 * np.pi, 5 * np.pi * np.array([0.07 / 3, 0.07 / 3, 0.005])),
        ('<sphere radius="0.3"/>', 36 * np.pi, 36 * np.pi * np.array([0.036, 0.036, 0.036])),
    ],
)
def test_robots_without_mass_weigh_what_their_shapes_weigh(inner, mass, moments, written):
    path = written(mini(shape(inner) + shape('<sphere radius="9"/>', "visual")))
    found, _, six, notes = body(path, inertia="from-geometry")
    cylinder = np.array([0.1**2 / 4 + 0.5**2 / 12] * 2 + [0.1**2 / 2]) * 5 * np.pi
    assert found == pytest.approx(mass, rel=1e-14)
    assert six[:3] == pytest.approx(cylinder if "cylinder" in inner else moments, rel=1e-14)
    assert notes == (f"assumed: mass and inertia are those of <collision> at 1000 kg/m^3 ({LINE})",)
    heavy, _, _, said = body(path, inertia="from-geometry", density=2700.0)
    assert heavy == pytest.approx(2.7 * mass, rel=1e-14)
    assert "at 2700 kg/m^3" in said[0]


def test_two_shapes_add_up_in_the_frame_of_the_link(written):
    """A dumb-bell of two boxes, one turned by a quarter about z, by Steiner's theorem."""
    left = shape(BOX, "visual", '<origin xyz="0 0.5 0"/>')
    right = shape(BOX, "visual", '<origin xyz="0 -0.5 0" rpy="0 0 1.5707963267948966"/>')
    mass, center, six, _ = body(written(mini(left + right)), inertia="from-geometry")
    x, y, z = 8 * OF_BOX
    assert (mass, center) == (pytest.approx(16, rel=1e-14), pytest.approx([0, 0, 0], abs=1e-15))
    assert six[:3] == pytest.approx([x + y + 16 / 4, x + y, 2 * z + 16 / 4], rel=1e-13)
    assert six[3:] == pytest.approx([0, 0, 0], abs=1e-15)


def test_a_mass_takes_the_inertia_of_its_shapes(written):
    """Whether its moments are impossible or absent; the centre of mass stays. A good link stays as it is."""
    for moments in (diagonal(0.001, 0.002, 0.01), None):
        path = written(mini(inertial("2", moments) + shape(BOX)))
        mass, center, six, notes = body(path, inertia="from-geometry")
        assert (mass, center) == (2, [0.1, 0, 0])
        assert six == pytest.approx([*2 * OF_BOX, 0, 0, 0], rel=1e-14)
        assert f"the inertia is that of <collision>, scaled to the mass ({LINE})" in notes[0]
    good = body(written(mini(inertial() + shape(BOX))), inertia="from-geometry")
    assert good == (1, [0.1, 0, 0], [0.01, 0.012, 0.014, 0, 0, 0], ())
    frame = f'<link name="tip">{shape(BOX)}</link><joint name="on" type="fixed"><parent link="a"/>'
    frame += '<child link="tip"/></joint>'
    assert body(written(mini(beside=frame)), inertia="from-geometry") == good  # a frame on a body that weighs


def test_a_mesh_weighs_as_its_volume(written, tmp_path):
    trimesh: Any = pytest.importorskip("trimesh")
    (tmp_path / "meshes").mkdir()
    mesh = trimesh.creation.box((400, 100, 200))
    mesh.apply_translation((100, 0, 0))
    mesh.export(tmp_path / "meshes" / "box.stl")
    text = mini(shape('<mesh filename="package://mini/meshes/box.stl" scale="0.001 0.001 0.001"/>'))
    mass, center, six, _ = body(written(text), inertia="from-geometry")
    assert mass == pytest.approx(8, rel=1e-6)  # an STL has single precision
    assert center == pytest.approx([0.1, 0, 0], abs=1e-7)
    assert six == pytest.approx([*8 * OF_BOX, 0, 0, 0], rel=1e-5, abs=1e-8)
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "meshes" / "box.stl")
    opened, _, _, notes = body(written(text), inertia="from-geometry")
    assert opened == pytest.approx(8, rel=1e-6)
    assert "a mesh that is not closed has the inertia of its convex hull" in notes[0]


@pytest.mark.parametrize(
    ("inner", "words"),
    [
        ('<mesh filename="none.stl"/>', "its mesh cannot be read: there is no file `none.stl`"),
        ('<capsule radius="1" length="1"/>', "a <capsule> has no known inertia"),
        ('<sphere radius="0"/>', "its <sphere> must have a volume above 0"),
        ('<sphere radius="r"/>', "`radius` of <sphere> must be written as plain decimal numbers"),
        ("", "<geometry> must hold one shape, but it holds 0"),
    ],
)
def test_shapes_that_cannot_weigh_are_refused(inner, words, written):
    said = refusal(written(mini(shape(inner))), inertia="from-geometry")
    assert words in said
    assert "line 4" in said


def test_a_link_without_shapes_has_no_inertia_to_take(written):
    said = refusal(written(REFUSED["a triangle"][0]), inertia="from-geometry")
    assert "`inertia='balance'` or, if the link has shapes, `inertia='from-geometry'`" in said


def test_a_base_that_stands_need_not_weigh(written):
    """Its mesh may be missing."""
    mesh = shape('<mesh filename="none.stl"/>')
    path = written(mini(shape(BOX)).replace('<link name="base"/>', f'<link name="base">{mesh}</link>'))
    assert body(path, inertia="from-geometry")[0] == pytest.approx(8)
    assert "there is no file `none.stl`" in refusal(path, base="free", inertia="from-geometry")


def test_a_flying_base_without_mass_is_told_of_its_shapes(written):
    path = written(GOOD.replace('<link name="base"/>', f'<link name="base">{shape(BOX)}</link>'))
    assert "shapes and load the robot with `inertia='from-geometry'`" in refusal(path, base="free")
    assert body(path, "base", base="free", inertia="from-geometry")[0] == pytest.approx(8)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inertia": "mend"}, "`inertia` must be one of the allowed words"),
        ({"density": 1000.0}, "`density` goes with `inertia='from-geometry'`"),
        ({"inertia": "from-geometry", "density": -1.0}, "and is a number above 0"),
    ],
)
def test_wrong_options_are_refused(options, words, written):
    assert words in refusal(written(GOOD), **options)


# Scenes and commands --------------------------------------------------------------------------------------------------


def test_a_scene_mends_inertias_and_names_its_own_keys(written, tmp_path):
    written(mini(shape(BOX)))
    scene = tmp_path / "scene.toml"
    scene.write_text('[robot]\nfile = "robot.urdf"\n')
    with pytest.raises(ClearanceError) as caught:
        cj.load(scene)
    assert 'shapes and load the robot with `robot.inertia = "from-geometry"`' in str(caught.value)
    scene.write_text('[robot]\nfile = "robot.urdf"\ninertia = "from-geometry"\ndensity = "2.7 g/cm^3"\n')
    with pytest.warns(NotReadWarning) as told:
        mechanism = cj.load(scene)
    assert "scene.toml: assumed: mass and inertia are those of <collision> at 2700 kg/m^3" in str(told[0].message)
    assert float(mechanism.bodies[0].mass) == pytest.approx(21.6)
    scene.write_text('[robot]\nfile = "robot.urdf"\ninertia = "mend"\n')
    with refused("robot.inertia", "mend", "balance"):
        cj.load(scene)


def run(*words):
    """What a command prints, or what it raises (the entry point prints it, with exit code 2)."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exception is None or isinstance(result.exception, ClearanceError)
    return str(result.exception or " ".join(result.output.split()))


def test_commands_take_the_options_of_a_robot(written, tmp_path):
    path = written(mini(shape(BOX)))
    assert "shapes and load the robot with `--inertia from-geometry`" in run("check", path)
    weighing = run("check", path, "--inertia", "from-geometry", "--density", "2700kg/m^3")
    assert "a valid robot" in weighing
    assert "those of <collision> at 2700 kg/m^3" in weighing
    assert "`--density` needs a unit" in run("check", path, "--inertia", "from-geometry", "--density", "2700")
    flying = written(GOOD.replace('<link name="base"/>', f'<link name="base">{inertial()}</link>'))
    assert "floating_base" in run("check", flying, "--base", "free")
    following = written(LOADED["a mimic"][0])
    assert "a valid robot" in run("check", following, "--mimic", "independent")
    assert "`mimic` must be one of the allowed words" in run("check", following, "--mimic", "refuse")
    scene = tmp_path / "scene.toml"
    scene.write_text('[robot]\nfile = "robot.urdf"\n')
    assert 'In a scene write `robot.base = "free"`' in run("check", scene, "--base", "free")


@pytest.mark.slow
def test_info_and_simulate_take_them_too(written, tmp_path):
    path, weighing = written(mini(shape(BOX))), ("--inertia", "from-geometry")
    assert "shapes and load the robot with `--inertia from-geometry`" in run("info", path)
    assert "a.mass" in run("info", path, *weighing)
    result = tmp_path / "robot.nc"
    run("simulate", path, "--t1", "1 ms", "--samples", 2, *weighing, "-o", result)
    assert "those of <collision> at 1000 kg/m^3" in cj.load_dataset(result).attrs["notes"]
    assert "the error of a point" not in run("info", path, *weighing, "--budget", "--point", "base", "--t1", "1 ms")


# xacro ----------------------------------------------------------------------------------------------------------------

MACRO = """<robot name="mini" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="length" value="0.2"/>
<xacro:macro name="arm" params="at"><link name="base"/><link name="a">INERTIAL</link>
<joint name="j" type="revolute">
<origin xyz="${at} 0 0"/><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
</xacro:macro>
<xacro:arm at="${length}"/>
</robot>
""".replace("INERTIAL", inertial())


class Expander(types.ModuleType):
    """Stands for the package xacro: gives a document of the text, or fails."""

    def __init__(self, text):
        super().__init__("xacro")
        self.text, self.asked = text, []
        self.__spec__ = types.SimpleNamespace(name="xacro")  # pyright: ignore[reportAttributeAccessIssue]

    def process_file(self, path):
        self.asked.append(path)
        if self.text is None:
            raise RuntimeError("unknown macro name: xacro:arm")
        return types.SimpleNamespace(toprettyxml=lambda indent: self.text)


def test_macros_are_expanded_by_xacro_if_it_is_there(written, monkeypatch):
    expander = Expander(GOOD)
    monkeypatch.setitem(sys.modules, "xacro", expander)
    for name in ("robot.urdf", "robot.urdf.xacro"):
        path = written(MACRO, name)
        with pytest.warns(NotReadWarning) as told:
            mechanism = cj.load(path)
        assert "assumed: the file is expanded by xacro, so that lines are those of" in str(told[0].message)
        assert [joint.name for joint in mechanism.joints] == ["j"]
        assert expander.asked[-1] == str(path)
    assert cj.load_urdf(written(GOOD)).notes == ()
    assert len(expander.asked) == 2
    monkeypatch.setitem(sys.modules, "xacro", Expander(None))
    assert "robot.urdf.xacro`: xacro cannot expand it: RuntimeError, unknown macro name" in refusal(path)


def test_xacro_itself_expands_a_macro(written):
    pytest.importorskip("xacro")
    mechanism = quietly(written(MACRO))
    assert float(mechanism.joints[0].at_parent.x) == 0.2
