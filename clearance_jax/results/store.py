"""Datasets in files: NetCDF, without loss, and the zarr stores of sweeps."""

from pathlib import Path

import numpy as np
import xarray as xr

from clearance_jax._basis.extras import missing_extra
from clearance_jax.errors import ClearanceError


def save(dataset: xr.Dataset, path: str | Path) -> None:
    """Write a dataset to a NetCDF file without loss. The file is written completely or not at all.

    **Arguments:** `dataset`; `path`: of the file.

    **Raises:** `ClearanceError` if the file cannot be written.
    """
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    try:
        dataset.to_netcdf(partial, engine="h5netcdf", invalid_netcdf=False)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise ClearanceError(f"Cannot write `{path}`: {error.strerror or error}. Choose another `-o` path.") from error


def load_dataset(path: str | Path) -> xr.Dataset:
    """Read a dataset that `save` has written.

    **Arguments:** `path`: of the file.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as file:
            return file.load()
    except (OSError, ValueError) as error:
        raise ClearanceError(f"Cannot read `{path}` as a result file: {error}.") from error


def open_sweep(path: str | Path) -> xr.Dataset:
    """Open a sweep's store; data are read when used, also while it runs (NaN: missing). **Raises** if it is none."""
    try:
        dataset = xr.open_zarr(path, consolidated=True)
    except ImportError:
        raise missing_extra("The store of a sweep", "zarr", "sweep") from None
    except (OSError, ValueError, KeyError) as error:
        raise ClearanceError(f"Cannot read `{path}` as a store of a sweep: {error}.") from None
    for name, coordinate in dataset.coords.items():
        if coordinate.dtype.kind == "T":  # numpy's new strings, which few others know
            labels = np.array(coordinate.values.tolist())
            dataset = dataset.assign_coords({name: (coordinate.dims, labels, coordinate.attrs)})
    return dataset
