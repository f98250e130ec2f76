"""C from programs reads as a person would write it."""

import math
import re

import numpy as np
import pytest

from slidax.codegen.builder import Builder
from slidax.codegen.c import Dialect, statements
from slidax.codegen.c.expressions import shortest


def lines_of(builder, *outputs, **options):
    """The statements that write values to y[0], y[1], ..."""
    program = builder.program
    assigned = [(f"y[{k}]", value) for k, value in enumerate(outputs)]
    return statements(program, assigned, lambda k, e: f"x[{e}]", **options).lines


def floats(builder, count):
    return [builder.input(f"{'abcdefgh'[k]}", "f64", ())[()] for k in range(count)]


def named(builder, count):
    """Builder inputs that are read by their names."""
    inputs = floats(builder, count)

    def text(*outputs, **options):
        assigned = [(f"y{k}", value) for k, value in enumerate(outputs)]
        read = lambda k, e: builder.program.inputs[k].name  # noqa: E731
        return [line.strip() for line in statements(builder.program, assigned, read, **options).lines if line]

    return inputs, text


def test_an_output_may_lie_where_an_input_was():
    b = Builder()
    x = b.input("x", "f64", (2,))
    read = lambda k, element: f"state->x[{element}]"  # noqa: E731
    swapped = statements(b.program, [("state->x[0]", x[1]), ("state->x[1]", b.apply("neg", x[0]))], read).lines
    assert [line.strip() for line in swapped] == [
        "const double x_2 = state->x[1];",
        "state->x[1] = -state->x[0];",
        "state->x[0] = x_2;",
    ]
    chained = statements(b.program, [("state->x[0]", x[1]), ("state->x[1]", b.constant(0.0, "f64"))], read).lines
    assert [line.strip() for line in chained] == ["state->x[0] = state->x[1];", "state->x[1] = 0.0;"]


def test_what_stays_where_it_is_is_not_assigned():
    b = Builder()
    x = b.input("x", "f64", ())[()]
    read = lambda k, element: "state->x"  # noqa: E731
    lines = statements(b.program, [("state->x", x), ("y", b.apply("mul", x, x))], read).lines
    assert [line.strip() for line in lines] == ["const double x = state->x;", "", "y = x * x;"]


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
    for expected, value in cases.items():
        written = text(value)
        swapped = expected.replace("x", "a").replace("y", "b").replace("z", "c")
        assert written[-1] == f"y0 = {swapped};", expected


def test_conditions_need_few_parentheses_too():
    b = Builder()
    (x, y, z), text = named(b, 3)
    first, second, third = b.apply("lt", x, y), b.apply("ge", y, z), b.apply("isfinite", z)
    both = b.apply("and", first, second)
    assert text(b.apply("or", both, third))[-1] == "y0 = isfinite(c) || (a < b && b >= c);"
    assert text(b.apply("and", b.apply("or", first, second), third))[-1] == "y0 = isfinite(c) && (a < b || b >= c);"
    assert text(b.apply("not", first))[-1] == "y0 = !(a < b);"
    assert text(b.apply("ne", x, x))[-1] == "y0 = isnan(a);"


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.5, "0.5"), (1.0, "1.0"), (0.001, "1e-3"), (-2.5, "-2.5"), (1e6, "1e6"), (0.0, "0.0"), (100.0, "100.0")],
)
def test_numbers_are_as_short_as_they_can_be(number, text):
    assert Dialect().number(number, "f64") == text
    assert Dialect("float").number(number, "f64") == text + "f"


def test_every_number_reads_back_to_the_same_bits():
    random = np.random.default_rng(3)
    for number in random.integers(0, 2**64, 4000, np.uint64).view(np.float64):
        if math.isfinite(number):
            assert float(shortest(repr(float(number)))) == number
    for number in random.integers(0, 2**32, 4000, np.uint32).view(np.float32):
        if np.isfinite(number):
            assert np.float32(Dialect().number(float(number), "f32").rstrip("f")) == number


def test_a_limit_beyond_floats_stays_a_finite_limit():
    single = Dialect("float")
    assert single.number(1.7e308, "f64") == "3.4028235e38f"
    assert single.number(-1e-300, "f64") == "-1.1754944e-38f"
    assert single.number(math.inf, "f64") == "INFINITY"


def test_what_is_used_once_is_written_where_it_is_used():
    b = Builder()
    (x, y), text = named(b, 2)
    product = b.apply("mul", x, y)
    assert text(b.apply("sin", product)) == ["y0 = sin(a * b);"]
    assert text(b.apply("sin", product), product) == ["const double v1 = a * b;", "y0 = sin(v1);", "y1 = v1;"]


