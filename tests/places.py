"""What tests share: where the files of the checkout lie that they read, and which error they expect."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from clearance_jax import ClearanceError

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "experiments" / "scenes"
REFERENCE = ROOT / "experiments" / "reference" / "data"
ANY = object()


@contextmanager
def refused(
    name: object, value: Any = ANY, allowed: Any = ANY, kind: type[ClearanceError] = ClearanceError
) -> Iterator[pytest.ExceptionInfo[ClearanceError]]:
    """A context that must raise an error of exactly this `kind`, about this `name` and `value`; `allowed`: a bound, or
    one of the words.
    """
    with pytest.raises(ClearanceError) as caught:
        yield caught
    error, wanted = caught.value, str(name)
    said = f"{error!r} is about {error.name!r}, given {error.value!r}, allowed {error.allowed!r}"
    assert type(error) is kind, said
    assert error.name == wanted, f"{said}, not about {wanted!r}"
    assert value is ANY or error.value == value, f"{said}, not given {value!r}"
    words = error.allowed if isinstance(error.allowed, tuple) else (error.allowed,)
    assert allowed is ANY or allowed in words, f"{said}, not allowed {allowed!r}"
