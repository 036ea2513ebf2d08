"""The worn sleeve of a scene's joint: its depths, listed or from a file."""

from pathlib import Path

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.io.files import read_table
from clearance_jax.io.play_keys import WORN
from clearance_jax.io.table import TomlTable, naming
from clearance_jax.joints import AbstractPin
from clearance_jax.units import to_si

# Tolerance of the angles of a table [deg]: they may be rounded to two decimals.
OFF = 0.01
UNUSED = "has no effect here. Remove it."


def with_wear(clearance: AbstractPin, joint: TomlTable, path: Path) -> AbstractPin:
    """The clearance with its sleeve worn as the table `worn` says, evenly along its length; `path`: of the scene."""
    where = joint.key("worn")
    table = joint.table("worn", WORN)
    if table.has("depth") == table.has("file"):
        raise ClearanceError(f"{where} must have `depth` or `file`, and not both.")
    if table.has("depth"):
        table.refuse("cycles", "unit", why=UNUSED)
        depth = np.array(table.get("depth"))
    else:
        file = path.parent / table.get("file")
        read = _of_life if file.suffix.lower() == ".nc" else _of_table
        depth = read(table, file)
    if np.any(depth < 0):
        raise ClearanceError(f"{where} must have depths of at least 0, but one is {depth.min():g} m.")
    with naming(where):
        return clearance.worn(depth)


def _of_life(table: TomlTable, file: Path) -> np.ndarray:
    """The depths of a wear result at an age [m], shape (sectors,)."""
    table.refuse("unit", why=UNUSED)
    where = table.key("file")
    if not file.is_file():
        raise ClearanceError(f"{where}: there is no file `{file}`.")
    from clearance_jax.results.store import load_dataset  # xarray takes a third of a second, and few scenes need it

    dataset = load_dataset(file)
    if "depth" not in dataset or dataset["depth"].dims != ("cycle", "sector"):
        raise ClearanceError(f"{where}: `{file}` is not the result of a study of wear.")
    lived = dataset["cycle"].values
    age = float(lived[-1]) if table.get("cycles") is None else table.get("cycles")
    if not lived[0] <= age <= lived[-1]:
        raise ClearanceError(
            f"{table.key('cycles')} must be at most the {lived[-1]:g} cycles of the file, but it is {age:g}."
        )
    return dataset["depth"].interp(cycle=age).values


def _of_table(table: TomlTable, file: Path) -> np.ndarray:
    table.refuse("cycles", why=UNUSED)
    table.need("unit")
    angle, depth = read_table(file, table.key("file"), "angle [deg] and depth")
    if np.any(np.abs(angle - 360 * np.arange(angle.size) / angle.size) > OFF):
        raise ClearanceError(
            f"{table.key('file')}: the angles of `{file}` must go round once, evenly, from 0 to less than 360 deg."
        )
    return depth * to_si(f"1 {table.get('unit')}", "m", table.key("unit"))
