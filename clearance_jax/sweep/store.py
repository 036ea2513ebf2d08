"""A sweep on disk: a zarr store, written region by region, with a journal of the finished regions.

A region is one chunk of every variable. It counts once the journal has its record, with a digest of its chunks. After a
kill the regions of the journal and the partial results are used; the rest is solved again, with the same bits.
"""

import hashlib
import shutil
import warnings
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from clearance_jax._basis.extras import missing_extra
from clearance_jax.errors import ClearanceError
from clearance_jax.results.store import open_sweep
from clearance_jax.runs.journal import Journal, Lock, RunWarning, refuse_in_words
from clearance_jax.runs.partial import PartialResults
from clearance_jax.solve.codes import Result
from clearance_jax.sweep.answers import InMemory, Values, attributes, coordinates, counts, ending_counts
from clearance_jax.sweep.grid import Grid, Partition, description, partition

JOURNAL, LOCK, PARTIAL = "journal.jsonl", "writer.lock", "partial"
# Zarr's file of metadata of a group; here it also has those of all arrays.
ROOT = "zarr.json"
# Begin of the name of the file with the question, which is there while a cluster works.
HANDED_OUT = "question."
OWN_FILES = JOURNAL, LOCK, PARTIAL, ROOT
# Attributes of a store about its layout.
CHUNK, VARIABLES = "region", "variables"


# Exceptions of reading a damaged chunk: a file, a checksum, a codec.
UNREADABLE = OSError, ValueError, RuntimeError, KeyError


def zarr_library() -> Any:
    """The module `zarr`. **Raises** `ClearanceError` if it is not installed."""
    try:
        import zarr
    except ImportError:
        raise missing_extra("The store of a sweep", "zarr", "sweep") from None
    return zarr


def create(path: Path, grid: Grid, provenance: Mapping[str, Any], least: int) -> None:
    """Create an empty store for a question; it gets its name when it is complete."""
    cut = partition(grid.shape, [bool(d.models) for d in grid.dims], least)
    partial = _lay_out(path, grid, provenance, cut.chunk)
    journal = Journal(partial / JOURNAL)
    journal.ask(description(grid))
    journal.add(chunk=cut.chunk)
    partial.rename(path)


def remade(path: Path, grid: Grid, provenance: Mapping[str, Any]) -> bool:
    """Write the metadata of a damaged store again, and warn; returns false if its journal has another question."""
    journal = Journal(path / JOURNAL)
    chunk = next((record["chunk"] for record in journal.records if "chunk" in record), None)
    if chunk is None or journal.differences(description(grid)):
        return False
    lock = Lock(path / LOCK)
    try:
        partial = _lay_out(path, grid, provenance, chunk)
        (partial / ROOT).replace(path / ROOT)
        shutil.rmtree(partial)
    finally:
        lock.release()
    warnings.warn(f"`{path}`: its `{ROOT}` is damaged; it is mended.", RunWarning, stacklevel=2)
    return True


