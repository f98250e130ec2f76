"""Generated C is readable."""

import math
import re

import numpy as np
import pytest

from slidax.codegen.builder import Builder
from slidax.codegen.c import Dialect, statements
from slidax.codegen.c.expressions import shortest_decimal


def named(builder, count):
    """Return inputs of a builder, and a function that prints values with the inputs' names."""
    inputs = [builder.input("abcdefgh"[k], "f64", ())[()] for k in range(count)]

    def text(*outputs):
        assigned = [(f"y{k}", value) for k, value in enumerate(outputs)]
        read = lambda k, e: builder.program.inputs[k].name  # noqa: E731
        return [line.strip() for line in statements(builder.program, assigned, read).lines if line]

    return inputs, text


def test_an_output_may_share_memory_with_an_input_and_is_not_assigned_if_unchanged():
    b = Builder()
    x = b.input("x", "f64", (2,))

    def text(*assigned):
        lines = statements(b.program, list(assigned), lambda k, element: f"state->x[{element}]").lines
        return [line.strip() for line in lines if line]

    swapped = text(("state->x[0]", x[1]), ("state->x[1]", b.apply("neg", x[0])))
    assert swapped == ["const double x_2 = state->x[1];", "state->x[1] = -state->x[0];", "state->x[0] = x_2;"]
    chained = text(("state->x[0]", x[1]), ("state->x[1]", b.constant(0.0, "f64")))
    assert chained == ["state->x[0] = state->x[1];", "state->x[1] = 0.0;"]
    kept = text(("state->x[0]", x[0]), ("y", b.apply("mul", x[0], x[0])))
    assert kept == ["const double x_1 = state->x[0];", "y = x_1 * x_1;"]


def test_parentheses_are_only_where_they_are_needed():
    b = Builder()
    (x, y, z), text = named(b, 3)
    cases = {
        "x + y * z": b.apply("add", x, b.apply("mul", y, z)),
        "z * (x + y)": b.apply("mul", b.apply("add", x, y), z),
        "x - (y - z)": b.apply("sub", x, b.apply("sub", y, z)),
        "x - y - z": b.apply("sub", b.apply("sub", x, y), z),
        "x / (y * z)": b.apply("div", x, b.apply("mul", y, z)),
        "y / z * x": b.apply("mul", x, b.apply("div", y, z)),
        "y + z + x": b.apply("add", x, b.apply("add", y, z)),
        "2.0 * x": b.apply("mul", x, b.constant(2.0, "f64")),
        "x - 2.0": b.apply("add", b.constant(-2.0, "f64"), x),
        "x + 2.0": b.apply("sub", x, b.constant(-2.0, "f64")),
        "-(x + y)": b.apply("neg", b.apply("add", x, y)),
        "-x * y": b.apply("neg", b.apply("mul", x, y)),
        "x * y * (x * z)": b.apply("mul", b.apply("mul", x, y), b.apply("mul", x, z)),
        "x + y + (x + z)": b.apply("add", b.apply("add", x, y), b.apply("add", x, z)),
        "x * x * x": b.apply("mul", b.apply("mul", x, x), x),
        "pow(x + y, z)": b.apply("pow", b.apply("add", x, y), z),
        "x < y ? x : z": b.apply("select", b.apply("lt", x, y), x, z),
    }
    first, second, third = b.apply("lt", x, y), b.apply("ge", y, z), b.apply("isfinite", z)
    cases |= {
        "isfinite(z) || (x < y && y >= z)": b.apply("or", b.apply("and", first, second), third),
        "isfinite(z) && (x < y || y >= z)": b.apply("and", b.apply("or", first, second), third),
        "!(x < y)": b.apply("not", first),
        "isnan(x)": b.apply("ne", x, x),
    }
    for expected, value in cases.items():
        swapped = re.sub(r"\b[xyz]\b", lambda name: "abc"["xyz".index(name.group())], expected)
        assert text(value)[-1] == f"y0 = {swapped};", expected


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.5, "0.5"), (1.0, "1.0"), (0.001, "1e-3"), (-2.5, "-2.5"), (1e6, "1e6"), (0.0, "0.0"), (100.0, "100.0")],
)
def test_numbers_have_their_shortest_form(number, text):
    assert Dialect().number(number, "f64") == text
    assert Dialect("float").number(number, "f64") == text + "f"


