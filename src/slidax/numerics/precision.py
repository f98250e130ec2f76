"""Check for 64-bit numbers."""

from __future__ import annotations

import jax

from slidax._errors import DefinitionError


def require_64_bits() -> None:
    """Raise DefinitionError if JAX computes with 32-bit numbers."""
    if not jax.config.read("jax_enable_x64"):
        raise DefinitionError(
            'slidax needs 64-bit numbers: call jax.config.update("jax_enable_x64", True) before anything else'
        )
