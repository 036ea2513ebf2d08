"""URDF files: what is refused and how, what a stranger's XML cannot do, and links merged against direct sums."""

import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax.errors import LONGEST, ClearanceError
from clearance_jax.io.urdf.bodies import mass_matrix, merge
from clearance_jax.io.urdf.elements import read_xml
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.robot import Mimic, rotation_of, rpy_of
from clearance_jax.mechanism.body import Limits
from tests.urdf_cases import ARM, AXIS, BAD, INERTIA, MASS, ZERO, hinge, link, robot
from tests.urdf_reference import homogeneous, poses, pseudo_inertia, tree

pytestmark = pytest.mark.quick


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "robot.urdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refused(path, words):
    with pytest.raises(ClearanceError) as caught:
        cj.load_urdf(path)
    said = str(caught.value)
    assert words in said
    assert path.name in said
    assert len(said) <= LONGEST
    assert said.endswith((".", "`."))
    return said


def test_what_a_file_says(written):
    text, robot = read_urdf(written(ARM))
    assert text == ARM
    assert (robot.name, robot.root) == ("arm", "base")
    shoulder, elbow, flange = robot.joints
    assert (shoulder.xyz, shoulder.rpy, shoulder.axis) == ((0, 0, 0.3), (0, 0, 0.5), (0, 0, 1))
    assert shoulder.limits == Limits(-2, 2.5, 3, 40)
    assert (shoulder.damping, shoulder.friction) == (0.5, 0.1)
    assert (elbow.axis, elbow.limits) == ((0, 1, 0), Limits(None, None, 4, None))
    assert (flange.kind, flange.limits, flange.mimic) == ("fixed", None, None)
    base, upper, fore, _ = robot.links
    assert (base.mass, upper.mass, fore.line) == (0, 2.5, 13)
    assert upper.center.tolist() == [0.1, 0.02, -0.03]
    given = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.04]])
    turn = rotation_of((0.1, -0.2, 0.3))
    np.testing.assert_allclose(upper.inertia, turn @ given @ turn.T, atol=1e-17)
    np.testing.assert_array_equal(fore.inertia, given)


def test_defaults_of_the_format(written):
    text = ARM.replace('<axis xyz="0 0 1"/>', "").replace('lower="-2" upper="2.5"', 'upper="2.5"')
    text = text.replace('ixy="0.001" ixz="-0.002" iyz="0.003"', "")
    (shoulder, elbow, _), links = read_urdf(written(text))[1].joints, read_urdf(written(text))[1].links
    assert shoulder.axis == (1, 0, 0)
    assert shoulder.limits == Limits(0, 2.5, 3, 40)
    assert (elbow.rpy, elbow.damping) == ((0, 0, 0), 0)
    np.testing.assert_array_equal(links[2].inertia, np.diag([0.02, 0.03, 0.04]))
    nothing_said = ARM.replace('lower="-2" upper="2.5" ', "")
    assert read_urdf(written(nothing_said))[1].joints[0].limits == Limits(None, None, 3, 40)


def test_joints_come_parents_first_and_limb_by_limb(written):
    links = "".join(f'<link name="{name}"/>' for name in "fedcba")

    def joint(parent, child):
        return f'<joint name="{parent}{child}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'

    pairs = ("cd", "ab", "bc", "ae", "ef")
    text = f"<robot name='r'>{links}{''.join(joint(*pair) for pair in pairs)}</robot>"
    _, robot = read_urdf(written(text))
    assert [j.name for j in robot.joints] == ["ab", "bc", "cd", "ae", "ef"]
    assert robot.root == "a"


# What is refused ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_refused_by_name(case, written):
    old, new, words = BAD[case]
    assert ARM.count(old) >= 1
    said = refused(written(ARM.replace(old, new, 1)), words)
    assert "line" in said or "robot" in said


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ("", Mimic("shoulder", 1.0, 0.0)),
        ('multiplier="-2" offset="0.25"', Mimic("shoulder", -2.0, 0.25)),
        ('multiplier="0"', Mimic("shoulder", 0.0, 0.0)),
    ],
)
def test_what_a_joint_follows(written, numbers, expected):
    _, robot = read_urdf(written(ARM.replace(AXIS, f'{AXIS}<mimic joint="shoulder" {numbers}/>')))
    assert [joint.mimic for joint in robot.joints] == [None, expected, None]


@pytest.mark.parametrize("number", ['multiplier="nan"', 'offset="1e999"', 'offset="two"', 'multiplier=""'])
def test_what_a_joint_follows_is_finite(written, number):
    refused(written(ARM.replace(AXIS, f'{AXIS}<mimic joint="shoulder" {number}/>')), f"`{number.split('=')[0]}` of")


def test_joints_that_mimic_in_a_circle(written):
    text = ARM.replace(AXIS, AXIS + '<mimic joint="shoulder"/>')
    text = text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="elbow" multiplier="-2"/>')
    refused(written(text), "`shoulder`, `elbow` mimic one another")


