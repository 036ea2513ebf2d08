"""Meshes of a robot's file in the page: where they lie, what is missing, what else the dataset must hold."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from motions import arm
from places import SCENES, refused
from scipy.spatial.transform import Rotation
from test_page import Read

import clearance_jax as cj
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.state import layout
from clearance_jax.results.places import body_poses, mark_positions, marks

pytest.importorskip("trimesh", reason="needs the extra `meshes`")

# A tetrahedron, a name as of a package, and one that is nowhere.
STL = """solid t
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 10 0 0
vertex 0 20 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 20 0
vertex 0 0 30
endloop
endfacet
endsolid t
"""
LINK = '<link name="{name}">'
LINK += '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LINK += '<visual><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><geometry>{shape}</geometry></visual></link>'
JOINT = '<joint name="axis_{k}" type="revolute"><parent link="{parent}"/><child link="link_{k}"/></joint>'
SHAPES = {
    "link_0": '<mesh filename="package://robot/meshes/part.stl" scale="0.001 0.001 0.001"/>',
    "link_1": '<box size="0.1 0.2 0.3"/>',
    "link_2": '<mesh filename="nowhere.stl"/>',
}


@pytest.fixture
def robot(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "part.stl").write_text(STL)
    links = "".join(LINK.format(name=name, shape=shape) for name, shape in SHAPES.items())
    joints = "".join(JOINT.format(k=k, parent=f"link_{k - 1}" if k else "base") for k in range(3))
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="robot"><link name="base"/>{links}{joints}</robot>')
    return path


def moving() -> tuple[xr.Dataset, np.ndarray]:
    """An arm of three links with the poses of its bodies, whose places and rotations are any."""
    dataset, rng = arm(21, 3), np.random.default_rng(3)
    turns = Rotation.from_rotvec(rng.normal(size=3) + np.outer(np.linspace(0, 6, 21), [0.3, 1.0, -0.5])).as_matrix()
    place = dataset["mark_position"].values[:, 1::2][:, :3]
    dataset["body_position"] = ("time", "body", "axis"), place
    dataset["body_rotation"] = ("time", "body", "axis", "own_axis"), np.repeat(turns[:, None], 3, axis=1)
    return dataset.assign_coords(body=["link_0", "link_1", "link_2"]), turns


def test_meshes_lie_where_their_bodies_are(robot):
    dataset, turns = moving()
    read = Read(cj.view(dataset, urdf=robot).html)
    parts = {part["name"]: part for part in read.scene["parts"] if part["kind"] == "mesh"}
    assert parts.keys() == {"link_0", "link_1"}
    corners = read.arrays[parts["link_0"]["meshes"][0]["positions"]]
    # Turned by a quarter about z, then moved.
    expected = np.array([[0.1, 0, 0], [0.1, 0.01, 0], [0.08, 0, 0], [0.1, 0, 0.03]])
    off = np.linalg.norm(corners[:, None] - expected, axis=-1).min(axis=1)
    assert off.max() < 1e-5
    assert len(read.arrays[parts["link_1"]["meshes"][0]["faces"]]) == 12
    np.testing.assert_allclose(read.arrays[parts["link_0"]["position"]], dataset["body_position"][:, 0], atol=1e-7)
    numbers = read.arrays[parts["link_0"]["rotation"]]
    np.testing.assert_allclose(Rotation.from_quat(numbers).as_matrix(), turns, atol=1e-6)
    # Between samples the page interpolates them: no sign may jump.
    assert np.sum(numbers[1:] * numbers[:-1], axis=1).min() > 0
    left = {part["name"] for part in read.scene["parts"] if part["kind"] == "body"}
    assert left == {"link_2"}
    assert re.search(r"without their meshes: link_2: there is no file `nowhere.stl`", read.scene["notes"][-1])


def test_the_ideal_body_is_where_its_ideal_marks_are(robot):
    dataset, _ = moving()
    read = Read(cj.view(dataset, urdf=robot).html)
    part = next(part for part in read.scene["parts"] if part["kind"] == "mesh" and part["name"] == "link_1")
    marks = [k for k, body in enumerate(dataset["mark_body"].values) if body == "link_1"]
    actual, ideal = (dataset[name].values[:, marks] for name in ("mark_position", "ideal_mark_position"))
    shift, lean = (read.arrays[part[name]] for name in ("shift", "lean"))
    arms = actual - dataset["body_position"].values[:, 1][:, None]
    # The links here are not rigid, so a mark may stretch along its link; across it the fit is exact.
    left = actual - ideal - (shift[:, None] + np.cross(lean[:, None], arms))
    along = (actual[:, 1] - actual[:, 0]) / np.linalg.norm(actual[:, 1] - actual[:, 0], axis=1, keepdims=True)
    left = left - np.sum(left * along[:, None], axis=-1, keepdims=True) * along[:, None]
    assert np.abs(left).max() < 0.01 * np.abs(actual - ideal).max()


def test_a_dataset_without_poses_is_refused(robot):
    with refused("dataset"):
        cj.view(arm(11, 3), urdf=robot)


def test_a_file_that_is_no_robot_is_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text("<sdf/>")
    with pytest.raises(ClearanceError) as caught:
        cj.view(moving()[0], urdf=path)
    assert f"{path}`: a URDF file must hold a <robot>" in str(caught.value)


def test_poses_place_what_bodies_carry():
    """A mark on a body is at the body's place plus its rotation of where the mark is in its frame."""
    mechanism = cj.load(SCENES / "six_axes.urdf").prepare()
    state = jnp.asarray(np.random.default_rng(5).uniform(-1, 1, layout(mechanism).size))
    poses, places = body_poses(mechanism, jnp.asarray(0.0), state), mark_positions(mechanism, jnp.asarray(0.0), state)
    bodies = [body.name for body in mechanism.bodies]
    turns = np.asarray(poses["body_rotation"])
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    for mark, place in zip(marks(mechanism), places, strict=True):
        if mark.body in bodies:
            k = bodies.index(mark.body)
            inside = turns[k] @ np.array([0.0 if x is None else float(x) for x in mark.at.vector])
            np.testing.assert_allclose(poses["body_position"][k] + inside, place, atol=1e-12)
