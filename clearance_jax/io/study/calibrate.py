"""The section `calibrate` of a study: the arguments of `calibrate`."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from clearance_jax.calibrate.measurement import read_measurement, unit_of
from clearance_jax.errors import ClearanceError, naming, unknown_name
from clearance_jax.io.files import TIME, Meant, read_columns
from clearance_jax.io.keys.metric import OF, OF_SIGNAL
from clearance_jax.io.keys.study import CALIBRATE, PARAMETER_TABLE, SIGNAL_TABLE
from clearance_jax.io.study.file import StudyFile, of_parameter, signal_of
from clearance_jax.io.table import TomlTable
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.results.store import load_dataset

_TABLE = Meant("table of measured data", "signal", "`time [s], tip.position.x [mm]`")


def calibration_of(study: StudyFile) -> dict[str, Any]:
    """The arguments of `calibrate` by name. **Raises:** `ClearanceError` naming the key and the fix."""
    table, mechanism = study.table.table("calibrate", CALIBRATE), study.mechanism
    path = study.folder / table.get("data")
    table.need("parameter")
    bounds: dict[str, tuple[float, float] | None] = {}
    for name, values, where in table.entries("parameter"):
        given = of_parameter(name, values, where, PARAMETER_TABLE, mechanism).only("lower", "upper")
        bounds[name] = (given.get("lower", -np.inf), given.get("upper", np.inf)) if given else None
    with naming(table.key("data")):
        data = read_data(path)
    signals, deviations = _signals(table, data, mechanism)
    books = bool(study.options.get("energy_balance", False))
    with naming(table.key("signal" if table.has("signal") else "data")):
        last = read_measurement(mechanism, data, signals, deviations, books).times[-1]
    t1 = study.table.get("t1")  # `None`: the end of the data
    if t1 is not None and last > t1:
        fix = "Take it away: then the motion ends with the data."
        study.table.refuse("t1", why=f"is {t1:g} s, but the data reach to {last:g} s. {fix}")
    out = {"mechanism": mechanism, "dataset": data, "parameters": bounds, "signals": signals, "deviations": deviations}
    return {**out, "t1": t1, **table.only("loss", "starts", "seed", "most"), **study.options}


def read_data(path: str | Path) -> xr.Dataset:
    """Measured data, of the CSV file with a header or the NetCDF file at `path`.

    **Raises:** `ClearanceError` that names the file, line and column.
    """
    path = Path(path)
    if path.suffix.lower() in (".nc", ".h5"):
        return load_dataset(path)
    heads, _, values = read_columns(path, _TABLE, gaps=True)
    columns = {
        name: (TIME, column, {} if unit is None else {"units": unit})
        for (name, unit, _), column in zip(heads, values.T, strict=True)
    }
    return xr.Dataset(columns, {TIME: columns.pop(TIME)})


def _signals(table: TomlTable, data: xr.Dataset, mechanism: Mechanism) -> tuple[Any, dict[str, float]]:
    """Signals by column (`None`: every column is the quantity of its name), and the deviations that are given."""
    if not table.has("signal"):
        return None, {}
    signals: dict[str, str | AbstractSignal] = {}
    deviations = {}
    for column, values, where in table.entries("signal"):
        if column not in data:
            raise unknown_name(f"{where}: the data have no column `{column}`.", column, map(str, data), where)
        signal = TomlTable(values, where, SIGNAL_TABLE)
        if signal.has("signal") and signal.has("quantity"):
            raise ClearanceError(f"{where}: a column is a `quantity` or a `signal`, not both. Take one away.")
        if not signal.has("signal"):
            signal.refuse(*OF, why="has no effect without `signal`. Take it away, or add a signal.")
        reading = signal_of(signal, mechanism) if signal.has("signal") else signal.get("quantity") or column
        signals[column] = reading
        with naming(where):
            unit = unit_of(mechanism, column, reading)
        if signal.has("deviation"):
            deviations[column] = signal.get("deviation", {OF_SIGNAL: unit})
    return signals, deviations
