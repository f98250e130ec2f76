"""What there is no native code for is refused by name, in one line, with the place in the source and the remedy."""

import importlib

import jax.numpy as jnp
import pytest
from jax import lax

from slidax.codegen import NoNativeCodeError, builder, trace

X = jnp.array([0.3, -1.7, 2.5])
A = jnp.arange(12.0).reshape(3, 4) - 5.0


@pytest.mark.parametrize(
    ("function", "primitive", "remedy"),
    [
        (lambda x: jnp.sort(x), "sort", "jnp.max"),
        (lambda x: jnp.linalg.cholesky(jnp.diag(x)), "cholesky", "solve_symmetric"),
        (lambda x: lax.lgamma(x), "lgamma", "engine `xla`"),
    ],
)
def test_an_unknown_primitive_is_named_with_its_place_and_what_to_write_instead(function, primitive, remedy):
    with pytest.raises(NoNativeCodeError) as error:
        trace(function, X)
    assert f"`{primitive}`" in str(error.value)
    assert __file__ in str(error.value)
    assert remedy in str(error.value)


def test_a_linear_system_that_jax_solves_by_a_library_is_refused_with_the_remedy():
    with pytest.raises(NoNativeCodeError, match=r"`lu`.*solve_symmetric"):
        trace(lambda a: jnp.linalg.solve(a, jnp.ones(2)), jnp.eye(2))


def rules():
    # Of the module, which the package shadows by its function.
    return importlib.import_module("slidax.codegen.trace.tracing").PLAIN


@pytest.mark.parametrize("failure", [AssertionError(), KeyError("jaxpr"), MemoryError("many\nlines"), RecursionError()])
def test_a_rule_that_fails_is_named_with_its_place_in_one_line(monkeypatch, failure):
    def fails(*_):
        raise failure

    monkeypatch.setitem(rules(), "tanh", fails)
    with pytest.raises(NoNativeCodeError) as error:
        trace(lambda x: lax.fori_loop(0, 3, lambda _, x: jnp.tanh(x), x), X)
    said = str(error.value)
    assert said.startswith("no native code for the JAX primitive `tanh` (line ")
    assert __file__ in said
    assert type(failure).__name__ in said
    assert "\n" not in said


@pytest.mark.parametrize("operations", [lambda x: jnp.sum(x * x), lambda x: x[0] + 1.0])
def test_a_program_of_too_many_numbers_is_refused_before_it_fills_the_memory(monkeypatch, operations):
    monkeypatch.setattr(builder, "LARGEST", 2000)
    monkeypatch.setattr(builder, "LARGEST_CODE", 500)
    with pytest.raises(NoNativeCodeError, match="programs of more than 500 operations or 2000 values"):
        trace(operations, jnp.ones(1000 if "sum" in str(operations.__code__.co_names) else 3000))
    trace(operations, jnp.ones(100))


def test_numbers_of_an_unknown_type_are_refused_by_name():
    with pytest.raises(NoNativeCodeError, match="`position`"):
        trace(lambda x: x, X.astype(jnp.float16), names=("position",))
