"""Shapes of arrays are checked while the tests run."""

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

from slidax.core import vector_norm
from tests import array_modules


def test_every_module_that_writes_shapes_is_checked():
    names = set(array_modules.names())
    writes = {
        ".".join(("slidax", *path.relative_to(array_modules.SOURCE).with_suffix("").parts))
        for path in array_modules.SOURCE.rglob("*.py")
        if "from jaxtyping import" in (text := path.read_text(encoding="utf-8")) and "Float[" in text
    }
    assert {name for name in writes if not name.startswith("slidax.codegen.")} <= names
    assert "slidax.core.powers" in names


def test_a_wrong_shape_is_an_error():
    with pytest.raises(TypeCheckError):
        vector_norm(jnp.zeros((2, 2)))
