"""Small answers that are kept between processes because asking again takes long, such as those of pint's registry."""

import atexit
import json
from collections.abc import Callable
from pathlib import Path

from clearance_jax._compile import files

# Answers at most.
_MOST = 20_000
_NAME = "quantities"
_where: list[Path] = []
_known: dict[str, float] = {}
_new: dict[str, float] = {}


def remember_in(folder: Path | None) -> None:
    """Keep answers in this folder from now on; `None`: nowhere."""
    _where[:] = [] if folder is None else [folder]
    _known.clear()
    _new.clear()
    if folder is not None:
        _known.update(_read(folder))


def remember(question: str, ask: Callable[[], float]) -> float:
    """The answer to a question whose text covers everything on which it depends. Errors of `ask` are not kept."""
    if not _where:
        return ask()
    if question not in _known:
        if not _new:
            atexit.register(_write)
        _known[question] = _new[question] = ask()
    return _known[question]


def _read(folder: Path) -> dict[str, float]:
    content = None if files.unsafe(folder) else files.read(folder, _NAME)
    try:
        return {} if content is None else {key: float.fromhex(value) for key, value in json.loads(content).items()}
    except (ValueError, AttributeError, TypeError):
        return {}


def _write() -> None:
    """Write the new answers; those that other processes have kept meanwhile stay."""
    if not _where or not _new:
        return
    every = _read(_where[0]) | _new
    if len(every) > _MOST:
        every = dict(_new)
    files.write(_where[0], _NAME, json.dumps({key: value.hex() for key, value in every.items()}).encode())
    _new.clear()
