"""The surroundings on which a compiled program depends: sources, versions, JAX's settings, the processor."""

import functools
import hashlib
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
from equinox import _config as equinox_config  # what its checks do where they fail
from jax._src import compiler  # the flags of XLA as they are in force: the variable may have been set too late
from jax._src import config as jax_config  # all that a trace depends on
from jax._src import core as jax_core

from clearance_jax._compile.code import PACKAGE, VERSIONED
from clearance_jax._compile.structure import hash_texts

_jax: Any = jax.config  # whose settings have no types


def surroundings() -> str:
    """All surroundings as one text; what cannot change within a process is read once."""
    return hash_texts(source_digest(), processor(), _versions(), _flags(), repr(settings()))


def settings() -> tuple:
    """The settings of JAX and Equinox that programs depend on."""
    # Named axes, an object without a text, are there only within a transformation.
    context = (x for x in jax_config.trace_context() if not isinstance(x, jax_core.AxisEnv))
    return (_jax.jax_enable_x64, equinox_config.EQX_ON_ERROR, *context)


def is_plain() -> bool:
    """Whether programs run as in any process like this one: on one CPU, without checks for errors."""
    return (
        jax.default_backend() == "cpu"
        and jax.local_device_count() == 1
        and _jax.jax_default_device is None
        and not (_jax.jax_debug_nans or _jax.jax_debug_infs or _jax.jax_disable_jit)
        and processor() != ""
    )


@functools.cache
def source_digest() -> str:
    """A digest of all Python sources of this library, read once a process. The version's number alone does not
    distinguish two states of a working copy.
    """
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


@functools.cache
def processor() -> str:
    """The abilities of this processor; empty if they are not known."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    words = "flags", "Features", "model", "CPU part", "cpu family", "vendor"
    told = sorted({x for x in lines if x.startswith(words)})
    return hash_texts(platform.machine(), *told) if any(x.startswith(("flags", "Features")) for x in told) else ""


@functools.cache
def _versions() -> str:
    return hash_texts(sys.version, *(f"{name} {_version(name)}" for name in VERSIONED))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"


def _flags() -> bytes:
    """XLA's flags with which programs are compiled."""
    options = compiler.get_compile_options(num_replicas=1, num_partitions=1)
    return options.SerializeAsString()