def test_every_number_reads_back_to_the_same_bits():
    random = np.random.default_rng(3)
    for number in random.integers(0, 2**64, 4000, np.uint64).view(np.float64):
        if math.isfinite(number):
            assert float(shortest_decimal(repr(float(number)))) == number
    for number in random.integers(0, 2**32, 4000, np.uint32).view(np.float32):
        if np.isfinite(number):
            assert np.float32(Dialect().number(float(number), "f32").rstrip("f")) == number


@pytest.mark.parametrize(
    ("number", "text"), [(1.7e308, "3.4028235e38f"), (-1e-300, "-1.1754944e-38f"), (math.inf, "INFINITY")]
)
def test_limit_beyond_the_float_range_becomes_the_largest_or_smallest_float(number, text):
    assert Dialect("float").number(number, "f64") == text


def test_values_used_once_are_written_inline():
    b = Builder()
    (x, y), text = named(b, 2)
    product = b.apply("mul", x, y)
    assert text(b.apply("sin", product)) == ["y0 = sin(a * b);"]
    assert text(b.apply("sin", product), product) == ["const double v1 = a * b;", "y0 = sin(v1);", "y1 = v1;"]


@pytest.mark.parametrize("prefix", ["", "a_long_name_of_an_input_"], ids=["short names", "long names"])
def test_generated_lines_have_at_most_7_operations_and_100_characters(prefix):
    b = Builder()
    inputs, _ = named(b, 8)
    value = inputs[0]
    for k in range(60):
        value = b.apply("sin", b.apply("add", b.apply("mul", value, inputs[k % 8]), inputs[(k + 3) % 8]))
    lines = statements(b.program, [("y", value)], lambda k, e: prefix + b.program.inputs[k].name).lines
    operations = [len(re.findall(r" [+*] |sin\(", line)) for line in lines]
    assert sum(operations) == 180
    assert max(operations) <= 7 and max(map(len, lines)) <= 100


@pytest.mark.parametrize("counted", [True, False], ids=["for", "while"])
def test_value_that_is_constant_in_a_loop_is_computed_before_it(counted):
    b = Builder()
    (x, y), text = named(b, 2)
    zero, step, n = (b.constant(k, "i32") for k in (0, 1, 7))
    # Made inside, and used once there: nothing but its operands tells that it is constant.
    left = b.loop(
        [zero, x],
        lambda c: b.apply("lt", c[0], n),
        lambda c: [b.apply("add", c[0], step), b.apply("add", c[1], b.apply("sin", y))],
        iterations=n if counted else None,
    )
    lines = text(left[1])
    (computed,) = (k for k, line in enumerate(lines) if "sin(" in line)
    (loop,) = (k for k, line in enumerate(lines) if line.startswith(("for (", "while (")))
    assert lines[loop].startswith("for (" if counted else "while (") and computed < loop


def test_value_that_only_one_side_of_a_branch_needs_is_computed_there():
    b = Builder()
    (x, y), text = named(b, 2)
    sine, cosine = b.apply("sin", x), b.apply("cos", y)
    squares = lambda value: [b.apply("mul", value, value), b.apply("neg", value)]  # noqa: E731
    left = b.branch(b.apply("lt", x, y), lambda: squares(sine), lambda: squares(cosine))
    lines = text(*left)
    order = [k for part in ("if (", "sin(", "} else {", "cos(") for k, line in enumerate(lines) if part in line]
    assert len(order) == 4 and order == sorted(order)


def test_a_short_branch_is_a_conditional_expression():
    b = Builder()
    (x, y), text = named(b, 2)
    left = b.branch(b.apply("lt", x, y), lambda: [b.apply("exp", x)], lambda: [b.apply("sin", y)])
    assert text(*left) == ["y0 = a < b ? exp(a) : sin(b);"]
