"""`configure`: JAX set up for this library, on request only (importing it changes nothing)."""

import os
import warnings
from pathlib import Path

import jax

from clearance_jax._compile.files import programs_in, user_cache
from clearance_jax._compile.kept import keep_in
from clearance_jax._compile.private import has_started, use_whole_entries

# Vectors as wide as the machine's, where XLA would use half: lanes are long rows of the same arithmetic. On a machine
# without them the flag has no effect.
_WIDE_VECTORS = "xla_cpu_prefer_vector_width"
# XLA's threads. A LAPACK kernel for many matrices shares its work among them while its program holds one of them: as
# many programs side by side as there are threads would wait for each other for ever.
_THREADS = "PJRT_NPROC"


def configure(*, cache: bool | str | Path = False) -> None:
    """Set up JAX for mechanisms: 64-bit floats, and compiled programs that are kept.

    Call it early: before the first JAX computation of a process it also makes batches a few per cent faster (wider
    vectors, which change results in their last digits only) and lets one more of them run side by side.

    **Arguments:**

    - `cache`: keep compiled programs between processes, in this folder, or (`True`) in the user's cache folder.
      Programs of single solves, of their derivatives and of datasets are kept ready to run, in the folder `programs`
      below it: a second process only loads them. The environment variable CLEARANCE_KEPT=0 switches this off. All other
      programs go to JAX's own cache, in the same folder or where the environment variable JAX_COMPILATION_CACHE_DIR
      says. An entry is written whole or not at all, so that several processes may share a folder, and what cannot be
      read is compiled anew. `clearance cache` shows both caches, and `clearance cache --clear` empties them.

    **Warns:** `UserWarning` if JAX has started already, with what could not be set.
    """
    jax.config.update("jax_enable_x64", True)
    _set_flags()
    folder = user_cache() if cache is True or not cache else Path(cache)
    if cache and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(folder))
    keep_in(programs_in(folder) if cache else None)
    if cache:
        use_whole_entries()
        # However small: reading a program is cheaper than compiling it.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _set_flags() -> None:
    """What a process reads once, when JAX starts: width of vectors, number of threads."""
    flags = os.environ.get("XLA_FLAGS", "")
    if has_started():
        if _WIDE_VECTORS not in flags:
            warnings.warn(
                "JAX has started before `configure()`: batches keep its narrower vectors, a few per cent slower.",
                stacklevel=3,
            )
        return
    if _WIDE_VECTORS not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_WIDE_VECTORS}=512".strip()
    if "NPROC" not in os.environ:
        os.environ.setdefault(_THREADS, str(2 * (os.cpu_count() or 1)))
