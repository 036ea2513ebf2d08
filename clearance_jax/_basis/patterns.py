"""Names with a star, which match other names."""

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from typing import TypeVar

from clearance_jax.errors import unknown_name

Given = TypeVar("Given")


def expand(given: Mapping[str, Given], known: Iterable[str]) -> dict[str, Given]:
    """Values by names, some with a star: "*.radial_clearance" matches every known name that ends so; a full name has
    precedence. **Raises** `ClearanceError` for a name with a star that matches none.
    """
    out: dict[str, Given] = {}
    names = list(known)
    for name, value in given.items():
        if "*" not in name:
            out[name] = value
            continue
        fitting = [match for match in names if fnmatchcase(match, name)]
        if not fitting:
            raise unknown_name(f"`{name}` fits no parameter.", name, names)
        out |= {match: value for match in fitting if match not in given and match not in out}
    return out
