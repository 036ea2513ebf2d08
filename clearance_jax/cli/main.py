"""The command `clearance`, and `clearance cache`. Every error is one sentence and exit code 2."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import typer

from clearance_jax._compile import files
from clearance_jax._version import __version__
from clearance_jax.cli.answer import answer, answered, console, errors
from clearance_jax.cli.check import check
from clearance_jax.cli.common import say
from clearance_jax.cli.examples import examples, new
from clearance_jax.cli.info import info
from clearance_jax.cli.plot import animate, plot, view
from clearance_jax.cli.run import run
from clearance_jax.cli.simulate import simulate
from clearance_jax.errors import LONGEST, ClearanceError, cut

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Mechanisms and robots with clearance joints.\n\n"
    "[bold]Examples[/bold]\n\n"
    "clearance examples slider_crank\n\n"
    "clearance simulate slider_crank.toml -o out.nc --plot out.png\n\n"
    "clearance plot out.nc -o out.png\n\n"
    "clearance animate out.nc -o out.gif --magnify wrist\n\n"
    "clearance view out.nc -o out.html\n\n"
    "clearance simulate slider_crank.toml --set wrist.radial_clearance=0.2mm --set wrist.friction.coefficient=0.1\n\n"
    "clearance info slider_crank.toml\n\n"
    "clearance examples arm_with_play\n\n"
    "clearance info arm_with_play.toml --budget --plot budget.png\n\n"
    "clearance simulate six_axes.urdf --clearance axis_5:radial_clearance=0.05mm,pin_radius=20mm\n\n"
    "clearance examples slider_crank_design\n\n"
    "clearance run slider_crank_design.toml --report out.html\n\n"
    "clearance new press --kind slider-crank\n\n"
    "clearance check press.toml",
    epilog="[bold]Exit codes[/bold]\n\n"
    "0: done. 1: done, but the answer is none (a motion that failed, a limit that no design holds). "
    "2: wrong input, said in one sentence. 130: interrupted by Ctrl-C; what was done is kept.",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def cache(
    clear: bool = typer.Option(False, "--clear", help="Remove all of it. What is needed is compiled again."),
) -> None:
    """Show where compiled programs are kept between commands, and how much there is; or empty it."""
    home = files.user_cache()
    programs, jax = files.programs_in(home), files.jax_folder(home)
    kept, compiled = files.size(programs), files.jax_size(jax)
    if clear:
        left = files.clear(programs) + files.jax_clear(jax)
        if left:
            raise ClearanceError(f"{left} files in `{programs}` and `{jax}` cannot be removed. Remove them by hand.")
        answer["removed"] = {"programs": kept[0] + compiled[0], "bytes": kept[1] + compiled[1]}
        say(f"removed {kept[0] + compiled[0]} programs, {_bytes(kept[1] + compiled[1])}")
        return
    folders = {"ready_to_run": (programs, kept), "jax": (jax, compiled)}
    answer.update({k: {"folder": str(at), "programs": n[0], "bytes": n[1]} for k, (at, n) in folders.items()})
    say(f"ready to run {programs}: {kept[0]} programs, {_bytes(kept[1])} of at most {_bytes(files.LARGEST)}")
    say(f"JAX's cache  {jax}: {compiled[0]} programs, {_bytes(compiled[1])}")
    if why := files.unsafe(programs):
        say(f"Nothing in `{programs}` is used: {why}.")


def _bytes(count: int) -> str:
    return f"{count / 2**20:.1f} MiB" if count < 2**30 else f"{count / 2**30:.1f} GiB"


def _version(asked: bool) -> bool:
    if asked:
        console.print(f"clearance {__version__}", highlight=False)
        raise typer.Exit
    return asked


@app.callback()
def about(
    _: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version and end."),
) -> None:
    """Options before the command."""


COMMANDS = examples, new, check, simulate, run, info, plot, animate, view, cache
for command in COMMANDS:
    app.command()(answered(command) if command in (check, simulate, run, info, cache) else command)


# Typer's error for wrong arguments; its own message has no limit on its length.
UsageError: Any = typer.BadParameter.__bases__[0]


def main() -> None:
    """Entry point: turns every `ClearanceError`, and every wrong argument, into one sentence and exit code 2."""
    gc.set_threshold(50_000, 20, 20)  # imports make many permanent objects, which the collector need not scan again
    try:
        with _block_imports(*(_UNUSED if sys.argv[1:2] == ["simulate"] else ())):
            raise SystemExit(app(sys.argv[1:] or ["--help"], standalone_mode=False))
    except UsageError as error:
        text = error.format_message().rstrip(".")
        if text.startswith("No such command"):
            allowed = ", ".join(command.__name__ for command in COMMANDS)
            text += f"{'.' * (not text.endswith('?'))} Allowed: {allowed} (`run` does what a study asks)"
        _fail(f"{text}. See `clearance --help`.")
    except ClearanceError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        errors.print("interrupted")
        raise SystemExit(130) from None


# Packages that xarray imports, if they are installed, to recognise their arrays. A motion has none of these, and the
# imports are slow.
_UNUSED = "dask", "distributed", "cupy", "sparse"


@contextmanager
def _block_imports(*names: str) -> Iterator[None]:
    """A context in which importing these modules raises `ImportError`, unless they are imported already."""
    hidden = [name for name in names if name not in sys.modules]
    modules: Any = sys.modules
    modules.update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        for name in hidden:
            sys.modules.pop(name, None)


def _fail(message: str) -> NoReturn:
    errors.print("error:", style="red", end=" ")
    errors.print(cut(message, LONGEST), soft_wrap=True, highlight=False, markup=False)
    raise SystemExit(2) from None
