"""Inertias that no body has, mended on request; masses of robots whose file gives none, from the shapes of links."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax._basis.extras import require
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.io.urdf import elements as xml
from clearance_jax.io.urdf import robot as parts
from clearance_jax.io.urdf.bodies import ROUNDED, SMALLEST, Weight, lack, merge, sum_of
from clearance_jax.io.urdf.text import Note

# Density of a body without mass [kg/m^3]: that of water, as in MuJoCo.
WATER = 1000.0


class Weighing(NamedTuple):
    """How inertias are mended: `how` ("refuse", "balance", "from-geometry"), the `density` of shapes [kg/m^3], whether
    the root link is `free` (else its mass does not matter).
    """

    how: str = "refuse"
    density: float = WATER
    free: bool = False


def with_inertias(robot: parts.Robot, top: xml.Element, folder: Path, weighing: Weighing) -> parts.Robot:
    """The robot with inertias that bodies have, and with what was assumed; `folder`: of the file, beside its meshes."""
    if weighing.how == "refuse":
        return robot
    whole, notes = merge(robot), []
    elements = {element.get("name"): element for element in top if element.tag == "link"}
    links = []
    for link in robot.links:
        body = whole.bodies[whole.frames[link.name].body]
        is_wrong = lack(link) > ROUNDED or (link.mass == 0 and bool(link.inertia.any()))
        is_point = link.mass > 0 and np.abs(link.inertia).max() <= link.mass * SMALLEST**2
        if body.name == whole.root and not weighing.free:
            pass
        elif weighing.how == "balance" and is_wrong and link.mass > 0 and np.trace(link.inertia) > 0:
            link = link._replace(inertia=np.trace(link.inertia) / 3 * np.eye(3))
            notes.append(("moments that no body has are replaced by their mean", link.line))
        elif weighing.how == "from-geometry" and (is_wrong or is_point or body.mass == 0):
            link = _of_shapes(link, elements[link.name], folder, weighing.density, notes)
        links.append(link)
    return robot._replace(links=tuple(links), assumed=(*robot.assumed, *notes))


def _of_shapes(link: parts.Link, element: xml.Element, folder: Path, density: float, notes: list[Note]) -> parts.Link:
    """The link with the inertia of its shapes; without mass also with their mass. Without shapes it stays as it is."""
    tag = "collision" if element.find("collision") is not None else "visual"
    shapes = [_shape(each, folder, notes) for each in element.findall(tag)]
    if not shapes:
        return link
    volume, center, inertia = sum_of(shapes)
    if link.mass > 0:
        notes.append((f"the inertia is that of <{tag}>, scaled to the mass", link.line))
        return link._replace(inertia=inertia * (link.mass / volume))
    notes.append((f"mass and inertia are those of <{tag}> at {density:g} kg/m^3", link.line))
    return link._replace(mass=volume * density, center=center, inertia=inertia * density)


def _shape(element: xml.Element, folder: Path, notes: list[Note]) -> Weight:
    """Volume, centre and inertia of a <collision> or <visual> of density one, in the frame of its link."""
    where = xml.place(element)
    xyz, rpy = xml.pose(element, where)
    holder = xml.need(element, "geometry", where, '<geometry><sphere radius="0.1"/></geometry>')
    if len(holder) != 1:
        raise ClearanceError(f"{where}: <geometry> must hold one shape, but it holds {len(holder)}. Correct it.")
    given = holder[0]
    volume, center, inertia = _of_mesh(given, where, folder, notes) if given.tag == "mesh" else _of_solid(given, where)
    turn = parts.rotation_of(rpy)
    return volume, np.array(xyz) + turn @ center, turn @ inertia @ turn.T


def _of_solid(given: xml.Element, where: str) -> Weight:
    """Volume, centre and inertia of a box, cylinder (along z) or sphere of density one."""
    if given.tag == "box":
        edges = np.array(xml.numbers(given, "size", 3, where))
        volume, squares = np.prod(edges), (edges**2).sum() - edges**2
        moments = volume / 12 * squares
    elif given.tag == "cylinder":
        radius, length = xml.number(given, "radius", where), xml.number(given, "length", where)
        volume = np.pi * radius**2 * length
        moments = volume * np.array([*2 * [radius**2 / 4 + length**2 / 12], radius**2 / 2])
    elif given.tag == "sphere":
        radius = xml.number(given, "radius", where)
        volume = 4 / 3 * np.pi * radius**3
        moments = volume * 0.4 * radius**2 * np.ones(3)
    else:
        raise ClearanceError(f"{where}: a <{given.tag[:60]}> has no known inertia. Write its <inertial>.")
    if not volume > 0:
        raise ClearanceError(f"{where}: its <{given.tag}> must have a volume above 0. Correct its sizes.")
    return float(volume), np.zeros(3), np.diag(moments)


def _of_mesh(given: xml.Element, where: str, folder: Path, notes: list[Note]) -> Weight:
    """The same of a mesh, or of its convex hull if it is not closed."""
    require("The inertia of a mesh", "meshes", "trimesh")
    try:
        mesh = load_mesh(given, where, folder)
        if not (mesh.is_volume and mesh.volume > 0):
            notes.append(("a mesh that is not closed has the inertia of its convex hull", given.line))
            mesh = mesh.convex_hull
        volume, center, inertia = float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia)
    except ClearanceError:
        raise
    except Exception as error:  # readers of meshes raise errors of many kinds
        raise ClearanceError(f"{where}: its mesh cannot be read: {quote(str(error))[1:-1]}. Mend it there.") from None
    if not volume > 0:
        raise ClearanceError(f"{where}: its mesh has no volume. Write its <inertial>.")
    return volume, center, inertia


def load_mesh(given: xml.Element, where: str, folder: Path) -> Any:
    """The mesh that a <mesh> names, beside or above the folder of its file; `OSError` if there is no such file."""
    import trimesh

    name = xml.text(given, "filename", where).removeprefix("file://").removeprefix("package://")
    tails = [name, *("/".join(name.split("/")[k:]) for k in range(1, len(name.split("/"))))]
    files = [above / tail for tail in tails for above in (folder, *folder.resolve().parents[:4])]
    path = next((file for file in files if file.is_file()), None)
    if path is None:
        raise OSError(f"there is no file `{name}`")
    mesh: Any = trimesh.load(path, force="mesh")
    mesh.apply_scale(xml.numbers(given, "scale", 3, where, (1.0, 1.0, 1.0)))
    return mesh
