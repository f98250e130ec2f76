"""What all tests of the code generator share."""

import jax
import pytest


@pytest.fixture(autouse=True)
def _optimised():
    """XLA's bits as users have them: without its optimisations a chain of roundings is another one."""
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)
