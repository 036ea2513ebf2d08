"""`configure`: JAX set up for this library, on request only (importing it changes nothing)."""

import os
from pathlib import Path

import jax
from jax._src import xla_bridge  # the only place that knows whether a backend has started

from clearance_jax.errors import ClearanceError

# XLA runs a loop's body operation by operation, some 0.1 us each, unless one turn of the loop touches fewer bytes than
# this (1024 by default): then the whole loop becomes one compiled function. That makes a single solve several times
# faster, and a batch, whose chunks of lanes are loops that stay in the cache, three times (0.7 instead of 2.1 ms a lane
# with a threshold below what a chunk touches).
_WHOLE_LOOPS = "xla_cpu_small_while_loop_byte_threshold"
_THRESHOLD = 100_000_000


def configure(*, cache: bool | str | Path = False) -> None:
    """Set JAX up for mechanisms: 64-bit floats, and single solves compiled as one function on the CPU.

    The second makes a single solve several times faster, and changes no result but in the last digits
    (`experiments/batches.py` measures it). Call it before the first JAX computation of the process.

    **Arguments:**

    - `cache`: keep compiled programs between processes, in this folder, or (`True`) in the user's cache folder. The
      environment variable JAX_COMPILATION_CACHE_DIR comes first.

    **Raises:** `ClearanceError` where JAX has started already without the setting.
    """
    jax.config.update("jax_enable_x64", True)
    flags = os.environ.get("XLA_FLAGS", "")
    if _WHOLE_LOOPS not in flags:
        if xla_bridge.backends_are_initialized():
            raise ClearanceError(
                "`configure()` must come before the first JAX computation, but JAX has started already. Move it up, "
                f"or set the environment variable XLA_FLAGS=--xla_backend_extra_options={_WHOLE_LOOPS}={_THRESHOLD}."
            )
        option = f"--xla_backend_extra_options={_WHOLE_LOOPS}={_THRESHOLD}"
        os.environ["XLA_FLAGS"] = f"{flags} {option}".strip()
    if cache and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
        jax.config.update("jax_compilation_cache_dir", str(home / "clearance_jax" if cache is True else cache))
    if cache:
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
