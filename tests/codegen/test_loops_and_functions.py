"""What is alike for all elements of an array becomes a loop in C, and a long function of the source stays one."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax.codegen.c import statements
from slidax.codegen.c.layout import Line
from slidax.codegen.c.scopes import scoped, stack
from slidax.codegen.ir import Call, functions
from slidax.codegen.rebuild import rebuild
from slidax.codegen.trace import Library, trace

N = 7


def written(function, *args):
    """The statements of a function of arrays, with loops."""
    program = trace(function, *args)
    outputs = [value for output in program.outputs for value in output.values]
    assigned = [(f"out[{k}]", value) for k, value in enumerate(outputs)]
    lines = statements(program, assigned, lambda k, e: f"{'xyz'[k]}[{e}]", loops=True).lines
    return [line.strip() for line in lines if line.strip()]


def test_one_operation_on_an_array_is_a_loop():
    assert written(lambda x, y: jnp.tanh(x) * y + 2.0, jnp.ones(N), jnp.ones(N)) == [
        "for (size_t i = 0; i < 7; ++i) {",
        "out[i] = tanh(x[i]) * y[i] + 2.0;",
        "}",
    ]


def test_columns_and_reversed_rows_are_found_by_a_rule():
    text = written(lambda a, x: a[:, 1] * x[::-1], jnp.ones((N, 3)), jnp.ones(N))
    assert "out[i] = a[3 * i + 1] * x[6 - i];".replace("a[", "x[").replace(" * x[6", " * y[6") in text


def test_what_hangs_on_the_element_before_stays_in_order():
    text = written(lambda x: jnp.cumsum(jnp.sin(x)), jnp.ones(N))
    assert len([line for line in text if line.startswith("for")]) <= 1
    assert sum("sin(" in line for line in text) in (1, N)


def test_a_branch_within_leaves_an_array():
    text = written(lambda x: jax.lax.cond(x[0] > 0, lambda: jnp.exp(x), lambda: x), jnp.ones(N))
    assert "out[i] = exp(x[i]);" in text or any("exp(x[i])" in line for line in text)


@jax.jit
def _long(x, y):
    for _ in range(6):
        x = jnp.tanh(x * y) + x
    return x


@jax.jit
def _short(x):
    return x + 1.0


def test_a_long_function_that_is_called_twice_is_one():
    library = Library()
    program = trace(lambda x, y: _long(x, y) + _long(_short(x), y), jnp.ones(N), jnp.ones(N), library=library)
    calls = [value for value in program.walk() if isinstance(value, Call)]
    assert len(calls) == 2
    assert calls[0].program is calls[1].program
    assert [one.name for one in functions(program)] == ["long"]


def test_the_same_call_is_made_once_and_known_numbers_are_no_arguments():
    library = Library()

    def function(x):
        return _long(x, jnp.full(N, 2.0)) * _long(x, jnp.full(N, 2.0))

    program = trace(function, jnp.ones(N), library=library)
    (call,) = [value for value in program.walk() if isinstance(value, Call)]
    assert len(call.args) == N
    again = rebuild(program, lambda builder, value, args: None)
    assert [one.name for one in functions(again)] == ["long"]


def test_without_a_library_all_is_written_out():
    program = trace(lambda x: _long(x, x), jnp.ones(N))
    assert not functions(program)


def test_blocks_that_follow_each_other_share_their_stack():
    lines = []
    for k in range(3):
        lines += [Line(1, f"double a{k}[40];", f"part {k}"), Line(1, f"f(a{k});", f"part {k}")]
    assert stack(lines) == 3 * 320
    blocks = scoped(lines)
    assert stack(blocks) == 320
    assert sum(line.text == "{" for line in blocks) == 3


def test_what_is_needed_after_a_block_is_declared_before_it():
    lines = [
        Line(1, "double a[40];", "one"),
        Line(1, "const double s = f(a);", "one"),
        Line(1, "double b[40];", "two"),
        Line(1, "g(b, s);", "two"),
    ]
    texts = [line.text for line in scoped(lines)]
    assert texts.index("double s;") < texts.index("{") < texts.index("s = f(a);")
