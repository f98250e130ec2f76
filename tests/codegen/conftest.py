"""Fixtures of all tests of the code generator."""

import jax
import pytest

from slidax.codegen.llvm import machine

USUAL = 2
"""LLVM's optimisation level for users."""


@pytest.fixture(autouse=True)
def _optimised(monkeypatch):
    """Use the users' optimisation levels of XLA, whose roundings depend on them, and of LLVM."""
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
    """The test's own cache folder for object code."""
    monkeypatch.setattr(machine, "folder", lambda: tmp_path / "native")
    return tmp_path / "native"
