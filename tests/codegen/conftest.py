"""Fixtures of all tests of the code generator."""

import jax
import pytest

from slidax.codegen.llvm import machine

USUAL = 2
"""LLVM's level as users have it."""


@pytest.fixture(autouse=True)
def _optimised(monkeypatch):
    """As users have it: XLA's bits, since without its optimisations roundings are others; LLVM's code."""
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", False)
    with monkeypatch.context() as usual:
        usual.setattr(machine, "OPTIMISED", USUAL)
        machine.host.cache_clear()
        yield
    machine.host.cache_clear()
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder of the test's own for the object code that is kept."""
    monkeypatch.setattr(machine, "folder", lambda: tmp_path / "native")
    return tmp_path / "native"
