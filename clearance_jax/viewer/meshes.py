"""Meshes of a robot's URDF file on the bodies of a motion: STL, OBJ, DAE, and boxes, cylinders and spheres."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from clearance_jax._basis.extras import require
from clearance_jax.errors import ClearanceError, naming
from clearance_jax.io.urdf import elements as xml
from clearance_jax.io.urdf.bodies import merge
from clearance_jax.io.urdf.file import describe, open_urdf
from clearance_jax.io.urdf.inertia import load_mesh
from clearance_jax.io.urdf.robot import rotation_of
from clearance_jax.results.places import names_of
from clearance_jax.viewer.scene import ViewedMotion

# Most faces of a robot in a page; more are merged on a grid, which is made coarser until they fit.
FACES, GRID = 30_000, 192


def with_meshes(scene: dict[str, Any], motion: ViewedMotion, path: str | Path) -> None:
    """Put the meshes of a URDF file in the place of the bodies that have one; what is missing is noted in the scene.

    **Raises:** `ClearanceError` for a file that is no URDF, without the extra `meshes`, for a dataset without poses.
    """
    require("A robot's meshes", "meshes", "trimesh")
    if "body_rotation" not in motion.dataset:
        text = "This result does not hold the poses of bodies in space, which meshes need. Simulate again."
        raise ClearanceError(text).about("dataset")
    _, top = open_urdf(path)
    with naming(f"`{path}`"):
        whole, shapes, missing = merge(describe(top)), {}, []
    bodies = names_of(motion.dataset, "body")
    for link in (element for element in top if element.tag == "link"):
        body, pose = whole.frames[link.get("name", "").strip()]
        for visual in (element for element in link if element.tag == "visual"):
            try:
                vertices, faces = _shape(visual, Path(path).parent)
            except (OSError, ValueError, ImportError, KeyError, ClearanceError) as error:
                missing.append(f"{link.get('name')}: {error}")
                continue
            shapes.setdefault(body, []).append((vertices @ pose.rotation.T + pose.position, faces))
    count = sum(len(faces) for each in shapes.values() for _, faces in each)
    for body, each in shapes.items():
        if body not in bodies and body != whole.root:
            missing.append(f"{body}: the motion has no such body")
            continue
        thin = [_coarser(points, faces, FACES * len(faces) // max(count, FACES)) for points, faces in each]
        add = motion.numbers.add
        stored = [{"positions": add(v, "i2")[0], "faces": add(f, "u4")[0]} for v, f in thin]
        scene["parts"] = [p for p in scene["parts"] if p["kind"] != "body" or p["name"] != body]
        scene["parts"].append({"kind": "mesh", "name": body, "meshes": stored} | _pose(motion, body))
    if missing or not shapes:
        told = "; ".join(missing) or "the file has no <visual>"
        scene["notes"].append(f"Some bodies are shown without their meshes: {told}.")


def _shape(visual: xml.Element, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m], in the link's frame, and triangles of a <visual>."""
    import trimesh

    where = xml.place(visual)
    xyz, rpy = xml.pose(visual, where)
    given = next(iter(xml.need(visual, "geometry", where, '<sphere radius="0.1"/>')))
    if given.tag == "mesh":
        mesh = load_mesh(given, where, folder)
    elif given.tag == "box":
        mesh = trimesh.creation.box(xml.numbers(given, "size", 3, where))
    else:
        sizes = [xml.number(given, key, where) for key in ("radius", "length") if key in given.attrib]
        mesh = trimesh.creation.cylinder(*sizes) if given.tag == "cylinder" else trimesh.creation.icosphere(3, *sizes)
    return np.asarray(mesh.vertices) @ rotation_of(rpy).T + xyz, np.asarray(mesh.faces)


def _coarser(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh of at most so many faces: vertices in one cell of a grid become one."""
    cells = GRID
    while len(faces) > most and cells > 4:
        low, extent = vertices.min(axis=0), max(float(np.ptp(vertices, axis=0).max()), 1e-12)
        _, first, which = np.unique(
            np.round((vertices - low) * (cells / extent)), axis=0, return_index=True, return_inverse=True
        )
        vertices, faces = vertices[first], which.reshape(-1)[faces]
        faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
        cells = int(cells / 1.4)
    return vertices, faces


def _pose(motion: ViewedMotion, body: str) -> dict[str, Any]:
    """Where the page finds a body's place and rotation, and its small `shift` and `lean` from the ideal mechanism."""
    kept, known = motion.kept, body in names_of(motion.dataset, "body")
    chosen = motion.dataset.sel(body=body) if known else None
    place = np.zeros((len(kept), 3)) if chosen is None else chosen["body_position"].values[kept]
    turn = np.tile(np.eye(3), (len(kept), 1, 1)) if chosen is None else chosen["body_rotation"].values[kept]
    numbers = Rotation.from_matrix(turn).as_quat()
    numbers[1:] *= np.cumprod(np.where(np.sum(numbers[1:] * numbers[:-1], axis=1) < 0, -1, 1))[:, None]
    add = motion.numbers.add
    pose: dict[str, Any] = {"position": add(place)[0], "rotation": add(numbers)[0], "shift": None, "lean": None}
    marks = motion.placed.bodies.get(body)
    if motion.error is None or not marks or chosen is None:
        return pose
    # Marks move by shift + lean x arm; of what they leave open, the least.
    size = motion.placed.size
    arms = (motion.placed.at[kept][:, marks] - place[:, None]) / size
    cross = np.cross(np.eye(3), arms[:, :, None, :]).swapaxes(-1, -2)
    rows = np.concatenate([np.broadcast_to(np.eye(3), cross.shape), cross], axis=-1).reshape(len(kept), -1, 6)
    small = (np.linalg.pinv(rows) @ motion.error[kept][:, marks].reshape(len(kept), -1, 1))[..., 0]
    return pose | {"shift": add(small[:, :3], "i2")[0], "lean": add(small[:, 3:] / size, "i2")[0]}