@pytest.mark.slow
def test_a_chain_of_thousands_is_judged_at_once(written):
    links = "".join(f'<link name="l{i}"/>' for i in range(1999))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>' for i in range(1998)
    )
    _, robot = read_urdf(written(f"<robot name='r'>{links}{joints}</robot>"))
    assert len(robot.joints) == 1998
    more = links + "".join(f'<link name="m{i}"/>' for i in range(2))
    refused(written(f"<robot name='r'>{more}{joints}</robot>"), "has 2001 links, but 2000 are the most")


# XML ------------------------------------------------------------------------------------------------------------------

LAUGHS = "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))
TRICKS = {
    "billion laughs": f'<!DOCTYPE r [<!ENTITY l0 "lol">{LAUGHS}]><robot name="&l9;"/>',
    "one entity": '<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>',
    "a file": '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>',
    "an address": '<!DOCTYPE r SYSTEM "http://localhost:9/evil.dtd"><robot name="r"/>',
    "a parameter entity": '<!DOCTYPE r [<!ENTITY % a SYSTEM "http://localhost:9/x"> %a;]><robot name="r"/>',
}


@pytest.mark.parametrize("trick", TRICKS)
def test_document_types_are_refused(trick, written, monkeypatch):
    monkeypatch.setattr("socket.socket", None)
    said = refused(written(TRICKS[trick]), "declares a document type")
    assert "passwd" not in said


NOT_XML = {
    "nothing": (b"", "not valid XML"),
    "no element": (b"<?xml version='1.0'?>", "not valid XML: no element found"),
    "half a file": (ARM[:900].encode(), "not valid XML"),
    "an unknown entity": (b'<robot name="&what;"/>', "not valid XML: undefined entity"),
    "two elements": (b"<robot/><robot/>", "not valid XML: junk after document element"),
    "an attribute twice": (b'<robot name="a" name="b"/>', "not valid XML: duplicate attribute"),
    "an unbound prefix": (b"<r><sensor:camera/></r>", "not valid XML: unbound prefix"),
    "a zero byte": (b'<robot name="a\0"/>', "not valid XML"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not valid XML"),
    "nested without end": (b"<a>" * 200_000, "nested deeper than 100"),
    "a scene": (b'name = "slider-crank"', "not valid XML"),
}


@pytest.mark.parametrize("case", NOT_XML)
def test_what_is_no_xml_is_refused(case, written):
    data, words = NOT_XML[case]
    refused(written(data), words)


def test_a_file_too_large_is_not_read(written, monkeypatch):
    monkeypatch.setattr("clearance_jax.io.urdf.elements.LARGEST_XML", 1_000_000)
    refused(written(ARM + " " * 1_000_000), "larger than 1 MB")


def test_what_is_no_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "none.urdf"):
        with pytest.raises(ClearanceError, match="URDF file"):
            read_urdf(path)


def test_declared_encodings_and_marks_do_not_matter(written):
    for start in (b"\xef\xbb\xbf", b""):
        text = start + ARM.replace('version="1.0"?', 'version="1.0" encoding="utf-8"?').encode()
        assert read_urdf(written(text))[1].name == "arm"


def test_elements_know_their_lines(written):
    _, top = read_xml(written("<a>\n<b/>\n\n<c\n x='1'><d/></c></a>"), "file")
    b, c = top
    assert (top.line, b.line, c.line, c[0].line) == (1, 2, 4, 5)
    assert c.attrib == {"x": "1"}


# Merging --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_merging_against_direct_sums(seed, written):
    _, robot = read_urdf(written(tree(seed)))
    whole = merge(robot)
    q = {joint.name: 0.1 * i - 0.5 for i, joint in enumerate(robot.joints)}
    links, bodies = poses(robot.root, robot.joints, q), poses(robot.root, whole.joints, q)
    assert set(bodies) == set(whole.bodies)
    for name, (body, pose) in whole.frames.items():
        here = np.eye(4)
        here[:3, :3], here[:3, 3] = pose.rotation, pose.position
        np.testing.assert_allclose(bodies[body] @ here, links[name], atol=1e-14)
    for name, body in whole.bodies.items():
        parts = [link for link in robot.links if whole.frames[link.name].body == name]
        assert sorted(body.links) == sorted(link.name for link in parts)
        assert body.links[0] == name
        expected = np.zeros((4, 4))
        for part in parts:
            expected += links[part.name] @ pseudo_inertia(part.mass, part.center, part.inertia) @ links[part.name].T
        found = bodies[name] @ pseudo_inertia(body.mass, body.center, body.inertia) @ bodies[name].T
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_is_not_merged_stays_as_written(written):
    whole = merge(read_urdf(written(ARM))[1])
    assert [joint.name for joint in whole.joints] == ["shoulder", "elbow"]
    assert whole.joints == read_urdf(written(ARM))[1].joints[:2]
    fore = whole.bodies["fore"]
    assert (fore.mass, fore.links) == (1.5, ("fore", "tool"))
    assert fore.inertia[0, 1] == 0.001
    body, pose = whole.frames["tool"]
    assert body == "fore"
    assert pose.position.tolist() == [0.3, 0, 0.01]


