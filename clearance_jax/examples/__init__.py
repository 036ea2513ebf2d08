"""Example scenes, robots (URDF), trajectories (CSV) and studies, as files of the package.

`cj.examples.arm()` reads the file `arm.toml`: a `Mechanism` for a scene or a robot, a `Study` for a study. Every
example has such a function.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from clearance_jax.errors import suggest, unknown_name

__all__ = ["names", "path"]  # and a function for each example

_FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """The names of all examples: scenes, robots and studies."""
    return tuple(sorted(_files()))


def path(name: str) -> Path:
    """The path of an example's file.

    **Arguments:** `name`: of the example, such as "arm"; or of a table of numbers with its ending, "disc_worn.csv".

    **Raises:** `ClearanceError` for an unknown name.
    """
    tables = {each.name: each for each in _FOLDER.rglob("*.csv")}
    if file := _files().get(name, tables.get(name)):
        return file
    raise unknown_name(f"There is no example `{name}`.", name, _files())


def kinds() -> tuple[str, ...]:
    """The kinds of mechanism that `clearance new` begins with."""
    return tuple(sorted(each.stem.removesuffix("_study") for each in (_FOLDER / "new").glob("*_study.toml")))


def template(kind: str) -> dict[str, str]:
    """The files of a kind by their names, with NAME for the name of a new mechanism."""
    several = [each for each in (_FOLDER / "new").iterdir() if each.stem in (kind, f"{kind}_study")]
    return {each.name: each.read_text(encoding="utf-8") for each in sorted(several)}


def _files() -> dict[str, Path]:
    places = (_FOLDER, _FOLDER / "studies")
    return {each.stem: each for at in places for ending in ("toml", "urdf") for each in at.glob(f"*.{ending}")}


def _reader(file: Path) -> Callable[[], Any]:
    def read() -> Any:
        from clearance_jax.io.scene.scene import load
        from clearance_jax.io.study.study import load_study

        return load_study(file) if file.parent.name == "studies" else load(file)

    read.__name__, read.__doc__ = file.stem, f"The example `{file.name}`."
    return read


def __getattr__(name: str) -> Callable[[], Any]:
    if file := _files().get(name):
        return _reader(file)
    hint = "" if name.startswith("_") else " " + suggest(name, (*__all__, *names()))
    raise AttributeError(f"clearance_jax.examples has no `{name}`.{hint}", name=name)


def __dir__() -> list[str]:
    return [*__all__, *names()]
