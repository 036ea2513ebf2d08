"""Datasets in files: NetCDF, without loss, and the zarr stores of sweeps; files that are written as a whole."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import xarray as xr

from clearance_jax._basis.extras import missing_extra
from clearance_jax.errors import ClearanceError


@contextmanager
def whole_file(
    path: str | Path,
    what: str = "",
    fix: str = "Choose another path",
    refused: tuple[type[Exception], ...] = (OSError,),
) -> Iterator[Path]:
    """A context with a path to write to, whose file gets its own name at the end: it is written completely or not at
    all, if interrupted too. **Raises** `ClearanceError` in the place of what is `refused`: that `what` cannot be
    written, why, and the `fix`.
    """
    path = Path(path)
    partial = path.with_name(f".partial.{path.name}")
    try:
        yield partial
        partial.replace(path)
    except refused as error:
        why = getattr(error, "strerror", None) or error
        raise ClearanceError(f"Cannot write {what}`{path}`: {why}. {fix}.") from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def save(dataset: xr.Dataset, path: str | Path) -> None:
    """Write a dataset to a NetCDF file without loss. The file is written completely or not at all.

    **Arguments:** `dataset`; `path`: of the file.

    **Raises:** `ClearanceError` if the file cannot be written.
    """
    with whole_file(path, fix="Choose another `-o` path") as partial:
        dataset.to_netcdf(partial, engine="h5netcdf", invalid_netcdf=False)


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
