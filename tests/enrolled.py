"""Run a test for every member of a family: `members.py` of a folder lists its members as (name, instance)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest


def every(
    name: str, members: Sequence[tuple[str, Any]], full: Sequence[str] = (), scope: str | None = None
) -> pytest.MarkDecorator:
    """Runs the test once per member.

    - `name`: the argument of the test that takes the member.
    - `members`: (name, instance) pairs.
    - `full`: names of members that are for the long version alone.
    - `scope`: "module" keeps the tests of a member together, so that a fixture of that scope serves all of them.
    """
    parameters = [
        pytest.param(instance, id=label, marks=[pytest.mark.full] if label in full else [])
        for label, instance in members
    ]
    return pytest.mark.parametrize(name, parameters, scope=scope)


def stacked(parts: Sequence[Any]) -> Any:
    """Pytrees of one structure, stacked leaf by leaf."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)


def assert_same(a: Any, b: Any, rtol: float = 0.0, atol: float | None = None) -> None:
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(x, y, rtol=rtol, atol=rtol if atol is None else atol)


def assert_same_numbers(a: Any, b: Any) -> None:
    """Check that two pytrees have the same arrays, whatever their static fields."""
    assert_same(jax.tree.leaves(a), jax.tree.leaves(b))


def assert_same_form(a: Any, b: Any) -> None:
    """Check structure, shapes and types of two pytrees."""
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert (x.shape, x.dtype) == (y.shape, y.dtype)


def assert_finite(tree: Any) -> None:
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(tree))


def assert_float_leaves(part: Any) -> None:
    """Check that all numbers of a part are floating arrays, which a batch can vary."""
    leaves = jax.tree.leaves(part)
    assert leaves and all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in leaves)
