"""Optional packages, and how to install them."""

import importlib.util
from pathlib import Path

from clearance_jax.errors import ClearanceError

# In a clone, the project file is beside the library.
CLONE = Path(__file__).parents[2]


def install_command(extra: str) -> str:
    """The command that installs an extra of this library, from the clone if there is one."""
    inside = (CLONE / "pyproject.toml").is_file()
    return f"pip install '{CLONE if inside else 'clearance-jax'}[{extra}]'"


def missing_extra(what: str, package: str, extra: str) -> ClearanceError:
    """The error for a missing package: `what` needs it, and the command that installs it."""
    return ClearanceError(f"{what} needs {package}, which is not installed. Install it: `{install_command(extra)}`.")


def require(what: str, extra: str, *packages: str) -> None:
    """Raise, before anything takes long, if a package of an extra is missing."""
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise missing_extra(what, package, extra)
