"""Functions without native code are refused by name, in one line, with the source location and the remedy."""

import importlib

import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from slidax.codegen import NoNativeCodeError, builder, trace
from slidax.codegen.trace import tracing

X = jnp.array([0.3, -1.7, 2.5])


def around(inner):
    """A root whose solver is `inner`."""
    return lambda e: lax.custom_root(lambda x: x - e, e, lambda f, x: inner(x - f(x)), lambda g, y: y)


@pytest.mark.parametrize(
    ("primitive", "function", "remedy"),
    [
        ("sort", jnp.sort, "jnp.max"),
        ("top_k", lambda e: lax.top_k(e, 2)[0], "jnp.argmax"),
        ("convert_element_type", lambda e: jnp.real(jnp.fft.fft(e)), "arrays of complex128; use float64"),
        ("fft", lambda e: jnp.fft.irfft(jnp.fft.rfft(e)), "other operations of `jax.numpy`"),
        ("lu", lambda e: jnp.linalg.solve(jnp.eye(3) + jnp.outer(e, e), e), "solve_symmetric"),
        ("cholesky", lambda e: jnp.linalg.cholesky(jnp.diag(e)), "solve_symmetric"),
        ("lgamma", lax.lgamma, "engine `xla`"),
        ("reduce_precision", lambda e: lax.reduce_precision(e, 8, 10), "engine `xla`"),
        ("sort", around(jnp.sort), "jnp.max"),
        ("sort", lambda e: lax.fori_loop(0, 2, lambda _, e: jnp.sort(e), e), "jnp.max"),
        ("sort", lambda e: lax.cond(e[0] > 0, jnp.sort, lambda e: e, e), "jnp.max"),
    ],
)
def test_unknown_primitive_is_named_with_its_location_and_an_alternative(primitive, function, remedy):
    with pytest.raises(NoNativeCodeError, match=f"the JAX primitive `{primitive}` \\(line ") as error:
        trace(lambda e: function(e), X)
    assert __file__ in str(error.value)
    assert remedy in str(error.value)


@pytest.mark.parametrize("failure", [AssertionError(), KeyError("jaxpr"), MemoryError("many\nlines"), RecursionError()])
def test_failing_translation_rule_is_reported_with_its_location_in_one_line(monkeypatch, failure):
    def fails(*_):
        raise failure

    # The function `slidax.codegen.trace` shadows the package of this name.
    monkeypatch.setitem(importlib.import_module("slidax.codegen.trace.tracing").PLAIN, "tanh", fails)
    with pytest.raises(NoNativeCodeError) as error:
        trace(lambda x: lax.fori_loop(0, 3, lambda _, x: jnp.tanh(x), x), X)
    message = str(error.value)
    assert message.startswith("no native code for the JAX primitive `tanh` (line ")
    assert __file__ in message
    assert type(failure).__name__ in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("operations", "size"),
    [(lambda x: jnp.sum(x * x), 1000), (lambda x: x[0] + 1.0, 3000)],
    ids=["operations", "values"],
)
def test_a_program_with_too_many_operations_or_values_is_refused_before_memory_is_full(monkeypatch, operations, size):
    monkeypatch.setattr(builder, "LARGEST", 2000)
    monkeypatch.setattr(builder, "LARGEST_CODE", 500)
    with pytest.raises(NoNativeCodeError, match="programs of more than 500 operations or 2000 values"):
        trace(operations, jnp.ones(size))
    trace(operations, jnp.ones(100))


def test_numbers_of_an_unknown_type_are_refused_by_name():
    with pytest.raises(NoNativeCodeError, match="`position`"):
        trace(lambda x: x, X.astype(jnp.float16), names=("position",))


def test_installed_packages_count_as_user_code_inside_the_standard_library_folder(monkeypatch):
    monkeypatch.setattr(tracing, "STANDARD", "/usr/lib/python3")
    monkeypatch.setattr(tracing, "INSTALLED", ("/usr/lib/python3/site-packages",))
    places = {"site-packages/law.py": True, "functools.py": False}
    for name, own in places.items():
        assert tracing._is_own(f"/usr/lib/python3/{name}") == own
    assert not tracing._is_own(np.__file__) and not tracing._is_own(tracing.__file__)
