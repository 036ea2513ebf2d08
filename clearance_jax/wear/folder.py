"""A folder that keeps a life on its way: what was asked, and the journal of its blocks.

Whoever goes on with it must ask the same; what differs is said by name.
"""

import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from clearance_jax.errors import ClearanceError
from clearance_jax.identity import differences, kept, numbers, refusal, settings, versions
from clearance_jax.sweep.lock import Lock
from clearance_jax.wear.criteria import AbstractCriterion
from clearance_jax.wear.journal import JournalWarning
from clearance_jax.wear.model import WearModel

ASKED, BLOCKS, LOCK = "asked.json", "blocks.jsonl", "lock"


def described(model: WearModel, until: AbstractCriterion | None = None, **rest: Any) -> dict[str, Any]:
    """What makes another life, by names, each a number or a short text; `rest`: its other arguments."""
    parts = {"law of wear": model.wear, "pressure": model.pressure, "until": until}
    own = [numbers(part, f" ({what})") for what, part in parts.items() if part is not None]
    rest = {"joint": model.joint, "cycle": float(model.cycle), **rest}
    named = {k: v for one in (numbers(model.mechanism), *own) for k, v in one.items()}
    return kept({**versions(), **named, **settings(rest)})


@contextmanager
def folder(path: str | Path, asked: Mapping[str, Any], resume: bool = False) -> Iterator[Path]:
    """The journal for `wear.simulate_wear`, in a folder that no other process writes meanwhile.

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
        try:
            partial.write_text(json.dumps(asked, indent=1))
            partial.replace(path)
        except OSError as error:
            raise ClearanceError(f"Cannot write `{path}`: {error.strerror}. Choose another path.") from None
        return
    try:
        before = json.loads(path.read_text())
        found = differences(before, asked, "there")
    except OSError as error:
        raise ClearanceError(f"Cannot read `{path}`: {error.strerror}. Choose another folder.") from None
    except (ValueError, TypeError):
        said = f"`{path}` is damaged: each journal beside it is compared by itself."
        warnings.warn(said, JournalWarning, stacklevel=2)
        return
    if found:
        raise ClearanceError(refusal(path.parent, found, "keeps another life", "Choose another folder, or delete it"))
