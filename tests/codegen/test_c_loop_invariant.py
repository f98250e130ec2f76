"""Values that depend on parameters only are computed separately."""

import jax.numpy as jnp
import numpy as np
from jax import lax

from slidax.codegen import trace
from slidax.codegen.builder import Builder
from slidax.codegen.c import loop_invariant, statements


def split(function, *args):
    """Return the statements that depend on the first argument only, and the other statements."""
    program = trace(function, *args)
    kept = loop_invariant(program, {0})
    places = {value: f"workspace->kept{k}" for k, value in enumerate(kept)}
    read = lambda k, e: f"{'pxyz'[k]}[{e}]"  # noqa: E731
    outputs = [(f"out[{k}]", value) for k, value in enumerate(v for o in program.outputs for v in o.values)]
    first = statements(program, [(text, value) for value, text in places.items()], read)
    return "\n".join(first.lines), "\n".join(statements(program, outputs, read, precomputed=places).lines)


def test_values_that_depend_on_parameters_only_are_precomputed():
    derived, step = split(lambda p, x: jnp.exp(p[0]) * x + p[1] * 2.0, jnp.ones(2), jnp.ones(()))
    assert "exp(p[0])" in derived
    assert "exp" not in step
    assert "workspace->kept0" in step
    assert "2.0 * p[1]" in step, "a product is not worth a place in memory"


def test_cheap_functions_of_stored_values_are_not_stored():
    derived, step = split(lambda p, x: (jnp.exp(p[0]) * x, 2.0 * jnp.exp(p[0]) + x), jnp.ones(2), jnp.ones(()))
    assert derived.count("workspace->") == 1
    assert "2.0 * workspace->kept0" in step


def test_parameter_values_inside_branches_and_loops_are_precomputed():
    def law(p, x):
        inside = lambda: lax.fori_loop(0, 3, lambda i, a: a * jnp.exp(p[0]), x)  # noqa: E731
        return lax.cond(x > 0.0, inside, lambda: x)

    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "exp(p[0])" in derived
    assert "exp" not in step
    assert "x[" not in derived


def test_loop_that_depends_on_parameters_only_is_precomputed():
    law = lambda p, x: x * lax.fori_loop(0, 30, lambda i, a: 0.5 * (a + p[1] / a), p[0])  # noqa: E731
    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "for (" in derived
    assert "for (" not in step


def test_a_loop_that_may_be_endless_stays_in_its_branch():
    def law(p, x):
        halved = lambda: lax.while_loop(lambda a: a > 1.0, lambda a: a * p[1], p[0])  # noqa: E731
        return lax.cond(x > 0.0, halved, lambda: x)

    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "while (" not in derived
    assert "while (" in step


def test_a_table_value_with_a_guarded_index_is_not_precomputed():
    b = Builder()
    b.input("table", "f64", (3,))
    index, x = b.input("index", "i64", ())[()], b.input("x", "f64", ())[()]
    in_range = b.apply("lt", index, b.constant(3, "i64"))
    read = lambda: [b.apply("exp", b.apply("load", index, type="f64", data=0))]  # noqa: E731
    result = b.branch(in_range, read, lambda: [x])
    b.output("y", "f64", np.array(result, object))
    assert loop_invariant(b.program, {0, 1}) == []