def test_no_line_is_too_long_to_read():
    b = Builder()
    inputs, text = named(b, 8)
    value = inputs[0]
    for k in range(60):
        value = b.apply("sin", b.apply("add", b.apply("mul", value, inputs[k % 8]), inputs[(k + 3) % 8]))
    assert max(map(len, text(value))) <= 100
    assert all(len(re.findall(r"[-+*/(]", line)) < 20 for line in text(value))


def test_a_counted_loop_is_a_for():
    b = Builder()
    x = b.input("x", "f64", (2,))
    zero, one, n = (b.constant(k, "i32") for k in (0, 1, 7))
    left = b.loop(
        [zero, x[0]],
        lambda c: b.apply("lt", c[0], n),
        lambda c: [b.apply("add", c[0], one), b.apply("mul", c[1], x[1])],
        turns=n,
    )
    assert lines_of(b, left[1]) == [
        "    double v1 = x[0];",
        "    for (int32_t i = 0; i < 7; ++i) {",
        "        v1 = x[1] * v1;",
        "    }",
        "",
        "    y[0] = v1;",
    ]


def test_a_loop_updates_what_it_carries_all_at_once():
    b = Builder()
    x = b.input("x", "f64", (2,))
    left = b.loop(
        list(x), lambda c: b.apply("lt", c[0], b.constant(9.0, "f64")), lambda c: [c[1], b.apply("add", c[0], c[1])]
    )
    assert [line.strip() for line in lines_of(b, *left)] == [
        "double v1 = x[0];",
        "double v2 = x[1];",
        "while (v1 < 9.0) {",
        "const double v3 = v2;",
        "v2 = v1 + v2;",
        "v1 = v3;",
        "}",
        "",
        "y[0] = v1;",
        "y[1] = v2;",
    ]


def test_what_only_one_side_of_a_branch_needs_is_computed_there():
    b = Builder()
    (x, y), text = named(b, 2)
    sine = b.apply("sin", x)
    dear = b.apply("mul", sine, sine)
    long = lambda: [b.apply("exp", b.apply("mul", dear, dear)), b.apply("neg", dear)]  # noqa: E731
    left = b.branch(b.apply("lt", x, y), long, lambda: [x, y])
    assert text(*left) == [
        "double v1 = a;",
        "double v2 = b;",
        "if (a < b) {",
        "const double v3 = sin(a);",
        "const double v4 = v3 * v3;",
        "v1 = exp(v4 * v4);",
        "v2 = -v4;",
        "}",
        "y0 = v1;",
        "y1 = v2;",
    ]


def test_a_short_branch_is_a_choice():
    b = Builder()
    (x, y), text = named(b, 2)
    left = b.branch(b.apply("lt", x, y), lambda: [b.apply("exp", x)], lambda: [b.apply("sin", y)])
    assert text(*left) == ["y0 = a < b ? exp(a) : sin(b);"]


def test_what_does_not_change_in_a_loop_stays_outside():
    b = Builder()
    x = b.input("x", "f64", (2,))
    zero, one, n = (b.constant(k, "i32") for k in (0, 1, 7))
    fixed = b.apply("exp", x[1])
    left = b.loop(
        [zero, x[0]],
        lambda c: b.apply("lt", c[0], n),
        lambda c: [b.apply("add", c[0], one), b.apply("add", c[1], fixed)],
        turns=n,
    )
    lines = [line.strip() for line in lines_of(b, left[1])]
    assert lines.index("const double v1 = exp(x[1]);") < lines.index("for (int32_t i = 0; i < 7; ++i) {")


def test_a_loop_whose_condition_takes_statements_asks_in_its_midst():
    b = Builder()
    x = b.input("x", "f64", (2,))
    left = b.loop(
        [x[0]],
        lambda c: b.apply("lt", b.apply("sin", c[0]), x[1]),
        lambda c: [b.apply("mul", c[0], b.apply("sin", c[0]))],
    )
    assert [line.strip() for line in lines_of(b, *left)] == [
        "double v1 = x[0];",
        "for (;;) {",
        "const double v2 = sin(v1);",
        "if (!(v2 < x[1])) {",
        "break;",
        "}",
        "v1 = v1 * v2;",
        "}",
        "",
        "y[0] = v1;",
    ]


def test_small_functions_are_printed_only_where_they_are_called():
    b = Builder()
    (x, y), _ = named(b, 2)
    sum_of_both = statements(b.program, [("y", b.apply("add", x, y))], lambda k, e: f"x{k}")
    largest = statements(b.program, [("y", b.apply("max", x, y))], lambda k, e: f"x{k}")
    assert sum_of_both.helpers.names == []
    assert largest.helpers.names == ["larger"]
