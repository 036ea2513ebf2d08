"""`clearance sweep`: a sweep file to a store of answers."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

from clearance_jax.cli.common import aloud, check_distinct, console, errors, say, say_written, set_up
from clearance_jax.cli.interruption import Interruption
from clearance_jax.cli.pictures import check_folder, draw_sweep
from clearance_jax.errors import ClearanceError
from clearance_jax.extras import require

# Endings that promise a file of another kind.
OF_FILES = (".csv", ".txt", ".json", ".nc", ".h5", ".hdf5", ".parquet", ".xlsx", ".png", ".pdf")


def sweep(
    sweep_file: Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep file (TOML with units).")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Store of the answers (default: SWEEP with .zarr).")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a store that is there; its axes may have grown.")
    ] = False,
    cores: Annotated[int | None, typer.Option(help="How many cores (default: all).", min=1)] = None,
    cluster: Annotated[
        str | None,
        typer.Option(help='Run the lanes by the dask scheduler at this address, tcp://node1:8786 ("local": here).'),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FOLDER", help="Write the pictures that fit into this folder.")
    ] = None,
) -> None:
    """Answer one question for many mechanisms: outputs over axes, into a zarr store.

    Ctrl-C, or whatever else ends it, leaves a store that `--resume` goes on with.
    """
    require("The store of a sweep", "sweep", "zarr")
    if cluster is not None:
        require("A sweep on a cluster", "sweep", "dask", "distributed", "cloudpickle")
    output = sweep_file.with_suffix(".zarr") if output is None else output
    if output.suffix.lower() in OF_FILES:
        raise ClearanceError(f"Cannot write a store to `{output}`: it is a folder. Give it a name that ends in .zarr.")
    set_up()
    from clearance_jax.io.sweep_file import load_sweep
    from clearance_jax.runs.journal import RunWarning
    from clearance_jax.sweep.run import sweep as swept

    asked_for = load_sweep(sweep_file)
    check_folder(plot)
    check_distinct(store=output, pictures=plot)
    console.print(f"[bold]{escape(asked_for.name)}[/bold]")
    with aloud(RunWarning), _bar() as bar, Interruption() as asked:
        task = bar.add_task("", total=None, said="compiling")

        def progress(now: Any) -> None:
            bar.update(task, total=now.lanes, completed=now.done, said=str(now))
            asked.check()

        try:
            dataset = swept(
                **asked_for.arguments,
                store=output,
                resume=resume,
                cores=cores,
                cluster=cluster,
                plan=lambda plan: say(str(plan)),
                progress=progress,
            )
        except KeyboardInterrupt:
            say(f"Interrupted. What is done is kept: clearance sweep {sweep_file} -o {output} --resume")
            raise typer.Exit(130) from None
    why = f": {dataset.attrs['failures']}" if dataset.attrs["failed"] else ""
    say(f"{dataset.attrs['lanes']} lanes, {dataset.attrs['failed']} failed{why}")
    say_written("store", output)
    if plot is not None:
        draw_sweep(dataset, plot)


def _bar() -> Progress:
    columns = (BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[said]}"))
    return Progress(*columns, console=errors, transient=True)