def _lay_out(path: Path, grid: Grid, provenance: Mapping[str, Any], chunk: Sequence[int]) -> Path:
    """Create a group with all arrays of a question, beside a path."""
    zarr = zarr_library()
    from zarr.codecs import Crc32cCodec, ZstdCodec

    partial = path.with_name(path.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    layout = {CHUNK: list(chunk), VARIABLES: list(grid.kinds)}
    columns = list(coordinates(grid))
    inner = " ".join(name for name, dim, *_ in columns if name != dim)
    layout |= {"coordinates": inner} if inner else {}
    root = zarr.create_group(partial, attributes={**attributes(grid), **provenance, **layout})

    def array(name, dims, shape, chunks, **about):
        codecs = [ZstdCodec(level=1), Crc32cCodec()]
        return root.create_array(name, shape=shape, chunks=chunks, dimension_names=dims, compressors=codecs, **about)

    for name, dim, values, attrs in columns:
        values = _as_stored(values)
        array(name, (dim,), values.shape, values.shape, dtype=values.dtype, attributes=attrs)[...] = values
    names = tuple(dimension.name for dimension in grid.dims)
    for name, kind in grid.kinds.items():
        chunks = *chunk, *(max(size, 1) for size in kind.shape)
        about = {"dtype": kind.dtype, "fill_value": kind.missing, "attributes": kind.attributes}
        array(name, (*names, *kind.dims), (*grid.shape, *kind.shape), chunks, **about)
    with warnings.catch_warnings():
        # Warnings that this is not in the standard yet, and about the journal in the folder.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(partial)  # in one file, which is read and replaced at once
    return partial


def _as_stored(values: Any) -> np.ndarray:
    """A coordinate's values in the type that zarr stores."""
    values = np.asarray(values)
    return values.astype(np.dtypes.StringDType()) if values.dtype.kind == "U" else values


class Regions:
    """The regions of an existing store."""

    def __init__(self, path: Path):
        zarr = zarr_library()
        self.path = path
        try:
            self.root = zarr.open_group(path, mode="r+")
            self.partition = Partition(self.root["code"].shape, tuple(self.root.attrs[CHUNK]))
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise ClearanceError(
                f"`{path}` is no store of a sweep ({error!r}). Choose another path; or, where it was one, go on with "
                "the very question that it had: that mends it."
            ) from None
        self.names = list(self.root.attrs[VARIABLES])
        self.journal = Journal(path / JOURNAL)
        self.records = {record["region"]: record for record in self.journal.records if "region" in record}
        # Opened once: that takes as long as to read a region. Chunks of missing values are written too, as the digest
        # is that of files.
        self.arrays = {name: self.root[name].with_config({"write_empty_chunks": True}) for name in self.names}
        lead = len(self.partition.shape)
        kinds = {name: (array.dtype, array.shape[lead:]) for name, array in self.arrays.items()}
        self.partial = PartialResults(path / PARTIAL, kinds)

    def coordinate(self, name: str) -> np.ndarray:
        """The values of a coordinate. **Raises** `ClearanceError` if they cannot be read."""
        try:
            return self.root[name][...]
        except UNREADABLE:
            raise ClearanceError(
                f"The coordinate `{name}` of `{self.path}` is damaged. Go on with the axes that it had: that mends it."
            ).about(name, str(self.path)) from None

    def mend(self, grid: Grid) -> None:
        """Write coordinates again that are not those of the question, and warn."""
        for name, _, values, _ in coordinates(grid):
            with suppress(ClearanceError):
                if np.array_equal(self.coordinate(name), _as_stored(values)):
                    continue
            self.root[name][...] = _as_stored(values)
            message = f"`{self.path}`: the coordinate `{name}` is damaged; it is mended."
            warnings.warn(message, RunWarning, stacklevel=2)

    def verify(self) -> None:
        """Drop the records of damaged regions, and warn."""
        bad = []
        for region, record in self.records.items():
            with suppress(OSError):
                if self._digest(region) == record["digest"]:
                    continue
            bad.append(region)
        for region in bad:
            del self.records[region]
        if bad:
            shown = ", ".join(map(str, bad[:10])) + (" ..." if len(bad) > 10 else "")
            message = f"`{self.path}`: {len(bad)} of its regions are damaged ({shown}); they are computed again."
            warnings.warn(message, RunWarning, stacklevel=2)

    def _digest(self, region: int) -> str:
        """The digest of the files of a region's chunks, which need not be decompressed for it."""
        digest, place = hashlib.blake2b(digest_size=16), np.unravel_index(region, self.partition.grid)
        for name, array in self.arrays.items():
            if array.size:
                chunk = array.metadata.encode_chunk_key((*map(int, place), *[0] * (array.ndim - len(place))))
                digest.update(name.encode())
                digest.update((self.path / name / chunk).read_bytes())
        return digest.hexdigest()

    def read(self, region: int) -> Values:
        """Read the variables of a region, shape (lanes, ...)."""
        where, lead = self.partition.slices(region), len(self.partition.shape)
        blocks = {name: np.asarray(self.arrays[name][where]) for name in self.names}
        return {name: block.reshape(-1, *block.shape[lead:]) for name, block in blocks.items()}

    def write(self, region: int, values: Mapping[str, np.ndarray], old: Values | None = None) -> str:
        """Write a region's chunks and return their digest; until then `old` values are kept as partial results."""
        if old is not None:
            self.partial.add(region, np.arange(self.partition.size(region)), old)
            self.partial.flush()
        put(self.arrays, self.partition, region, values)
        self.partial.forget(region)
        return self._digest(region)


class Store:
    """Answers by region, in a store that only this process writes. `before`: the narrower store (`Before`) with known
    lanes.
    """

    on_disk = True

    def __init__(self, path: Path, grid: Grid, before: Any = None):
        self.path, self.grid, self._before = path, grid, before
        self._lock = Lock(path / LOCK)
        try:
            self._regions = Regions(path)
            self._regions.journal.ask(description(grid))
            self._regions.mend(grid)
        except BaseException:
            self._lock.release()
            raise
        self.partition = self._regions.partition
        self._regions.verify()
        for region in self._regions.partial.parts():
            if region in self._regions.records:
                self._regions.partial.remove(region)

    def open_regions(self) -> list[int]:
        """The regions without answers."""
        return [region for region in range(self.partition.count) if region not in self._regions.records]

    def partial_answers(self, region: int) -> Values:
        """The values of a missing region, as far as they are known; the `code` of an unknown lane is `NOT_RUN`."""
        return partial_answers(self.grid, self._regions, self._before, region)

    def keep(self, region: int, places: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        """Keep the values of lanes at these places of a missing region, until the whole region is written."""
        with self._refusal(region):
            self._regions.partial.add(region, places, values)

    def partial_counts(self) -> dict[int, int]:
        """How many lanes of each missing region are kept."""
        partial = self._regions.partial
        return {region: partial.count(region) for region in partial.parts()}

    def read(self, region: int) -> Values:
        """The answers of a region."""
        return self._regions.read(region)

    def write(self, region: int, values: Mapping[str, np.ndarray], **fields: Any) -> None:
        """Keep the answers of a whole region, with more `fields` of its record in the journal."""
        with self._refusal(region):
            old = self.read(region) if region in self._regions.records else None
            digest = self._regions.write(region, values, old)
        self.confirm(region, digest, ending_counts(values["code"]), **fields)

    def confirm(self, region: int, digest: str, endings: Mapping[str, int], **fields: Any) -> None:
        """Record a written region: its digest and the counts of its result codes."""
        record = {"region": region, "digest": digest, "ended": dict(endings), **fields}
        with self._refusal(region):
            self._regions.journal.add(**record)
            self._regions.partial.remove(region)
        self._regions.records[region] = record

    def _refusal(self, region: int) -> AbstractContextManager[None]:
        """The context that raises errors of writing as `ClearanceError`."""
        return refuse_in_words(f"region {region} of `{self.path}`", begun=True)

    def regions_to_repeat(self, settings: str) -> list[int]:
        """The regions with failed lanes that have not been solved again with these settings (in words)."""
        reached, records = {str(int(Result.REACHED_END))}, sorted(self._regions.records.items())
        tried = {region for region, record in records if settings in record.get("again", [])}
        return [region for region, record in records if set(record["ended"]) != reached and region not in tried]

    def dataset(self) -> xr.Dataset:
        """All answers as a dataset that reads the store lazily."""
        dataset = open_sweep(self.path)
        shown = {k: v for k, v in dataset.attrs.items() if k not in (CHUNK, VARIABLES)}
        endings = [record["ended"] for record in self._regions.records.values()]
        dataset.attrs = shown | counts(endings, self.grid.count)
        return dataset

    def close(self) -> None:
        """Release the store, and remove the narrower one if no region is missing."""
        if self._before is not None and not self.open_regions():
            self._before.remove()
        self._regions.partial.close()
        self._lock.release()


Answers = InMemory | Store
"""The answers so far, by the regions of a `partition`."""


def partial_answers(grid: Grid, regions: Regions, before: Any, region: int) -> Values:
    """The known values of a missing region, from `before` and from partial results."""
    lanes = regions.partition.lanes(region)
    values = grid.blank(len(lanes)) if before is None else before.partial_answers(lanes, grid)
    regions.partial.fill(region, values)
    return values


def put(arrays: Mapping[str, Any], cut: Partition, region: int, values: Mapping[str, np.ndarray]) -> None:
    """Write a region's chunk of each array."""
    where, extent = cut.slices(region), cut.extent(region)
    for name, column in values.items():
        arrays[name][where] = column.reshape(*extent, *column.shape[1:])
