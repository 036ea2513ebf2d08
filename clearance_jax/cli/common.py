"""Shared parts of the commands: consoles, options, and checks of files before a long computation.

Modules that need JAX are imported inside the functions, so that the help does not wait for them.
"""

import os
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.markup import escape
from typer import Argument, Option

from clearance_jax.cli.answer import answer, console, errors
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.examples import names
from clearance_jax.report.figures import LISTED, save_figure
from clearance_jax.units import to_si

SCENE = Argument(..., metavar="SCENE", help="A scene file (TOML with units), or a robot (URDF, MJCF).")
SETTINGS = Option(
    None, "--set", metavar="NAME=VALUE", help="Replace one parameter, e.g. joint5.radial_clearance=0.2mm."
)
_PLAY = (
    "axis_5:kind=sleeve,radial_clearance=0.05mm,length=40mm,pin_radius=10mm or slide:side_clearance=0.1mm,length=60mm."
)
CLEARANCES = Option(None, "--clearance", metavar="JOINT:NUMBERS", help=f"Give a joint play, e.g. {_PLAY}")
IDEAL = Option(False, "--ideal", help="Take every clearance away.")
MAGNIFIED = Option(None, "--magnify", metavar="JOINT", help="The joint magnified, or a gap (default: what bears most).")

KIND = Option(None, "--plot-kind", metavar="NAME", help=f"Kind of figure (default: overview). {LISTED}")
NARROW = Option(False, "--narrow", help="Panels below each other, to be read on a phone.")
FIGURES = (".png", ".pdf", ".svg")
DATASETS = (".nc",)


def set_up() -> None:
    """Set up JAX for a command."""
    # Before JAX is loaded: hide XLA's messages about slow compiles and cache files, which a user cannot act on.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    from clearance_jax.configure import configure

    with aloud(UserWarning):
        configure(cache=True)


def read_scene(scene_file: Path, **robot: Any) -> Any:
    """Read a scene, without the changes of the command's options; `robot`: the options of a robot's file."""
    check_there(scene_file, "scene file")
    set_up()
    from clearance_jax.io.scene.scene import read_scene
    from clearance_jax.io.urdf.mechanism import IN_COMMAND

    given = {name: value for name, value in robot.items() if value is not None}
    if "density" in given:
        given["density"] = to_si(given["density"], "kg/m^3", "`--density`")
    return read_scene(scene_file, IN_COMMAND, **given)


def change(mechanism: Any, settings: list[str] | None, ideal: bool, clearances: list[str] | None = None) -> Any:
    """Apply the options --clearance, --set and --ideal to a mechanism."""
    from clearance_jax.io.scene.scene import implausible
    from clearance_jax.io.settings import parse_settings, with_play
    from clearance_jax.parameters import check_values, replace

    mechanism = with_play(mechanism, clearances or [])
    mechanism = replace(mechanism, parse_settings(settings or [], mechanism))
    check_values(mechanism)
    warn(implausible(mechanism))
    return mechanism.ideal() if ideal else mechanism


def check_writable(path: Path | None, endings: tuple[str, ...] = ()) -> None:
    """Raise `ClearanceError`, before the solve, if a file cannot be written."""
    if path is None:
        return
    if "\0" in str(path):
        raise ClearanceError(f"Cannot write {quote(str(path))}: it is no path. Choose another.")
    try:
        if path.exists() and not path.is_file():
            raise ClearanceError(f"Cannot write `{path}`: it is a folder or a device. Choose another path.")
        if not path.parent.is_dir():
            raise ClearanceError(f"Cannot write `{path}`: its folder does not exist. Make it first.")
        if path.exists() and not os.access(path, os.W_OK):
            raise ClearanceError(f"Cannot write `{path}`: no permission. Choose another path.")
        # A file gets its name only when it is complete, so a temporary file beside it must be possible. (Permissions
        # alone do not tell, and a name can be too long.)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", suffix=f".{path.name}.partial"):
            pass
    except OSError as error:
        raise ClearanceError(f"Cannot write `{path}`: {error.strerror}. Choose another path.") from None
    if endings and path.suffix.lower() not in endings:
        raise ClearanceError(f"Cannot write `{path}`: its name must end in {', '.join(endings)}.")


def check_there(path: Path, what: str) -> None:
    """Raise `ClearanceError`, before anything slow is imported, if there is no such file."""
    if "\0" not in str(path) and not os.path.exists(path):
        known = path.suffix.lower() in (".toml", ".urdf") and path.stem in names()
        hint = f" `clearance examples {path.stem}` writes the example of this name." if known else ""
        raise ClearanceError(f"Cannot read the {what} `{path}`: there is no such file.{hint}")


def output(help: str) -> Any:
    """The option for what a command writes."""
    return Option(None, "-o", "--output", help=help)


def choice(help: str, *allowed: str) -> Any:
    """An option whose value is one of some words, which the shell completes."""
    return Option(None, help=f"{help}: {', '.join(allowed)}.", autocompletion=lambda: list(allowed))


BASE = choice("Base of a robot (URDF)", "fixed", "free")
MIMIC = choice("Joints of a robot with <mimic>", "follow", "independent")
INERTIA = choice("Impossible inertias, and missing masses, of a robot", "refuse", "balance", "from-geometry")
DENSITY = Option(None, help="Density of shapes without mass, e.g. 2700kg/m^3 (with from-geometry; default: of water).")


def check_distinct(**paths: Path | None) -> None:
    """Raise `ClearanceError` if two of these paths, given by what they are for, are the same file."""
    seen: dict[Path, str] = {}
    for word, path in paths.items():
        if path is not None and seen.setdefault(path.resolve(), word) != word:
            both = f"The {seen[path.resolve()]} and the {word}"
            raise ClearanceError(f"{both} are the same file `{path}`. Give two names.")


def say(text: str) -> None:
    """Print a text without markup."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def note(text: str) -> None:
    """Print what is no result on stderr."""
    errors.print(text, highlight=False, markup=False, soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning, if the text is not empty."""
    if text:
        answer.setdefault("warnings", []).append(text)
        errors.print("warning:", style="yellow", end=" ")
        errors.print(text, soft_wrap=True, highlight=False, markup=False)


@contextmanager
def aloud(*categories: type[Warning]) -> Iterator[None]:
    """Print each warning as one line; those of `categories` every time, not only once."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: warn(str(message))
        for category in categories:
            warnings.simplefilter("always", category)
        yield


def say_written(what: str, path: Path) -> None:
    """Print where something was written."""
    answer.setdefault("files", {})[what] = str(path)
    console.print(f"{what:<8} {escape(str(path))}", soft_wrap=True)


def write_dataset(dataset: Any, path: Path) -> None:
    """Write a dataset, and print where."""
    from clearance_jax.results.store import save

    save(dataset, path)
    say_written("dataset", path)


def write_figure(figure: Any, path: Path) -> None:
    """Write a figure, and print where."""
    save_figure(figure, path)
    say_written("figure", path)
