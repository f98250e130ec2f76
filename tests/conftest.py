"""What every test stands on: 64-bit numbers, no silent promotion, checked shapes, and the same inputs every time."""

from __future__ import annotations

import pkgutil
import time

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


WEEK = 7 * 24 * 3600.0
"""How long compiled code is kept [s]."""


def pytest_configure(config):
    """Most of a day's run went into XLA's compiler: so it does little, and what it has done is kept for the next run.

    The long version compiles everything anew and as a user does.
    """
    if config.getoption("markexpr") != "not full":
        return
    jax.config.update("jax_disable_most_optimizations", True)
    if getattr(config, "cache", None) is None:
        return
    kept = config.cache.mkdir("xla")
    if not hasattr(config, "workerinput"):
        for file in kept.iterdir():
            if time.time() - file.stat().st_mtime > WEEK:
                file.unlink(missing_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(kept))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
