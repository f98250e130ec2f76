"""What every test stands on: 64-bit numbers, no silent promotion, checked shapes, and the same inputs every time."""

from __future__ import annotations

from pathlib import Path

import jax
import pytest
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

from tests import array_modules, compiled_code

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
install_import_hook(array_modules.names(), "beartype.beartype")

settings.register_profile(
    "slidax",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("slidax")


OWN = pytest.StashKey[Path]()


def pytest_configure(config: pytest.Config) -> None:
    """Most of a day's run goes into XLA's compiler: so it does little, and what it has done is kept for the next run.

    The long version compiles everything anew, and as a user does.
    """
    if config.getoption("markexpr") == "not full":
        jax.config.update("jax_disable_most_optimizations", True)
        if config.pluginmanager.has_plugin("cacheprovider"):
            config.stash[OWN] = compiled_code.taken(config.cache.mkdir("xla"))


def pytest_unconfigure(config: pytest.Config) -> None:
    if OWN in config.stash:
        compiled_code.given_back(config.stash[OWN])
