"""Datasets in files: NetCDF, without loss."""

from pathlib import Path

import xarray as xr

from clearance_jax.errors import ClearanceError


def save(dataset: xr.Dataset, path: str | Path) -> None:
    """Write to NetCDF without loss, whole or not at all. **Raises** `ClearanceError` for a path not writable."""
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    try:
        dataset.to_netcdf(partial, engine="h5netcdf", invalid_netcdf=False)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise ClearanceError(f"Cannot write `{path}`: {error.strerror or error}. Choose another `-o` path.") from error


def load_dataset(path: str | Path) -> xr.Dataset:
    """Read a dataset written by `save`."""
    try:
        with xr.open_dataset(path, engine="h5netcdf") as file:
            return file.load()
    except (OSError, ValueError) as error:
        raise ClearanceError(f"Cannot read `{path}` as a result file: {error}.") from error
