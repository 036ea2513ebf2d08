"""The three voices of error: structure and value raise here; what happens inside a solve is a result code."""

import jax


class ClearanceError(ValueError):
    """A scene, a mechanism or an argument that cannot be simulated. The message names the place and the fix."""


def require_float64() -> None:
    """Raise unless 64-bit floats are on: a penetration of 1e-8 m on a 1 m arm does not exist in float32."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise ClearanceError(
            "clearance_jax needs 64-bit floats, but they are off in JAX. Call `clearance_jax.configure()` before "
            "anything else, or set the environment variable JAX_ENABLE_X64=1."
        )


def suggest(word: str, allowed) -> str:
    """A sentence that lists the allowed words, the nearest first."""
    import difflib

    allowed = sorted(allowed)
    near = difflib.get_close_matches(word, allowed, n=1)
    hint = f"Did you mean `{near[0]}`? " if near else ""
    return f"{hint}Allowed: {', '.join(allowed)}." if allowed else "There are none here."
