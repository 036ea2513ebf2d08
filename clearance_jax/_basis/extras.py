"""Optional packages, and how to install them."""

import importlib.util
from pathlib import Path

from clearance_jax.errors import ClearanceError

# In a clone, the project file is beside the library.
CLONE = Path(__file__).parents[2]


def missing_extra(what: str, package: str, extra: str) -> ClearanceError:
    """The error for a missing package: `what` needs it, and the command that installs its extra."""
    source = CLONE if (CLONE / "pyproject.toml").is_file() else "clearance-jax"
    command = f"pip install '{source}[{extra}]'"
    return ClearanceError(f"{what} needs {package}, which is not installed. Install it: `{command}`.")


def require(what: str, extra: str, *packages: str) -> None:
    """Raise, before anything takes long, if a package of an extra is missing."""
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise missing_extra(what, package, extra)
