"""Operations on all elements of an array become loops in C, and long functions of the source stay functions."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax.codegen import trace
from slidax.codegen.builder import Builder
from slidax.codegen.c import statements
from slidax.codegen.c.layout import CodeLine, add_scopes, stack_bytes
from slidax.codegen.c.writer import Callee
from slidax.codegen.ir import Call, functions
from slidax.codegen.passes import rebuild
from slidax.codegen.trace import Library
from slidax.core import barrier

N = 7


def text_of(program, pairs, names):
    """The statements that assign values to places, with loops."""
    lines = statements(program, pairs, lambda k, e: f"{names[k]}[{e}]", loops=True).lines
    return [line.strip() for line in lines if line.strip()]


def written(function, *args, **options):
    """The statements of a function of arrays, with loops."""
    program = trace(function, *args, **options)
    outputs = [value for output in program.outputs for value in output.values]
    return text_of(program, [(f"out[{k}]", value) for k, value in enumerate(outputs)], "xyz")


def test_elementwise_array_expression_becomes_a_c_loop():
    assert written(lambda x, y: jnp.tanh(x) * y + 2.0, jnp.ones(N), jnp.ones(N)) == [
        "for (size_t i = 0; i < 7; ++i) {",
        "out[i] = tanh(x[i]) * y[i] + 2.0;",
        "}",
    ]


def test_columns_and_reversed_rows_become_index_expressions():
    assert "out[i] = x[3 * i + 1] * y[6 - i];" in written(lambda a, x: a[:, 1] * x[::-1], jnp.ones((N, 3)), jnp.ones(N))


def test_cumulative_sum_keeps_its_order():
    assert written(lambda x: jnp.cumsum(jnp.sin(x)), jnp.ones(N)) == [
        "double v[5];",
        "v[0] = sin(x[0]);",
        "for (size_t i = 0; i < 4; ++i) {",
        "v[i + 1] = sin(x[i + 1]) + v[i];",
        "}",
        "const double v6 = sin(x[5]) + v[4];",
        "memcpy(out, v, 5 * sizeof v[0]);",
        "out[5] = v6;",
        "out[6] = sin(x[6]) + v6;",
    ]


def test_a_partial_sum_in_an_array_becomes_a_loop():
    def sums(x):
        partial = [jnp.sin(x[0])]
        for k in range(1, N):
            partial.append(jnp.sin(x[k]) + partial[-1])
        return barrier(jnp.stack(partial)) * 2.0

    text = written(sums, jnp.ones(N), library=Library())
    assert text[:3] == ["double partial[7];", "partial[0] = sin(x[0]);", "partial[1] = partial[0] + sin(x[1]);"]
    assert text[3:6] == ["for (size_t i = 0; i < 5; ++i) {", "partial[i + 2] = sin(x[i + 2]) + partial[i + 1];", "}"]
    assert text[6:] == ["for (size_t i = 0; i < 7; ++i) {", "out[i] = 2.0 * partial[i];", "}"]


def test_joint_with_a_different_formula_stays_in_the_common_array():
    def function(x, y):
        others = jnp.concatenate([jnp.sin(x[:-1]) + y[1:], x[-1:] - y[:1]])
        turned = jnp.tanh(others)
        return turned * turned + others

    text = written(function, jnp.ones(N), jnp.ones(N))
    assert "turned[i] = tanh(v[i]);" in text
    assert "out[i] = turned[i] * turned[i] + v[i];" in text
    assert not any(line.startswith("out[6]") for line in text)


def test_conditions_on_all_elements_become_a_loop_or_a_function_call():
    def function(x, low):
        return jnp.all(jnp.isfinite(x)), jnp.any(jnp.abs(x) * 2.0 + low > low * low), jnp.any(x > low) & (low[0] > 0)

    text = written(function, jnp.ones(30), jnp.ones(30))
    assert "out[0] = all_finite(x, 30);" in text
    some = text.index("bool some = false;")
    assert text[some + 1 : some + 4] == [
        "for (size_t i = 0; i < 30; ++i) {",
        "some = some || 2.0 * fabs(x[i]) + y[i] > y[i] * y[i];",
        "}",
    ]
    few = written(lambda x, low: jnp.any(x > low), jnp.ones(3), jnp.ones(3))
    assert few == ["out[0] = x[0] > y[0] || x[1] > y[1] || x[2] > y[2];"]


def assigned(*pairs):
    """Return the C text of assignments of inputs and numbers."""
    builder = Builder()
    inputs = builder.input("memory->x", "f64", (30,))
    zero = builder.constant(0.0, "f64")
    return text_of(builder.program, [(to, zero if of is None else inputs[of]) for to, of in pairs], ["memory->x"])


def test_block_moves_use_memcpy_and_never_overwrite_unread_values():
    assert assigned(*[(f"y[{k}]", k + 2) for k in range(4)], *[(f"z[{k}]", None) for k in range(9)]) == [
        "memcpy(y, &memory->x[2], 4 * sizeof y[0]);",
        "memset(z, 0, 9 * sizeof z[0]);",
    ]
    # The second move overwrites the source of the first move, so the order matters.
    moved = [(f"memory->x[{k + 10}]", k) for k in range(5)] + [(f"memory->x[{k}]", k + 20) for k in range(5)]
    assert assigned(*moved[::-1]) == [
        "memcpy(&memory->x[10], memory->x, 5 * sizeof memory->x[0]);",
        "memcpy(memory->x, &memory->x[20], 5 * sizeof memory->x[0]);",
    ]
    # Overlapping ranges move element by element, beginning at the end that is no longer needed.
    shifted = assigned(*[(f"memory->x[{k}]", k + 1) for k in range(6)])
    assert shifted == ["for (size_t i = 0; i < 6; ++i) {", "memory->x[i] = memory->x[i + 1];", "}"]


def test_values_are_overwritten_after_their_last_read():
    builder = Builder()
    x = builder.input("x", "f64", (8,))
    double = [builder.apply("add", element, element) for element in x]
    pairs = [(f"x[{k}]", double[k + 4]) for k in range(4)]
    pairs += [(f"y[{k}]", builder.apply("neg", x[k + 1])) for k in range(4)]
    text = text_of(builder.program, pairs, "x")
    assert text.index("y[i] = -x[i + 1];") < text.index("x[i] = x[i + 4] + x[i + 4];")


@jax.jit
def _long(x, y):
    for _ in range(6):
        x = jnp.tanh(x * y) + x
    return x


@jax.jit
def _short(x):
    return x + 1.0


def test_a_long_function_called_twice_is_shared():
    library = Library()
    program = trace(lambda x, y: _long(x, y) + _long(_short(x), y), jnp.ones(N), jnp.ones(N), library=library)
    calls = [value for value in program.walk() if isinstance(value, Call)]
    assert len(calls) == 2
    assert calls[0].program is calls[1].program
    assert [function.name for function in functions(program)] == ["long"]


def test_equal_calls_are_merged_and_constants_are_not_passed():
    library = Library()

    def function(x):
        return _long(x, jnp.full(N, 2.0)) * _long(x, jnp.full(N, 2.0))

    program = trace(function, jnp.ones(N), library=library)
    (call,) = [value for value in program.walk() if isinstance(value, Call)]
    assert len(call.args) == N
    again = rebuild(program, lambda builder, value, args: None)
    assert [function.name for function in functions(again)] == ["long"]


def test_all_functions_are_inlined_without_a_library():
    program = trace(lambda x: _long(x, x), jnp.ones(N))
    assert not functions(program)


def test_consecutive_blocks_share_their_stack():
    lines = []
    for k in range(3):
        lines += [CodeLine(1, f"double a{k}[40];", f"part {k}"), CodeLine(1, f"f(a{k});", f"part {k}")]
    assert stack_bytes(lines) == 3 * 320
    blocks = add_scopes(lines)
    assert stack_bytes(blocks) == 320
    assert sum(line.text == "{" for line in blocks) == 3


def test_variables_needed_after_a_block_are_declared_before_it():
    lines = [
        CodeLine(1, "double a[40];", "one"),
        CodeLine(1, "const double s = f(a);", "one"),
        CodeLine(1, "double b[40];", "two"),
        CodeLine(1, "g(b, s);", "two"),
    ]
    texts = [line.text for line in add_scopes(lines)]
    assert texts.index("double s;") < texts.index("{") < texts.index("s = f(a);")


def test_variable_for_a_call_result_avoids_names_of_the_c_library():
    def function(x):
        free = _long(x, x)
        return free + _long(free, x)

    program = trace(function, jnp.ones(N), library=Library())
    values = program.outputs[0].values
    text = statements(
        program,
        [(f"out[{k}]", value) for k, value in enumerate(values)],
        lambda k, e: f"x[{e}]",
        callees=lambda called: Callee("long", (), (0, 1)),
    ).lines
    assert "double free_[7];" in map(str.strip, text)
