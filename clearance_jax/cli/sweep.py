"""`clearance run` of a sweep: solve it into a zarr store."""

from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from clearance_jax._basis.extras import require
from clearance_jax.cli.common import aloud, console, errors, say, say_written
from clearance_jax.cli.interruption import Interruption
from clearance_jax.cli.pace import ProgressDisplay
from clearance_jax.cli.pictures import draw_sweep
from clearance_jax.errors import ClearanceError

# File endings that a store, which is a folder, must not have.
OF_FILES = (".csv", ".txt", ".json", ".nc", ".h5", ".hdf5", ".parquet", ".xlsx", ".png", ".pdf")


def check_sweep(output: Path, cluster: str | None) -> None:
    """Raise `ClearanceError`, before the solves, for a missing package or a store that is named like a file."""
    require("The store of a sweep", "sweep", "zarr")
    if cluster is not None:
        require("A sweep on a cluster", "sweep", "dask", "distributed", "cloudpickle")
    if output.suffix.lower() in OF_FILES:
        raise ClearanceError(f"Cannot write a store to `{output}`: it is a folder. Give it a name that ends in .zarr.")


def run_sweep(
    study: Any, file: Path, output: Path, *, resume: bool, cores: int | None, cluster: str | None, plot: Path | None
) -> None:
    """Run the sweep of a study into a zarr store. Ctrl-C, or another end, leaves a store that can be resumed."""
    from clearance_jax.runs.journal import RunWarning
    from clearance_jax.sweep.run import sweep as swept

    console.print(f"[bold]{escape(study.name)}[/bold]")
    with aloud(RunWarning), ProgressDisplay(errors, parts=True) as shown, Interruption() as asked:
        shown.phase("compiling")

        def progress(now: Any) -> None:
            shown.update(str(now), now.done / now.lanes)
            asked.check()

        try:
            dataset = swept(
                **study.sweep,
                store=output,
                resume=resume,
                cores=cores,
                cluster=cluster,
                plan=lambda plan: say(str(plan)),
                progress=progress,
            )
        except KeyboardInterrupt:
            say(f"Interrupted. What is done is kept: clearance run {file} -o {output} --resume")
            raise typer.Exit(130) from None
    why = f": {dataset.attrs['failures']}" if dataset.attrs["failed"] else ""
    say(f"{dataset.attrs['lanes']} samples, {dataset.attrs['failed']} failed{why}")
    say_written("store", output)
    if plot is not None:
        draw_sweep(dataset, plot)
