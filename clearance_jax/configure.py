"""`configure`: JAX set up for this library, on request only (importing it changes nothing)."""

import os
from pathlib import Path

import jax
from jax._src import xla_bridge  # the only place that knows whether a backend has started

from clearance_jax._compile.files import programs_in, user_cache
from clearance_jax._compile.jax_cache import use_whole_entries
from clearance_jax._compile.kept import keep_in
from clearance_jax.errors import ClearanceError

# XLA runs a loop's body operation by operation, unless one turn of the loop touches fewer bytes than this: then the
# whole loop becomes one compiled function. That makes single solves, and batches whose chunks are loops that stay in
# the cache, several times faster.
_WHOLE_LOOPS = "xla_cpu_small_while_loop_byte_threshold"
# Vectors as wide as the machine's, where XLA would use half: lanes are long rows of the same arithmetic. On a machine
# without them the flag has no effect.
_WIDE_VECTORS = "xla_cpu_prefer_vector_width"
_FLAGS = {
    _WHOLE_LOOPS: f"--xla_backend_extra_options={_WHOLE_LOOPS}=100000000",
    _WIDE_VECTORS: f"--{_WIDE_VECTORS}=512",
}
# XLA's threads. A LAPACK kernel for many matrices shares its work among them while its program holds one of them: as
# many programs side by side as there are threads would wait for each other for ever.
_THREADS = "PJRT_NPROC"


def configure(*, cache: bool | str | Path = False) -> None:
    """Set up JAX for mechanisms: 64-bit floats, and on the CPU compiler options that make a single solve and a batch
    several times faster.

    The compiler options (loops compiled as one function, wide vectors) change results in their last digits only
    (`experiments/batches.py` measures their effect). Call this before the first JAX computation of the process.

    **Arguments:**

    - `cache`: keep compiled programs between processes, in this folder, or (`True`) in the user's cache folder.
      Programs of single solves, of their derivatives and of datasets are kept ready to run, in the folder `programs`
      below it: a second process only loads them. The environment variable CLEARANCE_KEPT=0 switches this off. All other
      programs go to JAX's own cache, in the same folder or where the environment variable JAX_COMPILATION_CACHE_DIR
      says. An entry is written whole or not at all, so that several processes may share a folder, and what cannot be
      read is compiled anew. `clearance cache` shows both caches, and `clearance cache --clear` empties them.

    **Raises:** `ClearanceError` if JAX has started already without the setting.
    """
    jax.config.update("jax_enable_x64", True)
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = [option for name, option in _FLAGS.items() if name not in flags]
    if wanted:
        if xla_bridge.backends_are_initialized():
            raise ClearanceError(
                "`configure()` must come before the first JAX computation, but JAX has started already. Move it up, "
                f'or set the environment variable XLA_FLAGS="{" ".join(wanted)}".'
            )
        os.environ["XLA_FLAGS"] = " ".join([flags, *wanted]).strip()
    if not xla_bridge.backends_are_initialized() and "NPROC" not in os.environ:
        os.environ.setdefault(_THREADS, str(2 * (os.cpu_count() or 1)))
    folder = user_cache() if cache is True or not cache else Path(cache)
    if cache and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(folder))
    keep_in(programs_in(folder) if cache else None)
    if cache:
        use_whole_entries()
        # However small: reading a program is cheaper than compiling it.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