@pytest.mark.parametrize("seed", range(5))
def test_turns_are_found_again(seed):
    rng = np.random.default_rng(seed)
    for pitch in (rng.uniform(-1.5, 1.5), np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-7, np.pi / 2 + 1e-12):
        rpy = np.array([rng.uniform(-3, 3), pitch, rng.uniform(-3, 3)])
        turn = homogeneous((0, 0, 0), rpy)[:3, :3]
        np.testing.assert_allclose(rotation_of(rpy), turn, atol=1e-15)
        np.testing.assert_allclose(rotation_of(rpy_of(turn)), turn, atol=4e-15)
    assert rpy_of(rotation_of((0, 0, 0.7))).tolist()[:2] == [0, 0]
    assert rpy_of(np.eye(3)).tolist() == [0, 0, 0]


# Bodies that cannot be moved, or cannot be ----------------------------------------------------------------------------


PARTS = link("base"), link("cross", ""), link("arm")
BETWEEN = {
    "a cardan": (hinge("a", "base", "cross", "1 0 0"), hinge("b", "cross", "arm", "0 1 0"), True),
    "in line": (hinge("a", "base", "cross", "0 0 1"), hinge("b", "cross", "arm", "0 0 1", "0 0 0.5"), False),
    "parallel": (hinge("a", "base", "cross", "0 0 1"), hinge("b", "cross", "arm", "0 0 1", "0.5 0 0"), True),
    "a slide": (
        hinge("a", "base", "cross", "0 0 1", kind="prismatic"),
        hinge("b", "cross", "arm", "0 0 1", "0.5 0 0"),
        True,
    ),
    "before six": (hinge("a", "base", "cross", "0 0 1"), hinge("b", "cross", "arm", "", kind="floating"), False),
    "across a plane": (hinge("a", "base", "cross", "1 0 0"), hinge("b", "cross", "arm", "0 0 1", kind="planar"), True),
    "in a plane": (hinge("a", "base", "cross", "1 0 0"), hinge("b", "cross", "arm", "1 0 0", kind="planar"), False),
}


@pytest.mark.parametrize("case", BETWEEN)
def test_links_without_mass_between_joints(case, written):
    *joints, moves = BETWEEN[case]
    path = written(robot(*PARTS, *joints))
    if moves:
        assert [(body.name, body.mass is None) for body in cj.load_urdf(path).bodies] == [
            ("cross", True),
            ("arm", False),
        ]
    else:
        refused(path, "can move without moving any mass")


def test_the_mass_matrix_of_two_links(written):
    """Against the double pendulum of the textbooks, at the angle that the function chose."""
    text = robot(
        link("base"), link("a"), link("b"), hinge("one", "base", "a", "0 0 1"), hinge("two", "a", "b", "0 0 1", "2 0 0")
    ).replace("<mass", '<origin xyz="1 0 0"/><mass')
    whole = merge(read_urdf(written(text))[1])
    matrix, owners = mass_matrix(whole.joints, {name: whole.bodies[name] for name in "ab"}, 3)
    assert [joint.name for joint in owners] == ["one", "two"]
    turn, m = 0.04 + 1.5, 1.5
    np.testing.assert_allclose(matrix[1, 1], turn, rtol=1e-14)
    cosine = (matrix[0, 1] - turn) / (m * 2)
    assert -1 < cosine < 1
    np.testing.assert_allclose(matrix[0, 0], 2 * turn + m * 4 + 2 * m * 2 * cosine, rtol=1e-14)


def test_what_no_body_has_is_refused(written):
    impossible = INERTIA.replace('izz="0.04"', 'izz="0.4"')
    whole = f"{MASS}{INERTIA}"
    refused(written(ARM.replace(whole, MASS + impossible)), "link `fore` (with 1 link fixed to it): no body has its")
    # Printed with three digits, the moments of a plate need not add up.
    plate = '<inertia ixx="0.0111" iyy="0.0222" izz="0.03331" ixy="0" ixz="0" iyz="0"/>'
    assert cj.load_urdf(written(ARM.replace(whole, MASS + plate))).bodies[1].mass == 1.5
    # What the ground holds is not asked, nor a sensor fixed to what has mass.
    base = ARM.replace('<link name="base"/>', link("base", f"<inertial>{MASS}{impossible}</inertial>"))
    assert len(cj.load_urdf(written(base)).bodies) == 2
    sensor = ARM.replace('<link name="tool"/>', link("tool", f'<inertial><mass value="1e-3"/>{ZERO}</inertial>'))
    assert float(cj.load_urdf(written(sensor)).bodies[1].mass) == pytest.approx(1.501, rel=1e-15)
