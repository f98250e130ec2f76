"""Settings of all tests: 64-bit numbers, no silent promotion, checked shapes, and the same inputs every time."""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

import jax
import pytest
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

# Containers often switch the files of compiled modules off; the tests start so many processes that this costs minutes.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Processes of pytest-xdist set it, and messages in a pipe would be wrapped.
os.environ.pop("COLUMNS", None)

from tests import array_modules, compiled_code  # noqa: E402  (once compiled modules are kept)

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
install_import_hook(array_modules.names(), "beartype.beartype")

from slidax.codegen.llvm import machine  # noqa: E402  (once its shapes are checked)

settings.register_profile(
    "slidax",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("slidax")


OWN = pytest.StashKey[Path]()

MOST_MAPS = 25_000
"""Largest number of memory maps of a process: Linux allows 65 530, and the next test may need thousands."""


def pytest_configure(config: pytest.Config) -> None:
    """In daily runs, compile without most optimizations and keep XLA's programs for the next run, to save time.

    The results have the same bits at any optimization level of LLVM, which tests/codegen shows. The long version
    compiles everything anew, as for a user.
    """
    if config.getoption("markexpr") == "not full":
        jax.config.update("jax_disable_most_optimizations", True)
        machine.OPTIMISED = 0
        if config.pluginmanager.has_plugin("cacheprovider"):
            config.stash[OWN] = compiled_code.open_own_folder(config.cache.mkdir("xla"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave slow tests to the long version (`scripts/write-long-tests`)."""
    names = (Path(__file__).parent / "long_tests.txt").read_text(encoding="utf-8").splitlines()
    long = set(names)
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.full)


def pytest_collection_finish() -> None:
    """Keep the garbage collector from searching imported modules and collected tests again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Clear JAX's caches in the long version before the process reaches Linux's limit of memory maps and dies."""
    if item.config.getoption("markexpr") != "not full" and compiled_code.memory_maps() > MOST_MAPS:
        jax.clear_caches()
        gc.collect()


def pytest_unconfigure(config: pytest.Config) -> None:
    if OWN in config.stash:
        compiled_code.keep_programs(config.stash[OWN])
