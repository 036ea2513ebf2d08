"""All that the library uses of JAX's and equinox's private parts: the first place that a new release may break.

- JAX's cache of compiled programs, made safe for several processes: entries are written whole, and one that cannot be
  read is removed, so that its program is compiled anew. JAX writes an entry in place. Another process that reads it
  meanwhile, or after the writer was killed, gets half of it, warns, and does not write it again.
- The settings on which a trace depends, whether JAX has started, LAPACK's functions: JAX gives none in public.
"""

import contextlib
import functools
import importlib
from typing import Any

import jax
from equinox import _config as equinox_config  # what its checks do where they fail
from jax._src import compilation_cache, xla_bridge  # how JAX's cache writes its entries; whether JAX has started
from jax._src import config as jax_config  # all that a trace depends on

from clearance_jax._compile import files

_jax: Any = jax.config  # whose settings have no types
_caches: Any = compilation_cache  # whose classes a type checker does not count as exported


def has_started() -> bool:
    """Whether JAX has read its flags: they have no effect any more."""
    return xla_bridge.backends_are_initialized()


def settings() -> tuple:
    """The settings of JAX and equinox that programs depend on."""
    # Named axes, an object without a text, are there only within a transformation.
    context = (x for x in jax_config.trace_context() if type(x).__name__ != "AxisEnv")
    return (_jax.jax_enable_x64, equinox_config.EQX_ON_ERROR, *context)


@functools.cache
def find_lapack() -> None:
    """Load LAPACK's functions. JAX does so only when it lowers a program; a loaded program would crash without them."""
    # To lower such a program would be a public way. It is slow in a process that lowers nothing else.
    lapack: Any = importlib.import_module("jaxlib.lapack")
    lapack._lapack.initialize()


def jax_cache_off() -> contextlib.AbstractContextManager:
    """A context without JAX's own cache, in this thread alone. JAX heeds the switch of the first thread that compiles;
    from the first such context on that of each.
    """
    if compilation_cache.is_cache_used is not _is_cache_used:
        compilation_cache.is_cache_used = _is_cache_used
        compilation_cache.reset_cache()  # what it has seen of the first
    return jax_config.enable_compilation_cache(False)


def _is_cache_used(backend: Any) -> bool:
    return jax_config.enable_compilation_cache.value and _used_at_all(backend)


_used_at_all = compilation_cache.is_cache_used


class WholeEntries(_caches.LRUCache):
    """JAX's cache in a folder, with entries that are always whole."""

    def get(self, key: str) -> bytes | None:
        """The content under a key; `None` if there is none or it is not whole."""
        packed = super().get(key)
        if packed is not None:
            try:
                # Unpacking is cheap compared with loading, and its checksum detects an entry that is not whole.
                compilation_cache.decompress_executable(packed)
            except Exception:  # whatever the packer in use says of it
                with contextlib.suppress(OSError):
                    self._file(key).unlink(missing_ok=True)
                return None
        return packed

    def put(self, key: str, value: bytes) -> None:
        """Keep a content under a key. A cache of limited size has a lock, for which readers wait."""
        if self.eviction_enabled:
            super().put(key, value)
        elif not self._file(key).exists():
            files.write_whole(self._file(key), value, 0o666)  # less the umask, as JAX does

    def _file(self, key: str):
        return self.path / f"{key}-cache"


def use_whole_entries() -> None:
    """Make JAX's own cache use whole entries from now on."""
    compilation_cache.get_file_cache = _make
    compilation_cache.reset_cache()


def _make(path: str):
    if "://" in path or jax_config.compilation_cache_check_contents.value:  # not a folder here; a cache of another kind
        return _jaxs_own(path)
    return WholeEntries(path, max_size=jax_config.compilation_cache_max_size.value), path


_jaxs_own = compilation_cache.get_file_cache
