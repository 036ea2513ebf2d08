"""A folder that keeps a life on its way: what was asked, and the journal of its blocks.

Whoever goes on with it must ask the same; what differs is said by name.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.sweep.identity import differences, kept, numbers
from clearance_jax.sweep.lock import Lock
from clearance_jax.wear.laws import AbstractWearLaw
from clearance_jax.wear.pressure import AbstractPressure

ASKED, BLOCKS, LOCK = "asked.json", "blocks.jsonl", "lock"


def described(
    mechanism: Mechanism, law: AbstractWearLaw, pressure: AbstractPressure, until: Any = None, **rest: Any
) -> dict[str, Any]:
    """What makes another life, by names, each a number or a short text."""
    models = {"law of wear": law, "pressure": pressure, "until": until}
    own = {f"{name} ({what})": v for what, m in models.items() if m is not None for name, v in numbers(m).items()}
    versions = {"clearance_jax": version("clearance-jax"), "jax": jax.__version__}
    return kept({**versions, **numbers(mechanism), **own, **rest})


@contextmanager
def folder(path: str | Path, asked: Mapping[str, Any], resume: bool = False) -> Iterator[Path]:
    """The journal for `wear.life`, in a folder that no other process writes meanwhile.

    **Raises:** `ClearanceError` where the folder is there and is not to be gone on with, is one of another question,
    is written by another process, or cannot be written.
    """
    path = Path(path)
    if path.exists() and not resume:
        raise ClearanceError(f"`{path}` exists already. Go on with it by `resume`, or choose another path.")
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise ClearanceError(f"Cannot write `{path}`: {error.strerror}. Choose another path.") from None
    lock = Lock(path / LOCK)
    try:
        _check(path / ASKED, asked)
        yield path / BLOCKS
    finally:
        lock.release()


def _check(path: Path, asked: Mapping[str, Any]) -> None:
    """The question is that of the folder, or its first one."""
    if not path.exists():
        if (path.parent / BLOCKS).exists():
            raise ClearanceError(f"`{path.parent}` has blocks of wear, but not what was asked. Choose another path.")
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(asked, indent=1))
        partial.replace(path)
        return
    try:
        before = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ClearanceError(f"Cannot read `{path}`: {error}. Choose another folder.") from None
    found = list(differences(before, asked, "there").values())
    if found:
        more = f"; and {len(found) - 3} more" if len(found) > 3 else ""
        raise ClearanceError(
            f"`{path.parent}` keeps another life: {'; '.join(found[:3])}{more}. Choose another folder, or delete it."
        )
