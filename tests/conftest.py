"""What every test stands on: 64-bit numbers, no silent promotion, checked shapes, and the same inputs every time."""

from __future__ import annotations

import jax
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
install_import_hook("slidax", "beartype.beartype")

settings.register_profile(
    "slidax",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("slidax")
