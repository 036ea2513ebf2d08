"""CMA-ES for a tolerance problem, as a `Method`: a baseline without gradients (package `cma`)."""

import tempfile
import warnings

import cma
import numpy as np

from clearance_jax.design import Method, Program, ScaledProgram


def cma_es(program: Program, start: np.ndarray, tolerance: float = 1e-6, seed: int = 1) -> None:
    """Covariance matrix adaptation with an augmented Lagrangian."""
    scaled = ScaledProgram(program, start, False)
    options: dict = {"bounds": [b.tolist() for b in scaled.bounds], "seed": seed, "verbose": -9}
    options |= {"tolx": tolerance, "tolfun": tolerance**2}
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as scratch:
        options["verb_filenameprefix"] = scratch + "/"  # its logger always makes a folder
        warnings.filterwarnings("ignore", message=".*moarchiving")  # an optional package of cma that is not used
        cma.fmin_con2(
            lambda z: scaled.value(np.asarray(z))[0],
            scaled.start.tolist(),
            0.2,
            constraints=lambda z: scaled.value(np.asarray(z))[1].tolist(),
            options=options,
        )


CMA_ES = Method("cma-es", cma_es, gradients=False)
