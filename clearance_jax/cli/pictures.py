"""Write the figures of a sweep to a folder."""

import os
import re
from pathlib import Path
from typing import Any

from clearance_jax.cli.common import errors, say_written, warn
from clearance_jax.errors import ClearanceError

# Characters of a figure's name that a file name must not have.
UNFIT = re.compile(r"[^\w.+-]+")


def check_folder(folder: Path | None) -> None:
    """Raise `ClearanceError`, before the solves, if pictures cannot be written to a folder."""
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise ClearanceError(f"Cannot write pictures to `{folder}`: it is a file. Name a folder.")
    there = folder if folder.exists() else folder.parent
    if not there.is_dir():
        raise ClearanceError(f"Cannot make the folder `{folder}`: `{there}` does not exist. Make that first.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ClearanceError(f"Cannot write pictures to `{folder}`: no permission. Choose another folder.")


def draw_sweep(dataset: Any, folder: Path) -> None:
    """Draw every figure that fits a sweep, with sensitivity indices if its samples allow them. If nothing can be drawn,
    print a warning.
    """
    from clearance_jax.report.figures import save_figure
    from clearance_jax.report.sweep_axes import results
    from clearance_jax.report.sweep_figures import figures
    from clearance_jax.results.sobol import is_sobol, middle_derivatives, sobol_indices

    try:
        with errors.status("drawing"):
            named = [name for name in results(dataset) if is_sobol(dataset[name])]
            indices = {name: sobol_indices(dataset, name) for name in named}
            slopes = ((name, middle_derivatives(dataset, name)) for name in named)
            drawn = figures(dataset, indices, {name: slope for name, slope in slopes if slope is not None})
            folder.mkdir(exist_ok=True)
            for name, figure in drawn.items():
                save_figure(figure, folder / f"{UNFIT.sub('_', name)}.png")
    except ClearanceError as error:
        warn(str(error))
        return
    say_written("pictures", folder)
