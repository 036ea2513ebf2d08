"""Open the store of a question: a new one, one to continue, or one whose axes have grown."""

import dataclasses
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError, quote
from clearance_jax.runs.identity import VERSIONS, refusal
from clearance_jax.runs.journal import Lock, refuse_in_words
from clearance_jax.sweep.answers import coordinates
from clearance_jax.sweep.grid import AXIS, LEAST, Grid, Lanes, description, labels
from clearance_jax.sweep.store import HANDED_OUT, LOCK, OWN_FILES, Regions, Store, create, remade

# The longest name of a folder, with room for suffixes.
LONGEST_NAME = 200
# The relative difference of numbers that count as the same.
ROUND_OFF = 1e-14


def open_store(
    path: str | Path, grid: Grid, provenance: Mapping[str, Any], *, resume: bool, least: int = LEAST
) -> Store:
    """Open or create the store at a path for this question. **Raises** `ClearanceError` if it exists and `resume` is
    off, belongs to another question (with the differences), is written by another process, or cannot be written; and
    for names of outputs and axes that no array can have.
    """
    path = Path(path)
    _check_names(grid)
    narrower = _narrower(path)
    with refuse_in_words(f"`{path}`"):
        if path.exists() and not resume:
            text = f"`{path}` exists already. Go on with it by `resume` (`--resume`), or choose another path."
            raise ClearanceError(text)
        if path.exists():
            try:
                old = Regions(path)
            except ClearanceError:
                if not remade(path, grid, provenance):
                    raise
                old = Regions(path)
            grid = snap(grid, old)
        if not path.exists():
            create(path, grid, provenance, least)
        elif _differs(path, narrower, grid):
            lock = Lock(path / LOCK)
            path.rename(narrower)
            create(path, grid, provenance, least)
            lock.release()
        return Store(path, grid, before_of(path, grid))


def _check_names(grid: Grid) -> None:
    """Raise `ClearanceError` for a name that the folder of an array cannot have."""
    for name in (*(coordinate[0] for coordinate in coordinates(grid)), *grid.kinds):
        low = name.casefold()
        if low in OWN_FILES or low.startswith(HANDED_OUT) or low.startswith("__"):
            why = "a store has something of its own of that name"
        elif not name.strip(".") or "/" in name or "\\" in name or not name.isprintable():
            why = "no folder has such a name"
        elif len(name.encode()) > LONGEST_NAME:
            why = f"it is longer than {LONGEST_NAME} bytes"
        else:
            continue
        text = f"{quote(name)} cannot be the name of an output or axis in a store: {why}. Rename it."
        raise ClearanceError(text).about(name)


def _differs(path: Path, narrower: Path, grid: Grid) -> bool:
    """Whether the store at a path has a narrower question. **Raises** `ClearanceError` if it has another one."""
    old = Regions(path)
    changes, described = old.journal.differences(description(grid)), old.journal.question or {}
    if not changes:
        return False
    grown = {name: words for name, words in changes.items() if name.startswith(AXIS) and name in described}
    # New names may belong to a new model of a `Choice`; all other differences make another question.
    suffixes = tuple(label for label in labels(grid) if label)
    more = {name for name in changes if name not in described and name not in VERSIONS and name.endswith(suffixes)}
    others = {name: words for name, words in changes.items() if name not in grown and name not in more}
    if others or _places(old, grid) is None:
        raise refusal(path, others or changes)
    if narrower.exists():
        raise ClearanceError(f"`{path}` is being widened already: finish that with its own axes, and then go on.")
    return True


def snap(grid: Grid, old: Regions) -> Grid:
    """The grid with the exact numbers of an older store, where its own (`linspace`) differ by round-off."""
    dims = []
    for dimension in grid.dims:
        columns = dict(dimension.columns)
        for name in columns:
            with suppress(ClearanceError):  # `Regions.mend` may repair a damaged one
                columns[name] = _snap(columns[name], old.coordinate(name)) if name in old.root else columns[name]
        dims.append(dimension._replace(columns=columns))
    return dataclasses.replace(grid, dims=tuple(dims))


def _snap(values: np.ndarray, old: np.ndarray) -> np.ndarray:
    near = np.sort(old)
    after = np.clip(np.searchsorted(near, values), 1, max(len(near) - 1, 1))
    pair = np.stack([near[after - 1], near[np.minimum(after, len(near) - 1)]])
    nearest = np.where(np.abs(pair[0] - values) <= np.abs(pair[1] - values), *pair)
    return np.where(np.abs(nearest - values) <= ROUND_OFF * np.abs(values), nearest, values)


def _places(old: Regions, grid: Grid) -> list[np.ndarray] | None:
    """By dimension, the index in the older store of every place (-1: new); `None` if one of its places is missing."""
    if len(old.partition.shape) != len(grid.dims):
        return None
    by_axis = []
    for dimension, size in zip(grid.dims, old.partition.shape, strict=True):
        if any(name not in old.root for name in (dimension.name, *dimension.columns)):
            return None
        columns = {dimension.name: np.asarray(list(dimension.models))} if dimension.models else dimension.columns
        before = list(zip(*(old.coordinate(name).tolist() for name in columns), strict=True))
        known = {key: i for i, key in enumerate(before)}
        now = list(zip(*(values.tolist() for values in columns.values()), strict=True))
        places = np.array([known.get(key, -1) for key in now])
        if len(set(places[places >= 0].tolist())) != len(known) or len(known) != size:
            return None
        by_axis.append(places)
    return by_axis


def before_of(path: Path, grid: Grid) -> "Before | None":
    """The narrower store beside the one at a path, if there is one."""
    return Before(_narrower(path), grid) if _narrower(path).exists() else None


def _narrower(path: Path) -> Path:
    """The path of a store while its answers are copied into one with longer axes."""
    return path.with_name(path.name + ".narrower")


class Before:
    """The answers of the store before its axes grew."""

    def __init__(self, path: Path, grid: Grid):
        self._old, self._kept, self._blank = Regions(path), {}, grid.blank
        places = _places(self._old, grid)
        if places is None:
            raise ClearanceError(f"`{path}` does not fit the store beside it. Move it away.")
        self._places = places
        self._old.verify()

    def partial_answers(self, lanes: Lanes, grid: Grid) -> dict[str, np.ndarray]:
        """As `store.partial_answers`."""
        out, old = grid.blank(len(lanes)), self._old
        there = np.unravel_index(lanes, grid.shape)
        before = [places[at] for places, at in zip(self._places, there, strict=True)]
        some = np.flatnonzero(np.all([at >= 0 for at in before], axis=0))
        flat = np.ravel_multi_index([at[some] for at in before], old.partition.shape)
        regions, here = old.partition.of(flat)
        for region in np.unique(regions).tolist():
            members = regions == region
            for name, values in self._region(region).items():
                out[name][some[members]] = values[here[members]]
        return out

    def _region(self, region: int) -> dict[str, np.ndarray]:
        if region not in self._kept:
            known = region in self._old.records
            values = self._old.read(region) if known else self._blank(self._old.partition.size(region))
            if not known:
                self._old.partial.fill(region, values)
            self._kept = {region: values}  # the next call mostly needs the same region
        return self._kept[region]

    def remove(self) -> None:
        """Remove the store, when all of it has been copied."""
        shutil.rmtree(self._old.path)
