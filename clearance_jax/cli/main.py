"""The command `clearance`. Every error is one sentence and exit code 2."""

import typer

from clearance_jax.cli.common import errors
from clearance_jax.cli.info import info
from clearance_jax.cli.optimize import optimize
from clearance_jax.cli.plot import plot
from clearance_jax.cli.simulate import simulate
from clearance_jax.errors import ClearanceError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    help="Mechanisms and robots with clearance joints.\n\n"
    "[bold]Examples[/bold]\n\n"
    "clearance simulate experiments/scenes/slider_crank.toml -o out.nc --plot out.png\n\n"
    "clearance simulate experiments/scenes/joint5_velocity_1.toml --set joint5.radial_clearance=0.2mm "
    "--set joint5.friction.coefficient=0.3\n\n"
    "clearance info experiments/scenes/four_bar.toml\n\n"
    "clearance plot out.nc -o out.png\n\n"
    "clearance optimize optimize/studies/slider_crank.toml --report out.html",
)
for command in (simulate, info, plot, optimize):
    app.command()(command)


def main() -> None:
    """Entry point: turns every `ClearanceError` into one sentence and exit code 2."""
    try:
        app()
    except ClearanceError as error:
        errors.print("error:", style="red", end=" ")
        errors.print(str(error), soft_wrap=True, highlight=False, markup=False)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        errors.print("interrupted")
        raise SystemExit(130) from None
