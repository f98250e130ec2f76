"""What every test stands on: 64-bit numbers, no silent promotion, checked shapes, and the same inputs every time."""

from __future__ import annotations

import pkgutil

import jax
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

import slidax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
# Not codegen: it works on numbers one by one, and to check the arguments of every call takes ten times as long as it.
rooms = [room.name for room in pkgutil.iter_modules(slidax.__path__) if room.name != "codegen"]
install_import_hook([f"slidax.{room}" for room in rooms], "beartype.beartype")

settings.register_profile(
    "slidax",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("slidax")
