"""How many bits numbers have."""

from __future__ import annotations

import jax

from slidax._errors import DefinitionError


def require_64_bits() -> None:
    """Raises DefinitionError where JAX cuts numbers to 32 bits."""
    if not jax.config.read("jax_enable_x64"):
        raise DefinitionError(
            'slidax needs 64-bit numbers: call jax.config.update("jax_enable_x64", True) before anything else'
        )
