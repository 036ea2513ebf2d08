"""`clearance cache`: show or empty the folder of compiled programs."""

from pathlib import Path
from typing import Annotated

import typer

from clearance_jax._compile import files
from clearance_jax.cli.common import say
from clearance_jax.errors import ClearanceError


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove all of it. What is needed is compiled again.")] = False,
) -> None:
    """Show where compiled programs are kept between commands, and how much there is; or empty it."""
    home = files.user_cache()
    programs, jax = files.programs_in(home), files.jax_folder(home)
    kept, compiled = files.size(programs), files.jax_size(jax)
    if clear:
        left = files.clear(programs) + files.jax_clear(jax)
        if left:
            raise ClearanceError(f"{left} files in `{programs}` and `{jax}` cannot be removed. Remove them by hand.")
        say(f"removed {kept[0] + compiled[0]} programs, {_bytes(kept[1] + compiled[1])}")
        return
    _show("ready to run", programs, kept, f" of at most {_bytes(files.LARGEST)}")
    _show("JAX's cache", jax, compiled, "")
    why = files.unsafe(programs)
    if why:
        say(f"Nothing in `{programs}` is used: {why}.")


def _show(what: str, folder: Path, size: tuple[int, int], most: str) -> None:
    say(f"{what:<13}{folder}: {size[0]} programs, {_bytes(size[1])}{most}")


def _bytes(count: int) -> str:
    return f"{count / 2**20:.1f} MiB" if count < 2**30 else f"{count / 2**30:.1f} GiB"
