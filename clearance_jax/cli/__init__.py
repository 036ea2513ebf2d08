"""The command `clearance`."""

from clearance_jax.cli.main import main

__all__ = ["main"]
